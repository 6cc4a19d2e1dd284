"""Dense kernels of the active-set method, all from SciPy's BLAS.

NumPy brings a BLAS of its own; calls that alternate between the two make their thread pools wait
for each other, which costs more than a product with a matrix of a thousand rows.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.blas import dsymv
from scipy.linalg.lapack import dpotrf, dpotrs, dtrtrs


def symmetric_product(P: np.ndarray, x: np.ndarray) -> np.ndarray:
    """``P x`` for a symmetric P in row-major order."""
    return dsymv(1.0, P.T, x, lower=1)


def cholesky(M: np.ndarray) -> np.ndarray:
    """Lower factor of the symmetric M, which is overwritten; raises `LinAlgError`."""
    if not M.size:
        return M
    L, info = dpotrf(M.T, lower=1, clean=0, overwrite_a=1)
    if info:
        raise np.linalg.LinAlgError(f"leading minor {info} is not positive")
    return L


def cholesky_solve(L: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Solve ``L L' u = r``."""
    return dpotrs(L, r, lower=1)[0] if r.size else r


def lower_solve(L: np.ndarray, r: np.ndarray, transposed: bool = False) -> np.ndarray:
    """Solve ``L u = r`` or ``L' u = r``."""
    return dtrtrs(L, r, lower=1, trans=int(transposed))[0] if r.size else r
