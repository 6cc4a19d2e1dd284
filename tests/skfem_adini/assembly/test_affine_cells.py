"""Matrices from one table of the reference cell: those of scikit-fem, symmetric to the last bit."""

import numpy as np
import pytest
from skfem import (
    Basis,
    BilinearForm,
    ElementQuad1,
    ElementTetP1,
    ElementTetP2,
    ElementTriMorley,
    ElementTriP1,
    ElementTriP2,
    ElementTriP4,
    ElementVector,
    MeshQuad,
    MeshTet,
    MeshTri,
    MeshTri2,
)

from skfem_adini import AffineCells, InputError
from skfem_adini.assembly import affine_cells


def uneven(mesh, seed=0):
    """No two cells are congruent, and vertices come in any order."""
    rng = np.random.default_rng(seed)
    x = mesh.p + 0.02 * rng.standard_normal(mesh.p.shape)
    order = rng.permutation(mesh.p.shape[1])
    return type(mesh)(x[:, np.argsort(order)], order[mesh.t])


TRIANGLES, TETRAHEDRA = uneven(MeshTri().refined(3)), uneven(MeshTet().refined(2))
CASES = {
    "TriP1": (TRIANGLES, ElementTriP1()),
    "vector TriP2": (TRIANGLES, ElementVector(ElementTriP2())),
    "vector TriP4": (TRIANGLES, ElementVector(ElementTriP4())),
    "five TriP1": (TRIANGLES, ElementVector(ElementTriP1(), 5)),
    "vector TetP1": (TETRAHEDRA, ElementVector(ElementTetP1())),
    "vector TetP2": (TETRAHEDRA, ElementVector(ElementTetP2())),
    "TetP2": (TETRAHEDRA, ElementTetP2()),
}


def random_tensor(k, dim, cells):
    """C_cadb of each cell with C_cadb = C_dbca, without any other symmetry."""
    C = np.random.default_rng(1).uniform(-1, 1, (k, dim, k, dim, cells))
    return C + C.transpose(2, 3, 0, 1, 4)


@pytest.mark.parametrize("case", CASES)
def test_the_matrix_is_that_of_scikit_fem(case):
    basis = Basis(*CASES[case])
    k = basis.elem.dim if isinstance(basis.elem, ElementVector) else 1
    dim = basis.mesh.dim()
    C = random_tensor(k, dim, basis.nelems)

    @BilinearForm
    def form(u, v, w):
        du, dv = (np.reshape(f.grad, (k, dim, *f.grad.shape[-2:])) for f in (u, v))
        return np.einsum("cadbt,catq,dbtq->tq", C, dv, du)

    expected = form.assemble(basis)
    K = AffineCells.of(basis).matrix(C)
    assert abs(K - expected).max() <= 1e-13 * abs(expected).max()
    assert abs(K - K.T).max() == 0.0
    again = K.copy()
    again.has_sorted_indices = False
    again.sort_indices()
    np.testing.assert_array_equal(again.indices, K.indices)


def test_a_tensor_for_all_cells():
    basis = Basis(*CASES["vector TetP2"])
    C = random_tensor(3, 3, 1)
    one = AffineCells.of(basis).matrix(C[..., 0])
    each = AffineCells.of(basis).matrix(np.repeat(C, basis.nelems, axis=-1))
    assert abs(one - each).max() <= 1e-14 * abs(each).max()


def test_threads_do_not_change_bits(monkeypatch):
    cells = AffineCells.of(Basis(*CASES["vector TetP2"]))
    C = random_tensor(3, 3, len(cells.size))
    one = cells.matrix(C)
    ranges = lambda first, columns: [(0, 7), (7, 8), (8, len(first) - 1)]  # noqa: E731
    monkeypatch.setattr(affine_cells, "shares_of", ranges)
    several = cells.matrix(C)
    for name in ("indptr", "indices", "data"):
        np.testing.assert_array_equal(getattr(one, name), getattr(several, name))


@pytest.mark.parametrize(
    "basis",
    [
        Basis(MeshQuad().refined(1), ElementQuad1()),
        Basis(MeshTri2.init_circle(2), ElementTriP2()),
        Basis(TRIANGLES, ElementTriMorley()),
        Basis(TRIANGLES, ElementTriP1(), elements=[0, 1]),
    ],
    ids=["quadrilaterals", "curved", "global", "part"],
)
def test_other_gradients_have_no_table(basis):
    assert AffineCells.of(basis) is None


def test_another_shape_is_refused():
    cells = AffineCells.of(Basis(*CASES["vector TriP2"]))
    with pytest.raises(InputError, match=r"tensor: expected shape \(2, 2, 2, 2\) or .*got \(2, 2"):
        cells.matrix(np.zeros((2, 2)))


NONE = np.zeros((2, 2, 2, 2))
ONE_SIDED = NONE.copy()
ONE_SIDED[0, 0, 1, 1] = 1.0


@pytest.mark.parametrize(
    "tensor", [NONE + np.nan, NONE + np.inf, NONE + 1j, ONE_SIDED, "x"], ids=lambda t: str(t)[-9:]
)
def test_tensors_of_another_kind_or_symmetry_are_refused(tensor):
    cells = AffineCells.of(Basis(*CASES["vector TriP2"]))
    with pytest.raises(InputError, match="tensor: expected"):
        cells.matrix(tensor)
