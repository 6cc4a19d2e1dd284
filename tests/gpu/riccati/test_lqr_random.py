"""Random stabilisable systems of all scales: every answer is certified, or an error is raised."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_continuous_are

from gpu import GpuError, lqr


def random_system(seed):
    """A, B, Q, R, N, E with scales from 1e-6 to 1e6 and a definite joint weight."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 9)), int(rng.integers(1, 4))
    p = int(rng.integers(1, n + 1))
    scale = 10.0 ** rng.uniform(-6, 6, 4)
    A, B = scale[0] * rng.standard_normal((n, n)), scale[1] * rng.standard_normal((n, m))
    C, M = scale[2] * rng.standard_normal((p, n)), rng.standard_normal((m, m))
    R = scale[3] * (M @ M.T + 0.1 * np.eye(m))
    if rng.random() < 0.4:
        unit = 10.0 ** rng.uniform(-3, 3, n)
        A, B, C = A * unit / unit[:, None], B / unit[:, None], C * unit
    N = E = None
    if rng.random() < 0.3:
        E = rng.standard_normal((n, n)) + 2 * np.eye(n)
    if rng.random() < 0.3:
        D = rng.standard_normal((p, m))
        N = C.T @ (D / (1.1 * np.linalg.norm(D, 2))) @ np.linalg.cholesky(R).T
    Q = C.T @ C
    return A, B, (Q + Q.T) / 2, R, N, E


def wrong(A, B, Q, R, N, E, result):
    """What is wrong with an answer, judged in extended precision; empty if nothing is."""
    K, S, _ = result
    long = np.longdouble
    A, B, Q, R, S = (M.astype(long) for M in (A, B, Q, R, S))
    E = np.eye(len(A), dtype=long) if E is None else E.astype(long)
    N = np.zeros_like(B) if N is None else N.astype(long)
    half, cross = (E.T @ S) @ A, (E.T @ S) @ B + N
    inverse = np.linalg.inv(R.astype(float)).astype(long)
    inverse = 2 * inverse - inverse @ R @ inverse
    fed = cross @ inverse @ cross.T
    residual = half + half.T + Q - fed
    # In units in which the diagonal of the terms is one, so that no state hides behind another.
    size = np.diag(abs(half) + abs(half.T) + abs(Q) + abs(fed))
    unit = np.sqrt(np.where(size > 0, size, 1))
    found = []
    if not np.linalg.norm((residual / unit / unit[:, None]).astype(float)) <= 1e-6:
        found.append("residual")
    loop = np.linalg.solve(E.astype(float), (A - B @ K.astype(long)).astype(float))
    if not np.linalg.eigvals(loop).real.max() < 0:
        found.append("poles")
    if np.linalg.eigvalsh(S.astype(float))[0] < -1e-9 * np.linalg.norm(S.astype(float)):
        found.append("negative cost")
    return found


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(st.integers(0, 10**6))
def test_certified_or_raised(seed):
    problem = random_system(seed)
    try:
        result = lqr(*problem)
    except GpuError:
        return
    assert wrong(*problem, result) == []


def test_most_of_them_are_solved():
    solved = 0
    for seed in range(60):
        try:
            solved += not wrong(*random_system(seed), lqr(*random_system(seed)))
        except GpuError:
            continue
    # The others have weights so far apart that double precision cannot tell their poles.
    assert solved >= 50


def test_slow_poles_beside_fast_ones():
    """Loops as fast as 1e9 with poles near one: their gain needs more digits than S has."""
    rng = np.random.default_rng(20)
    for n in (10, 20, 34):
        A, B = rng.standard_normal((n, n)), rng.standard_normal((n, 2))
        C = 1e3 * rng.standard_normal((n // 2, n))
        problem = A, B, C.T @ C, 1e-2 * np.eye(2), None, None
        result = lqr(*problem)
        assert wrong(*problem, result) == []
        assert result.converged


@pytest.mark.parametrize("n", [16, 40])
def test_rounding_of_the_mass_matrix_needs_no_units(n):
    """Entries that are zero but for rounding of E^-1 A have no say in the units of the states."""
    rng = np.random.default_rng(0)
    A = -np.eye(n) + np.eye(n, k=1) * (np.arange(n) % 3 > 0)
    B, Q = rng.standard_normal((n, 2)), np.diag(np.arange(n) % 2.0)
    E = (4.0 * np.eye(n) + np.eye(n, k=1) + np.eye(n, k=-1)) / 6.0
    X = solve_continuous_are(A, B, Q, np.eye(2))
    result = lqr(E @ A, E @ B, Q, 1.0, E=E)
    np.testing.assert_allclose(result.K, B.T @ X, atol=1e-12 * np.abs(X).max())
