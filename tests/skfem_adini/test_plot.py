"""Pictures show the numbers they are given, on the axes they are given."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from skfem import Basis, ElementQuad1, ElementVector, MeshQuad
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace

from skfem_adini import AdiniExtension, CutDomain, ElementQuadAdini, ElementQuadBFS
from skfem_adini.plot import plot_cut_domain, plot_cut_field, plot_matrix, plot_shape_function
from tests.skfem_adini.cut_problems import LEVEL_SETS, unit_square


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


# Pictures of cut domains show every kind of cell.


@pytest.fixture
def domain():
    return CutDomain(unit_square(8), LEVEL_SETS["disk"], q=3)


def test_cells_of_cut_domains(domain):
    basis = Basis(domain.mesh, ElementQuadAdini(), intorder=1)
    extension = AdiniExtension(basis, domain)
    ax = plot_cut_domain(domain, extension)
    drawn = {c.get_label(): len(c.get_paths()) for c in ax.collections}
    assert drawn["full"] == domain.full.size
    assert drawn["cut"] + drawn["aggregated"] == domain.cut.size
    assert drawn["ghost facets"] == domain.ghost_facets.size
    assert "extension" in drawn
    plain = plot_cut_domain(domain, ax=plt.figure().add_subplot())
    assert {c.get_label() for c in plain.collections} == {"full", "cut", "ghost facets"}


def test_field_and_error_on_cut_domains(domain):
    element = ElementQuadAdini()
    x = Basis(domain.mesh, element).project(lambda x: x[0] ** 3)
    whole, parts = plot_cut_field(domain, element, x).collections
    assert 0 < parts.get_array().min() < parts.get_array().max() < 1
    assert whole.get_clim() == parts.get_clim()
    # The surfaces are x^3 at the corners of the full cells and between.
    assert 0 < whole.get_array().min() < whole.get_array().max() < 1
    assert whole.get_array().size == 36 * domain.full.size
    # Together they cover the disk and no more, but for tangents at its edge.
    corners = np.array([path.vertices[:3] for c in (whole, parts) for path in c.get_paths()])
    assert np.hypot(*(corners - 0.5).reshape(-1, 2).T).max() < 0.411 * (1 + 2e-3)
    sides = corners[:, 1:] - corners[:, :1]
    area = 0.5 * np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]).sum()
    assert abs(area / domain.area - 1) < 2e-3
    error = plot_cut_field(domain, element, x, exact=lambda x: x[0] ** 3).collections
    assert max(c.get_array().max() for c in error) < -10
