"""Contact rows that depend on each other: forces are not unique, what they do to the body is.

Two Gauss points on each edge of quadratic triangles are one row too many where both ends of the
contact boundary are held along its normal. `test_random_problems` repeats rows at random.
"""

import numpy as np
import pytest
from skfem import ElementTriP2

from contact import ContactProblem, cross_check
from contact.condensation.boundary_problem import BoundaryProblem
from contact.laws.active_set import signorini
from gpu import NotConverged


def gauss(make, friction, law):
    body = make.block(4, ElementTriP2)
    return ContactProblem(body, "bottom", make.foundation[2], friction, law, functional="gauss")


@pytest.mark.parametrize(
    ("friction", "law"), [(0.0, "coulomb"), (0.01, "tresca"), (0.3, "coulomb")]
)
def test_two_methods_agree(friction, law, make):
    problem = gauss(make, friction, law)
    least = np.linalg.eigvalsh(problem.condense()._W)[:2]
    # One row too many, to rounding.
    assert abs(least[0]) < 1e-14
    assert least[1] > 1e-3
    one, two = problem.solve(), problem.solve("pdas")
    for result in (one, two):
        assert make.law_error(result) < 1e-10
        assert max(result.kkt.values()) < 1e-10
    np.testing.assert_allclose(one.u, two.u, atol=1e-9 * np.abs(one.u).max())
    np.testing.assert_allclose(one.resultant, two.resultant, atol=1e-9 * one.contact_force)


@pytest.mark.parametrize(("friction", "law"), [(0.0, "coulomb"), (0.01, "tresca")])
def test_another_solver_agrees(friction, law, make):
    problem = gauss(make, friction, law)
    other = cross_check(problem, problem.solve())
    # OSQP's polished accuracy.
    assert other.displacement < 1e-7
    assert other.objective < 1e-9


def test_rows_that_exclude_each_other():
    """A point between two obstacles that leave no room: u <= -1 and -u <= 0."""
    rows = np.array([[1.0], [-1.0]])
    problem = BoundaryProblem(
        W=rows @ rows.T,
        v0=np.zeros(2),
        C=np.zeros((2, 0)),
        s=np.zeros(0),
        gap=np.array([-1.0, 0.0]),
        normal=np.arange(2),
        tangent=np.full((2, 1), -1),
        prescribed_slip=np.zeros((2, 1)),
    )
    with pytest.raises(NotConverged, match="dependent contact rows"):
        signorini(problem)
