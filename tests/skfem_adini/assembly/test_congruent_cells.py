"""Local matrices of classes of cells: against a dense sum over all cells; equal bits on arrays."""

import numpy as np
import pytest
from skfem import (
    Basis,
    BilinearForm,
    ElementHex1,
    ElementQuad2,
    ElementTetP2,
    ElementTriMorley,
    ElementTriP2,
    ElementVector,
    MeshHex,
    MeshQuad,
    MeshTet,
    MeshTri,
)

from skfem_adini import CongruentCells, ElementHexAdini, ElementQuadAdini, InputError
from skfem_adini.assembly.congruent_cells import scatter_on

TICKS = np.array([0.0, 0.3, 0.5, 0.9, 1.0])
GRID, BRICKS = MeshQuad.init_tensor(TICKS, TICKS), MeshHex.init_tensor(*[TICKS[:4]] * 3)
CASES = {
    "Adini": (GRID, ElementVector(ElementQuadAdini())),
    "HexAdini": (BRICKS, ElementHexAdini()),
    "Quad2": (GRID, ElementVector(ElementQuad2())),
    "Hex1": (BRICKS, ElementVector(ElementHex1())),
    "TriP2": (MeshTri().refined(3), ElementTriP2()),
    "TetP2": (MeshTet().refined(1), ElementVector(ElementTetP2())),
}


def random_matrices(basis, classes, zeros):
    rng = np.random.default_rng(0)
    local = rng.uniform(-1, 1, (len(classes.cells), basis.Nbfun, basis.Nbfun))
    if zeros:
        local[rng.uniform(size=local.shape) < 0.6] = 0.0
    return local


@pytest.mark.parametrize("zeros", [False, True])
@pytest.mark.parametrize("case", CASES)
def test_matrices_of_classes_are_summed_over_all_cells(case, zeros):
    basis = Basis(*CASES[case], intorder=2)
    classes = CongruentCells.of(basis)
    local = random_matrices(basis, classes, zeros)
    expected = np.zeros((basis.N, basis.N))
    for cell, label in enumerate(classes.labels):
        dofs = basis.element_dofs[:, cell]
        np.add.at(expected, np.ix_(dofs, dofs), local[label])
    result = classes.matrix(local)
    np.testing.assert_allclose(result.toarray(), expected, atol=1e-13)


@pytest.mark.parametrize("zeros", [False, True])
@pytest.mark.parametrize("case", CASES)
def test_whole_arrays_give_the_bits_of_the_kernel(case, zeros):
    basis = Basis(*CASES[case], intorder=2)
    classes = CongruentCells.of(basis)
    local = random_matrices(basis, classes, zeros)
    kernel = classes.matrix(local)
    arrays = scatter_on(np, local, classes.labels, classes._blocks, classes._blocks)
    for name in ("indptr", "indices", "data"):
        ours, theirs = getattr(arrays, name), getattr(kernel, name)
        assert ours.dtype == theirs.dtype
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.gpu
@pytest.mark.parametrize("case", CASES)
def test_a_device_gives_the_bits_of_the_host(case):
    cupy = pytest.importorskip("cupy")
    basis = Basis(*CASES[case], intorder=2)
    classes = CongruentCells.of(basis)
    local = random_matrices(basis, classes, True)
    host, there = classes.matrix(local), classes.matrix(local, cupy)
    for name in ("indptr", "indices", "data"):
        np.testing.assert_array_equal(getattr(there, name).get(), getattr(host, name))


def test_fields_divide_classes():
    basis = Basis(MeshQuad.init_tensor(*[np.linspace(0, 1, 5)] * 2), ElementQuad2())
    k = np.where(np.arange(16) < 5, 1.0, 10.0)
    classes = CongruentCells.of(basis, k, np.array(3.0))
    assert len(CongruentCells.of(basis).cells) == 1
    np.testing.assert_array_equal(classes.cells, [0, 5])
    np.testing.assert_array_equal(k[classes.cells][classes.labels], k)


def test_part_is_a_basis_of_the_chosen_cells():
    basis = Basis(BRICKS, ElementVector(ElementHex1()))
    classes = CongruentCells.of(basis)
    form = BilinearForm(lambda u, v, w: u.grad[0, 1] * v.grad[1, 2] + u[2] * v[0])
    expected = form.assemble(basis)
    local = form.elemental(classes.part).tolocal().swapaxes(1, 2)  # scikit-fem: trial first
    assert abs(classes.matrix(local) - expected).max() < 1e-14


def test_functions_that_depend_on_the_place_have_no_classes():
    assert CongruentCells.of(Basis(MeshTri().refined(2), ElementTriMorley())) is None


def test_another_shape_is_refused():
    classes = CongruentCells.of(Basis(GRID, ElementQuad2()))
    with pytest.raises(InputError, match=r"local: expected shape \(\d+, 9, 9\), got \(1, 9, 9\)"):
        classes.matrix(np.zeros((1, 9, 9)))
