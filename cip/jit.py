"""The one door to numba: kernel modules are plain Python that this compiles when first used.

Kernel modules keep to a small part of Python (numbers, flat arrays, if, for, tuples of results), so
that `cip.device_source` can translate the very same functions to C for the device. They are
imported where they are used, never by `import cip`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

# Types of the kernel language: whole numbers, numbers of the working precision, flat arrays of
# these. An `Out` is written, an `Array` only read.
Index = int
Real = float
Array = Any
Out = Any


def kernel(function: Function) -> Function:
    """Compile without the global interpreter lock, so that threads share the nodes among them."""
    from numba import njit

    compiled: Function = njit(nogil=True, cache=True, error_model="numpy")(function)
    return compiled
