"""Pressures that follow the body, and paths of equilibrium past limit points."""

import numpy as np
import pytest
from rubber_blocks import FAR, orders
from scipy.integrate import quad
from scipy.optimize import minimize_scalar
from skfem import ElementHex2, ElementQuad1, ElementQuad2, MeshHex, MeshQuad, MeshQuad2

from contact import (
    ContactProblem,
    Cylinder,
    InputError,
    MooneyRivlin,
    NeoHooke,
    NonlinearBody,
    NonlinearStepper,
    Plane,
    SaintVenant,
    Viscous,
)

INNER, OUTER = 1.0, 1.3
RUBBER = NeoHooke(1.0, 9.0)
LAW, SOFT = (MooneyRivlin(0.48, 0.02, K) for K in (2e6, 2e3))  # pressures fall by .8 / K
FACING = {2: Plane((0.0, 9.0), (0.0, -1.0)), 3: Plane((0.0, 0.0, 9.0), (0.0, 0.0, -1.0))}


def pressure_of(radius, outer=OUTER):
    """Pressure that opens an incompressible shell to an inner radius; R. W. Ogden, Non-Linear
    Elastic Deformations, 1984, section 5.3.2: p is the integral of 2 (s_t - s_r) / r over r."""

    def density(R):
        r = np.cbrt(R**3 + radius**3 - INNER**3)
        hoop = r / R
        P = LAW(np.diag([hoop**-2, hoop, hoop]))
        return 2 * (P[1, 1] * hoop - P[0, 0] / hoop**2) * R**2 / r**3

    return quad(density, INNER, outer, epsabs=1e-13, epsrel=1e-13)[0]


def half_shell(n, m, element=ElementQuad2, outer=OUTER, law=LAW):
    """The upper half of a spherical shell of n layers, as a ring; quadratic cells are curved."""
    grid = MeshQuad.init_tensor(np.linspace(INNER, outer, n + 1), np.linspace(0, np.pi / 2, m + 1))
    sides = grid.with_defaults().boundaries
    curved = MeshQuad2.from_mesh(grid) if element is ElementQuad2 else grid
    r, angle = curved.doflocs
    mesh = type(curved)(r * np.array([np.cos(angle), np.sin(angle)]), grid.t, sort_t=False)
    names = {"inner": "left", "outer": "right", "at 1": "bottom"}
    mesh = mesh.with_boundaries({name: sides[side] for name, side in names.items()})
    options = {"plane": "axisymmetric", "dilatation": "mean"}
    return NonlinearBody.from_mesh(mesh, element(), stress=law, **options).fix("at 1", "y")


def octant(n, m):
    """An eighth of the shell, of three parts of m by m cells."""
    ticks = np.linspace(0.0, np.pi / 4, m + 1)
    grid = MeshHex.init_tensor(np.linspace(INNER, OUTER, n + 1), ticks, ticks)
    way = np.array([np.ones(grid.nvertices), *np.tan(grid.p[1:])])
    p, mesh = grid.p[0] * way / np.linalg.norm(way, axis=0), None
    for turn in range(3):
        part = MeshHex(np.roll(p, turn, axis=0), grid.t)
        mesh = part if mesh is None else mesh + part
    radius, layer = lambda x: np.linalg.norm(x, axis=0), 0.3 * (OUTER - INNER) / n
    names = {
        "inner": lambda x: radius(x) < INNER + layer,
        "outer": lambda x: radius(x) > OUTER - layer,
    }
    names |= {f"at {c}": lambda x, c=c: np.isclose(x[c], 0.0) for c in range(3)}
    mesh = mesh.with_boundaries(names)
    body = NonlinearBody.from_mesh(mesh, ElementHex2(), stress=SOFT, dilatation="mean")
    for c in range(3):
        body.fix(f"at {c}", c)
    return body


def inflated(body):
    problem = ContactProblem(body, "outer", FACING[body.dim])
    return NonlinearStepper(problem).pressure("inner", 1.0)


def radius_of(body, u):
    at = np.argmin(np.linalg.norm(body.mesh.p - np.eye(body.dim)[:, :1] * INNER, axis=0))
    return INNER + u[body.basis.nodal_dofs[0, at]]


@pytest.mark.turns(2)
def test_inflated_eighth_of_a_sphere():
    """Straight cells: their error falls with the square of their size, see below."""
    body = octant(1, 2)
    for result in inflated(body).run([0.2, 0.26]):
        expected = pressure_of(radius_of(body, result.u))
        assert abs(result.time - expected) <= 0.05 * expected
        assert orders(result.history).max() > 1.7


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("element", "order", "last"), [(ElementQuad1, 2.0, 2e-3), (ElementQuad2, 2.6, 1.5e-5)]
)
def test_inflated_sphere_converges_to_the_closed_form(element, order, last):
    errors = []
    for k in (1, 2, 4):
        body = half_shell(k, 4 * k, element)
        result = inflated(body).run([0.15, 0.25]).results[-1]
        errors.append(abs(pressure_of(radius_of(body, result.u)) / 0.25 - 1))
    assert errors[-1] <= last
    assert abs(-np.polyfit(np.log([1, 2, 4]), np.log(errors), 1)[0] - order) <= 0.3


@pytest.mark.sampled(2)
@pytest.mark.parametrize("outer", [OUTER, 1.01])
def test_balloon_past_its_limit_point(outer):
    """A thin one of neo-Hooke has its greatest pressure at the stretch 7^(1/6), by hand."""
    rubber = LAW if outer == OUTER else MooneyRivlin(0.5, 0.0, 2e6)
    body = half_shell(1, 8, outer=outer, law=rubber)
    history = inflated(body).follow(0.11, 8)
    radii, k = np.array([radius_of(body, result.u) for result in history]), history.times.argmax()
    assert 0 < k < len(history) - 2
    a, b, c = np.polyfit(radii[k - 1 : k + 2], history.times[k - 1 : k + 2], 2)
    at, greatest = -b / (2 * a), c - b**2 / (4 * a)
    if outer == OUTER:
        expected = np.array([pressure_of(radius) for radius in radii])
        assert np.abs(history.times / expected - 1).max() <= 1e-3
        top = minimize_scalar(lambda a: -pressure_of(a), bounds=(1.2, 2.2), method="bounded")
        assert abs(greatest + top.fun) <= 2e-3 * greatest
        assert abs(at - top.x) <= 0.02
        assert history.times[-1] < 0.97 * greatest
    else:
        middle, s = (INNER + outer) / 2, 7 ** (1 / 6)
        assert abs(greatest * middle / (2 * (outer - INNER) * (1 / s - s**-7)) - 1) <= 2e-3
        assert abs((at + (outer - INNER) / (2 * s**2)) / middle - s) <= 0.01
    assert max(result.certificate["balance"] for result in history) <= 1e-9


@pytest.mark.turns(8)
def test_balloon_grows_into_a_plate():
    """The pressure rises again where the plate holds the balloon."""
    body = half_shell(1, 8, law=SOFT)
    wall = Plane((0.0, 1.9), (0.0, -1.0))
    stepper = NonlinearStepper(ContactProblem(body, "outer", wall, 0.2)).pressure("inner", 1.0)
    history = stepper.follow(0.15, 8)
    free = inflated(half_shell(1, 8, law=SOFT)).follow(0.15, 8)
    assert history.times[-1] > 1.05 * free.times[-1]
    last = history.results[-1]
    assert last.mu.max() > 0
    assert last.gap.min() >= -1e-9
    assert np.all(np.abs(last.t[:, 0]) <= 0.2 * last.mu + 1e-9 * last.mu.max())


def arch(tied=True):
    """Half a shallow arch of thickness .06 and rise .25, symmetric about x = 0, loaded there."""
    grid = MeshQuad.init_tensor(np.linspace(0.0, 1.0, 17), np.linspace(-0.03, 0.03, 3))
    p = np.array([grid.p[0], grid.p[1] + 0.25 * (1 - grid.p[0] ** 2)])
    at = {"middle": lambda x: np.isclose(x[0], 0.0), "end": lambda x: np.isclose(x[0], 1.0)}
    at["below"] = lambda x: x[1] < 0.25 * (1 - x[0] ** 2) - 0.02
    mesh = MeshQuad(p, grid.t, sort_t=False).with_boundaries(at)
    body = NonlinearBody.from_mesh(mesh, ElementQuad2(), stress=SaintVenant(1000.0, 0.3))
    body.fix("middle", "x").fix("end")
    return body.tie("middle", "y") if tied else body.fix("middle", "y")


def depth_of(result):
    body, u = result.of_body()
    return -u[body.basis.get_dofs("middle").all("u^2")].mean()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("control", [None, ("middle", "y")], ids=["arc", "displacement"])
def test_arch_snaps_through_as_under_a_prescribed_displacement(control):
    held = arch(tied=False)
    stepper = NonlinearStepper(ContactProblem(held, "below", FAR[2])).move("middle", "y", -0.4)
    known = stepper.run(np.linspace(0.0625, 1.0, 16))
    force = -known.curve("middle")[:, 1]
    stepper = NonlinearStepper(ContactProblem(arch(), "below", FAR[2]))
    stepper.load("middle", (0.0, -1.0 / 0.06))
    history = stepper.follow(0.02 if control is None else -0.025, 16, control=control)
    depths = np.array([depth_of(result) for result in history])
    assert depths[-1] > 0.35
    assert np.all(np.diff(depths) > 0)
    top = np.argmax(history.times[:8])
    assert history.times[top:12].min() < 0.6 * history.times[top]  # it snaps
    if control is not None:
        assert np.allclose(depths, 0.025 * np.arange(1, 17), atol=1e-9)
        assert np.allclose(history.times, force, atol=1e-7 * force.max())
    else:
        inside = depths < 0.35
        between = np.interp(depths, 0.025 * np.arange(17), np.r_[0.0, force])
        assert np.abs(history.times - between)[inside].max() <= 0.03 * force.max()


@pytest.mark.turns(2)
def test_arch_under_more_than_its_greatest_load(caplog):
    """It snaps to where the same force is needed for the depth that it has there."""
    load = 0.075  # the greatest before it snaps is .058
    stepper = NonlinearStepper(ContactProblem(arch(), "below", FAR[2]), halvings=1)
    snapped = stepper.load("middle", (0.0, -1.0 / 0.06)).run([0.05, load])[-1]
    assert "came to rest" in caplog.text
    held = NonlinearStepper(ContactProblem(arch(tied=False), "below", FAR[2]))
    held.move("middle", "y", -depth_of(snapped))
    assert depth_of(snapped) > 0.4
    assert any(line.phase == "damped" for line in snapped.history)
    force = -held.run(np.linspace(0.1, 1.0, 10)).curve("middle")[-1, 1]
    assert abs(force - load) <= 1e-7 * load


@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_steps_of_given_times_go_on_from_a_path(friction):
    """Contact points are among the unknowns of both, beside the time of the path."""
    mesh = MeshQuad.init_tensor(np.linspace(-1, 1, 5), np.linspace(0, 1, 3)).with_defaults()

    def stepper():
        body = NonlinearBody.from_mesh(mesh, ElementQuad2(), stress=RUBBER).fix("top")
        floor = Plane((0.0, 0.0), (0.0, 1.0))
        problem = ContactProblem(body, "bottom", floor, friction=friction)
        return NonlinearStepper(problem).load("left", (-0.3, -0.1)).load("right", (0.0, -0.1))

    both = stepper()
    times = both.follow(0.02, 2).times
    later = np.append(times, times[-1] + 0.1)
    last = both.run(later[-1:]).results[-1]
    assert np.allclose(last.u, stepper().run(later).results[-1].u, atol=1e-9)
    again = both.follow(0.02, 1).results[-1]
    assert again.certificate["balance"] <= 1e-9


def test_arch_snaps_onto_a_bump():
    bump = Cylinder((0.5, -0.4), 0.45)
    stepper = NonlinearStepper(ContactProblem(arch(), "below", bump, 0.3))
    stepper.load("middle", (0.0, -1.0 / 0.06))
    history = stepper.follow(0.02, 8)
    last = history.results[-1]
    assert last.mu.max() > 0
    assert last.gap.min() >= -1e-9
    assert last.time > 1.2 * history.times[:5].max()  # the bump carries
    assert last.resultant[1] > 0


@pytest.mark.turns(4)
def test_a_followed_path_is_resumed(tmp_path):
    whole = inflated(half_shell(1, 4, law=SOFT)).follow(0.1, 4)
    inflated(half_shell(1, 4, law=SOFT)).follow(0.1, 2, path=tmp_path / "run")
    stepper = inflated(half_shell(1, 4, law=SOFT))
    assert len(stepper.resume(tmp_path / "run")) == 2
    history = stepper.follow(0.1, 2, path=tmp_path / "run")
    assert np.array_equal(history.times, whole.times)
    assert all(np.array_equal(a.u, b.u) for a, b in zip(history, whole, strict=True))
    other = inflated(half_shell(1, 4, law=SOFT)).pressure("inner", 0.1)
    with pytest.raises(InputError, match="another problem"):
        other.resume(tmp_path / "run")


def plain(law=RUBBER, **more):
    mesh = MeshQuad().refined(1).with_defaults()
    body = NonlinearBody.from_mesh(mesh, ElementQuad1(), stress=law).fix("top")
    return NonlinearStepper(ContactProblem(body, "bottom", FAR[2], **more))


BAD = {
    "pressure: expected a finite number": lambda: plain().pressure("right", (1.0, 2.0)),
    ", got nan": lambda: plain().pressure("right", np.nan),
    "no load varies": lambda: plain().follow(0.1, 1),
    "length=": lambda: plain().follow(0.0, 1),
    "control=": lambda: plain().pressure("right", 1.0).follow(0.1, 1, control="right"),
    "one component": lambda: plain().pressure("right", 1.0).follow(0.1, 1, control=("right", "xy")),
    "depends on rates": lambda: (
        plain(Viscous(RUBBER, 0.5, 1.0)).pressure("right", 1.0).follow(0.1, 1)
    ),
    "obstacles stay": lambda: plain().obstacle(lambda t: FAR[2]).follow(0.1, 1),
    "supports stay": lambda: plain().move("top", "y", -0.1).pressure("right", 1.0).follow(0.1, 1),
}


@pytest.mark.parametrize("said", BAD)
def test_bad_paths_are_refused(said):
    with pytest.raises(InputError, match=said):
        BAD[said]()
