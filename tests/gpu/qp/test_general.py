"""Rows, semidefinite and sparse matrices, sequences, certificates, and the door to qpsolvers."""

import numpy as np
import pytest
import qpsolvers
from scipy import sparse
from scipy.optimize import linprog

from gpu import (
    GpuError,
    Infeasible,
    InputError,
    NotConverged,
    QPFactor,
    Unbounded,
    batch_solve_qp,
    register_qpsolvers,
    solve_qp,
)
from gpu.qp.data.budget import Budget
from gpu.qp.data.qp_problem import check_problem
from gpu.qp.solve_qp import _proximal

Q, ROW = np.array([1.0, -1.0]), {"A": [[1.0, 1.0]], "b": [1.0]}


def random(seed, n=30, l=20, m=4):
    rng = np.random.default_rng(seed)
    M = rng.standard_normal((n, n))
    G, A, x = rng.standard_normal((l, n)), rng.standard_normal((m, n)), rng.standard_normal(n)
    return M @ M.T / n + 0.1 * np.eye(n), rng.standard_normal(n), G, G @ x + 0.1, A, A @ x


def test_closed_forms():
    """A projection onto a half space, signs of multipliers, sides that count as infinite."""
    result = solve_qp(np.eye(2), [-2.0, -2.0], G=[[1.0, 1.0]], h=1.0)
    np.testing.assert_allclose(result.x, [0.5, 0.5], atol=1e-15)
    np.testing.assert_allclose(result.z, [1.5], atol=1e-15)
    np.testing.assert_array_equal(result.active_rows, [1])
    result = solve_qp(np.eye(2), [3.0, -3.0], G=np.eye(2), h=1.0, h_low=-2.0)
    np.testing.assert_allclose(result.x, [-2.0, 1.0])
    np.testing.assert_allclose(result.z, [-1.0, 2.0])
    result = solve_qp(np.eye(2), [1.0, 1.0], G=np.eye(2), h=1e20, h_low=-1e20, lb=-1e30, ub=1e25)
    np.testing.assert_allclose(result.x, [-1.0, -1.0])
    result = solve_qp(np.eye(2), Q, A=[[1.0, 1.0], [0.0, 0.0], [2.0, 2.0]], b=[1.0, 0.0, 2.0])
    np.testing.assert_allclose(result.x, [-0.5, 1.5], atol=1e-14)
    result = solve_qp(np.eye(3), np.ones(3), A=np.eye(3)[:2], b=[1.0, 0.0], lb=0.0, ub=1.0)
    np.testing.assert_allclose(result.x, [1.0, 0.0, 0.0], atol=1e-15)
    asymmetric = np.array([[2.0, 1.0], [1.0 + 1e-13, 2.0]])
    np.testing.assert_allclose(solve_qp(asymmetric, Q).x, [-1.0, 1.0], rtol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_storage_equal_sides_and_scales_do_not_matter(seed):
    P, q, G, h, A, b = data = random(seed)
    one = solve_qp(*data)
    two = solve_qp(P, q, np.vstack([G, A]), np.r_[h, b], h_low=np.r_[np.full(20, -np.inf), b])
    np.testing.assert_allclose(one.x, two.x, atol=1e-12)
    np.testing.assert_allclose(one.y, two.z[20:], atol=1e-11)
    stored = [sparse.csc_matrix(v) if v.ndim == 2 else v for v in data]
    np.testing.assert_allclose(solve_qp(*stored).x, one.x, atol=1e-10)
    for cost, row in ((1e-6, 1e6), (1e6, 1e-6)):
        two = solve_qp(cost * P, cost * q, row * G, row * h, row * A, row * b)
        np.testing.assert_allclose(two.x, one.x, atol=1e-11)
        np.testing.assert_allclose(two.z, one.z * cost / row, rtol=1e-9, atol=1e-9 * cost / row)


@pytest.mark.parametrize("seed", range(5))
def test_linear_programs_against_highs(seed):
    rng = np.random.default_rng(seed)
    n, l = 40, 25
    G, q = rng.random((l, n)), -rng.random(n)
    h = G.sum(axis=1)
    result = solve_qp(np.zeros((n, n)), q, G, h, lb=0.0, ub=3.0)
    other = linprog(q, G, h, bounds=(0.0, 3.0), method="highs")
    assert q @ result.x == pytest.approx(other.fun, rel=1e-10)
    assert result.path == "interior point"
    assert result.kkt.gap < 1e-9


def test_the_gap_of_a_box_problem_is_recomputed():
    P, q = np.eye(2), [-2.0, 1.0]
    result = solve_qp(P, q, lb=0.0)
    assert result.kkt.gap == 0.0
    # With other bounds x = (2, 0) and z = (0, -1) leave x'Px + q'x + z'lb = 4 - 4 + 1.
    assert result.residuals(P, q, lb=-1.0).gap == pytest.approx(1.0 / 9.0)


@pytest.mark.parametrize("seed", range(4))
def test_proximal_points_reach_singular_boxes_at_1e_12(seed):
    rng = np.random.default_rng(seed)
    B = rng.standard_normal((8, 12))[rng.integers(0, 8, 14)]  # rows that return
    P, q = B @ B.T, -B @ rng.standard_normal(12)
    ub = rng.exponential(1.0, 14)
    found = _proximal(check_problem(P, q, None, None, None, None, -ub, ub, None), 1e-12, Budget())
    assert not QPFactor(P).definite
    # The definition, not the solver's residuals: a projected gradient step leads nowhere.
    step = np.clip(found.x - (P @ found.x + q), -ub, ub)
    np.testing.assert_allclose(step, found.x, rtol=0, atol=1e-10)
    # Forces of rows that return are not unique, what they do together is.
    np.testing.assert_allclose(
        B.T @ solve_qp(P, q, lb=-ub, ub=ub, tol=1e-12).x, B.T @ found.x, atol=1e-9
    )


def test_warm_starts_take_one_step():
    P, q, G, h, A, b = random(2)
    factor = QPFactor(P)
    cold = solve_qp(factor, q, G, h, A, b)
    again = solve_qp(factor, q, G, h, A, b, start=cold)
    assert (cold.path, again.path) == ("active set", "active set")
    assert again.iterations == 1 < cold.iterations
    np.testing.assert_allclose(again.x, cold.x, atol=1e-13)


def test_batch_equals_single_solves():
    P, q, G, h, A, b = random(3)
    rng = np.random.default_rng(4)
    many = q + 0.1 * rng.standard_normal((6, q.size))
    results = batch_solve_qp(P, many, G, [h] * 6, A, [b] * 6)
    for one, result in zip(many, results, strict=True):
        np.testing.assert_allclose(result.x, solve_qp(P, one, G, h, A, b).x, atol=1e-10)
    with pytest.raises(InputError, match="h has 2 rows"):
        batch_solve_qp(P, many, G, [h] * 2)
    batch = batch_solve_qp([[1.0]], [[0.0], [0.0]], [[1.0], [-1.0]], [[1.0, 1.0], [-1.0, -1.0]])
    assert isinstance(batch.errors[1], Infeasible)


def test_qpsolvers_knows_the_name():
    register_qpsolvers()
    register_qpsolvers()
    assert qpsolvers.available_solvers.count("pdas") == 1
    problem = qpsolvers.Problem(*random(5))
    solution = qpsolvers.solve_problem(problem, "pdas")
    assert solution.is_optimal(1e-9)
    nothing = qpsolvers.Problem(np.eye(1), np.zeros(1), np.array([[1.0], [-1.0]]), -np.ones(2))
    lost = qpsolvers.solve_problem(nothing, "pdas", tol=1e-8)
    with pytest.raises(InputError, match=r"eps_abs: .*knows h_low, host_below, start, tol"):
        qpsolvers.solve_problem(problem, "pdas", eps_abs=1e-9)
    assert not lost.found
    assert isinstance(lost.extras["error"], GpuError)


@pytest.mark.parametrize("P", [np.zeros((2, 2)), np.ones((2, 2))], ids=["zero", "singular"])
def test_semidefinite_and_unbounded(P):
    with pytest.raises(Unbounded) as caught:
        solve_qp(P, Q)
    ray = caught.value.ray
    assert Q @ ray < 0
    np.testing.assert_allclose(P @ ray, 0.0, atol=1e-12)


def test_empty_rows_and_boxes():
    with pytest.raises(Infeasible, match=r"h_low\[1\] = 2.0 is above h\[1\] = 1.0"):
        solve_qp(np.eye(2), Q, G=np.eye(2), h=1.0, h_low=[0.0, 2.0])
    with pytest.raises(Infeasible, match=r"lb\[1\] = 2.0 is above ub\[1\] = 1.0") as caught:
        solve_qp(np.eye(2), Q, lb=[0.0, 2.0], ub=1.0, **ROW)
    np.testing.assert_array_equal(caught.value.certificate, [0.0])


@pytest.mark.parametrize(
    ("A", "b", "lb", "ub"),
    [
        ([[1.0, 1.0]], [3.0], 0.0, 1.0),
        ([[1.0, 1.0]], [-1e-6], 0.0, np.inf),
        ([[1.0, -1.0], [2.0, -2.0]], [1.0, 1.0], -np.inf, np.inf),
        ([[0.0, 0.0]], [1.0], -np.inf, np.inf),
        ([[1.0, 0.0], [1.0, 1.0]], [0.5, 0.1], 0.0, np.inf),
        ([[1e9, 1e9]], [3e9], 0.0, 1.0),
    ],
)
def test_infeasible_rows_come_with_a_separating_vector(A, b, lb, ub):
    with pytest.raises(Infeasible) as caught:
        solve_qp(np.eye(2), Q, A=A, b=b, lb=lb, ub=ub)
    y = caught.value.certificate
    c = np.transpose(A) @ y
    c[np.abs(c) < 1e-12 * np.abs(y).max() * np.abs(A).max()] = 0.0
    corner = np.where(c > 0, ub, np.where(c < 0, lb, 0.0))
    assert c @ corner < y @ np.array(b)


def test_what_is_not_reached_is_not_returned():
    # Hilbert's matrix: definite, but no x in double precision satisfies the equations to 1e-17.
    n = 6
    P = 1.0 / (np.arange(n)[:, None] + np.arange(n) + 1.0)
    assert solve_qp(P, np.ones(n)).kkt.worst < 1e-15
    with pytest.raises(NotConverged, match="tol = 1e-18"):
        solve_qp(P, np.ones(n), tol=1e-18)


def test_input_is_left_alone():
    P, q, lb, active = 2 * np.eye(2), Q.copy(), np.zeros(2), np.zeros(2, np.int8)
    solve_qp(P, q, lb=lb, start=active)
    np.testing.assert_array_equal(P, 2 * np.eye(2))
    np.testing.assert_array_equal(q, Q)
    np.testing.assert_array_equal(active, 0)
    factor = QPFactor(P)
    P[0, 0] = 100.0
    np.testing.assert_array_equal(solve_qp(factor, q).x, [-0.5, 0.5])


def test_residuals_are_recomputed_from_the_problem():
    lb = np.zeros(2)
    result = solve_qp(np.eye(2), Q, lb=lb, **ROW)
    assert result.residuals(np.eye(2), Q, lb=lb, **ROW) == result.kkt
    assert result.kkt.worst < 1e-15
    assert result.residuals(np.eye(2), Q + 1.0, lb=lb, **ROW).stationarity > 0.1
    assert result.residuals(np.eye(2), Q, lb=lb, A=ROW["A"], b=[2.0]).primal > 0.1
    assert result.residuals(np.eye(2), Q, lb=lb + 0.5, **ROW).primal > 0.1
    bounded = solve_qp(np.eye(2), -Q, lb=lb)
    assert bounded.kkt.sign == 0.0
    assert bounded.residuals(np.eye(2), -Q).sign > 0.1
    assert bounded.residuals(np.eye(2), -Q, lb=lb - 1.0).complementarity > 0.1
