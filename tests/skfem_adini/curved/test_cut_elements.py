"""Elements for curved domains: the weighted one has order six, that of 2012 stalls."""

import numpy as np
import pytest
from example_scripts import load
from skfem import Basis, MeshQuad
from skfem.models.poisson import laplace, mass

from skfem_adini import (
    AdiniExtension,
    CutDomain,
    ElementQuadAdiniCut,
    ElementQuadAdiniWeighted,
    InputError,
    UnisolvenceWarning,
    lowest_eigenpairs,
)
from tests.skfem_adini.cut_problems import disk_eigenvalues, unit_square


def inside(x):
    return 0.411**2 - (x[0] - 0.5) ** 2 - (x[1] - 0.5) ** 2


def slope(x):
    return 1 - 2 * x


def test_disk(convergence_order):
    exact = disk_eigenvalues(1)[0]
    element, errors = ElementQuadAdiniWeighted(inside, slope), []
    for n in (8, 16, 32):
        mesh = unit_square(n)
        domain = CutDomain(mesh, lambda x: -inside(x))
        A, M = (domain.assemble(form, element) for form in (laplace, mass))
        extension = AdiniExtension(Basis(mesh, element, intorder=1), domain)
        A, M = extension.apply(A, M)
        errors.append(abs(lowest_eigenpairs(A, M, 1, shift=0.0)[0][0] / exact - 1))
    assert errors[-1] <= 5e-11
    assert convergence_order([8, 16, 32], errors) == pytest.approx(6, abs=0.4)


def test_every_function_vanishes_on_the_boundary():
    element = ElementQuadAdiniWeighted(inside, slope)
    domain = CutDomain(unit_square(8), lambda x: -inside(x))
    boundary = domain.boundary(element)
    x = np.random.default_rng(0).uniform(-1, 1, boundary.N)
    assert np.abs(np.asarray(boundary.interpolate(x))).max() < 1e-12
    assert np.abs(boundary.interpolate(x).grad).max() > 0.1


def differences(element, mesh, X, i, part, d):
    """Central differences of a part of a function, along each axis."""
    mapping, cells = mesh._mapping(), np.arange(mesh.t.shape[1])
    for shift in d * np.eye(2)[:, :, None, None]:
        ends = [mapping.invF(mapping.F(X) + s * shift, cells) for s in (1, -1)]
        high, low = (part(element.gbasis(mapping, end, i, cells)[0]) for end in ends)
        yield (high - low) / (2 * d)


def test_derivatives_are_those_of_the_values():
    mesh = MeshQuad.init_tensor(np.array([0, 0.4, 1.0]), np.array([0, 0.7, 1.0]))
    weighted = ElementQuadAdiniWeighted(
        lambda x: np.exp(x[0]) * np.sin(x[1] + 1),
        lambda x: np.exp(x[0]) * np.array([np.sin(x[1] + 1), np.cos(x[1] + 1)]),
        lambda x: np.exp(x[0]) * np.array(
            [[np.sin(x[1] + 1), np.cos(x[1] + 1)], [np.cos(x[1] + 1), -np.sin(x[1] + 1)]]
        ),
        derivatives=2,
    )  # fmt: skip
    X = np.array([[0.3], [0.6]])
    for i in range(12):
        (here,) = weighted.gbasis(mesh._mapping(), X, i)
        slopes = [*differences(weighted, mesh, X, i, np.asarray, 1e-5)]
        np.testing.assert_allclose(here.grad, slopes, atol=1e-8)
        second = [*differences(weighted, mesh, X, i, lambda f: f.grad, 1e-5)]
        np.testing.assert_allclose(here.hess, second, atol=1e-8)
    mesh = MeshQuad.init_tensor(np.linspace(0, 1, 9), np.linspace(0, 1, 11))
    cut = ElementQuadAdiniCut(mesh, disk)
    for i in range(18):
        (here,) = cut.gbasis(mesh._mapping(), X, i)
        scale = 1 + np.abs(here.grad)
        slopes = np.array([*differences(cut, mesh, X, i, np.asarray, 1e-6)])
        np.testing.assert_allclose(slopes / scale, here.grad / scale, atol=1e-5)


# The 2012 element interpolates what it says, refuses straight cuts, and stalls.


def disk(x, r=0.411):
    return (x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2 - r**2


def test_quadratics_are_reproduced_everywhere():
    """P2 lies in every space, so nodal values of a quadratic give it back in all used cells."""
    mesh = unit_square(8)
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


def test_functions_vanish_at_the_points_of_the_curve():
    """A nodal function is zero at alpha and beta of the cells on both sides."""
    mesh = unit_square(8)
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


def tilted(curvature):
    """A curve through (0.4, 0.5) at 0.2 from the vertical."""
    c, s = np.cos(0.2), np.sin(0.2)

    def level_set(x):
        u, v = x[0] - 0.4, x[1] - 0.5
        return c * u + s * v + curvature * (u**2 + v**2) / 2

    return level_set


def test_cuts_and_meshes_that_are_refused():
    """The matrix is singular where a conic through the vertices vanishes at all ten conditions."""
    for angle in (0.0, 0.1, 0.2):
        c, s = np.cos(angle), np.sin(angle)
        with pytest.raises(InputError, match="its matrix is singular"):
            ElementQuadAdiniCut(
                unit_square(4), lambda x, c=c, s=s: c * (x[0] - 0.4) + s * (x[1] - 0.4)
            )
    with pytest.raises(InputError, match="its matrix is singular"):  # an arc, symmetric in the cell
        ElementQuadAdiniCut(unit_square(5), disk)
    with pytest.raises(InputError, match="opposite vertices"):
        ElementQuadAdiniCut(unit_square(1), lambda x: 0.1 - (x[0] - x[1]) ** 2)
    with pytest.raises(InputError, match="the mesh it was made for"):
        Basis(unit_square(8), ElementQuadAdiniCut(unit_square(8), disk))


def test_inverse_grows_like_one_over_curvature_of_nearly_straight_cuts():
    mesh, curvature = unit_square(1), np.array([1e-2, 1e-3, 1e-4])
    inverse = [ElementQuadAdiniCut(mesh, tilted(k)).unisolvence[0] for k in curvature]
    assert np.polyfit(np.log(curvature), np.log(inverse), 1)[0] == pytest.approx(-1, abs=0.1)
    with pytest.warns(UnisolvenceWarning, match="nearly singular"):
        ElementQuadAdiniCut(mesh, tilted(1e-7))


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
