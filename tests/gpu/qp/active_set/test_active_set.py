"""The course of the iteration: cycling, monotone active sets, warm starts."""

import itertools

import numpy as np
import pytest

from gpu import QPFactor, Status, Step, solve_qp

# Positive definite, and yet the full exchange runs through the same three active sets for ever.
CYCLING = [
    ([[8, -8, -8], [-8, 14, 16], [-8, 16, 19]], [-7, 5, 1]),
    ([[17, -8, 15], [-8, 5, -8], [15, -8, 14]], [-5, 6, -8]),
    ([[15, 1, 7, 10], [1, 20, -9, -15], [7, -9, 13, 20], [10, -15, 20, 31]], [-4, 3, -3, -5]),
    ([[26, 4, 5, -6, -8], [4, 13, -6, -13, 13], [5, -6, 14, 5, -3], [-6, -13, 5, 15, -15],
      [-8, 13, -3, -15, 27]], [9, -6, 6, -9, 5]),
]  # fmt: skip


def plain_full_exchange(P, q, max_steps=50):
    """Textbook primal-dual active sets for x >= 0; returns x, or None where a state returns."""
    held, seen = -q / np.diag(P) < 0, []
    for _ in range(max_steps):
        if any(np.array_equal(held, other) for other in seen):
            return None
        seen.append(held)
        free = ~held
        x = np.zeros(q.size)
        x[free] = np.linalg.solve(P[np.ix_(free, free)], -q[free])
        wrong = np.where(held, P @ x + q < 0, x < 0)
        if not wrong.any():
            return x
        held = held ^ wrong
    raise AssertionError("neither a solution nor a cycle")


@pytest.mark.parametrize(("P", "q"), CYCLING)
def test_ends_where_the_full_exchange_cycles(P, q):
    P, q = np.array(P, dtype=float), np.array(q, dtype=float)
    assert np.linalg.eigvalsh(P)[0] > 0
    assert plain_full_exchange(P, q) is None

    result = solve_qp(QPFactor(P), q, lb=0.0)
    best = min(
        x @ P @ x / 2 + q @ x
        for free in itertools.product([False, True], repeat=q.size)
        if (x := point(P, q, np.array(free))).min() >= 0
    )
    assert result.x.min() >= 0
    assert result.x @ P @ result.x / 2 + q @ result.x == pytest.approx(best, abs=1e-12)
    # More than five steps without progress come before the single exchanges.
    assert 5 < result.iterations < 20


def test_rounding_of_a_tie_does_not_cycle():
    # At the solution x_0 = 0 and its multiplier vanishes; each of its two states looks violated.
    P = np.array([[18, 10, 0, 0], [10, 28, -18, 6], [0, -18, 18, -6], [0, 6, -6, 12]], dtype=float)
    q = np.array([-5.0, -8.0, 3.0, 7.0])
    assert plain_full_exchange(P, q) is None
    result = solve_qp(QPFactor(P), q, lb=0.0)
    assert result.iterations <= 3
    np.testing.assert_allclose(result.x, [0.0, 1 / 2, 1 / 3, 0.0], atol=1e-15)


def point(P, q, free):
    x = np.zeros(q.size)
    x[free] = np.linalg.solve(P[np.ix_(free, free)], -q[free])
    return x


def obstacle(cells):
    """Membrane on the unit square pressed onto a paraboloid: P is an M-matrix."""
    n = cells - 1
    D = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    P = (np.kron(D, np.eye(n)) + np.kron(np.eye(n), D)) * cells**2
    t = np.arange(1, cells) / cells
    lb = -0.05 - ((t[:, None] - 0.5) ** 2 + (t - 0.5) ** 2).ravel() / 4
    return P, np.full(n * n, 10.0), lb


@pytest.mark.parametrize("cells", [12, 16, 24])
def test_obstacle_problem_shrinks_the_contact_set_monotonically(cells):
    P, q, lb = obstacle(cells)
    result = solve_qp(P, q, lb=lb, start=np.linalg.solve(P, -q))
    active = [step.active for step in result.history]
    assert len(active) >= 3
    assert all(a > b for a, b in itertools.pairwise(active))
    # For an M-matrix nothing that was released is held again: all violations are releases.
    assert [a - b for a, b in itertools.pairwise(active)] == [
        step.violated for step in result.history[:-1]
    ]


def test_warm_starts_take_fewer_steps(qps):
    P, q, lb = obstacle(20)
    factor = QPFactor(P)
    cold = solve_qp(factor, q, lb=lb)
    again = solve_qp(factor, q, lb=lb, start=cold)
    assert again.iterations == 1
    assert again.history == (Step(int(np.count_nonzero(cold.active)), 0),)
    np.testing.assert_allclose(again.x, cold.x, rtol=0, atol=1e-15)
    rng = np.random.default_rng(3)
    gram, A = qps.matrix(rng, 80, "gram"), rng.standard_normal((3, 80))
    rows = {"A": A, "b": A @ rng.uniform(0.0, 1.0, 80), "lb": 0.0}
    linear = rng.standard_normal(80)
    for task, start in (
        ((factor, 1.05 * q, {"lb": lb}), cold),
        ((gram, linear, rows), solve_qp(gram, linear, **rows)),
    ):
        scratch = solve_qp(*task[:2], **task[2])
        for given in (start, start.active, start.x):
            warm = solve_qp(*task[:2], **task[2], start=given)
            assert warm.iterations < scratch.iterations
            np.testing.assert_allclose(warm.x, scratch.x, rtol=0, atol=1e-12)


@pytest.mark.parametrize("start", [np.zeros(3), np.zeros(3, np.int8), -np.ones(3, np.int8)])
def test_any_start_leads_to_the_solution(start):
    # A state that holds a variable at an infinite bound is corrected.
    result = solve_qp(np.eye(3), [-1.0, 2.0, 3.0], lb=[-np.inf, 0.0, 4.0], ub=0.5 * 10, start=start)
    np.testing.assert_array_equal(result.x, [1.0, 0.0, 4.0])
    np.testing.assert_array_equal(result.active, [0, -1, -1])


def test_degenerate_solution_says_so():
    result = solve_qp(np.eye(2), [0.0, 1.0], lb=0.0, start=np.array([-1, -1], np.int8))
    assert result.status is Status.DEGENERATE
    assert "compare x" in result.status.value
    assert solve_qp(np.eye(2), [1.0, 1.0], lb=0.0).status is Status.OPTIMAL


@pytest.mark.parametrize("side", [1e-3, 1e-7, 1e-10])
def test_rows_beside_a_large_term_of_other_variables(side):
    """Variables that a large q holds at zero leave the row of the others all of its digits."""
    held, free = np.repeat([[1.0], [0.0]], 5, axis=1), np.repeat([[0.0], [1.0]], 5, axis=1)
    P, q = np.eye(10) + 0.1, held.ravel()
    lb = np.where(q > 0, 0.0, -np.inf)
    x = solve_qp(P, q, A=free.reshape(1, -1), b=[side], lb=lb, ub=np.full(10, np.inf)).x
    assert not x[:5].any()
    assert x[5:] == pytest.approx(np.full(5, side / 5), rel=1e-14, abs=0.0)
