"""What is said of the stability of large dense loops is proved, and nothing unstable passes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpu import lqr
from gpu.riccati.proof import closed_loop
from gpu.riccati.proof.closed_loop import DenseLoop, proven_bound
from gpu.riccati.proof.lyapunov import lyapunov_solver


@pytest.fixture
def small(monkeypatch):
    """Matrices of 60 rows are treated as if they were large."""
    monkeypatch.setattr(closed_loop, "LIMITS", closed_loop.LIMITS._replace(dense=20))
    monkeypatch.setattr(closed_loop, "SCHUR", 20)


def with_abscissa(a, seed=0, n=60, normal=False):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    if normal:
        A = A - A.T
    return A - (np.linalg.eigvals(A).real.max() - a) * np.eye(n)


def rounding(A):
    return 4 * np.finfo(float).eps * np.linalg.norm(A)


@pytest.mark.parametrize("normal", [False, True])
@pytest.mark.parametrize("abscissa", [-2.0, -0.1, -1e-3, 0.0, 1e-15, 1e-9, 1e-3])
def test_stable_loops_are_proved_stable_and_no_others(abscissa, normal, small):
    for seed in range(5):
        A = with_abscissa(abscissa, seed, normal=normal)
        loop = DenseLoop(A, rounding(A))
        assert loop.is_stable() == (abscissa < 0.0)
        assert abscissa >= 0.0 or abscissa * (1 + 1e-9) <= loop.bound < 0.0


@pytest.mark.parametrize("frequency", [0.0, 0.3, 40.0])
def test_a_pole_on_the_axis_far_from_the_others_never_passes(frequency, small):
    """The poles nearest to zero look stable: only the proof can tell."""
    A = -np.diag(np.linspace(0.1, 2.0, 60))
    A[-2:, -2:] = [[0.0, frequency], [-frequency, 0.0]]
    T = np.linalg.qr(np.random.default_rng(1).standard_normal((60, 60)))[0]
    for move in (0.0, 1e-14, 1e-3):
        M = A.copy()
        M[-2:, -2:] += move * np.eye(2)
        M = T @ M @ T.T
        assert not DenseLoop(M, rounding(M)).is_stable()


def test_symmetric_loops_give_all_poles(small):
    rng = np.random.default_rng(2)
    A = rng.standard_normal((60, 60))
    A = -A @ A.T - np.eye(60)
    loop = DenseLoop(A, rounding(A))
    assert loop.whole
    np.testing.assert_allclose(loop.poles.real, np.sort(np.linalg.eigvalsh(A))[::-1])
    assert loop.is_stable()


def test_a_bound_never_lies_left_of_a_pole(small):
    for seed in range(10):
        A = with_abscissa(-0.5, seed)
        P = lyapunov_solver(A)(np.eye(60))
        M = abs(A)
        bound = proven_bound(A, P, (lambda v, M=M: M @ v, lambda v, M=M: M.T @ v), -0.5)
        assert -0.5 * (1 + 1e-12) <= bound < 0.0
        # No positive definite function proves what is false, however hopeful the estimate.
        hopeful = proven_bound(A, P, (lambda v, M=M: M @ v, lambda v, M=M: M.T @ v), -50.0)
        assert hopeful >= -0.5 * (1 + 1e-12)
        assert proven_bound(A, -P, (M.__matmul__, M.T.__matmul__), -0.5) == np.inf


@settings(max_examples=15)
@given(st.integers(0, 10**6), st.sampled_from([1e-6, 1e-8, 1e-9]))
def test_a_weak_input_with_every_entry_moved_by_its_last_bit(seed, weak):
    """The right solution was refused: its poles, of -1, came out as .35 or -1.2 by chance."""
    rng = np.random.default_rng(seed)
    A, B = np.diag(np.r_[1.0, -np.arange(1.0, 20.0)]), np.r_[weak, np.ones(19)][:, None]
    A *= 1.0 + 2.3e-16 * rng.integers(-1, 2, A.shape)
    B *= 1.0 + 2.3e-16 * rng.integers(-1, 2, B.shape)
    result = lqr(A, B, 1.0, 1.0)
    assert result.converged
    assert result.abscissa == pytest.approx(-1.0, rel=1e-6)
    assert result.info["path"] == "doubling"


@given(st.integers(0, 10**6))
def test_lyapunov_equations_in_any_units(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 12))
    A = rng.standard_normal((n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(n)
    W = rng.standard_normal((n, n))
    W = W + W.T
    plain = lyapunov_solver(A)
    unit = 2.0 ** rng.integers(-30, 31, n)
    moved = lyapunov_solver(A * unit / unit[:, None])
    X = plain(W)
    assert np.abs(A.T @ X + X @ A + W).max() <= 1e-9 * max(np.abs(X).max(), 1.0)
    other = moved(W * unit * unit[:, None]) / unit / unit[:, None]
    np.testing.assert_allclose(other, X, rtol=0, atol=1e-8 * np.abs(X).max())
    assert moved.poles.real.max() == pytest.approx(plain.poles.real.max(), rel=1e-6)
