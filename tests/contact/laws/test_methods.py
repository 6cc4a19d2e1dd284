"""Methods, in the plane and in space: one solution, in few steps, from coarse meshes too."""

import functools

import numpy as np
import pytest
from posed_pairs import Pose, posed
from pressed_pairs import pair
from skfem import ElementHex1, ElementQuad1, ElementQuad2, ElementTetP1, ElementTriP2

from contact import (
    ContactProblem,
    ElasticBody,
    LayeredBlock,
    Parabola,
    Plane,
    Rigid,
    Status,
    cross_check,
)
from contact.condensation.boundary_problem import BoundaryProblem
from contact.laws import methods
from contact.laws.methods import signorini
from gpu import NotConverged
from skfem_adini import ElementQuadAdini

# Relative difference of u to the default method and the violation of the law: certificates at
# 1e-10, 1e-7 for QP solvers; the fixed point is regularised by 1e-5 of the displacement.
OFFERED = {
    (None, "pdas"): (1e-12, 1e-10),
    (None, "qp:osqp"): (1e-6, 1e-7),
    (None, "qp:proxqp"): (1e-6, 1e-7),
    ("tresca", "pdas"): (1e-10, 1e-10),
    ("tresca", "fixed_point"): (1e-4, 1.0),
    ("tresca", "qp:osqp"): (1e-6, 1e-7),
    ("tresca", "qp:proxqp"): (1e-6, 1e-7),
    ("coulomb", "pdas"): (1e-10, 1e-10),
    ("coulomb", "tresca_loop"): (1e-10, 1e-10),
    ("coulomb", "fixed_point"): (1e-4, 1.0),
    ("coulomb", "qp:osqp"): (1e-6, 1e-7),
}
FRICTION = {None: 0.0, "tresca": 0.05, "coulomb": 0.9}
IN_MILLIMETRES = {"size": 1e-3, "stress": 2e11}
ROWS = [
    (ElementQuadAdini, "bernstein"),
    (ElementQuadAdini, "gauss"),
    (ElementTriP2, "bernstein"),
    (ElementQuad1, "nodal"),
]


def difference(result, reference):
    return np.abs(result.u - reference.u).max() / np.abs(reference.u).max()


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("element", "functional"), ROWS)
@pytest.mark.parametrize(("law", "method"), OFFERED)
def test_agreement(law, method, element, functional, make):
    if method.startswith("qp:"):
        pytest.importorskip({"osqp": "osqp", "proxqp": "proxsuite"}[method[3:]])
    keys = {"law": law, "friction": FRICTION[law], "element": element, "functional": functional}
    _, reference = make.solved(**keys)
    _, result = make.solved(method, **keys)
    assert make.law_error(reference) < 1e-12
    away, violation = OFFERED[law, method]
    assert make.law_error(result) < violation
    assert difference(result, reference) < away


@pytest.mark.parametrize("method", ["pdas", "tresca_loop", "fixed_point"])
def test_agreement_in_other_units(method):
    """Millimetres and pascals; the fixed point is regularised by 1e-5 of the displacement."""
    here, there = (posed(ElementTriP2, Pose(np.eye(2), **at)) for at in ({}, IN_MILLIMETRES))
    ours, theirs = here[0].solve(), there[0].solve(method)
    off = np.abs(1e3 * theirs.u - ours.u).max()
    assert off < (1e-4 if method == "fixed_point" else 1e-9) * np.abs(ours.u).max()


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("law", "friction"), [("tresca", 0.2), ("coulomb", 0.9)])
def test_fixed_point_falls_to_the_solution_with_eps(law, friction, make):
    """The regularisation error is proportional to eps where points stick."""
    problem, reference = make.solved(law=law, friction=friction)
    widths = np.array([1e-3, 1e-4, 1e-5])
    errors = [
        difference(problem.solve("fixed_point", eps=eps, tol=1e-9), reference) for eps in widths
    ]
    assert np.all(np.diff(errors) < 0)
    assert errors[-1] < 1e-4
    # Order one, over three widths.
    assert 0.85 < np.polyfit(np.log(widths), np.log(errors), 1)[0] < 1.15


def energy_of(problem, u, g, eps):
    """J_eps written out: u' S u / 2 - f' u + sum g psi_eps(|u_t|), psi_eps of (4.11)."""
    slip = np.abs(problem.rows.T @ u)
    psi = np.where(slip >= eps, slip, slip**2 / (2 * eps) + eps / 2)
    return 0.5 * u @ problem.body.stiffness @ u - problem.body.f @ u + g @ psi


@pytest.fixture
def iterates(monkeypatch):
    """Solve by the fixed point; return the history and the displacement after every step."""

    def run(problem, **options):
        forces, step = [], methods.signorini

        def recorded(*args, **keys):
            forces.append(step(*args, **keys))
            return forces[-1]

        monkeypatch.setattr(methods, "signorini", recorded)
        history = problem.solve("fixed_point", **options).history
        condensed, load = problem.condense(), problem.system.load
        boundary = condensed.boundary_problem(load, problem.rows.gap)
        lines = [line for line in history if line.phase == "fixed point"]
        after = forces[-len(lines) :]  # the frictionless start comes first
        return lines, [condensed.recover(load, boundary, each)[0] for each in after]

    return run


def test_reported_energy_is_the_energy(iterates, make):
    """Differences of the history's energies are those of J_eps of the iterates."""
    eps, bound = 1e-3, 0.2  # some points stick, some slip
    problem, _ = make.solved(law="tresca", friction=bound)
    lines, u = iterates(problem, eps=eps, tol=1e-6)
    g = bound * problem.rows.weights
    reported = np.diff([line.energy for line in lines])
    recomputed = np.diff([energy_of(problem, each, g, eps) for each in u])
    assert reported[0] < 0
    assert reported.max() < 1e-15  # the energy never grows, but for rounding
    # Rounding of energies of order one.
    np.testing.assert_allclose(reported, recomputed, rtol=1e-6, atol=1e-14)


def test_dissertation_iteration_stopped_after_ten_steps(iterates, make):
    """Its least u_y then reads -.3116; converged it is -.31153."""
    problem, result = make.solved()
    _, u = iterates(problem, eps=1e-6, tol=1e-6)
    # The digits printed.
    assert round(float(u[9][1::6].min()), 4) == -0.3116
    assert abs(u[-1][1::6].min() + 0.311533) < 1e-5  # stopped at a change of 1e-6 a step
    assert abs(result.u[1::6].min() + 0.311533) < 2e-6


@pytest.mark.sampled(3)
@pytest.mark.parametrize("functional", ["bernstein", "gauss"])
@pytest.mark.parametrize("E", [1.0, 2.0, 5.0])
def test_three_digits_in_less_than_ten_steps(E, functional, iterates, make):
    """Of the nodal displacement of the body; that of the contact points alone takes longer."""
    problem, _ = make.solved(E=E, functional=functional)
    _, start = make.solved(E=E, functional=functional, friction=0.0)
    lines, u = iterates(problem, eps=1e-6)
    nodal = np.array([start.u, *u]).reshape(-1, u[0].size // 6, 6)[:, :, :2]
    moved = np.abs(np.diff(nodal, axis=0)).max(axis=(1, 2))
    change = moved / np.abs(nodal[1:]).max(axis=(1, 2))
    assert np.flatnonzero(change < 1e-3)[0] + 1 < 10
    # The history reports the change of the contact points' displacement, smaller than that of
    # the body in absolute terms but relative to a smaller displacement; three digits by 20 steps.
    assert next(line.step for line in lines if line.change < 1e-3) <= 20


@pytest.mark.parametrize("functional", ["bernstein", "gauss"])
@pytest.mark.parametrize(
    "n", [10, 40, *(pytest.param(n, marks=pytest.mark.slow) for n in (20, 64, 128))]
)
def test_monolithic_newton_steps(n, functional, make):
    """At most 8 steps after the frictionless start, or one on fewer points, whatever the mesh."""
    problem, seen = make.problem(n=n, functional=functional), []
    result = problem.solve(callback=seen.append)
    assert tuple(seen) == result.history
    phases = [line.phase for line in result.history]
    assert {phase.removeprefix("coarse ") for phase in phases} == {"frictionless", "newton"}
    assert phases.count("newton") <= 8
    assert phases == sorted(phases)  # the start comes first
    steps = [line.step for line in seen if line.phase == "newton"]
    assert steps == list(range(1, len(steps) + 1))
    assert result.history[-1].residual < 1e-12


@pytest.mark.parametrize("law", FRICTION)
@pytest.mark.parametrize("method", ["newton", "pdas"])
def test_warm_start(law, method, make):
    """From its own solution a method needs one step, and gives the same."""
    problem, cold = make.solved(method, law=law, friction=FRICTION[law])
    warm = problem.solve(method, start=cold)
    assert len(warm.history) <= min(2, len(cold.history))
    # Rounding times the condition of the body's stiffness.
    assert difference(warm, cold) < 1e-11


@pytest.mark.parametrize("method", ["newton", "pdas"])
def test_friction_without_contact(method, make):
    """(4.9): no obstacle, a given bound; agrees with its smoothed energy minimum."""
    problem = ContactProblem(make.block(8), "bottom", None, 0.03, "tresca")
    result = problem.solve(method)
    assert np.all(result.mu == 0)
    assert make.law_error(result) < 1e-11
    regularised = problem.solve("fixed_point", eps=1e-6, tol=1e-9)
    # A few eps against the largest displacement of order one.
    assert difference(regularised, result) < 1e-5


@pytest.mark.parametrize(
    ("friction", "law"), [(0.0, "coulomb"), (0.01, "tresca"), (0.3, "coulomb")]
)
def test_rows_that_depend_on_each_other(friction, law, make):
    """Two Gauss points an edge are one row too many where both ends are held along the normal.

    Forces are not unique, what they do to the body is.
    """
    body = make.block(4, ElementTriP2)
    problem = ContactProblem(body, "bottom", make.foundation[2], friction, law, functional="gauss")
    least = np.linalg.eigvalsh(problem.condense()._W)[:2]
    assert abs(least[0]) < 1e-14
    assert least[1] > 1e-3
    one, two = problem.solve(), problem.solve("pdas")
    for result in (one, two):
        assert make.law_error(result) < 1e-10
        assert max(result.kkt.values()) < 1e-10
    np.testing.assert_allclose(one.u, two.u, atol=1e-9 * np.abs(one.u).max())
    np.testing.assert_allclose(one.resultant, two.resultant, atol=1e-9 * one.contact_force)
    if friction < 0.3:
        other = cross_check(problem, one)
        # OSQP's polished accuracy.
        assert other.displacement < 1e-7
        assert other.objective < 1e-9


def test_rows_that_exclude_each_other():
    """A point between two obstacles that leave no room: u <= -1 and -u <= 0."""
    rows, none = np.array([[1.0], [-1.0]]), np.full((2, 1), -1)
    problem = BoundaryProblem(
        rows @ rows.T, np.zeros(2), np.zeros((2, 0)), np.zeros(0), np.array([-1.0, 0.0]),
        np.arange(2), none, np.zeros((2, 1)),
    )  # fmt: skip
    with pytest.raises(NotConverged, match="dependent contact rows"):
        signorini(problem)


COEFFICIENTS = [0.0, 0.3, 0.9, 1.5, 3.0]


def layered(n):
    """The block of `make.block` without a Basis: fine ones are quick to condense."""
    block = LayeredBlock(1.0, [(1.0, n, 2.0, 0.3)], sides="y", top="x")
    return block.load("top", (0.0, -1.0))


def with_friction(problem, friction):
    """The same problem, its condensation shared."""
    other = ContactProblem(problem.body, "bottom", 0.03, friction)
    other._condensed = problem._condensed
    return other


def full_size(result):
    """Steps with all contact points."""
    return sum(not line.phase.startswith("coarse") for line in result.history)


@pytest.fixture(scope="module")
def blocks():
    problems = [ContactProblem(layered(n), "bottom", 0.03) for n in (16, 32, 64, 128)]
    for problem in problems:
        problem.condense()
    return problems


@pytest.mark.sampled(3)
@pytest.mark.parametrize("friction", COEFFICIENTS)
def test_few_steps_at_any_size(blocks, friction):
    """Cold and nested, each mesh from the one before; both give the one solution."""
    coarse = None
    for block in blocks:
        problem = with_friction(block, friction)
        cold, nested = problem.solve(), problem.solve(start=coarse)
        assert full_size(cold) <= 12
        if coarse is not None:
            assert full_size(nested) == len(nested.history) <= 4
        # Newton's tolerance of 1e-12 times the condition of the boundary problem.
        assert np.abs(cold.mu - nested.mu).max() < 1e-9 * cold.mu.max()
        assert np.abs(cold.t - nested.t).max() < 1e-9 * cold.mu.max()
        coarse = nested


def test_coarse_start_spares_steps(blocks):
    """With all of its 258 points the finest block takes a few; the others are taken with fewer."""
    result = with_friction(blocks[-1], 3.0).solve()
    assert full_size(result) <= 3 < len(result.history)
    small = with_friction(blocks[0], 3.0).solve()
    assert full_size(small) == len(small.history)


def jaws(make, n):
    """A strip between two: the points of one are no neighbours of the other's."""
    mesh = make.box(ElementQuad1, np.linspace(0, 1, 8 * n + 1), np.linspace(0, 0.02, 2))
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3).fix("left", "x")
    gaps = [lambda x: 0.002 * x[0] - 0.001, lambda x: 0.001 - 0.002 * x[0]]
    return ContactProblem(body, ["bottom", "top"], gaps, 0.2)


def floating(make, n, friction):
    """Held by contact alone."""
    body = make.block(n, sides=()).load("left", (0.02, 0.0))
    return ContactProblem(body, "bottom", Parabola((0.5, -0.03), 4.0), friction)


def tilted_stamp(make, n, friction):
    ticks = np.linspace(0, 1, n + 1)
    mesh = make.box(ElementQuadAdini, ticks, ticks)
    body = ElasticBody.from_mesh(mesh, ElementQuadAdini(), E=2.0, nu=0.3).fix("top")
    stamp = Rigid(Plane((0, -5), (0, 1)), force=(None, 0.2), moment=0.01, centre=(0.5, 0))
    return ContactProblem(body, "bottom", stamp, friction)


# Sizes of the coarse and the fine problem, the largest count of steps, and how it is made.
NESTED = {
    "P2": (8, 16, 99, lambda m, n: m.problem(n, 0.6, element=ElementTriP2)),
    "Q1": (8, 16, 99, lambda m, n: m.problem(n, 0.6, element=ElementQuad1)),
    "Q2": (8, 16, 99, lambda m, n: m.problem(n, 0.6, element=ElementQuad2)),
    "space": (6, 9, 99, lambda m, n: m.dome(ElementHex1, n)),
    "jaws": (2, 4, 99, jaws),
    "floating": (12, 24, 4, lambda m, n: floating(m, n, 0.0)),
    "floating, rough": (12, 24, 4, lambda m, n: floating(m, n, 0.4)),
    "stamped": (12, 24, 4, lambda m, n: tilted_stamp(m, n, 0.0)),
    "stamped, rough": (12, 24, 4, lambda m, n: tilted_stamp(m, n, 0.4)),
}


@pytest.mark.parametrize("case", NESTED)
def test_start_from_a_coarser_mesh(case, make):
    """In space tractions turn along the boundary; motions of body and stamp are found too."""
    coarse, fine, most, made = NESTED[case]
    problem = made(make, fine)
    nested, cold = problem.solve(start=made(make, coarse).solve()), problem.solve()
    assert len(nested.history) <= min(most, len(cold.history) - (fine in (9, 16)))
    assert np.abs(cold.u - nested.u).max() < 1e-9 * np.abs(cold.u).max()


@pytest.mark.parametrize("element", [ElementQuad2, ElementTriP2, ElementQuadAdini])
def test_start_of_two_bodies_from_another_element(element):
    """Tractions go from contact point to contact point; the free punch is brought into touch."""
    coarse, problem = pair(friction=0.2).solve(), pair(element, friction=0.2)
    cold, nested = problem.solve(), problem.solve(start=coarse)
    assert len(nested.history) <= len(cold.history)
    assert np.abs(cold.u - nested.u).max() < 1e-11 * np.abs(cold.u).max()


SOLIDS = [ElementHex1, ElementTetP1]
IN_SPACE = [0.1, 0.3, 0.9, 3.0]


@pytest.fixture(scope="module")
def reference(make):
    """Problems and results of the default method."""

    @functools.cache
    def solve(element, friction, law="coulomb"):
        problem = make.dome(element, friction=friction, law=law)
        return problem, problem.solve()

    return solve


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("law", "friction", "method", "tol"),
    [
        # Certificates at 1e-10; the fixed point is regularised by 1e-5 of the displacement.
        *(("coulomb", F, m, 1e-10) for F in IN_SPACE for m in ("pdas", "tresca_loop")),
        *(("coulomb", F, "fixed_point", 1e-4) for F in IN_SPACE),
        *(("tresca", bound, "pdas", 1e-10) for bound in (0.001, 0.01, 0.1)),
    ],
)
@pytest.mark.parametrize("element", SOLIDS)
def test_methods_agree_in_space(law, friction, method, tol, element, reference):
    problem, expected = reference(element, friction, law)
    result = problem.solve(method)
    assert np.abs(result.u - expected.u).max() < tol * np.abs(expected.u).max()
    force = expected.mu.max()
    assert np.abs(result.mu - expected.mu).max() < 10 * tol * force
    assert np.abs(result.t - expected.t).max() < 100 * tol * force


@pytest.mark.parametrize("friction", [0.0, *IN_SPACE])
@pytest.mark.parametrize("element", SOLIDS)
def test_law_is_met_in_space(element, friction, reference, make):
    """Slip and stick both occur at F = .3."""
    _, result = reference(element, friction)
    assert np.count_nonzero(result.mu) >= 5
    assert max(result.kkt.values()) < 1e-10
    # Newton's tolerance on the condensed problem is 1e-12.
    assert make.law_error(result) < 1e-11
    # Rounding; the body has 75 to 225 dofs.
    assert np.abs(result.balance()["residual"]).max() < 1e-12
    assert np.abs(result.balance()["load"]).max() == 0.0
    assert result.resultant[2] > 0
    if (element, friction) == (ElementHex1, 0.3):
        assert {Status.OPEN, Status.STICK, Status.SLIP} == set(result.status)
