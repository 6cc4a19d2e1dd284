"""Friction of two bodies in space against Clarabel's cones, and without it against OSQP."""

from dataclasses import replace

import numpy as np
import pytest
from families import SOLID
from posed_pairs import Pose, posed

from contact import Status, cross_check

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")
elements = pytest.mark.parametrize("element", SOLID, ids=lambda e: e.__name__)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("condensed", [True, False])
@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@elements
def test_cones_agree(element, law, condensed):
    pytest.importorskip("clarabel")
    problem, *_ = posed(element, Pose(np.eye(3)), law=law)
    result = problem.solve()
    assert Status.SLIP in result.status
    check = cross_check(problem, result, "clarabel", condensed=condensed)
    assert check.verdict == "agrees"
    # An interior point method of tolerance 1e-11 on the energy: half the digits.
    assert check.objective < 1e-8
    assert check.displacement < 1e-4
    assert check.multipliers < 1e-3


@pytest.mark.sampled(4)
@pytest.mark.parametrize("condensed", [True, False])
@elements
def test_osqp_agrees_without_friction(element, condensed):
    problem, *_ = posed(element, Pose(np.eye(3)), friction=0.0)
    result = problem.solve()
    assert {Status.OPEN, Status.SLIP} == set(result.status)
    check = cross_check(problem, result, condensed=condensed)
    assert check.verdict == "agrees"
    assert max(check.displacement, check.multipliers) < 1e-9


def test_the_result_of_another_bound_disagrees():
    pytest.importorskip("clarabel")
    problem, *_ = posed(SOLID[2], Pose(np.eye(3)), law="tresca")
    other, *_ = posed(SOLID[2], Pose(np.eye(3)), friction=0.2)
    wrong = replace(other.solve(), system=problem.solve().system)
    # Of the dense program rounding decides whether Clarabel ends at a residual of 1e-8 or 1e-6.
    check = cross_check(problem, wrong, "clarabel", condensed=False)
    assert check.verdict == "disagrees"
