"""Residuals that are small in the units of the problem, where its numbers are large."""

from fractions import Fraction

import numpy as np
import pytest
from scipy import sparse

from gpu import solve_qp
from gpu.qp.data.qp_problem import check_problem
from gpu.qp.interior_point.polish import PrimalDual, extended
from gpu.qp.last_digits import absolute, closed, last_digits, least_multipliers


def checked(P, q, G=None, h=None, A=None, b=None, lb=None, ub=None):
    problem = check_problem(P, q, G, h, A, b, lb, ub, None)
    return problem, problem.program


def transport(seed, n=40, m=12, size=1e4):
    """A linear program with large costs and a feasible point, the rows with a few entries each."""
    rng = np.random.default_rng(seed)
    A = sparse.random_array((m, n), density=0.3, rng=rng, format="csr")
    A.data[:] = np.round(10.0 * A.data, 1) + 1.0
    x = np.round(size * rng.random(n), 1)
    return sparse.csr_array((n, n)), np.round(size * rng.random(n), 2), A, A @ x, np.zeros(n)


def exact_gap(P, q, A, b, lb, x, y, z_box):
    """Sum of the terms in rational arithmetic: no rounding at all."""

    def dot(u, v):
        return sum((Fraction(float(a)) * Fraction(float(c)) for a, c in zip(u, v, strict=True)), 0)

    Px = [dot(row, x) for row in P.toarray()]
    quadratic = sum((Fraction(float(a)) * c for a, c in zip(x, Px, strict=True)), Fraction(0))
    return quadratic + dot(q, x) + dot(b, y) + dot(lb, np.minimum(z_box, 0.0))


@pytest.mark.parametrize("seed", range(8))
def test_large_costs_leave_small_absolute_residuals(seed):
    P, q, A, b, lb = transport(seed)
    result = solve_qp(P, q, A=A, b=b, lb=lb, polish="digits")
    x, y, z = result.x, result.y, result.z_box
    size = abs(q @ x)
    assert size > 1e7
    assert abs(A @ x - b).max() <= 1e-9
    assert abs(q + A.T @ y + z).max() <= 1e-9
    assert abs(x @ (P @ x) + q @ x + b @ y + lb @ np.minimum(z, 0.0)) <= 1e-9
    # Nor was more than rounding of the products made to cancel.
    gap = abs(float(exact_gap(P, q, A, b, lb, x, y, z)))
    assert gap <= 4 * np.finfo(float).eps * (abs(q) @ abs(x) + abs(b) @ abs(y))


@pytest.mark.skipif(
    np.finfo(np.longdouble).eps == np.finfo(float).eps, reason="no longer numbers here"
)
@pytest.mark.parametrize("n", [4, 5, 6, 7])
def test_extended_precision_has_digits_that_a_factorisation_loses(n):
    # Hilbert's matrix, condition numbers 2e4 to 5e8, and a solution of integers; every product
    # and every sum is below 2^53, hence exact.
    i = np.arange(n)
    A = np.round(1e12 / (1.0 + i + i[:, None]))
    x = np.arange(1.0, n + 1.0)
    _, p = checked(np.zeros((n, n)), np.zeros(n), A=A, b=A @ x)
    near = np.linalg.solve(A, A @ x)
    lost = abs(near - x).max()
    assert lost > 1e-13
    found = [t.x for t in extended(p, PrimalDual(near, np.zeros(n), np.zeros(n)))]
    assert min(abs(f - x).max() for f in found) <= 0.02 * lost


def test_least_multipliers_of_rows_that_depend_on_each_other():
    # x1 >= 1 three times, once as a bound: the force -2 is shared by all of them.
    G = np.array([[-1.0, 0.0], [-2.0, 0.0]])
    _, p = checked(np.eye(2), np.array([1.0, 0.0]), G, np.array([-1.0, -2.0]), lb=[1.0, -5.0])
    y, z = least_multipliers(p.stored_sparsely(), np.array([1.0, 0.0]), np.zeros(2), 1e-9)
    # The point of y1 + 2 y2 - z = 2 next to the origin.
    np.testing.assert_allclose([*y, *z], [2 / 6, 4 / 6, -2 / 6, 0.0], atol=1e-12)


def test_a_gap_is_closed_without_harm():
    P, q, A, b, lb = transport(3)
    problem, p = checked(P, q, A=A, b=b, lb=lb)
    result = solve_qp(P, q, A=A, b=b, lb=lb, polish="digits")
    y = result.y.copy()
    y[0] += 1e-7 / b[0]
    before = PrimalDual(result.x, y, result.z_box)
    after = closed(problem, p, before, 1e-9)
    assert abs(absolute(problem, before).gap) > 1e-9 >= absolute(problem, after).worst
    moved = [np.flatnonzero(a != c).size for a, c in zip(before, after, strict=True)]
    assert 1 <= sum(moved) <= 10


def test_multipliers_that_are_rounding_of_zero_are_zero():
    """The unconstrained minimum lies on the row: nothing pushes."""
    P, A = [[2.0, -2.0], [-2.0, 2.0]], [[1.0, 1.0]]
    result = solve_qp(P, [0.0, 0.0], A=A, b=[1.0], lb=0.0, polish="digits")
    assert result.x.tolist() == [0.5, 0.5]
    assert result.y.tolist() == [0.0]
    assert result.z_box.tolist() == [0.0, 0.0]


def test_small_multipliers_are_no_rounding_where_costs_are_small():
    """Beside a larger error of the rows their force looks like nothing in absolute residuals."""
    P, q, A, b = np.zeros((2, 2)), np.full(2, 1e-12), np.ones((1, 2)), np.zeros(1)
    problem, p = checked(P, q, A=A, b=b)
    t = PrimalDual(np.array([1e-9, 0.0]), np.array([-1e-12]), np.zeros(2))
    assert last_digits(problem, p, t, 1e-6).y.tolist() == [-1e-12]
