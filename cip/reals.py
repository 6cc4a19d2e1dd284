"""The door through which arrays and numbers come in: real, and nothing of them masked unseen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError

Hidden = NDArray[np.bool_] | None


def real_array(value: Any, name: str) -> NDArray[Any]:
    """The value as an array of real numbers; masks, complex numbers and texts are refused.

    Masks are seen in lists, tuples and arrays of objects too. The array may be the caller's own.

    Raises
    ------
    InputError
        Masked entries, or numbers that are not real.
    """
    array, hidden = masked_array(value, name)
    if hidden is not None:
        at = tuple(int(q) for q in np.argwhere(hidden)[0])
        where = f", the first at {at}" if at else ""
        raise InputError(
            f"{name}: some values are masked{where}; fill them, for instance by .filled(0.0)"
        )
    return array


def own_array(value: Any, name: str) -> NDArray[Any]:
    """The same as an array that nobody else has: what the caller does with his changes nothing."""
    return np.array(real_array(value, name))


def masked_array(value: Any, name: str) -> tuple[NDArray[Any], Hidden]:
    """The value as an array of real numbers, and where it is masked; None if it is nowhere.

    Raises
    ------
    InputError
        Numbers that are not real.
    """
    try:
        value, hidden = _uncovered(value)
        array = np.asanyarray(value)
        if isinstance(array, np.ma.MaskedArray) or array.dtype == object:
            # It came out of another library's object.
            value, more = _uncovered(array)
            array, hidden = np.asarray(value), hidden if more is None else more
    except (TypeError, ValueError, RecursionError) as error:
        raise InputError(f"{name}: expected numbers, got {value!r}") from error
    if array.dtype.kind not in "fiub":
        raise InputError(
            f"{name}: expected real values instead of {array.dtype}, shape {array.shape}"
        )
    return array, hidden


def _uncovered(value: Any) -> tuple[Any, Hidden]:
    """A value without masks, 0 where something was masked, and where that was."""
    if isinstance(value, np.ma.MaskedArray):
        if np.ma.is_masked(value):
            return value.filled(0), np.ma.getmaskarray(value)
        return np.asarray(value), None
    if type(value).__name__ == "NAType":  # the missing value of pandas, which is not imported
        return 0.0, np.ones((), dtype=bool)
    if isinstance(value, np.ndarray) and value.dtype == object and value.ndim:
        value = list(value)
    if not isinstance(value, Sequence) or isinstance(value, str | bytes | range):
        return value, None
    if all(type(one) in (float, int) for one in value):
        return value, None
    parts = [_uncovered(one) for one in value]
    plain = [one for one, _ in parts]
    if all(hidden is None for _, hidden in parts):
        return plain, None
    masks = [np.zeros(np.shape(one), dtype=bool) if h is None else h for one, h in parts]
    return plain, np.array(masks)


def real_number(value: Any, name: str) -> float:
    """One real number, which may be infinite or NaN; True and False are none."""
    array = real_array(value, name)
    if array.dtype.kind == "b":
        raise InputError(f"{name}: expected a number, got {value!r}")
    if array.ndim:
        raise InputError(f"{name}: expected one number, got shape {array.shape}")
    return float(array)
