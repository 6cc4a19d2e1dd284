"""Checks of what a user says of sensors: times, reports and their deviations."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cip.errors import InputError
from cip.reals import masked_array, real_array

Array = NDArray[np.float64]


def checked_times(times: ArrayLike) -> Array:
    """Increasing finite times."""
    found = np.atleast_1d(real_array(times, "times").astype(float))
    if found.ndim != 1 or not found.size or not np.isfinite(found).all():
        raise InputError(f"times: expected finite times, shape (k,), got {times!r}")
    if np.any(np.diff(found) <= 0.0):
        raise InputError(f"times: expected increasing times, got {times!r}")
    return found


def checked_values(values: ArrayLike | None, shape: tuple[int, int]) -> Array:
    """Reports, NaN where none arrived; all 0 without any."""
    if values is None:
        return np.zeros(shape)
    given, hidden = masked_array(values, "values")
    found = given.astype(float)
    if hidden is not None:
        found[hidden] = np.nan
    if found.shape != shape:
        raise InputError(
            f"values: expected one for each of {shape[0]} times and {shape[1]} points, shape "
            f"{shape}, got {found.shape}"
        )
    if np.isinf(found).any():
        raise InputError("values: infinity among them; NaN means that no report arrived")
    return found


def checked_deviations(deviations: ArrayLike, shape: tuple[int, int]) -> Array:
    """Positive deviations of this shape."""
    given = real_array(deviations, "deviations").astype(float)
    try:
        found = np.broadcast_to(given, shape).copy()
    except ValueError:
        raise InputError(
            f"deviations: expected shape {shape} or one that broadcasts to it, got {given.shape}"
        ) from None
    if not (np.isfinite(found).all() and np.all(found > 0.0)):
        raise InputError(f"deviations: expected positive standard deviations, got {deviations!r}")
    return found
