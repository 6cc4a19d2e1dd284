"""Independent QP solvers find the same displacement, multipliers and energy."""

import importlib.util

import numpy as np
import pytest
from skfem import ElementHex1, ElementTriP2

from contact import ContactProblem, InputError, MissingDependency, cross_check
from skfem_adini import ElementQuadAdini

# Relative difference in u; interior-point methods lose digits in u, not in the energy.
SOLVERS = {"osqp": 1e-7, "proxqp": 1e-6, "piqp": 1e-4, "clarabel": 1e-3}
PACKAGES = {"proxqp": "proxsuite"}
PROBLEMS = {
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
    package = PACKAGES.get(request.param, request.param)
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    return request.param


@pytest.mark.sampled(2)
@pytest.mark.parametrize("condensed", [False, True], ids=["sparse", "condensed"])
@pytest.mark.parametrize("name", PROBLEMS)
def test_agreement(name, condensed, solver, make):
    problem, result = make.solved(**PROBLEMS[name])
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


def test_solid_without_friction(solver, make):
    problem = make.dome(ElementHex1, friction=0.0)
    check = cross_check(problem, problem.solve(), solver)
    # Interior-point tolerances are relative to an energy that prescribed values dominate.
    assert check.displacement <= SOLVERS[solver]
    assert check.objective <= 1e-8


@pytest.mark.parametrize("change", ["displacement", "multipliers", "bound"])
def test_a_wrong_result_is_seen(change, make):
    """A cross-check of a spoiled result does not agree."""
    from dataclasses import replace

    problem, result = make.solved()
    spoiled = {
        "displacement": lambda: replace(result, u=result.u * 1.01),
        "multipliers": lambda: replace(result, t=result.t * 1.01),
        "bound": lambda: replace(result, mu=result.mu * 1.01),
    }[change]()
    check = cross_check(problem, spoiled)
    assert max(check.displacement, check.multipliers) > 1e-3


def test_other_problem_is_seen(make):
    """The result of other material is no solution of this problem's condensed stiffness."""
    problem, _ = make.solved()
    _, other = make.solved(E=5.0)
    assert cross_check(problem, other, condensed=True).displacement > 1e-2


def test_unknown_solver(make):
    problem, result = make.solved()
    with pytest.raises(InputError, match="qpsolvers offers"):
        cross_check(problem, result, "no-such-solver")


def test_solver_that_is_not_installed(make, monkeypatch):
    import qpsolvers

    problem, result = make.solved()
    monkeypatch.setattr(qpsolvers, "available_solvers", ["osqp"])
    with pytest.raises(MissingDependency, match="pip install proxsuite"):
        cross_check(problem, result, "proxqp")


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
def test_friction_in_three_dimensions(law, make):
    problem = make.dome(ElementHex1, friction=0.01, law=law)
    with pytest.raises(InputError, match="3-D"):
        cross_check(problem, problem.solve())


def test_si_units(make):
    """Steel in pascal and metres: absolute tolerances of the peers must not matter."""
    body = make.block(8, ElementQuadAdini, E=2e11)
    body.f *= 1e11
    problem = ContactProblem(body, "bottom", make.foundation[2], 0.9)
    assert cross_check(problem, problem.solve(), "osqp").displacement <= 1e-7
