"""A bound for the poles of a large dense matrix, proved by Lyapunov's inequality."""

from __future__ import annotations

from typing import Any

import numpy as np

from gpu.arrays.dense import cholesky
from gpu.arrays.namespace import namespace
from gpu.riccati.problem.state_matrix import EPS

# Fractions of the likely abscissa that are tried, from the sharpest on.
FRACTIONS = (1 - 1e-3, 0.9, 0.5, 0.1, 1e-2, 1e-4, 0.0)


def proven_bound(A: Any, P: Any, magnitude: Any, likely: float) -> float:
    r"""A number right of which no eigenvalue of A lies; infinity where P proves nothing.

    Where P and :math:`-(A^T P + P A) - 2\mu P` are positive definite, every real part is below
    :math:`-\mu` (Lyapunov). Both are found so by Cholesky factorisations of matrices from which
    bounds of all rounding errors have been subtracted, so that neither how P was found nor how
    far A is from normal matters.

    Parameters
    ----------
    A, P : arrays, shape (n, n)
        P symmetric.
    magnitude : pair of callables v -> M v, v -> M^T v
        With ``|A| <= M`` entrywise; A itself is known to ``n EPS M``.
    likely : float
        An estimate of the abscissa; the bound is a fraction of it.

    References
    ----------
    J. W. Demmel, On floating point errors in Cholesky, LAPACK working note 14 (1989). S. M. Rump,
    Verification of positive definiteness, BIT 46 (2006).
    """
    xp, n = namespace(A), len(A)
    half = P @ A
    M = -(half + half.T)
    del half
    diagonal, own = M.diagonal(), P.diagonal()
    if not bool((diagonal > 0.0).all()) or not bool((own > 0.0).all()):
        return np.inf
    if not _definite(P, xp.sqrt(own), 0.0):
        return np.inf
    unit = xp.sqrt(diagonal)
    v, size = 1.0 / unit, abs(P)
    rows = size @ magnitude[0](v) + magnitude[1](size @ v)
    error = 2.0 * (n + 2) * EPS * float((rows / unit).max())
    del size
    steepest = float((diagonal / own).min()) / 2.0
    steepest = min(steepest, -likely) if likely < 0.0 else steepest
    for fraction in FRACTIONS:
        mu = fraction * steepest
        if _definite(M - 2.0 * mu * P if mu else M, unit, error):
            return -mu
    return np.inf


def _definite(M: Any, unit: Any, error: float) -> bool:
    """Whether M is positive definite, although ``M / unit / unit^T`` is wrong by ``error``."""
    xp, n = namespace(M), len(M)
    if not np.isfinite(error):
        return False
    scaled = M / unit / unit[:, None]
    places = xp.arange(n)
    # Cholesky factors are those of a matrix within (n + 2) EPS times the diagonal, entry by entry.
    scaled[places, places] -= error + n * (n + 2) * EPS
    try:
        L = cholesky(xp.ascontiguousarray(scaled))
    except np.linalg.LinAlgError:
        return False
    return bool(xp.isfinite(L.diagonal()).all())
