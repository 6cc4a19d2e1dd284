"""Friction in 3-D against Clarabel's second-order cones."""

import numpy as np
import pytest
from skfem import ElementHex1, ElementHex2, ElementTetP2

from contact import (
    ContactProblem,
    ElasticBody,
    InputError,
    LoadStepper,
    Rigid,
    Sphere,
    Status,
    cross_check,
)
from skfem_adini import ElementHexAdini

pytest.importorskip("clarabel")


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


def test_cones_see_a_wrong_result(make):
    """The comparison fails for another friction bound."""
    problem, other = (make.dome(ElementHex1, friction=g, law="tresca") for g in (0.003, 0.01))
    check = cross_check(problem, other.solve(), "clarabel")
    # The cones are solved with the result's own bound: compare the true problem's solution.
    assert check.displacement < 1e-4
    assert np.abs(problem.solve().u - other.solve().u).max() > 1e-3 * np.abs(other.solve().u).max()


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


def test_other_solvers_have_no_cones(make):
    problem = make.dome(ElementHex1)
    with pytest.raises(InputError, match="clarabel"):
        cross_check(problem, problem.solve(), "osqp")
