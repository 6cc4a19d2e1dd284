"""Contact rows take the place of unknowns, sparsely or not at all."""

import numpy as np
import pytest
import skfem
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from contact import ContactProblem, ElasticBody, InputError
from contact.condensation.primal import rows_as_unknowns


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10**6), st.integers(1, 60), st.integers(0, 30))
def test_the_rows_are_unknowns_and_the_rest_stays(seed: int, n: int, more: int) -> None:
    rng = np.random.default_rng(seed)
    nb = n + more
    # Rows of neighbouring unknowns, in any order, with one entry that stands out.
    B = sparse.lil_array((n, nb))
    order = rng.permutation(nb)[:n]
    for i in range(n):
        B[i, order[i]] = 2.0 + rng.random()
        B[i, order[max(i - 1, 0)]] += 0.3 * rng.standard_normal()
    B = sparse.csr_array(B)
    pivots, change, back = rows_as_unknowns(B)
    assert np.unique(pivots).size == n
    z = rng.standard_normal(nb)
    x = back @ z
    np.testing.assert_allclose(x[pivots], B @ z, rtol=0, atol=1e-13 * np.abs(z).max() * 10)
    rest = np.setdiff1d(np.arange(nb), pivots)
    np.testing.assert_array_equal(x[rest], z[rest])
    np.testing.assert_allclose(change @ x, z, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("mesh", "element", "boundary"),
    [
        (skfem.MeshTri().refined(4), skfem.ElementTriP2(), "bottom"),
        (skfem.MeshHex().refined(2), skfem.ElementHex2(), "front"),
    ],
)
def test_second_order_elements_stay_sparse(mesh: object, element: object, boundary: str) -> None:
    body = ElasticBody.from_mesh(mesh.with_defaults(), element, E=1.0, nu=0.3)  # type: ignore[attr-defined]
    rows = ContactProblem(body, boundary, 0.0, friction=0.1).rows
    B = sparse.csr_array(sparse.vstack((rows.G, rows.T), format="csr"))
    B = B[:, np.unique(B.indices)]
    change = rows_as_unknowns(B)[1]
    assert change.nnz <= 10 * change.shape[0]


def test_rows_that_depend_on_all_unknowns_are_refused() -> None:
    n = 400
    smooth = sparse.csr_array(
        sparse.diags_array(
            (np.full(n - 1, 1.0), np.full(n, 2.01), np.ones(n - 1)), offsets=(-1, 0, 1)
        )
    )
    with pytest.raises(InputError, match="each of its contact rows depends on all others"):
        rows_as_unknowns(smooth)


def test_dependent_rows_are_refused() -> None:
    row = sparse.csr_array(np.ones((3, 2)))
    with pytest.raises(InputError, match="linearly dependent"):
        rows_as_unknowns(row)
