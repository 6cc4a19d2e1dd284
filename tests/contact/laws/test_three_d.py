"""Friction as a cone in three dimensions: methods agree, the law is met, frames do not matter."""

import functools

import numpy as np
import pytest
from skfem import ElementHex1, ElementTetP1

from contact import Status

ELEMENTS = [ElementHex1, ElementTetP1]
FRICTION = [0.1, 0.3, 0.9, 3.0]


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
        *(("coulomb", F, m, 1e-10) for F in FRICTION for m in ("pdas", "tresca_loop")),
        *(("coulomb", F, "fixed_point", 1e-4) for F in FRICTION),
        *(("tresca", bound, "pdas", 1e-10) for bound in (0.001, 0.01, 0.1)),
    ],
)
@pytest.mark.parametrize("element", ELEMENTS)
def test_methods_agree(law, friction, method, tol, element, reference):
    problem, expected = reference(element, friction, law)
    result = problem.solve(method)
    assert np.abs(result.u - expected.u).max() < tol * np.abs(expected.u).max()
    force = expected.mu.max()
    assert np.abs(result.mu - expected.mu).max() < 10 * tol * force
    assert np.abs(result.t - expected.t).max() < 100 * tol * force


@pytest.mark.parametrize("friction", [0.0, *FRICTION])
@pytest.mark.parametrize("element", ELEMENTS)
def test_law_is_met(element, friction, reference, make):
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
