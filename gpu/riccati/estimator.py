"""The dual of the regulator: stationary Kalman-Bucy filters."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from gpu.arrays.namespace import to_host
from gpu.errors import InputError
from gpu.riccati.lqr_result import LQRResult
from gpu.riccati.problem.lqr_problem import LQRProblem, check_lqr, columns, numbers
from gpu.riccati.problem.state_matrix import stored


def dual_problem(
    A: Any, G: Any, C: Any, W: Any, V: Any, N: Any, E: Any, factored: bool
) -> LQRProblem:
    """The regulator problem of ``(A^T, C^T, G W G^T, V, G N, E^T)``."""
    A, E = numbers("A", A), numbers("E", E)
    n = A.shape[0]
    G = stored("G", numbers("G", G))
    if G.ndim == 1:
        G = G[:, None]
    if G.shape[0] != n:
        raise InputError(f"G has shape {G.shape}: expected ({n}, q), a row for each state")
    G = G.toarray() if hasattr(G, "toarray") else G
    C = numbers("C", C)
    if C.ndim == 1:
        C = C[None, :]
    if C.shape[1] != n:
        raise InputError(f"C has shape {C.shape}: expected (p, {n}), a column for each state")
    factor = G @ _noise_factor(W, G, factored)
    V = None if V is None else stored("V", numbers("V", V))
    cross = None
    if N is not None:
        N = stored("N", numbers("N", N))
        N = N[:, None] if N.ndim == 1 else N
        if N.shape != (G.shape[1], C.shape[0]):
            raise InputError(f"N has shape {N.shape}: expected {(G.shape[1], C.shape[0])}")
        cross = G @ N
    dense = A.ndim == 2 and not hasattr(A, "tocsr") and not hasattr(A, "matvec")
    return check_lqr(
        _transposed(A),
        columns("C", C.T, n, None),
        factor @ factor.T if dense else factor.T,
        V,
        cross,
        _transposed(E),
        factored=not dense,
    )


@dataclass(frozen=True, repr=False)
class FilterResult(LQRResult):
    """The gain L of a filter, shape (n, p), in the place of K, and the covariance in that of S."""

    def refined(self, *, steps: int = 200, tol: float = 1e-12) -> LQRResult:
        """The optimal gain by Newton-Kleinman from this one; see `LQRResult.refined`."""
        return transposed(LQRResult(**_turned(self)).refined(steps=steps, tol=tol))


def transposed(result: LQRResult) -> FilterResult:
    """The result of the dual problem as that of the filter: its gain stands upright."""
    return FilterResult(**_turned(result))


def _turned(result: LQRResult) -> dict[str, Any]:
    return {f.name: getattr(result, f.name) for f in fields(result)} | {"K": result.K.T}


def _noise_factor(W: Any, G: Any, factored: bool) -> Any:
    q = G.shape[1]
    W = stored("W", numbers("W", W))
    if factored:
        W = W[:, None] if W.ndim == 1 else W
        if W.shape[0] != q:
            raise InputError(f"W has shape {W.shape}: a factor must have {q} rows")
        return W
    W = to_host(W.toarray() if hasattr(W, "toarray") else W)
    if W.shape == (1, 1) and q > 1:
        W = W[0, 0] * np.eye(q)
    if W.ndim == 1 and len(W) == q:
        W = np.diag(W)
    if W.shape != (q, q):
        raise InputError(f"W has shape {W.shape}: expected ({q}, {q}), an intensity for each noise")
    if not np.allclose(W, W.T, rtol=0.0, atol=1e-12 * np.abs(W).max()):
        raise InputError("W is not symmetric: pass (W + W.T) / 2 if that is what is meant")
    values, vectors = np.linalg.eigh((W + W.T) / 2)
    if values[0] < -1e-12 * q * max(values[-1], 0.0):
        raise InputError(f"W is not positive semidefinite: an eigenvalue is {values[0]:.3g}")
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    from gpu.arrays.namespace import namespace

    return namespace(G).asarray(root)


def _transposed(M: Any) -> Any:
    if M is None or getattr(M, "ndim", 2) == 1:
        return M
    return M.T
