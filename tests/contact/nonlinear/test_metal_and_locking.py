"""Plastic bodies beside closed forms, nearly incompressible ones that must not lock."""

import numpy as np
import pytest
from rubber_blocks import FAR, alone
from skfem import ElementQuad1, ElementQuad2, ElementTriP2, MeshQuad, MeshTri
from skfem.helpers import ddot, det, inv, transpose

from contact import (
    ContactProblem,
    MooneyRivlin,
    Moved,
    NeoHooke,
    NonlinearBody,
    NonlinearStepper,
    Plane,
    Plasticity,
)

CELLS = [ElementQuad1, ElementQuad2, ElementTriP2]
K = 1 / 3**0.5  # yield stress in shear, of one in tension


def tube(n, nu, element=ElementQuad2, dilatation="pointwise", E=1000.0):
    """A ring of radii 1 and 2 in plane strain, elastic and perfectly plastic."""
    mesh = MeshQuad.init_tensor(np.linspace(1.0, 2.0, n + 1), [0.0, 1.0 / n]).with_defaults()
    law = Plasticity(E, nu, 1.0)
    options = {"plane": "axisymmetric", "dilatation": dilatation}
    body = NonlinearBody.from_mesh(mesh, element(), stress=law, **options)
    return body.fix(["bottom", "top"], "y")


def pressure_of(front):
    """Inner pressure at which the tube is plastic up to a radius, for nu = 1/2."""
    return K * (2 * np.log(front) + 1 - front**2 / 4)


def radial_stress(r, front):
    """sigma_rr at that pressure; R. Hill, The Mathematical Theory of Plasticity, 1950, ch. V."""
    inside = 2 * np.log(r / front) - 1 + front**2 / 4
    return K * np.where(r < front, inside, front**2 / 4 - front**2 / r**2)


def error_of(n, element):
    """Root mean square error of sigma_rr in a tube plastic to 1.5, over the pressure. Strains of
    1e-5 and nu = .4999 are as good as the small ones and nu = 1/2 of the formula."""
    stepper = alone(tube(n, 0.4999, element, "mean", E=1e5))
    stepper.load("left", (pressure_of(1.5), 0.0))
    result = stepper.run([0.5, 0.8, 1.0]).results[-1]
    body, u = result.of_body()
    sigma = body.cauchy_stress(u, result.before.states[0])[0, 0]
    r, alpha = np.asarray(body.basis.global_coordinates())[0], result.states[0]["alpha"]
    assert np.all(alpha[r < 1.4] > 0)
    assert np.all(alpha[r > 1.6] == 0)
    return np.sqrt(np.mean((sigma - radial_stress(r, 1.5)) ** 2)) / pressure_of(1.5)


@pytest.mark.parametrize(
    ("element", "order", "last"), [(ElementQuad1, 1, 0.023), (ElementQuad2, 2, 2.5e-4)]
)
def test_thick_walled_tube(element, order, last):
    errors = [error_of(n, element) for n in (4, 8, 16)]
    assert errors[-1] <= last
    assert abs(np.polyfit(np.log([4, 8, 16]), np.log(errors), 1)[0] + order) <= 0.05


def strip_punch(rings, friction, n=4):
    """Force of a rigid punch of width 2 on a thick layer over k, in steps until all of it flows."""
    mesh = MeshTri.init_tensor(np.linspace(0, 4, 4 * n + 1), np.linspace(-2.5, 0, 5 * n // 2 + 1))
    for radius in rings:  # smaller cells around the edge of the punch
        x, y = mesh.p[:, mesh.t].mean(axis=1)
        mesh = mesh.refined(np.flatnonzero(np.hypot(x - 1, y) < radius))
    names = mesh.with_defaults().boundaries
    below = mesh.facets_satisfying(lambda x: np.isclose(x[1], 0) & (x[0] < 1), boundaries_only=True)
    mesh = mesh.with_boundaries({**names, "below": below})
    body = NonlinearBody.from_mesh(mesh, ElementTriP2(), stress=Plasticity(1e5, 0.3, 1.0))
    body.fix(["left", "right"], "x").fix("bottom", "xy")
    punch = Plane((0.0, 0.0), (0.0, -1.0))
    stepper = NonlinearStepper(ContactProblem(body, "below", punch, friction))
    stepper.obstacle(lambda depth: Moved(punch, (0.0, -depth)))
    depths = 1.25e-5 * np.array([1, 2, 3, 4, 6, 8, 11, 14, 18, 24])
    return -stepper.run(depths).resultant[:, 1] / K


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_strip_punch(friction):
    """(2 + pi) k, smooth or rough, approached from above, as displacements overestimate the load;
    L. Prandtl, Nachr. Ges. Wiss. Goettingen (1920), 74-85."""
    coarse, fine = (strip_punch(rings, friction) for rings in ((1.0,), (1.0, 0.5, 0.25)))
    limit = 2 + np.pi
    assert abs(fine[-1] - fine[-2]) <= 1e-3 * limit  # it flows
    assert limit < fine[-1] < coarse[-1]
    assert fine[-1] <= (1.015 if friction else 1.01) * limit


def test_the_state_changes_where_a_step_is_accepted_only():
    stepper = alone(tube(4, 0.3))
    stepper.load("left", (pressure_of(1.3), 0.0), lambda t: t if t <= 1.0 else 1.0 + 40 * (t - 1))
    one = stepper.run([1.0]).results[-1]
    alpha = one.states[0]["alpha"].copy()
    stepper.halvings = 1
    with pytest.raises(Exception, match="large strain"):
        stepper.run([2.0])  # far above the limit load
    assert len(stepper.history) == 1
    assert np.array_equal(stepper.history.results[-1].states[0]["alpha"], alpha)


def test_unloading_leaves_the_plastic_strain():
    stepper = alone(tube(4, 0.3))
    stepper.load("left", (pressure_of(1.3), 0.0), lambda t: 1 - abs(t - 1))
    loaded, unloaded = stepper.run([1.0, 2.0]).results
    assert np.abs(unloaded.states[0]["ep"] - loaded.states[0]["ep"]).max() <= 1e-12
    assert np.abs(unloaded.u).max() > 1e-6


def cook(element, law, n, force=100.0, dilatation="mean", height=60.0):
    """Deflection of the loaded side of Cook's membrane at a height, by default its top; result."""
    square = MeshQuad.init_tensor(*[np.linspace(0, 1, n + 1)] * 2)
    X, Y = square.p
    mesh = MeshQuad(np.array([48 * X, 44 * X + Y * (44 - 28 * X)]), square.t, sort_t=False)
    mesh = mesh.to_meshtri() if element is ElementTriP2 else mesh
    sides = {"left": lambda x: x[0] < 1e-9, "right": lambda x: x[0] > 48 - 1e-9}
    sides["bottom"] = lambda x: x[1] < 44 * x[0] / 48 + 1e-9
    mesh = mesh.with_boundaries(sides)
    body = NonlinearBody.from_mesh(mesh, element(), stress=law, dilatation=dilatation).fix("left")
    stepper = NonlinearStepper(ContactProblem(body, "bottom", FAR[2]))
    result = stepper.load("right", (0.0, force / 16.0)).run([0.25, 0.5, 0.75, 1.0]).results[-1]
    place = np.isclose(mesh.p[0], 48.0) & np.isclose(mesh.p[1], height)
    return result.u[body.basis.nodal_dofs[1, np.flatnonzero(place)[0]]], result


def compressible(F, mu=0.4225, nu=0.3):
    """mu/2 (tr C J^(-2/3) - 3) + K/4 (J^2 - 1 - 2 ln J), in N/mm^2, by hand."""
    J, K = det(F), 2 * mu * (1 + nu) / (3 * (1 - 2 * nu))
    back = transpose(inv(F))
    return mu * J ** (-2 / 3) * (F - ddot(F, F) / 3 * back) + K / 2 * (J**2 - 1) * back


@pytest.mark.parametrize(("n", "published"), [(2, 14.30), (4, 14.65), (8, 14.71), (16, 14.73)])
def test_cooks_membrane_has_its_published_deflection(n, published):
    """Q2 of J.-P. V. Pelteret and A. McBride, The deal.II code gallery: Quasi-static finite-strain
    compressible elasticity, doi 10.5281/zenodo.1228964, table of the readme since 2021."""
    found = cook(ElementQuad2, compressible, n, 1.0, "pointwise", height=52.0)[0]
    assert abs(found - published) <= 0.005  # half its last digit


RUBBER = MooneyRivlin(80.1938 / 2, 0.0, 400942.0)


def pressures(result):
    """Spread of -tr sigma / 3 within cells, and its jumps between them, the medians."""
    body, u = result.of_body()
    sigma = body.cauchy_stress(u, {})
    p = -(sigma[0, 0] + sigma[1, 1] + sigma[2, 2]) / 3
    sides = body.mesh.f2t[:, body.mesh.f2t[1] >= 0]
    return np.median(np.ptp(p, axis=1)), np.median(np.abs(np.diff(p.mean(axis=1)[sides], axis=0)))


@pytest.mark.turns(2)
def test_nearly_incompressible_membrane_does_not_lock():
    """The rubber of J. C. Simo and F. Armero, Int. J. Numer. Methods Engrg. 33 (1992), 1413."""
    found = {e: [cook(e, RUBBER, n)[0] for n in (4, 8)] for e in CELLS}
    best = cook(ElementQuad2, RUBBER, 16)[0]
    assert np.abs(np.array(found[ElementQuad2]) / best - 1).max() <= 0.01
    below, above = found[ElementQuad1], found[ElementTriP2]
    assert below[0] < below[1] < best < above[1] < above[0]
    assert above[1] <= 1.03 * best
    locked = cook(ElementQuad1, RUBBER, 8, dilatation="pointwise")[0]
    assert locked < 0.5 * below[1]


def test_pressures_of_nearly_incompressible_cells_mean_something():
    """With mean dilatation they vary within cells as from cell to cell; pointwise by much more."""
    spread, jump = {}, {}
    for n, dilatation in ((4, "mean"), (8, "mean"), (8, "pointwise")):
        result = cook(ElementQuad2, RUBBER, n, dilatation=dilatation)[1]
        spread[n, dilatation], jump[n, dilatation] = pressures(result)
    assert spread[8, "mean"] <= 0.6 * spread[4, "mean"]  # both fall with the cells
    assert jump[8, "mean"] <= 0.7 * jump[4, "mean"]
    assert spread[8, "pointwise"] > 20 * spread[8, "mean"]


def test_mean_dilatation_is_the_derivative_of_its_energy():
    mesh = MeshQuad().refined(1).with_defaults()
    law = NeoHooke(1.0, 100.0)
    body = NonlinearBody.from_mesh(mesh, ElementQuad1(), stress=law, dilatation="mean")
    rng = np.random.default_rng(0)
    u, way, h = *0.1 * rng.standard_normal((2, body.ndofs)), 1e-6
    slope = (body.cells.energy(u + h * way) - body.cells.energy(u - h * way)) / (2 * h)
    assert abs(slope - body.cells.at(u, {}, 0.0) @ way) <= 1e-7 * abs(slope)
    K = body.cells.tangent(u, {}, 0.0)
    assert abs(K - K.T).max() <= 1e-12 * abs(K).max()
