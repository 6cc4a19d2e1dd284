"""Conversion of user arguments to NumPy types, or an `InputError` that names the argument."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from functools import wraps
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from skfem_adini.ground.errors import InputError

Array = NDArray[Any]
Numbers = NDArray[np.float64]
Hidden = NDArray[np.bool_] | None
Function = TypeVar("Function", bound=Callable[..., Any])
# What others call an argument: the first of these names that a function has is meant.
_OTHER_NAMES = {
    ("young", "youngs", "youngs_modulus", "young_modulus", "modulus", "e"): ("E",),
    ("poisson", "poisson_ratio", "poissons_ratio", "v"): ("nu",),
    ("mu", "mue", "cof", "friction_coefficient", "coefficient"): ("friction",),
    ("tolerance", "eps", "rtol", "atol", "eps_abs"): ("tol",),
    ("max_iter", "maxiter", "maxit", "iterations"): ("max_iterations",),
    ("solver", "algorithm"): ("method", "backend"),
    ("scheme", "order"): ("profile",),
    ("bc", "boundary_conditions"): ("boundary",),
    ("time_step", "delta_t"): ("dt",),
    ("n", "size", "resolution", "points"): ("cells", "shape"),
    ("box", "extent", "domain"): ("bounds", "lengths"),
    ("aeq", "a_eq"): ("A",),
    ("beq", "b_eq"): ("b",),
    ("aub", "a_ub"): ("G",),
    ("bub", "b_ub"): ("h",),
    ("c", "f", "linear"): ("q",),
    ("h", "quadratic"): ("P",),
    ("lower", "bounds"): ("lb",),
    ("upper",): ("ub",),
    ("x0", "initvals", "guess", "initial"): ("start",),
}
_LAME = "E = mu (3 lam + 2 mu) / (lam + mu) and nu = lam / (2 (lam + mu))"


def keywords_named(function: Function) -> Function:
    """The function, whose `TypeError` for an unknown keyword names the one that is meant."""
    spec = inspect.getfullargspec(function)
    if spec.varkw is not None:
        return function
    known = [name for name in spec.args + spec.kwonlyargs if name not in ("self", "cls")]

    @wraps(function)
    def checked(*given: Any, **named: Any) -> Any:
        for name in named:
            if name not in known and (hint := _meant(name, known)):
                whole = re.sub(r"\.__\w+__$", "", function.__qualname__)
                raise TypeError(f"{whole}: there is no argument {name!r}; {hint}")
        return function(*given, **named)

    return checked  # type: ignore[return-value]


def _meant(name: str, known: Sequence[str]) -> str:
    """What to write instead of an unknown argument, or nothing."""
    if {"E", "nu"} <= set(known) and name.lower() in ("lam", "lame", "lmbda", "mu", "g"):
        return f"it takes E and nu; of Lame's constants lam and mu, {_LAME}"
    for others, ours in _OTHER_NAMES.items():
        meant = [own for own in ours if own in known]
        if name.lower() in others and meant:
            return f"do you mean {meant[0]!r}?"
    lower = {own.lower(): own for own in known}
    near = get_close_matches(name.lower(), lower, 1, 0.7)
    return f"do you mean {lower[near[0]]!r}?" if near else f"it takes {', '.join(known)}"


def shown(value: Any) -> str:
    """A value as messages show it: for large values the type."""
    if isinstance(value, int) and abs(value) > 1e18:
        return "a whole number beyond 1e18"
    if isinstance(value, int | float | complex | np.number | str | None):
        return f"{value.item() if isinstance(value, np.generic) else value!r:.60}"
    return type(value).__name__


def flag(name: str, value: Any) -> bool:
    """True or False."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name}={shown(value)}: expected True or False")
    return bool(value)


def choice(name: str, value: Any, among: Iterable[str]) -> str:
    """One of some words."""
    among = tuple(among)
    if not isinstance(value, str) or value not in among:
        words = ", ".join(map(repr, among[:-1]))
        raise InputError(f"{name}={shown(value)}: expected {words} or {among[-1]!r}")
    return value


def integer(name: str, value: Any, least: float, most: float = np.inf) -> int:
    """A whole number within limits."""
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or not least <= value <= most:
        upper = "" if most == np.inf else f" to {most:.0f}"
        raise InputError(f"{name}={shown(value)}: expected a whole number from {least:.0f}{upper}")
    return int(value)


def real_number(name: str, value: Any) -> float:
    """One real number, which may be infinite or NaN, but not True or False."""
    array = real_array(name, value)
    if array.dtype.kind == "b":
        raise InputError(f"{name}: expected a number, got {value!r}")
    if array.ndim:
        raise InputError(f"{name}: expected one number, got shape {array.shape}")
    return float(array)


def finite_number(name: str, value: Any) -> float:
    """One finite number."""
    number = numbers(name, value)
    if number.shape != () or not np.isfinite(number):
        raise InputError(f"{name}={value!r}: expected a finite number")
    return float(number)


def positive_number(name: str, value: Any, most: float = np.inf) -> float:
    """One positive number, at most `most`."""
    if isinstance(value, bool) or not 0 < finite_number(name, value) <= most:
        limit = "" if np.isinf(most) else f", at most {most:g}"
        raise InputError(f"{name}={value!r}: expected a positive number{limit}")
    return float(value)


def is_finite_number(value: Any) -> bool:
    """Whether a value is one real or complex number that is finite in double precision."""
    if isinstance(value, bool) or not isinstance(value, int | float | complex | np.number):
        return False
    try:
        return bool(np.isfinite(complex(value)))
    except OverflowError:
        return False


def array_of(name: str, value: Any) -> Array:
    """An array of any kind, or an `InputError` where nested sequences have no shape."""
    if holds_masked(value):
        raise InputError(f"{name}={value!r}: masked values have no number; fill them")
    try:
        return np.asarray(value)
    except ValueError as error:
        raise InputError(f"{name}={value!r}: {error}") from None


def real_array(name: str, value: Any) -> Array:
    """The value as an array of real numbers, maybe the caller's own; masks, also in lists, tuples
    and arrays of objects, complex numbers and texts are refused."""
    array, hidden = masked_array(name, value)
    if hidden is not None:
        at = tuple(int(q) for q in np.argwhere(hidden)[0])
        where = f", the first at {at}" if at else ""
        raise InputError(
            f"{name}: some values are masked{where}; fill them, for instance by .filled(0.0)"
        )
    return array


def own_array(name: str, value: Any) -> Array:
    """The same as a copy, so that changes of the caller's array have no effect."""
    return np.array(real_array(name, value))


def numbers(name: str, value: ArrayLike) -> Numbers:
    """Real numbers as a new array of floats."""
    try:
        return real_array("it", value).astype(np.float64)
    except InputError as error:
        reason = str(error).removeprefix("it: ")
        raise InputError(f"{name}={value!r}: expected real numbers ({reason})") from error


def masked_array(name: str, value: Any) -> tuple[Array, Hidden]:
    """The value as an array of real numbers, and where it is masked; None if it is nowhere."""
    try:
        value, hidden = _uncovered(value)
        array = np.asanyarray(value)
        if isinstance(array, np.ma.MaskedArray) or array.dtype == object:
            # It was taken from another library's object.
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


def holds_masked(value: Any) -> bool:
    """Whether entries are masked, also those of arrays in lists, in tuples and among objects."""
    nested = isinstance(value, list | tuple)
    if isinstance(value, np.ndarray):
        nested = value.dtype == object and value.ndim > 0
        if np.ma.is_masked(value):
            return True
    return nested and any(type(one) not in (float, int) and holds_masked(one) for one in value)


def unmasked(name: str, value: Any) -> None:
    """Refuse arrays whose entries would be misread: masked ones, and sparse vectors."""
    if holds_masked(value):
        raise InputError(
            f"{name} has masked entries: fill them, or leave out their rows and columns"
        )
    dimensions = len(getattr(value, "shape", ())) if sparse.issparse(value) else 2
    if dimensions != 2:
        raise InputError(
            f"{name} is a sparse array of {dimensions} dimensions: pass a matrix, or a dense vector"
        )


def finite_numbers(name: str, value: Any, shape: tuple[int, ...], complex_too: bool = False) -> Any:
    """Finite numbers of a shape in double precision, complex ones if `complex_too`."""
    kinds = "real or complex" if complex_too else "real"
    array = array_of(name, value)
    if array.shape != shape or array.dtype.kind not in ("iufc" if complex_too else "iuf"):
        raise InputError(
            f"{name}: expected finite {kinds} numbers of shape {shape}, got {array.dtype} of shape "
            f"{array.shape}"
        )
    bad = ~np.isfinite(array)
    if bad.any():
        place = tuple(np.argwhere(bad)[0].tolist())
        raise InputError(
            f"{name}: {bad.sum()} of {array.size} entries are NaN or infinite (first: "
            f"{array[place]} at {place}); expected finite {kinds} numbers"
        )
    return array.astype(complex if array.dtype.kind == "c" else float)


def real_part(name: str, value: Any) -> Numbers:
    """An array of floats; complex numbers must have no imaginary part."""
    array = array_of(name, value)
    if array.dtype.kind not in "biufc":
        try:
            array = array.astype(np.float64)
        except (TypeError, ValueError):
            kind = f"{type(value).__name__} of the type {array.dtype}"
            raise InputError(f"{name}: expected an array of numbers, got {kind}") from None
    if array.dtype.kind == "c":
        _check_real(name, array)
        array = array.real
    return np.asarray(array, dtype=np.float64)


def real_matrix(name: str, value: Any) -> Any:
    """A sparse matrix of floats by rows; see `real_part`."""
    matrix: Any = value
    if not sparse.issparse(value):
        dense = real_part(name, value)
        if dense.ndim != 2:
            raise InputError(f"{name}: expected a matrix, got shape {dense.shape}")
        return sparse.csr_array(dense)
    if matrix.dtype.kind not in "biufc":
        raise InputError(f"{name}: expected numbers, got the type {matrix.dtype}")
    if matrix.dtype.kind == "c":
        _check_real(name, matrix.tocsr().data)
        matrix = matrix.real
    return sparse.csr_array(matrix, dtype=np.float64)


def _check_real(name: str, values: Any) -> None:
    if not (values.imag == 0).all():
        raise InputError(
            f"{name}: expected real numbers, got complex ones; solve for the real and the "
            "imaginary part one by one"
        )


def dof_numbers(name: str, value: Any, size: int) -> NDArray[np.intp]:
    """Numbers of dofs, from numbers, a mask (size,), or the result of ``basis.get_dofs``."""
    dofs = array_of(name, value.flatten() if hasattr(value, "flatten") else value)
    if dofs.dtype == bool:
        if dofs.shape != (size,):
            raise InputError(f"{name}: a mask of dofs has the shape ({size},), got {dofs.shape}")
        return np.flatnonzero(dofs)
    if dofs.size == 0:
        return np.empty(0, dtype=np.intp)
    if dofs.dtype.kind not in "iu":
        raise InputError(f"{name}: expected numbers of dofs, got {value!r}")
    if not 0 <= dofs.min() <= dofs.max() < size:
        bad = dofs[(dofs < 0) | (dofs >= size)].ravel()[0]
        raise InputError(f"{name}: expected dofs from 0 to {size - 1}, got {bad}")
    return np.asarray(dofs.ravel(), dtype=np.intp)


def function_of_places(name: str, function: Any) -> Callable[..., Any]:
    """A caller's function of positions x; `InputError` unless it takes one argument."""
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


def evaluated(name: str, value: Any, x: Numbers) -> Numbers:
    """Numbers of the caller, or a function of the positions x that returns them."""
    return numbers(name, function_of_places(name, value)(x) if callable(value) else value)


def pointwise(name: str, function: Callable[[Array], Any]) -> Callable[[Array], Any]:
    """Return the function of points (dim, ...), which then raises where a value depends on others.
    The points of a call are padded batches, so a maximum over them means nothing. Values are
    compared with those at a few single points, the outermost ones included."""

    def checked(x: Array) -> Any:
        value = function(x)
        _check(name, function, np.asarray(x), value)
        return value

    return checked


def _check(name: str, function: Callable[[Array], Any], x: Array, value: Any) -> None:
    try:
        found = np.asarray(value)
    except ValueError:  # no array
        return
    if found.dtype.kind not in "biuf":  # no real numbers: the caller raises the error
        return
    shape = x.shape[1:]
    if not x.size or not np.isfinite(found).all():
        return
    vectors = 1 if len(shape) == 1 else 0  # at a list of places one row is one vector for all
    field = found.ndim >= len(shape) + vectors and found.shape[-len(shape) :] == shape
    limit = 1e-11 * np.abs(found).max(initial=0.0)  # vector instructions round differently
    for place in _places(x.reshape(len(x), -1)):
        at: Any = tuple(slice(i, i + 1) for i in np.unravel_index(place, shape))
        try:
            alone = np.asarray(function(x[:, *at]), dtype=float)
        except Exception as error:
            raise _refused(name, f"at one place alone it fails ({error!r})") from error
        if np.array_equal(alone, found):
            continue  # numbers that do not depend on the positions
        expected = found[..., *at] if field else found
        if alone.shape != expected.shape or not np.abs(alone - expected).max() <= limit:
            raise _refused(name, "at one place alone it gives another value than among others")


def _places(x: Array) -> NDArray[np.integer]:
    others = np.random.default_rng(0).permutation(x.shape[1])[:6]
    return np.unique(np.concatenate((x.argmin(axis=1), x.argmax(axis=1), others)))


def _refused(name: str, finding: str) -> InputError:
    return InputError(
        f"{name}: the function does not act on each place alone: {finding}. On cells that a curve "
        "cuts, places come in several batches, with points of weight zero: compute numbers such "
        "as a mean or a largest value beforehand"
    )
