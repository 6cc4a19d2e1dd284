"""Bonded points and compliant surfaces are handed to another package's solver as well."""

from dataclasses import replace

import numpy as np
import pytest
from families import SOLID
from posed_pairs import Pose, posed
from pressed_pairs import pair, stack
from skfem import ElementHex1, ElementQuad2, ElementTetP2
from solid_boxes import box

from contact import ContactProblem, InputError, Pair, PressureOverclosure, Tie, cross_check

pytestmark = pytest.mark.filterwarnings("ignore::contact.ContactWarning")
ways = pytest.mark.parametrize("condensed", [True, False], ids=["condensed", "sparse"])
# Straight, growing stiffer, growing softer, and one that begins before the surfaces touch.
LAWS = {
    "stiffness": 50.0,
    "stiffer": PressureOverclosure([0.0, 0.02, 0.5], [0.0, 0.01, 0.02]),
    "softer": PressureOverclosure([0.0, 0.03, 0.04], [0.0, 0.001, 0.01]),
    "coated": PressureOverclosure([0.0, 0.01, 0.02, 0.9], [-0.004, 0.001, 0.003, 0.1]),
}


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


@ways
def test_osqp_agrees_on_a_law_for_each_pair(condensed):
    problem = stack()
    problem.overclosure = [50.0, None, 20.0]
    check = cross_check(problem, problem.solve(), condensed=condensed)
    assert check.verdict == "agrees", check


@ways
def test_units_do_not_matter(condensed):
    small = pair(ElementQuad2, size=1e-3, E=2.1e11, overclosure=1e13)
    assert cross_check(small, small.solve(), condensed=condensed).verdict == "agrees"


@pytest.mark.sampled(3)
@ways
@pytest.mark.parametrize("element", SOLID, ids=lambda e: e.__name__)
def test_clarabel_agrees_on_compliant_surfaces_in_space(element, condensed):
    pytest.importorskip("clarabel")
    problem, *_ = posed(element, Pose(np.eye(3)), overclosure=100.0)
    check = cross_check(problem, problem.solve(), "clarabel", condensed=condensed)
    assert check.verdict == "agrees", check


def sandwich(element, friction):
    """Three boxes: friction above, a tie below, pushed aside and down."""
    top = box(element, (2, 2, 1), (0.1, 0.1, 1.0), (0.8, 0.8, 0.5))
    middle = box(element, (3, 3, 1), (0.0, 0.0, 0.5), (1.0, 1.0, 0.5))
    low = box(element, (2, 2, 1), (0.0, 0.0, 0.0), (1.0, 1.0, 0.5))
    low.fix("bottom", "xyz")
    top.fix("top", "x", 0.005).fix("top", "y", 0.002).fix("top", "z", -0.01)
    pairs = [Pair(top, "bottom", middle, "top", friction=friction)]
    return ContactProblem([top, middle, low], [*pairs, Tie(middle, "bottom", low, "top")])


@pytest.mark.sampled(2)
@ways
@pytest.mark.parametrize("element", [ElementHex1, ElementTetP2], ids=lambda e: e.__name__)
def test_ties_in_space(element, condensed):
    problem = sandwich(element, 0.0)
    result = problem.solve()
    check = cross_check(problem, result, condensed=condensed)
    assert check.verdict == "agrees", check
    assert np.any(result.mu[problem.rows.ties] != 0.0)


@ways
def test_ties_beside_friction_in_space(condensed):
    pytest.importorskip("clarabel")
    problem = sandwich(ElementHex1, 0.1)
    check = cross_check(problem, problem.solve(), "clarabel", condensed=condensed)
    assert check.displacement < 1e-6, check
    assert check.multipliers < 1e-4, check


@pytest.mark.parametrize("make", [stack, lambda: pair(overclosure=50.0)], ids=["tie", "soft"])
@pytest.mark.parametrize("what", ["u", "mu", "t"])
def test_a_spoiled_result_is_seen(make, what):
    problem = make()
    result = problem.solve()
    spoiled = replace(result, **{what: 1.01 * getattr(result, what)})
    check = cross_check(problem, spoiled)
    assert check.verdict != "agrees"


def test_the_result_of_another_stiffness_disagrees():
    problem, other = pair(overclosure=50.0), pair(overclosure=40.0)
    wrong = replace(other.solve(), system=problem.solve().system)
    assert cross_check(problem, wrong).verdict == "disagrees"


def test_the_exponential_law_is_refused_by_name():
    problem = pair(overclosure=PressureOverclosure.exponential(1.0, 0.01))
    with pytest.raises(InputError, match=r"^result: it has compliant surfaces with an exponential"):
        cross_check(problem, problem.solve())
