"""Lyapunov equations of a stable matrix: by its Schur form, or by squared Smith iterations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg

from gpu.eigenvalues.schur import eigenvalues_of
from gpu.riccati.problem.lqr_problem import solve, solver_of
from gpu.riccati.problem.state_matrix import EPS
from skfem_adini.ground.arrays import namespace

SCHUR = 600  # order up to which the Schur form on the host is faster


class LyapunovSolver(NamedTuple):
    """Solver of the Lyapunov equation for several W."""

    apply: Callable[[Any], Any]  # W -> X
    poles: np.ndarray | None  # eigenvalues of A, if its Schur form was computed

    def __call__(self, W: Any) -> Any:
        """``X`` with ``A^T X + X A + W = 0``."""
        return self.apply(W)


def lyapunov_solver(A: Any) -> LyapunovSolver:
    r"""Solve :math:`A^T X + X A + W = 0`, A stable, for several symmetric W.

    Bartels and Stewart (1972) on the host for a small A; otherwise Smith's series (1968), doubled:
    :math:`X = \sum_k (C^T)^k W_0 C^k`, :math:`C = I + 2\gamma (A - \gamma I)^{-1}`, :math:`W_0 =
    2\gamma (A - \gamma I)^{-T} W (A - \gamma I)^{-1}`. LinAlgError if it does not converge.
    """
    if isinstance(A, np.ndarray) and len(A) <= SCHUR:
        return _by_schur_form(A)
    return _by_squaring(A)


def _by_schur_form(A: np.ndarray) -> LyapunovSolver:
    """Solve with ``D^-1 A D``, D of powers of two that balance rows and columns. Rounding moves the
    eigenvalues by the norm times their condition, which the units of the states change by many
    orders."""
    balanced, (units, _) = linalg.matrix_balance(A, permute=False, separate=True)
    T, U = linalg.schur(balanced, output="real")
    trsyl = linalg.lapack.dtrsyl
    both = units * units[:, None]

    def apply(W: Any) -> Any:
        X, scale, _ = trsyl(T, T, -(U.T @ (W * both) @ U), trana="T")
        X = U @ (X * scale) @ U.T / both
        return (X + X.T) / 2

    return LyapunovSolver(apply, eigenvalues_of(T))


def _by_squaring(A: Any) -> LyapunovSolver:
    xp, n = namespace(A), len(A)
    A = filled(A)
    gamma = cayley_shift(A)
    moved = A.copy()
    places = xp.arange(n)
    moved[places, places] -= gamma
    inverse = solve(moved, xp.eye(n))
    powers = [2.0 * gamma * inverse]
    powers[0][places, places] += 1.0
    while True:
        size = float(xp.linalg.norm(powers[-1]))
        if size < 0.1 * np.sqrt(EPS):
            break
        # A loop that needs more than 2^60 steps of the series is stable by rounding alone.
        if len(powers) > 60 or not np.isfinite(size):
            raise np.linalg.LinAlgError("A is not stable: the powers of its Cayley transform grow")
        powers.append(powers[-1] @ powers[-1])

    def apply(W: Any) -> Any:
        X = 2.0 * gamma * (inverse.T @ W @ inverse)
        for C in powers:
            X = X + C.T @ (X @ C)
        return (X + X.T) / 2

    return LyapunovSolver(apply, None)


def cayley_shift(M: Any) -> float:
    """The geometric mean of the estimated largest and smallest moduli of eigenvalues of M."""
    xp = namespace(M)
    start = xp.asarray(np.random.default_rng(0).standard_normal((len(M), 2)))
    largest = _growth(lambda x: M @ x, start, xp)
    try:
        smallest = 1.0 / _growth(solver_of(M), start, xp)
    except (np.linalg.LinAlgError, ZeroDivisionError, FloatingPointError):
        smallest = 0.0
    if not largest > 0.0:
        return 1.0
    if not np.isfinite(smallest):
        smallest = 0.0
    return float(np.sqrt(largest * max(smallest, 1e-12 * largest)))


def _growth(product: Callable[[Any], Any], x: Any, xp: Any) -> float:
    """The modulus of the dominant eigenvalue, by a dozen products."""
    first = 0.0
    steps = 12
    for step in range(steps):
        size = float(xp.linalg.norm(x))
        if size == 0.0 or not np.isfinite(size):
            return size
        # The first products depend on the non-normal part of the matrix.
        first += np.log(size) if step > steps // 2 else 0.0
        x = product(x / size)
    first += np.log(max(float(xp.linalg.norm(x)), 1e-300))
    return float(np.exp(first / (steps - steps // 2)))


def filled(M: Any) -> Any:
    """M plus symmetric noise of 1e-40 of its norm if M is large and on the host, else M itself:
    inverses of banded matrices decay down to denormal numbers, with which processors are slower by
    two orders of magnitude and the doubling of 2048 states by one."""
    if not isinstance(M, np.ndarray) or len(M) < 256:  # slow arithmetic does not matter there
        return M
    size = float(np.linalg.norm(M))
    if not np.isfinite(size):
        return M
    noise: Any = np.random.default_rng(0).standard_normal(M.shape)
    noise += noise.T
    noise *= 1e-40 * size  # far above denormal numbers, even squared, and far below all rounding
    noise += M
    return noise
