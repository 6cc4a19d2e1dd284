"""What contact raises: one tree, each message naming the argument, the finding and the remedy."""

from __future__ import annotations

import sys
import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


class ContactError(Exception):
    """Base class of every error raised by `contact`."""


class InputError(ContactError, ValueError):
    """An argument is malformed: NaN, a wrong shape, an unknown name, an empty set, a wrong sign."""


class NotConverged(ContactError, RuntimeError):
    """A solver stopped before its recomputed residual met the tolerance.

    Attributes
    ----------
    history
        One entry an iteration, as in `ContactResult.history`.
    """

    def __init__(self, message: str, history: tuple[Any, ...] = ()) -> None:
        super().__init__(message)
        self.history = history


class Infeasible(ContactError):
    """No displacement satisfies the fixed values and the gap together."""


class Unbounded(ContactError):
    """The body is not held: a rigid motion meets no resistance.

    Attributes
    ----------
    mode : ndarray, shape (ndofs,)
        The free rigid motion, normalised to a largest entry of one.
    """

    def __init__(self, message: str, mode: NDArray[np.float64]) -> None:
        super().__init__(message)
        self.mode = mode


class ContactWarning(UserWarning):
    """The problem is well posed, but hardly the one that was meant; the message says what to do."""


class MissingDependency(ContactError, ImportError):
    """An optional package is needed; the message holds the install line."""


def warn(message: str) -> None:
    """Issue a `ContactWarning` that points at the line which called this package."""
    depth, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals["__name__"].startswith("contact."):
        depth, frame = depth + 1, frame.f_back
    warnings.warn(message, ContactWarning, stacklevel=depth)


def numbers(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Real numbers as an array of floats, or an `InputError` that names the argument."""
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "biuf":
            raise TypeError(f"{array.dtype} is not a real number")
        return array.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}={value!r}: expected real numbers ({error})") from error
