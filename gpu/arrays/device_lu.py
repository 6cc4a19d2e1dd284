"""LU factors on a device."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

_filters = threading.Lock()  # of warnings, which all threads share


def device_lu(A: Any) -> Any:
    """Factors and pivots of a CuPy array, without CuPy's warning where a pivot is zero.

    Who asks for them looks at the pivots, and says what they mean for its problem.
    """
    from cupyx.scipy.linalg import lu_factor

    with _filters, warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return lu_factor(A, check_finite=False)


def device_solver(M: Any) -> Callable[[Any], Any]:
    """``x -> M^-1 x``; `LinAlgError` of an exactly singular M."""
    from cupyx.scipy.linalg import lu_solve

    device = device_lu(M)
    if not bool(device[0].diagonal().all()):
        raise np.linalg.LinAlgError("singular matrix")
    return lambda x: lu_solve(device, x, check_finite=False)
