"""Checks of the numbers and vectors that describe an obstacle."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.errors import InputError
from skfem_adini.ground.arguments import holds_masked, numbers

Array = NDArray[np.float64]
GRAZING = 0.0175  # sine of 1 degree: normals at smaller angles to the obstacle meet nothing


def vector(name: str, value: ArrayLike) -> Array:
    """A vector of 2 or 3 finite numbers, or an `InputError` with the argument's name."""
    array = numbers(name, value)
    if array.ndim != 1 or array.size not in (2, 3) or not np.all(np.isfinite(array)):
        raise InputError(f"{name}={value!r}: expected 2 or 3 finite numbers")
    return array


def direction(name: str, value: ArrayLike) -> Array:
    """A vector as of `vector` that is not zero; need not be a unit vector."""
    array = vector(name, value)
    if not np.any(array):
        raise InputError(f"{name}: the zero vector is no direction")
    return array


def keep_vectors(obstacle: Any, *names: str) -> None:
    """Copy given vectors, so that later edits of the caller's array have no effect; masked values,
    of other attributes too, are refused."""
    for name, value in vars(obstacle).items():
        if holds_masked(value):
            raise InputError(f"{name}={value!r}: masked values have no number; fill them")
    for name in names:
        value = getattr(obstacle, name)
        if isinstance(value, list) or (isinstance(value, np.ndarray) and value.ndim):
            object.__setattr__(
                obstacle, name, tuple(value.tolist() if hasattr(value, "tolist") else value)
            )


def column(given: Array, like: Array) -> Array:
    """A vector broadcastable to points `like`, (dim, ...), or an `InputError`."""
    if given.size != like.shape[0]:
        raise InputError(f"obstacle of dimension {given.size} against a body of {like.shape[0]}")
    return given.reshape((-1,) + (1,) * (like.ndim - 1))
