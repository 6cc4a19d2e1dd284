"""Warnings of the package, the exceptions that it shares with the others; readers of arguments."""

from __future__ import annotations

import inspect
import sys
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skfem_adini.ground.errors import (  # noqa: F401
    AdiniError,
    Infeasible,
    InputError,
    MissingDependency,
    NotConverged,
    Unbounded,
)

ContactError = AdiniError
CHANGED = 0.25  # change of the gap along a motion, over the penetration, that is warned of


class ContactWarning(UserWarning):
    """The problem is well posed, but hardly the one that was meant; the message says what to do.

    A result is returned and is certified. Do what the message says, or filter the warning where the
    problem is meant so.

    Examples
    --------
    A roller that lies beside the block:

    >>> import warnings
    >>> from contact import ContactProblem, Cylinder, ElasticBody
    >>> from skfem import MeshQuad
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(1).with_defaults(), E=1.0, nu=0.3)
    >>> with warnings.catch_warnings(record=True) as found:
    ...     warnings.simplefilter("always")
    ...     problem = ContactProblem(body.fix("top", "xy"), "bottom", Cylinder((5.0, -1.0), 1.0))
    >>> print(found[0].message)
    obstacle: no normal of the contact boundary meets the Cylinder, so that nothing can touch; ...
    """


class LargeMotionWarning(ContactWarning):
    """Loaded points have moved along the obstacle so far that their gaps are others by now.

    Contact is linearised at rest: points keep the partners, normals and gaps which they have there.
    Let bodies slide with `LoadStepper(..., sliding="finite")`; place a rigid obstacle where it has
    moved to, as `LoadStepper.obstacle` does, instead of a large motion of a `Rigid`; or measure the
    gap by `ClosestPoint`, which a motion along a plane does not change. Where the gaps are off by
    more than bodies are pressed together, the result is refused with an `InputError`.

    Examples
    --------
    A roller of radius 1, pressed into a block by .02 and rolled on by .05:

    >>> import warnings
    >>> from contact import ContactProblem, Cylinder, ElasticBody, Rigid
    >>> from skfem import MeshQuad
    >>> mesh = MeshQuad().refined(5).translated((-0.5, -1.0)).with_defaults()
    >>> body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("bottom", "xy")
    >>> roller = Rigid(Cylinder((0.0, 1.0), 1.0), displacement=(0.05, -0.02))
    >>> with warnings.catch_warnings(record=True) as found:
    ...     warnings.simplefilter("always")
    ...     result = ContactProblem(body, "top", roller).solve()
    >>> print(found[0].category.__name__)
    LargeMotionWarning
    """


def warn(message: str, category: type[ContactWarning] = ContactWarning) -> None:
    """Issue a warning that points at the line which called this package."""
    depth, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals["__name__"].startswith("contact."):
        depth, frame = depth + 1, frame.f_back
    warnings.warn(message, category, stacklevel=depth)


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
