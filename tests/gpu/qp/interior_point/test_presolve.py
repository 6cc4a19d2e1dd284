"""What presolve takes out comes back: multipliers of rows that bounds or single rows decide."""

import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import linprog

from gpu import Infeasible, InputError, NotConverged, QPFactor, Status, solve_qp
from gpu.qp.data.standard_qp import StandardQP, residuals
from gpu.qp.interior_point.minimise import minimise
from gpu.qp.interior_point.presolve import presolve

INF = np.inf


def program(C, low, high, lb, ub, q, P=None):
    n = len(q)
    P = np.zeros((n, n)) if P is None else P
    return StandardQP(P, *(np.asarray(v, dtype=float) for v in (q, C, low, high, lb, ub)))


def kkt(p, x, y):
    """Violations by the definition: a multiplier needs its side, a force its bound."""
    force = -(p.P @ x + p.q + p.C.T @ y)
    value = p.C @ x
    rows = np.where(y > 0, p.row_high - value, np.where(y < 0, value - p.row_low, 0.0))
    bounds = np.where(force > 1e-11, p.ub - x, np.where(force < -1e-11, x - p.lb, 0.0))
    outside = np.maximum(np.maximum(p.row_low - value, value - p.row_high), 0.0)
    return max(abs(rows).max(), abs(bounds).max(), outside.max())


@pytest.mark.parametrize(
    ("C", "low", "high", "lb", "q", "P", "x", "y"),
    [
        # A row of one entry is a bound with a multiplier.
        ([[0, -2], [1, 1]], [-6, 0], [INF, 9], 0, [1, -4], 0, [0, 3], [-2, 0]),
        # Of parallel rows it goes to the one with the side: x1 + 2 x2 <= 2 by the second.
        ([[1, 2], [-3, -6], [0.5, 1]], [-INF, -6, -INF], [4, INF, 3], -INF, [-1, -1], 1,
         [0.8, 0.6], [0, -1 / 15, 0]),
        # x1 + x2 <= 0 within x >= 0 fixes both, whose multipliers have no upper bound.
        ([[1, 1, 0], [1, 0, 1]], [-INF, 1], [0, 1], 0, [-5, -7, 1], 0, [0, 0, 1], None),
    ],
)  # fmt: skip
def test_what_presolve_takes_out_comes_back(C, low, high, lb, q, P, x, y):
    n = len(q)
    p = program(C, low, high, np.full(n, lb), np.full(n, INF), q, P * np.eye(n))
    small = presolve(p)
    assert small.rows.size < len(low) or not small.free.size
    point = minimise(p, 1e-9)
    np.testing.assert_allclose(point.x, x, atol=1e-12)
    if y:
        np.testing.assert_allclose(point.y, y, atol=1e-12)
    assert kkt(p, point.x, point.y) < 1e-11


@pytest.mark.parametrize("store", [np.asarray, sparse.csr_array])
@pytest.mark.parametrize("seed", range(25))
def test_chains_of_reductions_against_highs(seed, store):
    rng = np.random.default_rng([11, seed])
    n = 12
    C = rng.integers(-2, 3, (9, n)).astype(float)
    C[0] = 0.0
    C[0, rng.integers(n)] = rng.choice([-2.0, 1.0, 3.0])
    C[1, rng.random(n) < 0.7] = 0.0
    C[2] = -2.0 * C[3]
    C[4] = abs(C[4])
    lb, ub = np.zeros(n), np.where(rng.random(n) < 0.5, 4.0, INF)
    x = np.where(C[4] > 0.0, 0.0, np.where(rng.random(n) < 0.3, 0.0, rng.random(n)))
    high = C @ x + np.where(rng.random(9) < 0.5, 0.0, rng.random(9))
    high[4] = 0.0  # forces every variable with an entry to zero
    low = np.full(9, -INF)
    low[5] = high[5] = C[5] @ x
    q = rng.exponential(1.0, n) - 0.3 * (ub < INF)
    p = program(C, low, high, lb, ub, q)
    stored = StandardQP(store(p.P), p.q, store(p.C), low, high, lb, ub)
    assert presolve(stored).free.size < n
    point = minimise(stored, 1e-9)
    other = linprog(
        q, C[low != high], high[low != high], C[5:6], high[5:6],
        bounds=np.stack([lb, ub], axis=1), method="highs",
    )  # fmt: skip
    assert q @ point.x == pytest.approx(other.fun, abs=1e-8)
    assert kkt(p, point.x, point.y) < 1e-8


def test_contradictions_that_presolve_meets_are_proved():
    for C, low, high in (
        ([[1.0, 0.0], [2.0, 0.0]], [2.0, -INF], [INF, 1.0]),  # x1 >= 2 and 2 x1 <= 1
        ([[1.0, 1.0], [1.0, 1.0]], [2.0, -INF], [INF, 1.0]),
        ([[1.0, 1.0], [1.0, -1.0]], [-INF, 1.0], [0.0, INF]),  # x = 0 by the first row
    ):
        with pytest.raises(Infeasible) as caught:
            solve_qp(np.zeros((2, 2)), [1.0, 1.0], C, high, lb=0.0, h_low=low)
        y = caught.value.certificate
        most = sum(max(c, 0.0) * 1e30 for c in np.round(np.asarray(C).T @ y, 9))
        side = np.where(y > 0, low, np.where(y < 0, high, 0.0))
        assert most < y @ side


@pytest.mark.parametrize("store", [np.asarray, sparse.csr_array])
@pytest.mark.parametrize("others", [0, 3])
def test_no_row_of_large_numbers_hides_a_contradiction_of_fixed_variables(store, others):
    """The third row is off by a thousandth of itself, and by 1e-10 of the first."""
    n = 2 + others
    A = np.zeros((3, n))
    A[:2], A[2, :2] = np.random.default_rng(0).standard_normal((2, n)), [2e-9, -1e-9]
    x = np.r_[-900.0, 300.0, np.ones(others)]
    lb, ub = x - np.r_[0.0, 0.0, np.ones(others)], x + np.r_[0.0, 0.0, np.ones(others)]
    P, b = np.eye(n), A @ x
    assert solve_qp(store(P), -x, A=store(A), b=b, lb=lb, ub=ub).x == pytest.approx(x)
    b[2] *= 1.001
    with pytest.raises(Infeasible) as caught:
        solve_qp(store(P), -x, A=store(A), b=b, lb=lb, ub=ub)
    y = caught.value.certificate
    c = A.T @ y
    assert c @ np.where(c > 0, ub, lb) < y @ b


def test_a_side_of_rounding_contradicts_no_fixed_variable():
    """As in QPILOTNO, whose row of five variables fixed at zero has the side -2e-16."""
    result = solve_qp(np.eye(2), [0.0, -1.0], A=[[2.0, 0.0]], b=[-2e-16], lb=[0, -5], ub=[0, 5])
    assert result.x == pytest.approx([0.0, 1.0])


def test_nearly_contradicting_rows_of_far_points_are_no_proof():
    # x1 - x2 <= 0 and x1 - (1 - 1e-9) x2 >= 1e-3 meet at x2 = 1e6.
    C, low = [[1.0, -1.0], [1.0, -(1.0 - 1e-9)]], [-INF, 1e-3]
    try:
        result = solve_qp(np.zeros((2, 2)), [1.0, 1.0], C, [0.0, INF], h_low=low)
    except NotConverged:
        return
    assert result.x[1] == pytest.approx(1e6, rel=1e-2)


def test_large_multipliers_do_not_hide_a_gap():
    # Multipliers of 1e12 that cancel: y'r and z'b are large, the objective is not.
    p = program([[1.0, 1.0]], [0.0], [0.0], [0.0, 0.0], [INF, INF], [1.0, 1.0])
    wide = StandardQP(
        p.P, p.q + 1.0, p.C, p.row_low + 2.0, p.row_high + 2.0, p.lb + 1.0 - 1e-3, p.ub
    )
    x, big = np.array([1.0, 1.0]), 1e12
    y = np.array([big])
    z = -(wide.q + y)
    assert residuals(wide, x, y, z).gap > 1e-4


def test_a_covariance_of_five_digits_is_nearly_convex():
    rng = np.random.default_rng(3)
    M = rng.standard_normal((40, 15))
    P = np.round(M @ M.T / 15, 5)
    assert np.linalg.eigvalsh(P)[0] < -1e-6
    assert QPFactor(P).nearly_convex
    for matrix in (P, sparse.csr_array(P)):
        result = solve_qp(matrix, np.zeros(40), A=np.ones((1, 40)), b=[1.0], lb=0.0, ub=0.2)
        assert result.status is Status.NEARLY
        step = result.x - (P @ result.x + result.y[0])
        np.testing.assert_allclose(np.clip(step, 0.0, 0.2), result.x, atol=1e-9)
    with pytest.raises(InputError, match="not positive semidefinite"):
        solve_qp(P - 1e-3 * np.eye(40), np.zeros(40), lb=0.0, ub=1.0)


@pytest.mark.parametrize("stored", [np.asarray, sparse.csr_array], ids=["dense", "sparse"])
def test_multipliers_that_grow_from_reduction_to_reduction(stored):
    """x_i <= 1e4 x_{i-1} holds all x at zero with multipliers up to 1e28, their sum with a few."""
    n = 8
    G = np.zeros((n + 2, n + 1))
    G[:n, :n] = np.eye(n) - 1e4 * np.eye(n, k=-1)
    G[n, n - 1 :] = -0.5, -1.0
    G[n + 1] = 1.0
    result = solve_qp(
        stored(np.zeros((n + 1, n + 1))), np.append(-np.ones(n), 0.0), stored(G), np.zeros(n + 2),
        lb=np.append(np.zeros(n), -np.inf),
    )  # fmt: skip
    assert not result.x.any()
    assert abs(result.z).max() < 1e4
    assert result.kkt.worst < 1e-12
