"""LU factors on a device."""

from __future__ import annotations

import threading
import warnings
from typing import Any

_filters = threading.Lock()  # of warnings, which all threads share


def device_lu(A: Any) -> Any:
    """Factors and pivots of a CuPy array, without CuPy's warning where a pivot is zero.

    Who asks for them looks at the pivots, and says what they mean for its problem.
    """
    from cupyx.scipy.linalg import lu_factor

    with _filters, warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return lu_factor(A, check_finite=False)
