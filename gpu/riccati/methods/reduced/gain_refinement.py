"""Newton-Kleinman on the gain alone: no n x n matrix, whatever the rank of Q."""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np
from scipy import linalg

from gpu.arrays.namespace import to_host
from gpu.errors import RiccatiError
from gpu.riccati.problem.lqr_problem import LQRProblem
from gpu.riccati.problem.state_matrix import StateMatrix

NEARLY_SINGULAR = 1e8  # from this condition number on half of the digits or more are lost


def kleinman(problem: LQRProblem, W: Any, K: Any) -> tuple[Any, Any]:
    r"""Return the next gain of Newton's method, shape (m, n), and U as below, shape (n, r).

    Newton's step solves a Lyapunov equation with :math:`A_K = A - B K`,

    .. math:: A_K^T X E + E^T X A_K = -(Q + K^T K), \qquad K_+ = B^T X E.

    X has full rank if Q has, but only :math:`X B` is needed. Let the range of W contain
    :math:`E^{-1} B` and be nearly invariant, :math:`A_K W = E W H`. Then :math:`U = X E W` solves
    the Sylvester equation

    .. math:: A_K^T U + E^T U H = -(Q + K^T K) W,

    whose triangular form takes one solve with :math:`A_K^T + h_j E^T` for each eigenvalue of H, and
    :math:`K_+^T = E^T U (W^+ E^{-1} B)`.

    Parameters
    ----------
    problem : LQRProblem
    W : array, shape (n, r)
        Orthonormal.
    K : array, shape (m, n)
        Stabilising gain for the inputs of unit cost.

    Raises
    ------
    RiccatiError
        K does not stabilise on W.

    References
    ----------
    D. Kleinman, On an iterative technique for Riccati equation computations, IEEE Trans. Autom.
    Control 13 (1968).
    """
    state, B, xp = problem.state, problem.input, problem.xp
    Er = to_host(W.T @ state.mass(W))
    H = np.linalg.solve(Er, to_host(W.T @ (state.apply(W) - B @ (K @ W))))
    b = np.linalg.solve(Er, to_host(W.T @ B))
    T, Z = linalg.schur(H, output="complex")
    if not np.all(np.diag(T).real < 0.0):
        raise RiccatiError("the gain to be refined does not stabilise: start from a better one")
    F = (problem.weight.apply(W) + K.T @ (K @ W)) @ xp.asarray(Z)
    V = xp.zeros((state.n, len(T)), dtype=complex)
    Kt = K.T + 0j
    # For real eigenvalues the shift is made real, which saves complex solves.
    for j in range(len(T)):
        h = T[j, j]
        shift = -h if abs(h.imag) > 1e-13 * abs(h) else float(-h.real)
        right = -F[:, j]
        if j:
            right = right - state.mass_transposed(V[:, :j] @ xp.asarray(T[:j, j]))
        V[:, j] = _solve(state, shift, B, Kt, right)
    U = (V @ xp.asarray(Z.conj().T)).real
    return state.mass_transposed(U @ xp.asarray(b)).T, U


def _solve(state: StateMatrix, shift: complex, B: Any, Kt: Any, right: Any) -> Any:
    """``(A - shift E - B K)^-T right``."""
    xp = state.xp
    factors = state.factor(shift)
    if factors is not None:
        solved = factors.solve_transposed(xp.concatenate([right[:, None], Kt], axis=1))
        u, G = solved[:, 0], solved[:, 1:]
        # By Sherman, Morrison and Woodbury.
        small = np.eye(B.shape[1]) - to_host(B.T @ G)
        if np.isfinite(small).all() and np.linalg.cond(small) < NEARLY_SINGULAR:
            return u + G @ xp.asarray(np.linalg.solve(small, to_host(B.T @ u)))
    # The optimal feedback mirrors an unstable mode of A without cost at the imaginary axis; then
    # the shift is an eigenvalue of A itself.
    moved = copy(state)
    moved.A = state.shifted(shift)
    factors = None if state.kind == "operator" else moved.factor_updated(B, Kt.real)
    if factors is None:
        raise RiccatiError(f"A - B K - s E is singular at s = {shift}, the mirror of a pole")
    return factors.solve_transposed(right)
