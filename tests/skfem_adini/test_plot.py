"""Pictures show the numbers they are given, on the axes they are given."""

import sys

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy import sparse
from skfem import Basis, ElementQuad1, ElementQuad2, ElementTriP1, ElementVector, MeshQuad
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace

from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS, InputError
from skfem_adini.errors import MissingDependency
from skfem_adini.plot import plot_matrix, plot_shape_function


@pytest.fixture(autouse=True)
def _no_open_figures():
    plt.close("all")  # other tests of this process may have left some
    yield
    plt.close("all")


SQUARE = MeshQuad().refined(2)
BASIS = Basis(MeshQuad(SQUARE.p * [[2.0], [1.0]], SQUARE.t), ElementQuadAdini())
LAPLACE = laplace.assemble(BASIS)


@pytest.mark.parametrize("element", [ElementQuadAdini(), ElementQuadBFS(), ElementQuad1()])
def test_surface_and_its_vertex(element):
    for i in range(len(element.doflocs)):
        ax = plot_shape_function(element, i)
        (line,) = ax.lines
        x, y, height = (float(part[0]) for part in line.get_data_3d())
        assert (x, y) == tuple(element.doflocs[i])
        assert height == pytest.approx(float(i % element.nodal_dofs == 0))
        value = element.lbasis(np.random.default_rng(i).uniform(0, 1, (2, 400)), i)[0]
        low, high = ax.zz_dataLim.intervalx
        assert low <= value.min() + 1e-3
        assert high >= value.max() - 1e-3
        plt.close(ax.figure)


def test_given_axes_are_used():
    figure, axes = plt.subplots(1, 2, subplot_kw={"projection": "3d"})
    assert plot_shape_function(ElementQuadAdini(), 4, axes[1]) is axes[1]
    assert axes[1].get_title() == "$u_{x}$ at (1, 0)"
    assert not axes[0].lines
    assert plt.get_fignums() == [figure.number]
    _, ax = plt.subplots()
    assert plot_matrix(LAPLACE, BASIS, ax) is ax


def test_matrix_is_grouped_by_kind_and_scaled():
    ax = plot_matrix(LAPLACE, BASIS)
    size = 10 ** np.ma.filled(ax.images[0].get_array(), np.nan)
    n = BASIS.mesh.nvertices
    blocks = size.reshape(3, n, 3, n).swapaxes(1, 2)
    assert np.isnan(blocks[1, 2]).all()  # u_x and u_y do not couple in the Laplacian
    np.testing.assert_allclose(np.diagonal(size), 1)
    # Vertices along y first: each couples with itself and its eight neighbours.
    place = np.lexsort(BASIS.mesh.p[::-1])
    x, y = np.rint(BASIS.mesh.p[:, place] * [[2], [4]])
    near = (np.abs(x[:, None] - x) <= 1) & (np.abs(y[:, None] - y) <= 1)
    np.testing.assert_array_equal(np.isfinite(blocks[0, 0]), near)
    u = BASIS.nodal_dofs[0, place]
    A = LAPLACE.toarray()[np.ix_(u, u)]
    expected = np.abs(A) / np.sqrt(np.outer(A.diagonal(), A.diagonal()))
    np.testing.assert_allclose(blocks[0, 0][near], expected[near], rtol=1e-12)
    assert [label.get_text() for label in ax.get_xticklabels()] == ["$u$", "$u_{x}$", "$u_{y}$"]


def test_matrix_of_a_vector_field():
    basis = BASIS.with_element(ElementVector(ElementQuadAdini()))
    ax = plot_matrix(linear_elasticity(1.0, 1.0).assemble(basis), basis)
    assert len(ax.get_xticklabels()) == 6


LARGE = Basis(MeshQuad().refined(5), ElementQuadAdini())
QUADRATIC = BASIS.with_element(ElementQuad2())
CASES = {
    "element of triangles": (lambda: plot_shape_function(ElementTriP1(), 0), "quadrilaterals"),
    "element of bricks": (lambda: plot_shape_function(ElementHexAdini(), 0), "quadrilaterals"),
    "flat axes": (lambda: plot_shape_function(ElementQuadAdini(), 0, plt.gca()), "projection"),
    "wrong shape": (lambda: plot_matrix(LAPLACE[1:], BASIS), "A: expected shape"),
    "too many": (lambda: plot_matrix(sparse.eye_array(LARGE.N), LARGE), "coarser mesh"),
    "dofs on edges": (lambda: plot_matrix(sparse.eye_array(QUADRATIC.N), QUADRATIC), "elsewhere"),
    "zero diagonal": (lambda: plot_matrix(0 * LAPLACE, BASIS), "not positive"),
}


@pytest.mark.parametrize("case", CASES)
def test_error(case):
    attempt, message = CASES[case]
    with pytest.raises(InputError, match=message):
        attempt()


def test_no_such_function():
    with pytest.raises(ValueError, match="Index larger"):
        plot_shape_function(ElementQuadAdini(), 12)


def test_without_matplotlib_the_install_line_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(MissingDependency, match="pip install"):
        plot_matrix(LAPLACE, BASIS)
