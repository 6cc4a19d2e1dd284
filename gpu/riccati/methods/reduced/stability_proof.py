r"""A proof that the closed loop of a reduced gain is stable, if A = A^T, E = E^T and Q = q E.

Let :math:`A_s = A - \delta E Z Z^T E` be negative definite, Z of few columns. Then :math:`S_0 =
-\frac q2 A_s^{-1}` solves the equation without the quadratic term and without :math:`\delta`. Its
difference to the Riccati solution has low rank, and the Galerkin solution P on the basis W gives
it:

.. math:: S = S_0 + W Y W^T,\qquad Y = P + \tfrac q2 (W^T A_s W)^{-1}.

S is positive definite if P is. In

.. math:: M = -(A - B K)^T S E - E S (A - B K)

the terms of :math:`S_0` give :math:`q E` up to terms in :math:`\delta`, and all other terms have
low rank: :math:`M = q E + U D U^T`, whose definiteness is that of a matrix of the order of D. No
poles are computed or estimated.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from gpu.arrays.namespace import to_host
from gpu.arrays.sparse_factor import SuperLUFactor
from gpu.riccati.methods.reduced.galerkin_riccati import Projected
from gpu.riccati.problem.lqr_problem import LQRProblem
from gpu.riccati.problem.state_matrix import EPS, Factors, factor, sparse_of, vanishing

# Required least eigenvalue of the matrix that must be definite, scaled so that for the exact
# solution it is at least one: far above rounding.
DEFINITE_MARGIN = 1e-2


def proves_stable(problem: LQRProblem, projected: Projected, P: np.ndarray, q: float) -> bool:
    """Whether Lyapunov's inequality holds for ``A - B K`` with an S near the Riccati solution. P,
    shape (r, r), solves the projected problem, which has no cross term, and gave the gain; q > 0.
    """
    state, xp, W = problem.state, problem.xp, projected.W
    found = _shifted(problem)
    if found is None or not _definite(P):
        return False
    Z, delta, solve = found
    EW, EZ, AW = state.mass(W), state.mass(Z), state.apply(W)
    ZW = to_host(EZ.T @ W)
    inner = projected.A - delta * ZW.T @ ZW
    Y = P + q / 2.0 * np.linalg.inv((inner + inner.T) / 2.0)
    BZ = solve(xp.concatenate([problem.input, EZ], axis=1))
    S0BZ = -q / 2.0 * state.mass(BZ)
    K = projected.gain(P)
    m, d, r = problem.input.shape[1], Z.shape[1], len(P)
    U = xp.concatenate([AW, EW, K.T, S0BZ, EZ], axis=1)
    size = xp.linalg.norm(U, axis=0)
    U = U / xp.where(size > 0.0, size, 1.0)
    D = np.zeros((U.shape[1],) * 2)
    at = np.cumsum([0, r, r, m, m, d, d])
    aw, ew, k, b, z, e = (slice(*pair) for pair in pairwise(at))
    D[aw, ew] = -Y
    D[k, ew] = projected.B.T @ Y
    D[k, b] = np.eye(m)
    D[z, e] = -delta * np.eye(d)
    lengths = to_host(size)
    D = (D + D.T) * lengths * lengths[:, None] / q
    gram = to_host(U.T @ _mass_solve(state.E)(U))
    values, vectors = np.linalg.eigh((gram + gram.T) / 2.0)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    small = root.T @ D @ root
    if not np.isfinite(small).all():
        return False
    return bool(1.0 + np.linalg.eigvalsh((small + small.T) / 2.0)[0] >= DEFINITE_MARGIN)


def _shifted(problem: LQRProblem) -> Any:
    """Z, delta, and solves with ``A - delta E Z Z^T E`` where that is negative definite."""
    state, xp = problem.state, problem.xp
    n, unit = state.n, state.size() or 1.0
    if state.kind == "diagonal":
        E = xp.ones(n) if state.E is None else state.E
        if not bool((E > 0.0).all()):
            return None
        places = xp.flatnonzero(vanishing(state.A) | (state.A > 0.0))
        if len(places) > 16:  # Z must have few columns
            return None
        Z = xp.zeros((n, len(places)))
        Z[places, xp.arange(len(places))] = 1.0 / xp.sqrt(E[places])
        ratio = float((xp.abs(state.A) / E).max())
        A = state.A.copy()
        A[places] -= ratio * E[places]
        return (Z, ratio, lambda x: x / A[:, None]) if bool((A < 0.0).all()) else None
    if state.kind != "sparse" or xp is not np:
        return None
    Z = np.zeros((n, 0))
    if _inertia(-state.A, Z, 1.0) != 0:
        constant = np.ones((n, 1))
        # Only constants are tried as null vector, the most frequent one; otherwise no proof.
        if float(abs(state.A @ constant).max()) > 1e-10 * unit:
            return None
        Z = constant / np.sqrt(float((constant * state.mass(constant)).sum()))
    EZ = state.mass(Z)
    delta = unit / max(1e-300, float(abs(EZ).max()) ** 2) if EZ.size else 1.0
    if state.E is not None and _inertia(state.E, np.zeros((n, 0)), 1.0) != 0:
        return None
    if EZ.size and _inertia(-state.A, EZ, delta) != EZ.shape[1]:
        return None
    factors = state.factor_updated(delta * EZ, EZ) if EZ.size else factor(state.A)
    return None if factors is None else (Z, delta, factors.solve)


def _inertia(H: Any, V: Any, delta: float) -> int:
    """Number of pivots of ``[[H, V], [V^T, -I / delta]]`` that are not positive; -1 if it fails. It
    is the number of columns of V if and only if ``H + delta V V^T`` is positive definite
    (Haynsworth 1968)."""
    block = sparse_of(np)
    if V.shape[1]:
        H = block.bmat([[H, block.csr_matrix(V)], [V.T, -block.identity(V.shape[1]) / delta]])
    H = block.csc_array(H)
    lu, diagonal = SuperLUFactor(H), H.diagonal()
    # Shift the diagonal down by more than the rounding errors of the factors, so that a positive
    # pivot is not positive by rounding.
    rounding = max(1e-12, 4 * H.shape[0] * EPS)
    try:
        lu.factor(diagonal - rounding * np.abs(diagonal))
    except np.linalg.LinAlgError:
        return -1
    return int((~(lu.pivots() > 0.0)).sum())


def _mass_solve(E: Any) -> Any:
    if E is None:
        return lambda x: x
    factors: Factors | None = factor(E)
    assert factors is not None
    return factors.solve


def _definite(P: np.ndarray) -> bool:
    values = np.linalg.eigvalsh(P)
    return bool(values[0] > 1e-13 * values[-1])  # above the rounding of P
