"""Other packages' QP solvers find the same displacement, forces and energy, in all units."""

from dataclasses import replace

import numpy as np
import pytest
from families import PLANE_AND_BFS, SOLID
from posed_pairs import Pose, posed
from pressed_pairs import PROBLEMS, pair, sandwich, stack
from skfem import ElementHex1, ElementHex2, ElementTetP2, ElementTriP2

from contact import (
    ContactProblem,
    ElasticBody,
    InputError,
    MissingDependency,
    Parabola,
    Plane,
    PressureOverclosure,
    Rigid,
    Status,
    cross_check,
)
from contact.laws.qp_peers import solve_with
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

quiet = pytest.mark.filterwarnings("ignore::contact.ContactWarning")
ways = pytest.mark.parametrize("condensed", [True, False], ids=["condensed", "sparse"])
# Relative difference in u; interior-point methods lose digits in u, not in the energy.
SOLVERS = {"osqp": 1e-7, "proxqp": 1e-6, "piqp": 1e-4, "clarabel": 1e-3}
PLANAR = {
    "frictionless": {"friction": 0.0},
    "tresca": {"friction": 0.05, "law": "tresca"},
    "tresca-sticking": {"friction": 0.2, "law": "tresca"},
    "coulomb-at-its-solution": {"friction": 0.9},
    "gauss-rows": {"friction": 0.9, "functional": "gauss"},
    "triangles": {"friction": 0.4, "element": ElementTriP2},
    "held-by-contact": {"friction": 0.0, "sides": ("left",)},
}


@pytest.fixture(params=SOLVERS)
def solver(request):
    pytest.importorskip({"proxqp": "proxsuite"}.get(request.param, request.param))
    return request.param


@pytest.mark.sampled(2)
@ways
@pytest.mark.parametrize("name", PLANAR)
def test_agreement(name, condensed, solver, make):
    problem, result = make.solved(**PLANAR[name])
    check = cross_check(problem, result, solver, condensed=condensed)
    assert check.solver == solver
    assert check.displacement <= SOLVERS[solver]
    # Multipliers are of the accuracy of u; ill-conditioned Gauss rows lose one digit more.
    assert check.multipliers <= 10 * SOLVERS[solver]
    assert check.objective <= 1e-8
    assert check.seconds > 0
    free = problem.body.constraint[0]
    unknowns = problem.condense().stiffness.shape[0] if condensed else free.shape[1]
    slacks = np.count_nonzero(result.system.bound(result.mu) > 0)
    assert unknowns <= check.size <= unknowns + slacks
    assert solver in str(check)


SPOILT = {
    "Adini": lambda make: make.problem(),
    "tie": lambda make: stack(),
    "soft": lambda make: pair(overclosure=50.0),
}


@pytest.mark.parametrize("what", ["u", "mu", "t"])
@pytest.mark.parametrize("name", SPOILT)
def test_a_spoiled_result_is_seen(name, what, make):
    problem = SPOILT[name](make)
    result = problem.solve()
    check = cross_check(problem, replace(result, **{what: 1.01 * getattr(result, what)}))
    assert check.verdict != "agrees"
    if name == "Adini":
        assert max(check.displacement, check.multipliers) > 1e-3


@pytest.mark.parametrize("change", ["friction", "overclosure"])
def test_the_result_of_another_problem_disagrees(change):
    """Of a pair with less friction or stiffness: its forces are no solution of this one."""
    values = {"friction": (0.3, 0.05), "overclosure": (50.0, 40.0)}[change]
    problem, other = (pair(**{change: value}) for value in values)
    wrong = replace(other.solve(), system=problem.solve().system)
    assert cross_check(problem, wrong).verdict == "disagrees"


def test_solver_that_is_not_installed(make, monkeypatch):
    import qpsolvers

    problem, result = make.solved()
    monkeypatch.setattr(qpsolvers, "available_solvers", ["osqp"])
    with pytest.raises(MissingDependency, match="pip install proxsuite"):
        cross_check(problem, result, "proxqp")


KINDS = ["open", "coulomb", "frictionless", "tresca"]
UNITS = [(1e-6, 1e12), (1e3, 1e-3)]  # length, modulus


def planar(element, kind, length, E, make):
    """A block in units of length and modulus; what is pressed, how, by the name of the kind."""
    ticks = np.linspace(0, length, 7)
    body = ElasticBody.from_mesh(make.box(element, ticks, ticks), element(), E=E, nu=0.3)
    floor = Plane((0, -0.03 * length), (0, 1))
    if kind == "driven":
        stamp = Rigid(
            Plane((0, -0.05 * length), (0, 1)),
            force=(None, 0.2 * E * length),
            moment=0.01 * E * length**2,
            centre=(0.5 * length, 0),
        )
        return ContactProblem(body.fix("top"), "bottom", stamp, 0.4)
    body.load("top", (0.0, -0.5 * E))
    if kind == "floating":
        bowl = Parabola((0.5 * length, -0.03 * length), 4.0 * length)
        return ContactProblem(body.load("left", (0.02 * E, 0.0)), "bottom", bowl, 0.4)
    body.fix("top", "x").fix(["left", "right"], "y")
    if kind == "open":
        body.f *= 1e-3
    friction = {"frictionless": 0.0, "tresca": 0.025 * E}.get(kind, 0.6)
    return ContactProblem(
        body, "bottom", floor, friction, "tresca" if kind == "tresca" else "coulomb"
    )


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("length", "E"), UNITS)
@pytest.mark.parametrize("kind", [*KINDS, "floating", "driven"])
@pytest.mark.parametrize("element", PLANE_AND_BFS)
def test_planar(element, kind, length, E, make):
    pytest.importorskip("osqp")
    problem = planar(element, kind, length, E, make)
    check = cross_check(problem, problem.solve())
    assert check.verdict == "agrees"
    # A polished solution is right to rounding times the condition of the boundary problem.
    assert max(check.displacement, check.multipliers, check.residual) < 1e-9
    assert check.ours < 1e-10
    assert "agrees" in str(check)


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("length", "E"), UNITS)
@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("element", [ElementHex1, ElementHex2, ElementTetP2, ElementHexAdini])
def test_spatial(element, friction, length, E, make):
    pytest.importorskip("clarabel")
    ticks = np.linspace(-length, length, 5 if element is ElementHex1 else 3)
    mesh = make.box(element, ticks, ticks, length * np.array([0.0, 0.4, 1.0]))
    body = ElasticBody.from_mesh(mesh, element(), E=E, nu=0.3)
    body.fix("top", "x", lambda x: 0.01 * length - 0.03 * x[1]).fix(
        "top", "y", lambda x: 0.03 * x[0]
    )
    body.fix("top", "z", -0.05 * length)
    problem = ContactProblem(
        body, "bottom", lambda x: 0.04 / length * (x[0] ** 2 + x[1] ** 2), friction
    )
    check = cross_check(problem, problem.solve(), "clarabel")
    assert check.verdict == "agrees"
    # An interior point method of tolerance 1e-13 on the energy: about half the digits in u.
    assert max(check.displacement, check.multipliers) < 1e-6


@pytest.mark.parametrize("element", [ElementQuadAdini, ElementQuadBFS, ElementTriP2])
def test_certificate_is_the_same_in_all_units(element, make):
    """Derivatives among the dofs grow as the length falls; they are no displacements."""
    spoiled = []
    for length in (1e-6, 1.0, 1e3):
        problem = planar(element, "coulomb", length, 1.0, make)
        result = problem.solve()
        dofs = result.system.body.basis.nodal_dofs[:2]
        u = result.u.copy()
        u[dofs] += 1e-3 * length * np.sin(np.arange(dofs.size)).reshape(dofs.shape)
        kkt = result.system.kkt(u, result.mu, result.t)
        spoiled.append([kkt[name] for name in ("penetration", "complementarity", "slip")])
    assert min(spoiled[1]) > 1e-4
    np.testing.assert_allclose(spoiled[0], spoiled[1], rtol=1e-6)
    np.testing.assert_allclose(spoiled[2], spoiled[1], rtol=1e-6)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("length", "E"), [(1.0, 2.0), (1e-3, 2e11)])
def test_qp_methods_in_all_units_and_where_nothing_touches(kind, solver, length, E, make):
    problem = planar(ElementQuadAdini, kind, length, E, make)
    theirs, ours = problem.solve(f"qp:{solver}"), problem.solve()
    size = ours.system.body.largest_displacement(ours.u)
    # The method's tolerance of 1e-7, loosely.
    assert ours.system.body.largest_displacement(theirs.u - ours.u) < 1e-5 * size
    assert (kind == "open") == (theirs.contact_force == 0.0)


def test_verdicts(make, monkeypatch):
    """A peer that gives up, one that stops early, and one that is right where we are not."""
    import importlib

    problem, result = make.solved()
    module = importlib.import_module("contact.checks.frozen_problem")
    assert cross_check(problem, replace(result, u=1.01 * result.u)).verdict == "disagrees"

    def gives_up(*program):
        solution, seconds = solve_with(*program)
        solution.x = None
        return solution, seconds

    def stops_early(*program):
        solution, seconds = solve_with(*program)
        solution.x = 1.001 * solution.x
        return solution, seconds

    for peer in (gives_up, stops_early):
        monkeypatch.setattr(module, "solve_with", peer)
        check = cross_check(problem, result)
        assert check.verdict == "the peer did not converge"
        assert not check.residual <= 1e-6
        assert check.ours < 1e-10
        assert "did not converge" in str(check)


@pytest.mark.sampled(3)
@ways
@pytest.mark.parametrize("name", PROBLEMS)
def test_osqp_agrees_on_several_bodies(name, condensed):
    problem = PROBLEMS[name]()
    check = cross_check(problem, problem.solve(), condensed=condensed)
    assert check.verdict == "agrees", check
    # OSQP polishes its solution; a millionth is what `verdict` asks for.
    assert max(check.displacement, check.multipliers) < 1e-9
    unknowns = sum(body.constraint[0].shape[1] for body in problem.body.bodies)
    assert (check.size >= unknowns) == (not condensed)


@quiet
@pytest.mark.sampled(4)
@ways
@pytest.mark.parametrize("element", SOLID)
def test_osqp_agrees_without_friction(element, condensed):
    problem, *_ = posed(element, Pose(np.eye(3)), friction=0.0)
    result = problem.solve()
    assert {Status.OPEN, Status.SLIP} == set(result.status)
    check = cross_check(problem, result, condensed=condensed)
    assert check.verdict == "agrees"
    assert max(check.displacement, check.multipliers) < 1e-9


# Straight, growing stiffer, growing softer, and one that begins before the surfaces touch.
LAWS = {
    "stiffness": 50.0,
    "stiffer": PressureOverclosure([0.0, 0.02, 0.5], [0.0, 0.01, 0.02]),
    "softer": PressureOverclosure([0.0, 0.03, 0.04], [0.0, 0.001, 0.01]),
    "coated": PressureOverclosure([0.0, 0.01, 0.02, 0.9], [-0.004, 0.001, 0.003, 0.1]),
}


@quiet
@pytest.mark.sampled(4)
@ways
@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("name", LAWS)
def test_osqp_agrees_on_tables(name, friction, condensed):
    problem = pair(friction=friction, overclosure=LAWS[name])
    result = problem.solve()
    check = cross_check(problem, result, condensed=condensed)
    assert check.verdict == "agrees", check
    assert max(check.displacement, check.multipliers, check.objective) < 1e-9
    # The pieces matter: most points are loaded, and those of a table lie on more than one.
    assert np.count_nonzero(result.pressure > 0) > 3


@quiet
@pytest.mark.sampled(2)
@ways
@pytest.mark.parametrize("element", [ElementHex1, ElementTetP2], ids=lambda e: e.__name__)
def test_ties_in_space(element, condensed):
    problem = sandwich(element, 0.0)
    result = problem.solve()
    check = cross_check(problem, result, condensed=condensed)
    assert check.verdict == "agrees", check
    assert np.any(result.mu[problem.rows.ties] != 0.0)


@quiet
def test_the_exponential_law_is_refused_by_name():
    problem = pair(overclosure=PressureOverclosure.exponential(1.0, 0.01))
    with pytest.raises(InputError, match=r"^result: it has compliant surfaces with an exponential"):
        cross_check(problem, problem.solve())
