"""The residual of a Riccati solution, in double or in extended precision."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gpu.arrays.namespace import to_host
from gpu.riccati.problem.lqr_problem import LQRProblem

# Powers of two from here on have squares near the ends of the range of double precision.
FAR = 250
EXTENDED = 128  # up to this order residuals are computed in extended precision on the host


class Residual(NamedTuple):
    """The residual and the size of the terms it is the sum of.

    Attributes
    ----------
    matrix : array, shape (n, n)
    relative : float
        Frobenius norm over that of the terms, in the balanced units that were asked for; infinite
        where one of them overflows.
    """

    matrix: Any
    relative: float


def riccati_residual(
    problem: LQRProblem, S: Any, unit: Any = None, extended: bool = False
) -> Residual:
    r"""Compute :math:`E^T S A + A^T S E + Q - (E^T S B + N) R^{-1} (E^T S B + N)^T`.

    Parameters
    ----------
    problem : LQRProblem
        Dense.
    S : array, shape (n, n)
    unit : array, shape (n,), optional
        States are measured in these units: entries are multiplied by ``unit_i unit_j`` before
        norms are taken.
    extended : bool
        In extended precision, on the host, where the platform has it.
    """
    xp = problem.xp
    if extended:
        if xp is not np:
            raise ValueError("extended precision lives on the host")
        A, E, Q, N = (_long(M) for M in problem.full())
        S = np.asarray(S, dtype=np.longdouble)
        B = problem.B.astype(np.longdouble)
        half = (S if E is None else E.T @ S) @ A
        cross = (S if E is None else E.T @ S) @ B
        inputs = _lower_solve(_cholesky(problem.R), (cross if N is None else cross + N).T)
    else:
        A, E, Q, N = problem.full()
        ES = S if E is None else E.T @ S
        half = ES @ A
        cross = ES @ problem.input
        if N is not None:
            cross = cross + N @ xp.asarray(np.linalg.inv(problem.root).T)
        inputs = cross.T
    quadratic = inputs.T @ inputs
    R = half + half.T + Q - quadratic
    R = (R + R.T) / 2
    weights = 1.0 if unit is None else unit * unit[:, None]
    # Squares of the terms may leave the range of double precision where they do not.
    largest = max(float(xp.abs(M * weights).max()) for M in (half, quadratic, Q))
    top = np.log2(largest) if 0.0 < largest < np.inf else 0.0
    weights = weights * 2.0 ** -np.round(top) if abs(top) > FAR else weights
    size = (
        2.0 * float(xp.linalg.norm(half * weights))
        + float(xp.linalg.norm(quadratic * weights))
        + float(xp.linalg.norm(Q * weights))
    )
    error = float(xp.linalg.norm(R * weights))
    R = R.astype(float)
    if not np.isfinite(error + size):
        return Residual(R, np.inf)  # what overflows says nothing about the equation
    return Residual(R, error / size if size > 0.0 else error)


def gain_in_extended(problem: LQRProblem, S: Any) -> np.ndarray:
    """``R^-1 (B^T S E + N^T)``, shape (m, n), rounded in the end."""
    E, N = (_long(M) for M in (problem.full()[1], problem.N))
    S = np.asarray(S, dtype=np.longdouble)
    cross = (S if E is None else E.T @ S) @ problem.B.astype(np.longdouble)
    L = _cholesky(problem.R)
    inputs = _lower_solve(L, (cross if N is None else cross + N).T)
    return np.asarray(_lower_solve(L[::-1, ::-1].T, inputs[::-1])[::-1], dtype=float)


def _long(M: Any) -> Any:
    return None if M is None else np.asarray(M, dtype=np.longdouble)


def _cholesky(R: np.ndarray) -> np.ndarray:
    """Lower factor in extended precision; R has been found definite before."""
    M = to_host(R).astype(np.longdouble)
    L = np.zeros_like(M)
    for j in range(len(M)):
        row = L[j, :j]
        L[j, j] = np.sqrt(max(M[j, j] - row @ row, np.finfo(np.longdouble).tiny))
        L[j + 1 :, j] = (M[j + 1 :, j] - L[j + 1 :, :j] @ row) / L[j, j]
    return L


def _lower_solve(L: np.ndarray, right: np.ndarray) -> np.ndarray:
    X = np.array(right, dtype=np.longdouble)
    for j in range(len(L)):
        X[j] = (X[j] - L[j, :j] @ X[:j]) / L[j, j]
    return X
