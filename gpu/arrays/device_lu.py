"""LU factors on a device."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

_filters = threading.Lock()  # the filters of warnings are shared by all threads


def device_lu(A: Any) -> Any:
    """LU factors and pivots of a CuPy array, without CuPy's warning about zero pivots.

    Callers check the pivots and raise an error in terms of their problem.
    """
    from cupyx.scipy.linalg import lu_factor

    with _filters, warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return lu_factor(A, check_finite=False)


def device_solver(M: Any) -> Callable[[Any], Any]:
    """The function ``x -> M^-1 x``; raises `LinAlgError` if M is exactly singular."""
    from cupyx.scipy.linalg import lu_solve

    device = device_lu(M)
    if not bool(device[0].diagonal().all()):
        raise np.linalg.LinAlgError("singular matrix")
    return lambda x: lu_solve(device, x, check_finite=False)
