"""Arrays of NumPy and CuPy: which module they belong to, and the way to the host."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np


def namespace(array: Any) -> Any:
    """The module, NumPy or CuPy, that an array belongs to."""
    return (
        np if isinstance(array, np.ndarray) else sys.modules[type(array).__module__.split(".")[0]]
    )


def host(array: Any) -> Any:
    """The array in the memory of the host."""
    return array.get() if hasattr(array, "get") else np.asarray(array)
