"""Real Schur form of a small matrix by compiled code, in two thirds of LAPACK's time."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.linalg.lapack import dgehrd, dorghr

BLOCK = 32  # columns for which LAPACK has room
LEAST, MOST = 1e-290, 1e290  # of the largest entry
_compiling = threading.Lock()


def real_schur(S: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """``S = Q T Q^T`` with T in LAPACK's standard form.

    None where S is zero, its entries are not finite or near the ends of what numbers can be, or the
    iteration does not converge, as with entries of hundreds of decades it may not.

    Parameters
    ----------
    S : ndarray of float64, shape (m, m)
        m > 1.

    Returns
    -------
    T, Q : ndarray, shape (m, m)
        By columns.
    """
    m = len(S)
    size = float(np.abs(S).max())
    if not LEAST < size < MOST:
        return None
    unit = 2.0 ** np.floor(np.log2(size))
    reduced, reflectors, _ = dgehrd(S / unit, lwork=BLOCK * m)
    Q, _ = dorghr(reduced, reflectors, lwork=BLOCK * m)
    W = np.zeros((m + 1, 2 * m + 1))
    W[:m, :m] = np.triu(reduced, -1)
    W[:m, m + 1 :] = Q.T
    with _compiling:
        iterate = _compiled()
    if not iterate(W):
        return None
    return np.asfortranarray(W[:m, :m] * unit), np.asfortranarray(W[:m, m + 1 :].T)


@functools.cache
def _compiled() -> Callable[[Any], bool]:
    """`schur_kernels.iterate`, compiled at the first call and kept on disk where that can be."""
    from numba import njit

    from gpu.eigenvalues.schur import schur_kernels

    # Calls find the compiled ones in place of the plain ones.
    for kernel in schur_kernels.KERNELS:
        try:
            compiled = njit(cache=True, **schur_kernels.OPTIONS)(kernel)
        except RuntimeError:  # no folder to write into
            compiled = njit(**schur_kernels.OPTIONS)(kernel)
        setattr(schur_kernels, kernel.__name__, compiled)
    return schur_kernels.iterate
