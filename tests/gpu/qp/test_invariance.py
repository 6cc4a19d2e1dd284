"""Units, order of the variables and repetition do not matter."""

import numpy as np
import pytest

from gpu import solve_qp

SEEDS = [3, 7, 13, 26, 41, 60, 77, 83]


def solved(p):
    return solve_qp(p.P, p.q, A=p.A, b=p.b, lb=p.lb, ub=p.ub)


def feasible(qps, seed):
    p = qps.random(seed)
    while not p.feasible:
        seed += 1000
        p = qps.random(seed)
    return p


@pytest.mark.parametrize("seed", SEEDS)
def test_a_repeated_call_gives_the_same_bits(qps, seed):
    p = feasible(qps, seed)
    first, second = solved(p), solved(p)
    for name in ("x", "y", "z_box", "active"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert first.history == second.history


@pytest.mark.parametrize("seed", SEEDS)
def test_units_by_powers_of_two_change_no_bit(qps, seed):
    p = feasible(qps, seed)
    rng = np.random.default_rng(seed)
    n, m = p.q.size, p.b.size
    unit = 2.0 ** rng.integers(-30, 30, n)
    row = 2.0 ** rng.integers(-30, 30, m)
    scaled = solve_qp(
        2.0**36 * unit[:, None] * p.P * unit,
        2.0**36 * unit * p.q,
        A=row[:, None] * p.A * unit,
        b=row * p.b,
        lb=p.lb / unit,
        ub=p.ub / unit,
    )
    result = solved(p)
    np.testing.assert_array_equal(unit * scaled.x, result.x)
    np.testing.assert_array_equal(scaled.z_box, 2.0**36 * unit * result.z_box)
    assert scaled.history == result.history


@pytest.mark.parametrize("factor", [1e-12, 1e-6, 1e6, 1e12])
def test_contact_like_scales(factor):
    t = np.linspace(0.0, 1.0, 60)
    W = np.exp(-10 * np.abs(t[:, None] - t))
    r = np.sin(7 * t)
    ub = np.where(t < 0.5, np.inf, 0.05)
    reference = solve_qp(W, -r, lb=np.where(t < 0.5, 0.0, -0.05), ub=ub)
    result = solve_qp(factor * W, -r, lb=np.where(t < 0.5, 0.0, -0.05) / factor, ub=ub / factor)
    np.testing.assert_array_equal(result.active, reference.active)
    np.testing.assert_allclose(factor * result.x, reference.x, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("seed", SEEDS)
def test_order_of_the_variables(qps, seed):
    p = feasible(qps, seed)
    result = solved(p)
    order = np.random.default_rng(seed).permutation(p.q.size)
    permuted = solve_qp(
        p.P[np.ix_(order, order)],
        p.q[order],
        A=p.A[:, order],
        b=p.b,
        lb=p.lb[order],
        ub=p.ub[order],
    )
    root = np.sqrt(np.diag(p.P))
    # Both are stationary to rounding; the condition of P, up to 1e8, separates the points.
    distance = root[order] * np.abs(permuted.x - result.x[order])
    assert distance.max() <= 1e-7 * (root * np.abs(result.x)).max()
