"""Supports of multi-moment bodies: a bar in tension is exact, nothing is over-constrained."""

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import spsolve
from skfem import MeshHex, MeshQuad

from contact import ElasticBody
from contact.body.supports import few_times, norms, scaled_columns, selected
from skfem_adini import ElementHexAdini, ElementQuadAdini

E, NU, LOAD = 3.0, 0.3, 0.2
TICKS = np.array([0.0, 0.3, 0.7, 1.0])


def sides(mesh):
    names = {
        "xyz"[a]: mesh.facets_satisfying(lambda x, a=a: x[a] < 1e-9) for a in range(mesh.dim())
    }
    names["end"] = mesh.facets_satisfying(lambda x: x[0] > 1 - 1e-9)
    return mesh.with_boundaries(names)


@pytest.mark.parametrize(
    ("mesh", "element", "plane"),
    [
        (MeshQuad.init_tensor(TICKS, TICKS), ElementQuadAdini(), "stress"),
        (MeshHex.init_tensor(TICKS, TICKS, TICKS), ElementHexAdini(), None),
    ],
    ids=["ElementQuadAdini", "ElementHexAdini"],
)
def test_tension(mesh, element, plane) -> None:
    mesh = sides(mesh)
    body = ElasticBody.from_mesh(mesh, element, E=E, nu=NU, plane=plane)
    for axis in "xyz"[: mesh.dim()]:
        body.fix(axis, axis)
    body.load("end", np.eye(mesh.dim())[0] * LOAD)
    P, u0 = body.constraint
    u = P @ spsolve((P.T @ body.stiffness @ P).tocsc(), P.T @ body.f) + u0
    strain = LOAD / E * np.array([1.0, -NU, -NU][: mesh.dim()])
    values = u[body.basis.nodal_dofs[: mesh.dim()]]
    # Linear fields lie in the space: only round-off of the solve is left.
    np.testing.assert_allclose(values, strain[:, None] * mesh.p, atol=1e-13)


RNG = np.random.default_rng(8)


@pytest.mark.parametrize("rows", [0, 1, 7])
@pytest.mark.parametrize("density", [0.0, 0.02, 0.5])
def test_a_product_of_few_rows_is_that_of_the_whole_matrix(rows, density):
    few = sparse.csr_array(sparse.random_array((rows, 60), density=density, rng=RNG))
    P = sparse.csr_array(sparse.random_array((60, 45), density=0.05, rng=RNG))
    found = few_times(few, P)
    np.testing.assert_allclose(found.toarray(), few.toarray() @ P.toarray(), atol=1e-15)
    assert found.has_sorted_indices
    size = np.linalg.norm(few.toarray(), axis=1)
    np.testing.assert_allclose(norms(few), size, rtol=1e-14)
    by = RNG.uniform(1, 2, 60)
    np.testing.assert_allclose(scaled_columns(few, by).toarray(), few.toarray() * by, rtol=1e-15)


def test_unknowns_that_are_dofs_are_told_from_others():
    dofs = RNG.permutation(20)[:12]
    P = sparse.csr_array((np.ones(12), (dofs, np.arange(12))), shape=(20, 12))
    np.testing.assert_array_equal(selected(P), dofs)
    for data, rows, columns in (
        (np.full(2, 0.5**0.5), [3, 4], [0, 0]),  # two dofs that move together
        (np.array([-1.0]), [3], [0]),
    ):
        assert selected(sparse.csr_array((data, (rows, columns)), shape=(20, 1))) is None
