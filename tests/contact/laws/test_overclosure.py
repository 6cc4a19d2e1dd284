"""Compliant surfaces: closed forms, the hard limit, Newton's order, units, friction, storage."""

import numpy as np
import pytest
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTriP1,
    ElementTriP2,
    MeshHex,
    MeshQuad,
    MeshTri,
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
    Status,
    cross_check,
    uniqueness,
)
from contact.condensation.boundary_problem import BoundaryProblem
from contact.laws.friction import Coulomb
from contact.laws.methods import solve_boundary
from contact.laws.options import Options
from contact.laws.surface_compliance import SurfaceCompliance
from skfem_adini import ElementQuadAdini, ElementQuadBFS

ELEMENTS = [
    ElementQuad1(),
    ElementQuad2(),
    ElementTriP1(),
    ElementTriP2(),
    ElementQuadAdini(),
    ElementQuadBFS(),
    ElementHex1(),
    ElementHex2(),
]
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


LAWS = [line, table, exponential]


def column(element, E, L):
    mesh = {"Quadrilateral": MeshQuad, "Triangular": MeshTri}.get(element.refdom.name, MeshHex)
    flat = element.refdom.dim() == 2
    mesh = mesh().refined(2 if flat else 1).scaled(L).with_defaults()
    body = ElasticBody.from_mesh(mesh, element, E=E, nu=0.0)
    body = body.fix("left", "x")
    return body if flat else body.fix("bottom", "y")


@pytest.mark.sampled(4)
@pytest.mark.parametrize("pushed", [False, True])
@pytest.mark.parametrize(("L", "E"), UNITS)
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
@pytest.mark.parametrize("element", ELEMENTS, ids=lambda element: type(element).__name__)
def test_column_under_uniform_pressure(element, law, L, E, pushed):
    """A given pressure, or a shortening of which the surface takes its share."""
    given, inverse = law(E, L)
    body, flat = column(element, E, L), element.refdom.dim() == 2
    top, bottom, axis = ("top", "bottom", 1) if flat else ("back", "front", 2)
    gap, p = 0.004 * L, 0.2 * E
    closed = inverse(p)
    if pushed:  # the top goes down by gap + overclosure + shortening of the column
        body = body.fix(top, "xyz"[axis], -(gap + closed + p * L / E))
    else:
        traction = np.zeros(body.dim)
        traction[axis] = -p
        body = body.load(top, traction)
    result = ContactProblem(body, bottom, gap, overclosure=given).solve()
    assert np.abs(result.pressure - p).max() <= 1e-11 * p
    assert np.abs(result.gap + closed).max() <= 1e-11 * L
    assert max(result.kkt.values()) <= 1e-10


def cylinder(overclosure, friction=0.0, law="coulomb", n=3, load=-0.02, **more):
    mesh = MeshQuad.init_tensor(np.linspace(-1, 1, 2**n + 1), np.linspace(0, 1, 2 ** (n - 1) + 1))
    body = ElasticBody.from_mesh(mesh.with_defaults(), ElementQuad2(), E=1.0, nu=0.3)
    body = body.fix("top", "x", 0.01 if friction else 0.0).load("top", (0.0, load))
    obstacle = Cylinder((0.1, -3.0), 3.0)
    return ContactProblem(body, "bottom", obstacle, friction, law, overclosure=overclosure, **more)


@pytest.mark.parametrize(("friction", "law"), [(0.0, None), (0.3, "coulomb"), (0.004, "tresca")])
def test_stiff_surfaces_tend_to_hard_contact(friction, law):
    """The difference is proportional to 1 / kappa, and 1e-8 where kappa is large."""
    hard = cylinder(None, friction, law).solve()
    stiffness = 10.0 ** np.arange(4, 8)
    off = []
    for kappa in [*stiffness, 1e10]:
        soft = cylinder(kappa, friction, law).solve()
        off.append(np.abs(soft.u - hard.u).max() / np.abs(hard.u).max())
    rate = np.polyfit(np.log(stiffness), np.log(off[:-1]), 1)[0]
    assert -1.05 < rate < -0.95
    assert off[-1] <= 1e-8


@pytest.mark.parametrize("law", ["coulomb", "tresca", None])
def test_newton_is_quadratic(law):
    """r_{k+1} <= C r_k^2 on a smooth curve, until rounding."""
    curve = PressureOverclosure.exponential(0.02, 0.1)
    friction = {"coulomb": 0.2, "tresca": 0.004, None: 0.0}[law]
    lines = cylinder(curve, friction, law).solve().history
    r = np.array([line.residual for line in lines if line.phase.endswith("newton")])
    assert r[-1] <= 1e-12
    assert r.size <= 9
    # Below 1e-2 no point changes between stick and slip any more.
    late = np.flatnonzero((r[:-1] < 1e-2) & (r[1:] > 1e-14))
    assert late.size >= 1
    assert np.all(r[late + 1] <= 10.0 * r[late] ** 2)


@pytest.mark.parametrize("method", ["newton", "pdas", "tresca_loop"])
@pytest.mark.parametrize("law", [1.5, PressureOverclosure([0, 0.02, 0.1], [-0.01, 0.01, 0.02])])
def test_methods_agree_and_obey_the_curve(law, method):
    result = cylinder(law, 0.3).solve(method)
    newton = cylinder(law, 0.3).solve()
    assert np.abs(result.u - newton.u).max() <= 1e-9
    touching = result.mu > 0
    assert touching.any()
    assert not touching.all()
    curve = law if isinstance(law, PressureOverclosure) else PressureOverclosure([0, law], [0, 1])
    assert np.abs(curve.pressure(-result.gap) - result.pressure).max() <= 1e-9
    bound = 0.3 * result.mu
    assert np.all(np.abs(result.t[:, 0]) <= bound + 1e-12)


def test_three_dimensions_with_friction():
    body = ElasticBody.from_mesh(MeshHex().refined(2).with_defaults(), ElementHex1(), E=1.0, nu=0.3)
    body = body.fix("back", "xyz", -0.01)
    curve = PressureOverclosure.exponential(0.01, 0.01)
    result = ContactProblem(body, "front", 0.0, 0.2, overclosure=curve).solve()
    assert np.abs(curve.pressure(-result.gap) - result.pressure).max() <= 1e-11
    assert np.any(result.status == Status.SLIP)
    found = uniqueness(ContactProblem(body, "front", 0.0, 0.2, overclosure=curve), result, starts=2)
    assert found.others == ()


def test_a_law_for_each_boundary_and_a_driven_obstacle():
    mesh = MeshQuad().refined(3).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.0)
    below, above = Plane((0.0, 0.0), (0.0, 1.0)), Plane((0.0, 1.0), (0.0, -1.0))
    body = body.fix("left", "x")
    problem = ContactProblem(
        body,
        ["bottom", "top"],
        [below, Rigid(above, force=(None, -0.1))],
        overclosure=[2.0, None],
    )
    result = problem.solve()
    part = result.part
    assert np.abs(result.pressure - 0.1).max() <= 1e-11
    assert np.abs(result.gap[part == 0] + 0.05).max() <= 1e-11
    assert np.abs(result.gap[part == 1]).max() <= 1e-11
    # the obstacle goes down by the overclosure below and the shortening
    assert result.motion[1] == pytest.approx(-0.15, abs=1e-10)


def test_history_and_storage(tmp_path):
    mesh = MeshQuad().refined(2).with_defaults()
    body = ElasticBody.from_mesh(mesh, ElementQuad2(), E=1.0, nu=0.3).fix("top", "xy")
    curve = PressureOverclosure.exponential(0.05, 0.02)
    stepper = LoadStepper(ContactProblem(body, "bottom", 0.0, 0.3, overclosure=curve))
    stepper.move("top", "y", -0.02).move("top", "x", 0.03, factor=np.square)
    history = stepper.run([0.5, 1.0])
    for step, result in enumerate(history):
        assert np.abs(curve.pressure(-result.gap) - result.pressure).max() <= 1e-10
        again = ContactResult.load(result.save(tmp_path / f"step.{step}"))
        assert again.kkt == result.kkt
        assert repr(again.system.overclosure) == repr(result.system.overclosure)


def test_certificate_sees_a_pressure_off_the_curve():
    result = cylinder(1.5).solve()
    system = result.system
    i = int(np.argmax(result.mu))
    for factor, name in ((0.9, "penetration"), (1.1, "complementarity")):
        mu = result.mu.copy()
        mu[i] *= factor
        assert system.kkt(result.u, mu, result.t)[name] > 1e-3


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


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_between_two_bodies(law):
    """Two columns of other meshes, pressed together through a compliant interface."""
    given, inverse = law(1.0, 1.0)
    lower = MeshQuad().refined(2).with_defaults()
    upper = MeshQuad().refined(1).translated((0.0, 1.0)).with_defaults()
    below = ElasticBody.from_mesh(lower, ElementQuad2(), E=1.0, nu=0.0).fix("bottom", "y")
    above = ElasticBody.from_mesh(upper, ElementQuad2(), E=1.0, nu=0.0).fix("left", "x")
    above = above.load("top", (0.0, -0.2))
    below = below.fix("left", "x")
    problem = ContactProblem(above, "bottom", below.surface("top"), overclosure=given)
    result = problem.solve()
    assert np.abs(result.pressure - 0.2).max() <= 1e-11
    assert np.abs(result.gap + inverse(0.2)).max() <= 1e-11


def test_between_two_bodies_in_finite_sliding():
    """Springs in a row: two columns of unit stiffness and a layer of stiffness 3."""
    lower = MeshQuad().refined(2).with_defaults()
    upper = MeshQuad().refined(1).translated((0.0, 1.0)).with_defaults()
    below = ElasticBody.from_mesh(lower, ElementQuad2(), E=1.0, nu=0.0).fix("bottom", "y")
    above = ElasticBody.from_mesh(upper, ElementQuad2(), E=1.0, nu=0.0).fix("top", "y")
    below, above = below.fix("left", "x"), above.fix("left", "x")
    problem = ContactProblem(above, "bottom", below.surface("top"), overclosure=3.0)
    stepper = LoadStepper(problem, sliding="finite").move("top", "y", -0.2, body=above)
    for share, result in zip((0.5, 1.0), stepper.run([0.5, 1.0]), strict=True):
        assert np.abs(result.pressure - share * 0.2 / (2.0 + 1.0 / 3.0)).max() <= 1e-11


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(60))
def test_random_problems_obey_the_curve_and_the_ties(seed):
    """An answer is right, by the definition of the laws."""
    rng = np.random.default_rng([seed, 7])
    m, dim_t = int(rng.integers(1, 60)), int(rng.choice([1, 2]))
    n = m * (1 + dim_t)
    root = rng.standard_normal((n, n))
    W = root @ root.T / n + 0.1 * np.eye(n)
    W /= np.sqrt(np.outer(np.diag(W), np.diag(W)))
    unit = 10.0 ** rng.uniform(-9, 9)
    gap, v0 = rng.uniform(-0.2, 1.0, m) * unit, rng.standard_normal(n) * unit
    normal, tangent = np.arange(m), m + np.arange(m * dim_t).reshape(dim_t, m).T
    bonded = (rng.random(m) < 0.2) & (rng.random() < 0.5)
    law = [
        PressureOverclosure([0.0, 1.0], [0.0, 10.0 ** rng.uniform(-3, 3)]),
        PressureOverclosure([0.0, 0.1 * unit, unit], [-0.1 * unit, 0.05 * unit, 0.1 * unit]),
        PressureOverclosure.exponential(unit * 10.0 ** rng.uniform(-2, 1), 0.1 * unit),
    ][seed % 3]
    laws = SurfaceCompliance((law,), np.where(bonded, -1, 0), np.ones(m), np.ones(m))
    held, none = np.zeros((m, dim_t)), np.zeros((n, 0))
    problem = BoundaryProblem(
        W, v0, none, np.zeros(0), gap, normal, tangent, held, bonded=bonded, compliance=laws
    )
    F = rng.uniform(0.0, 0.5)
    options = Options.checked("coulomb", 1 + dim_t, "newton", None, None, None)
    forces, _ = solve_boundary(
        problem, Coulomb(np.full(m, F)), options, None, np.ones(m), lambda line: None
    )
    u_n, u_t = problem.displacements(forces.mu, forces.t, forces.a)
    size, free = max(np.abs(forces.mu).max(), np.abs(forces.t).max(), 1e-9 * unit), ~bonded
    slope = laws.closest(forces.mu + u_n - gap)[2]
    off = np.abs(law.pressure(u_n - gap) - forces.mu) * np.minimum(slope, 1.0)
    assert np.max(off[free & (slope > 0)], initial=0.0) <= 1e-9 * size
    assert np.all((u_n - gap - law.start)[free & (slope == 0)] <= 1e-9 * size)
    assert np.all(forces.mu[free] >= -1e-10 * size)
    length = np.linalg.norm(forces.t, axis=1)
    assert np.all((length - F * forces.mu)[free] <= 1e-10 * size)
    power = np.sum(forces.t * u_t, axis=1) - F * forces.mu * np.linalg.norm(u_t, axis=1)
    assert np.abs(power[free]).max(initial=0.0) <= 1e-9 * size * max(size, np.abs(u_t).max())
    assert np.abs((u_n - gap)[bonded]).max(initial=0.0) <= 1e-9 * size
    assert np.abs(u_t[bonded]).max(initial=0.0) <= 1e-9 * size
