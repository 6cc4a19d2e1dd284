"""Inequality rows, semidefinite and sparse matrices, sequences, and the door to qpsolvers."""

import numpy as np
import pytest
import qpsolvers
from scipy import sparse
from scipy.optimize import linprog

from gpu import (
    GpuError,
    Infeasible,
    InputError,
    QPFactor,
    batch_solve_qp,
    register_qpsolvers,
    solve_qp,
)
from gpu.qp.data.qp_problem import check_problem
from gpu.qp.solve_qp import _proximal


def random(seed, n=30, l=20, m=4):
    rng = np.random.default_rng(seed)
    M = rng.standard_normal((n, n))
    G, A, x = rng.standard_normal((l, n)), rng.standard_normal((m, n)), rng.standard_normal(n)
    return M @ M.T / n + 0.1 * np.eye(n), rng.standard_normal(n), G, G @ x + 0.1, A, A @ x


def test_projection_onto_a_half_space():
    result = solve_qp(np.eye(2), [-2.0, -2.0], G=[[1.0, 1.0]], h=1.0)
    np.testing.assert_allclose(result.x, [0.5, 0.5], atol=1e-15)
    np.testing.assert_allclose(result.z, [1.5], atol=1e-15)
    np.testing.assert_array_equal(result.active_rows, [1])


def test_sides_carry_the_sign_of_their_multiplier():
    result = solve_qp(np.eye(2), [3.0, -3.0], G=np.eye(2), h=1.0, h_low=-2.0)
    np.testing.assert_allclose(result.x, [-2.0, 1.0])
    np.testing.assert_allclose(result.z, [-1.0, 2.0])


def test_rows_with_equal_sides_are_equalities():
    P, q, G, h, A, b = random(0)
    one = solve_qp(P, q, G, h, A, b)
    two = solve_qp(P, q, np.vstack([G, A]), np.r_[h, b], h_low=np.r_[np.full(20, -np.inf), b])
    np.testing.assert_allclose(one.x, two.x, atol=1e-12)
    np.testing.assert_allclose(one.y, two.z[20:], atol=1e-11)


@pytest.mark.parametrize("seed", range(3))
def test_sparse_storage_gives_the_same_answer(seed):
    data = random(seed)
    dense = solve_qp(*data)
    stored = [sparse.csc_matrix(v) if v.ndim == 2 else v for v in data]
    np.testing.assert_allclose(solve_qp(*stored).x, dense.x, atol=1e-10)


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
    found = _proximal(check_problem(P, q, None, None, None, None, -ub, ub, None), 1e-12)
    assert not QPFactor(P).definite
    # The definition, not the solver's residuals: a projected gradient step leads nowhere.
    step = np.clip(found.x - (P @ found.x + q), -ub, ub)
    np.testing.assert_allclose(step, found.x, rtol=0, atol=1e-10)
    # Forces of rows that return are not unique, what they do together is.
    np.testing.assert_allclose(
        B.T @ solve_qp(P, q, lb=-ub, ub=ub, tol=1e-12).x, B.T @ found.x, atol=1e-9
    )


def test_numbers_from_1e20_are_infinite():
    result = solve_qp(np.eye(2), [1.0, 1.0], G=np.eye(2), h=1e20, h_low=-1e20, lb=-1e30, ub=1e25)
    np.testing.assert_allclose(result.x, [-1.0, -1.0])


def test_scales_of_rows_and_objective_do_not_matter():
    P, q, G, h, A, b = random(1)
    one = solve_qp(P, q, G, h, A, b)
    for cost, row in ((1e-6, 1e6), (1e6, 1e-6)):
        two = solve_qp(cost * P, cost * q, row * G, row * h, row * A, row * b)
        np.testing.assert_allclose(two.x, one.x, atol=1e-11)
        np.testing.assert_allclose(two.z, one.z * cost / row, rtol=1e-9, atol=1e-9 * cost / row)


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
    with pytest.raises(Infeasible) as caught:
        batch_solve_qp([[1.0]], [[0.0], [0.0]], [[1.0], [-1.0]], [[1.0, 1.0], [-1.0, -1.0]])
    assert caught.value.index == 1


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
