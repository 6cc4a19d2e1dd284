"""Poles of a loop do not depend on the units of its states, nor on the last bit of its entries."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpu import lqr
from gpu.riccati.proof.lyapunov import lyapunov_solver


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
