"""Every method of the table gives the same solution, in the number of steps that is claimed."""

import numpy as np
import pytest
from skfem import ElementQuad1, ElementTriP2

from contact import ContactProblem, Plane, Rigid, cross_check
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


@pytest.mark.sampled(4)
@pytest.mark.parametrize("eps", [1e-2, 1e-4])
@pytest.mark.parametrize("bound", [0.02, 0.05, 0.2])
@pytest.mark.parametrize("functional", ["bernstein", "gauss"])
def test_energy_falls_at_every_step(functional, bound, eps, make):
    """J_eps of (4.12) with a fixed bound never grows, and falls while the iterate moves."""
    problem, _ = make.solved(law="tresca", friction=bound, functional=functional)
    history = problem.solve("fixed_point", eps=eps, tol=1e-8).history
    energy = np.array([line.energy for line in history if line.phase == "fixed point"])
    change = np.array([line.change for line in history if line.phase == "fixed point"])
    assert energy.size >= 3
    # Rounding of an energy of order .01, of which the QP is solved to 1e-12.
    assert np.diff(energy).max() < 1e-15
    assert np.all(np.diff(energy)[change[1:] > 1e-5] < 0)


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


def stamped(make, n, friction, force):
    """A plane five units away, driven against a block by a force and a moment."""
    stamp = Rigid(Plane((0, -5), (0, 1)), force=(None, force), moment=0.05 * force, centre=(0.5, 0))
    body = make.block(n, sides=())
    body.f[:] = 0.0
    return ContactProblem(body.fix("top"), "bottom", stamp, friction)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("friction", [0.1, 0.25, 0.4, 0.9])
@pytest.mark.parametrize("n", [6, 12, 20])
def test_driven_stamp_takes_few_steps(n, friction, make):
    """Displacements of five cancel in gaps of 1e-2: the floor is near the tolerance of 1e-12."""
    problem = stamped(make, n, friction, 0.2)
    result = problem.solve()
    assert len(result.history) <= 14
    assert result.history[-1].residual <= 1e-12
    assert len(problem.solve(start=result).history) <= 3
