"""Checks of the numbers and vectors that describe an obstacle."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.errors import InputError
from skfem_adini.ground.arguments import holds_masked, numbers

Array = NDArray[np.float64]
GRAZING = 0.0175  # sine of 1 degree: normals at smaller angles to the obstacle meet nothing


def vector(name: str, value: ArrayLike, dim: int | None = None) -> Array:
    """A vector of 2 or 3 finite numbers, or of `dim`, or an `InputError` with the argument's
    name."""
    array = numbers(name, value)
    sizes = (2, 3) if dim is None else (dim,)
    if array.ndim != 1 or array.size not in sizes or not np.all(np.isfinite(array)):
        expected = " or ".join(map(str, sizes))
        raise InputError(f"{name}={value!r}: expected {expected} finite numbers")
    return array


def direction(name: str, value: ArrayLike) -> Array:
    """A vector as of `vector` that is not zero; need not be a unit vector."""
    array = vector(name, value)
    if not np.any(array):
        raise InputError(f"{name}: the zero vector is no direction")
    return array


def positive_lengths(lengths: ArrayLike, axes: int) -> Array:
    """A positive number for each axis of a grid, shape (axes,)."""
    array = np.atleast_1d(numbers("lengths", lengths))
    if array.shape != (axes,) or not np.all((array > 0) & np.isfinite(array)):
        raise InputError(f"lengths={lengths!r}: expected {axes} positive numbers, one an axis")
    return array


@contextmanager
def reading(path: str | PathLike[str], formats: Sequence[str], what: str) -> Iterator[Path]:
    """The path of a file of one of the `formats`; errors of its readers, of any type, name it."""
    try:
        place = Path(path)
    except TypeError as error:
        raise InputError(f"path={path!r}: expected the name of a file ({error})") from None
    kind = place.suffix.lower()
    if kind not in formats:
        raise InputError(f"path={path!r}: {what} are read from {', '.join(formats)} files")
    if not place.is_file():
        raise InputError(f"path={path!r}: there is no such file")
    try:
        yield place
    except Exception as error:
        said = str(error) or type(error).__name__
        raise InputError(f"path={path!r}: not readable as {kind} ({said})") from error


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
