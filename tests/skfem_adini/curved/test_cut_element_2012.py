"""The 2012 element interpolates what it says, refuses straight cuts, and stalls."""

import numpy as np
import pytest
from example_scripts import load
from skfem import Basis, MeshQuad

from skfem_adini import ElementQuadAdiniCut, InputError, UnisolvenceWarning


def disk(x, r=0.411):
    return (x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2 - r**2


def test_quadratics_are_reproduced_everywhere(cut_problems):
    """P2 lies in every space, so nodal values of a quadratic give it back in all used cells."""
    mesh = cut_problems.unit_square(8)
    element = ElementQuadAdiniCut(mesh, disk)
    basis = Basis(mesh, element, intorder=4)

    def u(x):
        return 1 + x[0] - 2 * x[1] + x[0] ** 2 - 3 * x[0] * x[1] + 2 * x[1] ** 2

    x = basis.zeros()
    x[basis.nodal_dofs[0]] = u(mesh.p)
    x[basis.nodal_dofs[1]] = 1 + 2 * mesh.p[0] - 3 * mesh.p[1]
    x[basis.nodal_dofs[2]] = -2 - 3 * mesh.p[0] + 4 * mesh.p[1]
    cut = ~np.isnan(element.crossings[0])
    x[basis.facet_dofs[0, cut]] = u(element.crossings[:, cut])
    # The values at delta and eta follow from the others: least squares over the cells.
    values = np.asarray(basis.interpolate(x))
    exact = u(np.asarray(basis.global_coordinates()))
    inner = basis.dofs.interior_dofs
    for cell in np.flatnonzero(element.inside[mesh.t].any(axis=0)):
        functions = [np.asarray(basis.basis[16 + k][0])[cell] for k in range(2)]
        A = np.array(functions).T
        missing = exact[cell] - values[cell]
        found = np.linalg.lstsq(A, missing, rcond=None)[0] if A.any() else np.zeros(2)
        np.testing.assert_allclose(A @ found, missing, atol=1e-11)
        x[inner[:, cell]] = found
    assert cut.any()


def test_functions_vanish_at_the_points_of_the_curve(cut_problems):
    """A nodal function is zero at alpha and beta of the cells on both sides."""
    mesh = cut_problems.unit_square(8)
    element = ElementQuadAdiniCut(mesh, disk)
    mapping = mesh._mapping()
    for facet in np.flatnonzero(~np.isnan(element.crossings[0])):
        for cell in mesh.f2t[:, facet]:
            X = mapping.invF(element.crossings[:, facet][:, None, None], tind=np.array([cell]))
            local = 12 + np.flatnonzero(mesh.t2f[:, cell] == facet)[0]
            for i in range(18):
                (field,) = element.gbasis(mapping, X, i, tind=np.array([cell]))
                # As accurate as the inverse of the cell's matrix.
                error = 1e-15 * element.unisolvence[cell]
                assert abs(np.asarray(field).item() - (i == local)) < error


def test_gradient_is_that_of_the_values(cut_problems):
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 9), np.linspace(0, 1, 11))
    element, mapping, d = ElementQuadAdiniCut(mesh, disk), mesh._mapping(), 1e-6
    X = np.array([[0.3], [0.6]])
    for i in range(18):
        (here,) = element.gbasis(mapping, X, i)
        for k in range(2):
            ends = []
            for sign in (1, -1):
                moved = mapping.F(X).copy()
                moved[k] += sign * d
                cells = np.arange(mesh.t.shape[1])
                ends.append(
                    np.asarray(element.gbasis(mapping, mapping.invF(moved, cells), i, cells)[0])
                )
            difference = (ends[0] - ends[1]) / (2 * d)
            scale = 1 + np.abs(here.grad[k])
            np.testing.assert_allclose(difference / scale, here.grad[k] / scale, atol=1e-5)


@pytest.mark.parametrize("angle", [0.0, 0.1, 0.2])
def test_straight_cuts_are_refused(cut_problems, angle):
    """Two vertices inside and a line: x^2 times the line vanishes at all ten conditions."""
    c, s = np.cos(angle), np.sin(angle)
    with pytest.raises(InputError, match="its matrix is singular"):
        ElementQuadAdiniCut(
            cut_problems.unit_square(4), lambda x: c * (x[0] - 0.4) + s * (x[1] - 0.4)
        )


def tilted(curvature):
    """A curve through (0.4, 0.5) at 0.2 from the vertical."""
    c, s = np.cos(0.2), np.sin(0.2)

    def level_set(x):
        u, v = x[0] - 0.4, x[1] - 0.5
        return c * u + s * v + curvature * (u**2 + v**2) / 2

    return level_set


def test_nearly_straight_cuts_are_warned_of(cut_problems):
    with pytest.warns(UnisolvenceWarning, match="nearly singular"):
        ElementQuadAdiniCut(cut_problems.unit_square(1), tilted(1e-7))


def test_inverse_grows_like_one_over_curvature(cut_problems):
    curvature = np.array([1e-2, 1e-3, 1e-4])
    mesh = cut_problems.unit_square(1)
    inverse = [ElementQuadAdiniCut(mesh, tilted(k)).unisolvence[0] for k in curvature]
    assert np.polyfit(np.log(curvature), np.log(inverse), 1)[0] == pytest.approx(-1, abs=0.1)


def test_symmetric_cuts_are_refused(cut_problems):
    """An arc that is symmetric in the cell meets a conic through the vertices, however curved."""
    with pytest.raises(InputError, match="its matrix is singular"):
        ElementQuadAdiniCut(cut_problems.unit_square(5), disk)


def test_opposite_vertices_and_other_meshes_are_refused(cut_problems):
    mesh = cut_problems.unit_square(1)
    with pytest.raises(InputError, match="opposite vertices"):
        ElementQuadAdiniCut(mesh, lambda x: 0.1 - (x[0] - x[1]) ** 2)
    element = ElementQuadAdiniCut(cut_problems.unit_square(8), disk)
    with pytest.raises(InputError, match="the mesh it was made for"):
        Basis(cut_problems.unit_square(8), element)


@pytest.mark.turns(4)
def test_example_shows_order_one_beside_order_six(tmp_path, capsys):
    found = load("curved_2012").main(["--cells", "8", "16", "32", "--output", str(tmp_path)])
    errors = {name: np.abs(values) for name, values in found.items()}
    assert errors["exact"][-1] > 1e-4
    assert errors["chords"][-1] > 1e-4
    assert errors["extension"][-1] < 3e-9
    assert found["inverse"][-1] > 1e5
    assert "Table 5.4" in capsys.readouterr().out
    assert (tmp_path / "curved_2012.png").stat().st_size > 10_000
