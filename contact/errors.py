"""Exceptions and warnings; each message names the argument, what was found, and the remedy."""

from __future__ import annotations

import inspect
import re
import sys
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

CHANGED = 0.25  # change of the gap along a motion, over the penetration, that is warned of
# How NumPy shows its numbers, alone or in a tuple; what is said is the number.
_NUMPY_SCALAR = re.compile(
    r"\bnp\.(?:(?:u?int|float|complex|c?longdouble|str_|bool)\d*\(([^()]*|\(.*?\))\)|(True|False)_)"
)


class ContactError(Exception):
    """Base class of every error raised by `contact`.

    Catch it where any failure of the package is to be treated alike; its subclasses tell what to
    do.

    Examples
    --------
    >>> from contact import ContactError, ElasticBody
    >>> from skfem import MeshQuad
    >>> try:
    ...     ElasticBody.from_mesh(MeshQuad().refined(1), E=1.0, nu=0.5)
    ... except ContactError as error:
    ...     print(error)
    nu=0.5: Poisson's ratio must lie in (-1, 1/2)
    """

    def __str__(self) -> str:
        return _NUMPY_SCALAR.sub(r"\1\2", str(self.args[0]) if self.args else "")


class InputError(ContactError, ValueError):
    """An argument is malformed: NaN, a wrong shape, an unknown name, an empty set, a wrong sign.

    Nothing has been computed. Mend the argument that the message begins with; it is a `ValueError`
    too, so that code which knows only the exceptions of Python catches it.

    Examples
    --------
    >>> from contact import ContactProblem, ElasticBody
    >>> from skfem import MeshQuad
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(1).with_defaults(), E=1.0, nu=0.3)
    >>> ContactProblem(body, "bottom", 0.0, friction=-0.1).solve()
    Traceback (most recent call last):
        ...
    contact.errors.InputError: friction: must be finite and not negative
    """


class NotConverged(ContactError, RuntimeError):
    """A solver stopped before its recomputed residual met the tolerance.

    No result is returned, because it could not be certified. Do what the message says: it names the
    residual that was reached, and the argument or the method to change.

    Attributes
    ----------
    history : tuple of Iteration
        One entry an iteration, as in `ContactResult.history`.

    Examples
    --------
    A fixed point that is allowed two steps; the message says what to change:

    >>> from contact import ContactProblem, ElasticBody
    >>> from skfem import MeshQuad
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> body = body.fix("top", "xy").load("left", (0.1, -0.1))
    >>> problem = ContactProblem(body, "bottom", -0.01, friction=0.5)
    >>> problem.solve(method="fixed_point", max_iterations=2)
    Traceback (most recent call last):
        ...
    contact.errors.NotConverged: fixed point: ... raise max_iterations or eps, or use method=...
    """

    def __init__(self, message: str, history: tuple[Any, ...] = ()) -> None:
        super().__init__(message)
        self.history = history


class Infeasible(ContactError):
    """No displacement satisfies the fixed values and the gap together.

    Supports hold a contact point inside the obstacle. Free that support, or move it or the
    obstacle; the message names the contact point and its place.

    Examples
    --------
    The upper left corner is held, and an obstacle on the left reaches .1 into the body:

    >>> from contact import ContactProblem, ElasticBody
    >>> from skfem import MeshQuad
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(1).with_defaults(), E=1.0, nu=0.3)
    >>> ContactProblem(body.fix("top", "xy"), "left", -0.1).solve()
    Traceback (most recent call last):
        ...
    contact.errors.Infeasible: obstacle: contact point ... is fixed at normal displacement 0, ...
    """


class Unbounded(ContactError):
    """The body is not held: a rigid motion meets no resistance.

    Fix a displacement that this motion changes, add friction or an obstacle that stops it, or turn
    the load that drives it away from the obstacle.

    Attributes
    ----------
    mode : ndarray, shape (ndofs,)
        The free rigid motion, normalised to a largest entry of one.

    Examples
    --------
    A block that is pulled off its foundation:

    >>> from contact import ContactProblem, ElasticBody
    >>> from skfem import MeshQuad
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(1).with_defaults(), E=1.0, nu=0.3)
    >>> body = body.fix("left", "x").load("top", (0.0, 1.0))
    >>> ContactProblem(body, "bottom", 0.0).solve()
    Traceback (most recent call last):
        ...
    contact.errors.Unbounded: the body is not held: a translation along y meets no resistance ...
    """

    def __init__(self, message: str, mode: NDArray[np.float64]) -> None:
        super().__init__(message, mode)  # both: pickle makes errors anew from these
        self.mode = mode


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


class MissingDependency(ContactError, ImportError):
    """An optional package is needed; the message holds the install line.

    Run the line that the message ends with and repeat the call; it is an `ImportError` too.

    Examples
    --------
    An environment without pypardiso:

    >>> from unittest.mock import patch
    >>> from contact import ContactProblem, ElasticBody
    >>> from skfem import MeshQuad
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(1).with_defaults(), E=1.0, nu=0.3)
    >>> problem = ContactProblem(body.fix("top", "xy"), "bottom", -0.01, solver="pardiso")
    >>> with patch.dict("sys.modules", {"pypardiso": None}):
    ...     problem.solve()
    Traceback (most recent call last):
        ...
    contact.errors.MissingDependency: PARDISO needs pypardiso: pip install 'skfem-adini[mkl]'
    """


def warn(message: str, category: type[ContactWarning] = ContactWarning) -> None:
    """Issue a warning that points at the line which called this package."""
    depth, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals["__name__"].startswith("contact."):
        depth, frame = depth + 1, frame.f_back
    warnings.warn(message, category, stacklevel=depth)


def holds_masked(value: Any) -> bool:
    """Whether entries are masked, also those of arrays in lists, in tuples and among objects."""
    nested = isinstance(value, list | tuple)
    if isinstance(value, np.ndarray):
        nested = value.dtype == object and value.ndim > 0
        if np.ma.is_masked(value):
            return True
    return nested and any(type(one) not in (float, int) and holds_masked(one) for one in value)


def numbers(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Real numbers as an array of floats, a copy, or an `InputError` that names the argument."""
    try:
        if holds_masked(value):
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
    if holds_masked(value):
        raise InputError(f"{name}={value!r}: masked values have no number; fill them")
    try:
        return np.asarray(value)
    except ValueError as error:
        raise InputError(f"{name}={value!r}: {error}") from None
