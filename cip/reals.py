"""Checks that arguments are real numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError


def real_array(value: Any, name: str) -> NDArray[Any]:
    """The value as an array of real numbers; masks, complex numbers and texts are refused.

    Raises
    ------
    InputError
        Masked entries, or numbers that are not real.
    """
    if np.ma.is_masked(value):
        raise InputError(f"{name}: some values are masked; fill them, for instance by .filled(0.0)")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: expected numbers, got {value!r}") from error
    if array.dtype.kind not in "fiub":
        raise InputError(
            f"{name}: expected real values instead of {array.dtype}, shape {array.shape}"
        )
    return array


def real_number(value: Any, name: str) -> float:
    """One real number, which may be infinite or NaN; True and False are none."""
    array = real_array(value, name)
    if array.dtype.kind == "b":
        raise InputError(f"{name}: expected a number, got {value!r}")
    if array.ndim:
        raise InputError(f"{name}: expected one number, got shape {array.shape}")
    return float(array)
