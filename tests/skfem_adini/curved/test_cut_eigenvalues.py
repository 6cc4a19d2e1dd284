"""Curved domains: eigenvalues against Bessel roots and boundary integrals, and other elements."""

from functools import cache

import numpy as np
import pytest
from convergence import order
from scipy.special import jn_zeros
from skfem import Basis, BilinearForm, ElementVector, MeshQuad
from skfem.helpers import dot
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace, mass

import skfem_adini
from skfem_adini import CutDomain, ElementQuadAdiniCut, InputError, lowest_eigenpairs
from tests.skfem_adini.boundary_integrals import Curve, eigenvalue
from tests.skfem_adini.cut_problems import (
    LEVEL_SETS,
    R,
    disk_eigenvalues,
    elastic_radial_number,
    ellipse,
    ellipse_eigenvalue,
    extended,
    flower_eigenvalue,
    matrices,
    unit_square,
)


@cache
def of_disk(n):
    """Relative errors of the first ten eigenvalues, Dirichlet and Neumann."""
    A, K, M = extended(unit_square(n), LEVEL_SETS["disk"])
    dirichlet = lowest_eigenpairs(A, M, 10, shift=0.0)[0]
    neumann = lowest_eigenpairs(K, M, 10)[0]
    assert abs(neumann[0]) < 1e-9
    exact = disk_eigenvalues(10), disk_eigenvalues(10, neumann=True)[1:]
    return np.abs(dirichlet / exact[0] - 1), np.abs(neumann[1:] / exact[1] - 1)


@pytest.mark.parametrize("condition", [0, 1], ids=["Dirichlet", "Neumann"])
def test_disk_order_six(condition):
    cells = [16, 32, 64]
    worst = [of_disk(n)[condition].max() for n in cells]
    assert order(cells, worst) == pytest.approx(6, abs=0.3)
    assert worst[1] <= (2e-6, 5e-7)[condition]
    assert of_disk(64)[0].max() <= 3e-8
    assert of_disk(32)[0][0] <= 3e-9
    assert of_disk(64)[0][0] <= 5e-11


def test_disk_with_ghost_penalty():
    mesh, element = unit_square(32), skfem_adini.ElementQuadAdini()
    domain, K, M, B = matrices(mesh, LEVEL_SETS["disk"])
    active = domain.active_dofs(Basis(mesh, element, intorder=1))
    A = (K + B + skfem_adini.ghost_penalty(domain, element)).tocsr()[active][:, active]
    M = (M + skfem_adini.ghost_penalty(domain, element, matrix="mass")).tocsr()[active][:, active]
    errors = np.abs(lowest_eigenpairs(A, M, 10, shift=0.0)[0] / disk_eigenvalues(10) - 1)
    assert errors[0] <= 3e-9
    assert errors.max() <= 2e-6


def test_the_references_are_right():
    """Boundary integrals agree with themselves, however many points, and with Bessel's roots."""
    assert ellipse_eigenvalue(80) == pytest.approx(ellipse_eigenvalue(60), rel=1e-11)
    assert flower_eigenvalue(140) == pytest.approx(flower_eigenvalue(110), rel=1e-10)
    circle = [Curve(lambda t: R * np.exp(1j * t), 60)]
    for robin, exact in ((None, disk_eigenvalues(1)[0]), (0.0, disk_eigenvalues(2, True)[1])):
        assert eigenvalue(circle, 1.02 * exact, robin) == pytest.approx(exact, rel=1e-12)


def test_ellipse():
    errors = []
    for n in (16, 24, 32):
        A, _, M = extended(unit_square(n), ellipse)
        value = lowest_eigenpairs(A, M, 1, shift=0.0)[0][0]
        errors.append(abs(value / ellipse_eigenvalue() - 1))
    assert errors[-1] <= 1e-8
    assert order([16, 24, 32], errors) == pytest.approx(6, abs=0.5)


@pytest.mark.turns(4)
def test_strongly_curved_flower_with_a_refined_boundary():
    """The base grid alone leaves 3.8e-5; two levels of cells at the boundary 8e-8."""
    level_set, reference = LEVEL_SETS["flower"], flower_eigenvalue()
    errors = []
    for levels in (0, 2):
        mesh = skfem_adini.refined_at_boundary(unit_square(32), level_set, levels)
        A, _, M = extended(mesh, level_set)
        errors.append(abs(lowest_eigenpairs(A, M, 1, shift=0.0)[0][0] / reference - 1))
    assert errors[0] > 1e-5
    assert errors[1] <= 1e-6


@pytest.mark.sampled(2)
@pytest.mark.parametrize("held", [True, False], ids=["held", "free"])
def test_elastic_disk(held):
    """Torsion mu (j / R)^2 and breathing (lambda + 2 mu) k^2, in closed form."""
    lame, mu = 1.5, 1.0
    if held:
        exact = (mu * (jn_zeros(1, 1)[0] / R) ** 2, (lame + 2 * mu) * (jn_zeros(1, 1)[0] / R) ** 2)
    else:
        breathing = elastic_radial_number(lame, mu)
        exact = (mu * (jn_zeros(2, 1)[0] / R) ** 2, (lame + 2 * mu) * breathing**2)
    element = ElementVector(skfem_adini.ElementQuadAdini())
    inertia = BilinearForm(lambda u, v, _: dot(u, v))
    cells, errors = [12, 16, 24], []
    for n in cells:
        mesh = unit_square(n)
        domain = CutDomain(mesh, LEVEL_SETS["disk"], q=5)
        A = domain.assemble(linear_elasticity(Lambda=lame, Mu=mu), element)
        if held:
            A = A + skfem_adini.nitsche(domain.boundary(element), lame=(lame, mu))[0]
        extension = skfem_adini.AdiniExtension(Basis(mesh, element, intorder=1), domain)
        A, M = extension.apply(A, domain.assemble(inertia, element))
        values = lowest_eigenpairs(A, M, 16)[0]
        if not held:
            assert np.abs(values[:3]).max() < 1e-8 * values[3]
            assert values[3] > 1
        errors.append([np.abs(values / value - 1).min() for value in exact])
    for error in np.transpose(errors):
        assert 5.4 <= order(cells, error) <= 6.8


# The weighted element has order six, that of 2012 stalls.


disk = LEVEL_SETS["disk"]


def inside(x):
    return -disk(x)


def slope(x):
    return 1 - 2 * x


def test_disk():
    exact = disk_eigenvalues(1)[0]
    element, errors = skfem_adini.ElementQuadAdiniWeighted(inside, slope), []
    for n in (8, 16, 32):
        mesh = unit_square(n)
        domain = CutDomain(mesh, disk)
        A, M = (domain.assemble(form, element) for form in (laplace, mass))
        extension = skfem_adini.AdiniExtension(Basis(mesh, element, intorder=1), domain)
        A, M = extension.apply(A, M)
        errors.append(abs(lowest_eigenpairs(A, M, 1, shift=0.0)[0][0] / exact - 1))
    assert errors[-1] <= 5e-11
    assert order([8, 16, 32], errors) == pytest.approx(6, abs=0.4)


def test_every_function_vanishes_on_the_boundary():
    element = skfem_adini.ElementQuadAdiniWeighted(inside, slope)
    domain = CutDomain(unit_square(8), disk)
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
    weighted = skfem_adini.ElementQuadAdiniWeighted(
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
    with pytest.warns(skfem_adini.UnisolvenceWarning, match="nearly singular"):
        ElementQuadAdiniCut(mesh, tilted(1e-7))
