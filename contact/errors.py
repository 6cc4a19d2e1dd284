"""What contact raises: one tree, each message naming the argument, the finding and the remedy."""

from __future__ import annotations

import inspect
import sys
import warnings
from collections.abc import Callable
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
        super().__init__(message, mode)  # both: pickle makes errors anew from these
        self.mode = mode

    def __str__(self) -> str:
        return str(self.args[0])


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
    """Real numbers as an array of floats, a copy, or an `InputError` that names the argument."""
    try:
        if np.ma.is_masked(value):
            raise TypeError("masked values have no number; fill them")
        array = np.asarray(value)
        if array.dtype.kind not in "biuf":
            raise TypeError(f"{array.dtype} is not a real number")
        return array.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}={value!r}: expected real numbers ({error})") from error


def function_of_places(name: str, function: Any) -> Callable[..., Any]:
    """A caller's function of places x; `InputError` where it does not take one argument."""
    try:
        if not callable(function):
            raise TypeError("it cannot be called")
        inspect.signature(function).bind(None)
    except TypeError as error:
        raise InputError(
            f"{name}: expected a function of one argument, the places x of shape (dim, ...), got "
            f"{function!r} ({error})"
        ) from None
    except ValueError:  # compiled functions may have no signature
        pass
    checked: Callable[..., Any] = function
    return checked


def evaluated(name: str, value: Any, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Numbers that a caller gives, or a function of the places x that returns them."""
    return numbers(name, function_of_places(name, value)(x) if callable(value) else value)


def array_of(name: str, value: Any) -> NDArray[Any]:
    """An array of any kind, or an `InputError` where nested sequences have no shape."""
    try:
        return np.asarray(value)
    except ValueError as error:
        raise InputError(f"{name}={value!r}: {error}") from None
