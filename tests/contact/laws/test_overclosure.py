"""Compliant surfaces: closed forms, the hard limit, Newton's order, units, friction, storage."""

import numpy as np
import pytest
from families import PLANE_AND_BFS, STRAIGHT
from posed_pairs import Pose, posed
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP2,
    ElementTriP2,
    MeshQuad,
)

from contact import (
    ContactProblem,
    ContactResult,
    Cylinder,
    ElasticBody,
    InputError,
    LoadStepper,
    Plane,
    PressureOverclosure,
    Rigid,
    cross_check,
)
from skfem_adini import ElementHexAdini, ElementQuadAdini

UNITS = [(1.0, 1.0), (1e-3, 2e11), (1e3, 5e-4)]  # length, modulus


def line(E, L):
    return 3.0 * E / L, lambda p: p * L / (3.0 * E)


def table(E, L):
    knots = np.array([0.0, 0.1, 0.4]) * E, np.array([-0.01, 0.05, 0.08]) * L
    rest = 0.03 * L / (0.3 * E)

    def inverse(p):
        return np.interp(p, *knots) + max(p - knots[0][-1], 0.0) * rest

    return PressureOverclosure(*knots), inverse


def exponential(E, L):
    law = PressureOverclosure.exponential(0.05 * E, 0.02 * L)

    def inverse(p):  # by bisection
        low, high = -0.02 * L, 0.5 * L
        for _ in range(200):
            c = 0.5 * (low + high)
            x = 1.0 + c / (0.02 * L)
            larger = 0.05 * E / (np.e - 1.0) * x * np.expm1(x) > p
            low, high = (low, c) if larger else (c, high)
        return c

    return law, inverse


curves = pytest.mark.parametrize(
    "curve", [line, table, exponential], ids=lambda curve: curve.__name__
)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("pushed", [False, True])
@pytest.mark.parametrize(("L", "E"), UNITS)
@curves
@pytest.mark.parametrize("element", [*PLANE_AND_BFS, ElementHex1, ElementHex2])
def test_column_under_uniform_pressure(element, curve, L, E, pushed):
    """A given pressure, or a shortening of which the surface takes its share."""
    given, inverse = curve(E, L)
    flat = element().dim == 2
    mesh = STRAIGHT[element]().refined(2 if flat else 1).scaled(L).with_defaults()
    body = ElasticBody.from_mesh(mesh, element(), E=E, nu=0.0).fix("left", "x")
    if not flat:
        body.fix("bottom", "y")
    top, bottom, axis = ("top", "bottom", 1) if flat else ("back", "front", 2)
    gap, p = 0.004 * L, 0.2 * E
    closed = inverse(p)
    if pushed:  # the top goes down by gap + overclosure + shortening of the column
        body.fix(top, "xyz"[axis], -(gap + closed + p * L / E))
    else:
        body.load(top, -p * np.eye(body.dim)[axis])
    result = ContactProblem(body, bottom, gap, overclosure=given).solve()
    assert np.abs(result.pressure - p).max() <= 1e-11 * p
    assert np.abs(result.gap + closed).max() <= 1e-11 * L
    assert max(result.kkt.values()) <= 1e-10


def cylinder(overclosure, friction=0.0, law="coulomb"):
    mesh = MeshQuad.init_tensor(np.linspace(-1, 1, 9), np.linspace(0, 1, 5))
    body = ElasticBody.from_mesh(mesh.with_defaults(), ElementQuad2(), E=1.0, nu=0.3)
    body = body.fix("top", "x", 0.01 if friction else 0.0).load("top", (0.0, -0.02))
    obstacle = Cylinder((0.1, -3.0), 3.0)
    return ContactProblem(body, "bottom", obstacle, friction, law, overclosure=overclosure)


def pair(element):
    def pose(overclosure, friction, law):
        at = Pose(np.eye(element().dim))
        given = None if law == "tresca" else 2 * friction
        return posed(element, at, friction=given, law=law, overclosure=overclosure)[0]

    pose.__name__ = element.__name__
    return pose


PAIRS = [
    *map(pair, (ElementTriP2, ElementQuad1, ElementQuad2, ElementQuadAdini)),
    *map(pair, (ElementTetP2, ElementHex1, ElementHex2, ElementHexAdini)),
]
LAWS = [("coulomb", 0.0), ("coulomb", 0.4), ("tresca", 0.004)]
laws = pytest.mark.parametrize(("law", "friction"), LAWS)
poses = pytest.mark.parametrize("pose", [cylinder, *PAIRS], ids=lambda pose: pose.__name__)


@pytest.mark.filterwarnings("ignore::contact.ContactWarning")
@pytest.mark.sampled(6)
@laws
@poses
def test_stiff_surfaces_tend_to_hard_contact(pose, law, friction):
    """Displacements and pressures differ by a multiple of 1 / stiffness, down to 1e-8."""
    hard = pose(None, friction, law).solve()
    stiffness, off, pressure = 10.0 ** np.arange(4, 7), [], []
    for kappa in [*stiffness, 1e11]:
        soft = pose(kappa, friction, law).solve()
        off.append(np.abs(soft.u - hard.u).max() / np.abs(hard.u).max())
        pressure.append(np.abs(soft.pressure - hard.pressure).max() / hard.pressure.max())
    rate = np.polyfit(np.log(stiffness), np.log(off[:-1]), 1)[0]
    assert -1.05 < rate < -0.95 if pose is cylinder else -1.01 < rate < -0.99
    assert max(off[-1], pressure[-1]) <= 1e-8


@pytest.mark.filterwarnings("ignore::contact.ContactWarning")
@pytest.mark.sampled(4)
@laws
@poses
def test_newton_is_quadratic(pose, law, friction):
    """r_{k+1} <= C r_k^2 on a smooth curve, until rounding."""
    curve = PressureOverclosure.exponential(0.02, 0.1 if pose is cylinder else 0.02)
    result = pose(curve, friction, law).solve()
    r = np.array([line.residual for line in result.history if line.phase.endswith("newton")])
    assert r[-1] <= 1e-12
    assert r.size <= 12
    late = np.flatnonzero((r[:-1] < 1e-3) & (r[1:] > 1e-14))  # no status changes any more
    # In space slip turns: its direction has curvature 1 / |slip|.
    constant = 100.0 if result.solid.bodies[0].dim == 3 else 10.0
    assert np.all(r[late + 1] <= constant * r[late] ** 2)
    assert np.abs(curve.pressure(-result.gap) - result.pressure).max() <= 1e-10


@pytest.mark.parametrize("method", ["newton", "pdas", "tresca_loop"])
@pytest.mark.parametrize("law", [1.5, PressureOverclosure([0, 0.02, 0.1], [-0.01, 0.01, 0.02])])
def test_methods_agree_and_obey_the_curve(law, method):
    result, newton = cylinder(law, 0.3).solve(method), cylinder(law, 0.3).solve()
    assert np.abs(result.u - newton.u).max() <= 1e-9
    touching = result.mu > 0
    assert touching.any()
    assert not touching.all()
    curve = law if isinstance(law, PressureOverclosure) else PressureOverclosure([0, law], [0, 1])
    assert np.abs(curve.pressure(-result.gap) - result.pressure).max() <= 1e-9
    assert np.all(np.abs(result.t[:, 0]) <= 0.3 * result.mu + 1e-12)


def test_a_law_for_each_boundary_and_a_driven_obstacle():
    mesh = MeshQuad().refined(3).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.0).fix("left", "x")
    below, above = Plane((0.0, 0.0), (0.0, 1.0)), Plane((0.0, 1.0), (0.0, -1.0))
    obstacles = [below, Rigid(above, force=(None, -0.1))]
    problem = ContactProblem(body, ["bottom", "top"], obstacles, overclosure=[2.0, None])
    result = problem.solve()
    assert np.abs(result.pressure - 0.1).max() <= 1e-11
    assert np.abs(result.gap[result.part == 0] + 0.05).max() <= 1e-11
    assert np.abs(result.gap[result.part == 1]).max() <= 1e-11
    # the obstacle goes down by the overclosure below and the shortening
    assert result.motion[1] == pytest.approx(-0.15, abs=1e-10)


def test_history_and_storage(tmp_path):
    mesh = MeshQuad().refined(2).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuad2(), E=1.0, nu=0.3).fix("top", "xy")
    curve = PressureOverclosure.exponential(0.05, 0.02)
    stepper = LoadStepper(ContactProblem(body, "bottom", 0.0, 0.3, overclosure=curve))
    stepper.move("top", "y", -0.02).move("top", "x", 0.03, factor=np.square)
    for step, result in enumerate(stepper.run([0.5, 1.0])):
        assert np.abs(curve.pressure(-result.gap) - result.pressure).max() <= 1e-10
        again = ContactResult.load(result.save(tmp_path / f"step.{step}"))
        assert again.kkt == result.kkt
        assert repr(again.system.overclosure) == repr(result.system.overclosure)


def test_certificate_sees_a_pressure_off_the_curve():
    result = cylinder(1.5).solve()
    i = int(np.argmax(result.mu))
    for factor, name in ((0.9, "penetration"), (1.1, "complementarity")):
        mu = result.mu.copy()
        mu[i] *= factor
        assert result.system.kkt(result.u, mu, result.t)[name] > 1e-3


def test_what_is_refused():
    for wrong in (0.0, -1.0, np.nan, "soft", [1.0, 2.0]):
        with pytest.raises(InputError, match=r"^overclosure"):
            cylinder(wrong)
    for pressures, overclosures in (([0, 1], [0]), ([1, 2], [0, 1]), ([0, 1, 1], [0, 1, 2])):
        with pytest.raises(InputError, match=r"^(pressures|overclosures)"):
            PressureOverclosure(pressures, overclosures)
    with pytest.raises(InputError, match=r"^clearance"):
        PressureOverclosure.exponential(1.0, 0.0)
    for method, friction in (("fixed_point", 0.3), ("qp:osqp", 0.0)):
        with pytest.raises(InputError, match=r"^method"):
            cylinder(1.0, friction).solve(method)
    problem = cylinder(PressureOverclosure.exponential(0.01, 0.01))
    with pytest.raises(InputError, match=r"^result"):
        cross_check(problem, problem.solve())
    problem.overclosure = None
    assert problem.solve().gap.min() >= -1e-10


def columns():
    """Two columns of other meshes, one on the other."""
    lower = MeshQuad().refined(2).with_defaults()
    upper = MeshQuad().refined(1).translated((0.0, 1.0)).with_defaults()
    below, above = (
        ElasticBody.from_mesh(mesh, ElementQuad2(), E=1.0, nu=0.0).fix("left", "x")
        for mesh in (lower, upper)
    )
    return below.fix("bottom", "y"), above


def test_between_two_bodies_in_finite_sliding():
    """Springs in a row: two columns of unit stiffness and a layer of stiffness 3."""
    below, above = columns()
    problem = ContactProblem(above.fix("top", "y"), "bottom", below.surface("top"), overclosure=3.0)
    stepper = LoadStepper(problem, sliding="finite").move("top", "y", -0.2, body=above)
    for share, result in zip((0.5, 1.0), stepper.run([0.5, 1.0]), strict=True):
        assert np.abs(result.pressure - share * 0.2 / (2.0 + 1.0 / 3.0)).max() <= 1e-11
