"""Local matrices of classes of congruent cells, and of the tables of affine cells."""

import numpy as np
import pytest
import skfem
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import Basis, BilinearForm, ElementVector, MeshHex, MeshQuad, MeshTet, MeshTri, asm
from skfem.models.poisson import laplace

import skfem_adini
from skfem_adini import AffineCells, CongruentCells, ElementHexAdini, ElementQuadAdini, InputError
from skfem_adini.assembly import affine_cells
from skfem_adini.assembly import congruence_classes as module
from skfem_adini.assembly.congruent_cells import scatter_on

TICKS = np.array([0.0, 0.3, 0.5, 0.9, 1.0])
GRID, BRICKS = MeshQuad.init_tensor(TICKS, TICKS), MeshHex.init_tensor(*[TICKS[:4]] * 3)
CASES = {
    "Adini": (GRID, ElementVector(ElementQuadAdini())),
    "HexAdini": (BRICKS, ElementHexAdini()),
    "Quad2": (GRID, ElementVector(skfem.ElementQuad2())),
    "Hex1": (BRICKS, ElementVector(skfem.ElementHex1())),
    "TriP2": (MeshTri().refined(3), skfem.ElementTriP2()),
    "TetP2": (MeshTet().refined(1), ElementVector(skfem.ElementTetP2())),
}


def random_matrices(case, zeros):
    basis, rng = Basis(*CASES[case], intorder=2), np.random.default_rng(0)
    classes = CongruentCells.of(basis)
    local = rng.uniform(-1, 1, (len(classes.cells), basis.Nbfun, basis.Nbfun))
    if zeros:
        local[rng.uniform(size=local.shape) < 0.6] = 0.0
    return basis, classes, local


@pytest.mark.parametrize("zeros", [False, True])
@pytest.mark.parametrize("case", CASES)
def test_matrices_of_classes_are_summed_over_all_cells(case, zeros):
    """Against a dense sum; whole arrays give the bits of the kernel."""
    basis, classes, local = random_matrices(case, zeros)
    expected = np.zeros((basis.N, basis.N))
    for cell, label in enumerate(classes.labels):
        dofs = basis.element_dofs[:, cell]
        np.add.at(expected, np.ix_(dofs, dofs), local[label])
    kernel = classes.matrix(local)
    np.testing.assert_allclose(kernel.toarray(), expected, atol=1e-13)
    arrays = scatter_on(np, local, classes.labels, classes._blocks, classes._blocks)
    for name in ("indptr", "indices", "data"):
        ours, theirs = getattr(arrays, name), getattr(kernel, name)
        assert ours.dtype == theirs.dtype
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.gpu
@pytest.mark.parametrize("case", CASES)
def test_a_device_gives_the_bits_of_the_host(case):
    cupy = pytest.importorskip("cupy")
    _, classes, local = random_matrices(case, True)
    host, there = classes.matrix(local), classes.matrix(local, cupy)
    for name in ("indptr", "indices", "data"):
        np.testing.assert_array_equal(getattr(there, name).get(), getattr(host, name))


def test_fields_divide_classes():
    basis = Basis(MeshQuad.init_tensor(*[np.linspace(0, 1, 5)] * 2), skfem.ElementQuad2())
    k = np.where(np.arange(16) < 5, 1.0, 10.0)
    classes = CongruentCells.of(basis, k, np.array(3.0))
    assert len(CongruentCells.of(basis).cells) == 1
    np.testing.assert_array_equal(classes.cells, [0, 5])
    np.testing.assert_array_equal(k[classes.cells][classes.labels], k)


def test_part_is_a_basis_of_the_chosen_cells():
    basis = Basis(BRICKS, ElementVector(skfem.ElementHex1()))
    classes = CongruentCells.of(basis)
    form = BilinearForm(lambda u, v, w: u.grad[0, 1] * v.grad[1, 2] + u[2] * v[0])
    expected = form.assemble(basis)
    local = form.elemental(classes.part).tolocal().swapaxes(1, 2)  # scikit-fem: trial first
    assert abs(classes.matrix(local) - expected).max() < 1e-14


# Cells that differ by the rounding of their coordinates are one class; others are not.


@pytest.mark.parametrize("n", [3, 7, 10, 12])
def test_bricks_of_any_width_are_one_class(n):
    mesh = MeshHex.init_tensor(*[np.linspace(0, 1, n + 1)] * 3)
    basis = Basis(mesh, skfem.ElementHex1())
    assert len(CongruentCells.of(basis).cells) == 1
    expected = asm(laplace, basis)
    found = skfem_adini.assemble(laplace, mesh, skfem.ElementHex1(), fallback=False)
    # 8 eps of the largest coordinate, in widths of a cell.
    assert np.abs(found - expected).max() <= 8 * np.finfo(float).eps * n * expected.max()


def test_cells_that_are_much_smaller_than_their_coordinates_stay_apart():
    for sign in (1.0, -1.0):
        graded = np.sort(sign * np.append(0, np.geomspace(1e-10, 1, 40)))
        mesh = MeshQuad.init_tensor(graded + 1.0, np.linspace(0, 1, 3))
        assert len(CongruentCells.of(Basis(mesh, skfem.ElementQuad1())).cells) >= 40


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31), st.integers(2, 32), st.sampled_from([0, 1]))
def test_few_cells_are_compared_as_many_are(seed, cells, noise):
    """By pairs, and by sorted differences."""
    rng = np.random.default_rng(seed)
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    corners = 10 + rng.integers(0, 3, (cells, 2)) + unit[:, None] * rng.integers(1, 3, (cells, 2))
    corners = corners * (1 + noise * np.finfo(float).eps * rng.integers(-1, 2, corners.shape))
    points = np.ascontiguousarray(corners.reshape(-1, 2).T)
    nodes = np.arange(4 * cells).reshape(4, cells)
    words = rng.integers(0, 2, (cells, 1)).astype(np.uint64)
    few = module.congruence_classes(points, nodes, words)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "LIMITS", module.LIMITS._replace(few=0))
        many = module.congruence_classes(points, nodes, words)
    np.testing.assert_array_equal(few.labels, many.labels)
    np.testing.assert_array_equal(few.representatives, many.representatives)


# Matrices from one table of the reference cell: those of scikit-fem, symmetric to the last bit.


def uneven(mesh, seed=0):
    """No two cells are congruent, and vertices come in any order."""
    rng = np.random.default_rng(seed)
    x = mesh.p + 0.02 * rng.standard_normal(mesh.p.shape)
    order = rng.permutation(mesh.p.shape[1])
    return type(mesh)(x[:, np.argsort(order)], order[mesh.t])


TRIANGLES, TETRAHEDRA = uneven(MeshTri().refined(3)), uneven(MeshTet().refined(2))
AFFINE = {
    "TriP1": (TRIANGLES, skfem.ElementTriP1()),
    "vector TriP2": (TRIANGLES, ElementVector(skfem.ElementTriP2())),
    "vector TriP4": (TRIANGLES, ElementVector(skfem.ElementTriP4())),
    "five TriP1": (TRIANGLES, ElementVector(skfem.ElementTriP1(), 5)),
    "vector TetP1": (TETRAHEDRA, ElementVector(skfem.ElementTetP1())),
    "vector TetP2": (TETRAHEDRA, ElementVector(skfem.ElementTetP2())),
    "TetP2": (TETRAHEDRA, skfem.ElementTetP2()),
}


def random_tensor(k, dim, cells):
    """C_cadb of each cell with C_cadb = C_dbca, without any other symmetry."""
    C = np.random.default_rng(1).uniform(-1, 1, (k, dim, k, dim, cells))
    return C + C.transpose(2, 3, 0, 1, 4)


@pytest.mark.parametrize("case", AFFINE)
def test_the_matrix_is_that_of_scikit_fem(case):
    basis = Basis(*AFFINE[case])
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
    basis = Basis(*AFFINE["vector TetP2"])
    C = random_tensor(3, 3, 1)
    one = AffineCells.of(basis).matrix(C[..., 0])
    each = AffineCells.of(basis).matrix(np.repeat(C, basis.nelems, axis=-1))
    assert abs(one - each).max() <= 1e-14 * abs(each).max()


def test_threads_do_not_change_bits_of_affine_cells(monkeypatch):
    cells = AffineCells.of(Basis(*AFFINE["vector TetP2"]))
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
        Basis(MeshQuad().refined(1), skfem.ElementQuad1()),
        Basis(skfem.MeshTri2.init_circle(2), skfem.ElementTriP2()),
        Basis(TRIANGLES, skfem.ElementTriMorley()),
        Basis(TRIANGLES, skfem.ElementTriP1(), elements=[0, 1]),
    ],
    ids=["quadrilaterals", "curved", "global", "part"],
)
def test_other_gradients_have_no_table(basis):
    assert AffineCells.of(basis) is None
    if isinstance(basis.elem, skfem.ElementTriMorley):  # its functions depend on the place
        assert CongruentCells.of(basis) is None


def test_other_shapes_and_tensors_of_another_kind_or_symmetry_are_refused():
    cells = AffineCells.of(Basis(*AFFINE["vector TriP2"]))
    one_sided = np.zeros((2, 2, 2, 2))
    one_sided[0, 0, 1, 1] = 1.0
    for tensor in (one_sided * np.nan, one_sided + np.inf, one_sided * 1j, one_sided, "x"):
        with pytest.raises(InputError, match="tensor: expected"):
            cells.matrix(tensor)
    with pytest.raises(InputError, match=r"tensor: expected shape \(2, 2, 2, 2\) or .*got \(2, 2"):
        cells.matrix(np.zeros((2, 2)))
    classes = CongruentCells.of(Basis(GRID, skfem.ElementQuad2()))
    with pytest.raises(InputError, match=r"local: expected shape \(\d+, 9, 9\), got \(1, 9, 9\)"):
        classes.matrix(np.zeros((1, 9, 9)))
