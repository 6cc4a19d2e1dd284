"""Friction in space against Clarabel's second-order cones: of one body, of pairs, beside ties."""

import numpy as np
import pytest
from families import SOLID, STRAIGHT
from posed_pairs import Pose, posed
from pressed_pairs import sandwich
from skfem import ElementHex1, ElementHex2, ElementTetP2

from contact import ContactProblem, ElasticBody, LoadStepper, Rigid, Sphere, Status, cross_check
from skfem_adini import ElementHexAdini

pytest.importorskip("clarabel")
quiet = pytest.mark.filterwarnings("ignore::contact.ContactWarning")
ways = pytest.mark.parametrize("condensed", [True, False], ids=["condensed", "sparse"])
elements = pytest.mark.parametrize("element", SOLID, ids=lambda e: e.__name__)


@pytest.mark.parametrize(
    ("law", "friction"), [("tresca", 0.003), ("tresca", 0.01), ("coulomb", 0.3)]
)
@pytest.mark.parametrize("element", [ElementHex1, ElementHex2, ElementTetP2, ElementHexAdini])
def test_cones_agree(element, law, friction, make):
    """Twist and shear on a paraboloid: stick, slip in all directions, open points."""
    n = 4 if element is ElementHex1 else 2
    problem = make.dome(element, n=n, friction=friction, law=law)
    result = problem.solve()
    assert Status.SLIP in result.status
    check = cross_check(problem, result, "clarabel")
    # An interior point method of tolerance 1e-11 on the energy: half the digits in u.
    assert check.objective < 1e-8
    assert check.displacement < 1e-4
    assert check.multipliers < 1e-3


def test_cones_of_a_step_with_a_moving_obstacle(make):
    ticks = np.linspace(0, 1, 4)
    mesh = make.box(ElementHex1, ticks, ticks, ticks)
    body = ElasticBody.from_mesh(mesh, ElementHex1(), E=1.0, nu=0.3).fix("top")
    ball = Sphere((0.5, 0.5, -1.0), 1.02)
    problem = ContactProblem(body, "bottom", ball, 0.3)
    stepper = LoadStepper(problem).obstacle(
        lambda t: Rigid(ball, displacement=(0.05 * t, 0.02 * t**2, 0.01), rotation=(0, 0, 0.1 * t))
    )
    last = stepper.run([0.5, 1.0]).results[-1]
    check = cross_check(problem, last, "clarabel")
    assert check.displacement < 1e-4
    assert check.multipliers < 1e-3


def held_cube(element, **where):
    """A cube on a sloping floor; its left side is held in x, its front in y."""
    mesh = STRAIGHT[element].init_tensor(*[np.linspace(0, 1, 3)] * 3)
    sides = {"left": 0, "front": 1, "bottom": 2}
    named = {name: lambda x, a=axis: x[a] == 0.0 for name, axis in sides.items()}
    mesh = mesh.with_boundaries(named | {"top": lambda x: x[2] == 1.0})
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)
    return body.fix("left", "x", **where).fix("front", "y").load("top", (0.02, 0.03, -0.1))


@pytest.mark.parametrize(
    ("element", "law", "friction"), [(ElementHex1, "coulomb", 0.3), (ElementTetP2, "tresca", 0.01)]
)
def test_prescribed_slip_turns_friction(element, law, friction):
    """Where supports or the obstacle drag a point along x, its friction along y is less."""
    floor = lambda x: 0.002 * x[0]  # noqa: E731
    dragged = ContactProblem(held_cube(element, value=0.01), "bottom", floor, friction, law)
    pulled = Rigid(floor, displacement=(0.02, 0.005, 0.0))
    results = []
    for problem in (dragged, ContactProblem(held_cube(element), "bottom", pulled, friction, law)):
        results.append(problem.solve())
        check = cross_check(problem, results[-1], "clarabel")
        assert check.displacement < 1e-4
        assert check.multipliers < 1e-3
    for result in results:  # the law itself, on the points held in x and not in y
        edge = (result.x_nominal[0] == 0.0) & (result.x_nominal[1] > 0.0) & (result.mu > 1e-6)
        force, slip = result.t[edge], result.slip[edge]
        g = result.system.bound(result.mu)[edge]
        assert edge.any()
        along = g[:, None] * slip / np.linalg.norm(slip, axis=1)[:, None]
        assert np.abs(force - along).max() < 1e-9 * result.mu.max()


@pytest.mark.parametrize("method", ["pdas", "fixed_point", "tresca_loop"])
def test_methods_agree_on_a_prescribed_slip(method):
    problem = ContactProblem(held_cube(ElementHex1, value=0.01), "bottom", 0.0, 0.3)
    theirs, ours = problem.solve(method), problem.solve()
    # The regularised law of the fixed point is met to its eps.
    limit = 1e-4 if method == "fixed_point" else 1e-8
    assert np.abs(theirs.u - ours.u).max() < limit * np.abs(ours.u).max()
    assert np.abs(theirs.t - ours.t).max() < limit * ours.mu.max()


def test_obstacle_pulled_across_a_plane_of_symmetry():
    """Its force is that of all points, of those too that supports hold in its direction."""
    puller = Rigid(0.0, displacement=(None, 0.0, 0.0), force=(-0.045, None, None))
    result = ContactProblem(held_cube(ElementHex1), "bottom", puller, 0.5).solve()
    assert abs(result.resultant[0] + 0.045) < 1e-12
    assert result.motion[0] < 0
    assert np.abs(result.t[result.x_nominal[0] == 0.0]).max() > 0


@quiet
@pytest.mark.sampled(5)
@pytest.mark.parametrize(("law", "condensed"), [("coulomb", True), ("tresca", False)])
@elements
def test_cones_agree_on_two_bodies(element, law, condensed):
    problem, *_ = posed(element, Pose(np.eye(3)), law=law)
    result = problem.solve()
    assert Status.SLIP in result.status
    check = cross_check(problem, result, "clarabel", condensed=condensed)
    assert check.verdict == "agrees"
    # An interior point method of tolerance 1e-11 on the energy: half the digits.
    assert check.objective < 1e-8
    assert check.displacement < 1e-4
    assert check.multipliers < 1e-3


@quiet
@pytest.mark.sampled(3)
@ways
@elements
def test_clarabel_agrees_on_compliant_surfaces_in_space(element, condensed):
    problem, *_ = posed(element, Pose(np.eye(3)), overclosure=100.0)
    check = cross_check(problem, problem.solve(), "clarabel", condensed=condensed)
    assert check.verdict == "agrees", check


@quiet
@ways
def test_ties_beside_friction_in_space(condensed):
    problem = sandwich(ElementHex1, 0.1)
    check = cross_check(problem, problem.solve(), "clarabel", condensed=condensed)
    assert check.displacement < 1e-6, check
    assert check.multipliers < 1e-4, check
