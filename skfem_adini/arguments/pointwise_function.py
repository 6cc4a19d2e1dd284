"""A function given by the caller that must act on each point alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skfem_adini.errors import InputError

Array = NDArray[Any]

_MORE_PLACES = 6  # points tried beside the outermost ones
_ROUNDING = 1e-11  # relative to the largest value: vector instructions round differently


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
    if found.dtype.kind not in "biuf":  # no real numbers: the caller says so
        return
    shape = x.shape[1:]
    if not x.size or not np.isfinite(found).all():
        return
    vectors = 1 if len(shape) == 1 else 0  # at a list of places one row is one vector for all
    field = found.ndim >= len(shape) + vectors and found.shape[-len(shape) :] == shape
    limit = _ROUNDING * np.abs(found).max(initial=0.0)
    for place in _places(x.reshape(len(x), -1)):
        at: Any = tuple(slice(i, i + 1) for i in np.unravel_index(place, shape))
        try:
            alone = np.asarray(function(x[:, *at]), dtype=float)
        except Exception as error:
            raise _refused(name, f"at one place alone it fails ({error!r})") from error
        if np.array_equal(alone, found):
            continue  # numbers of its own, whatever the places
        expected = found[..., *at] if field else found
        if alone.shape != expected.shape or not np.abs(alone - expected).max() <= limit:
            raise _refused(name, "at one place alone it gives another value than among others")


def _places(x: Array) -> NDArray[np.integer]:
    others = np.random.default_rng(0).permutation(x.shape[1])[:_MORE_PLACES]
    return np.unique(np.concatenate((x.argmin(axis=1), x.argmax(axis=1), others)))


def _refused(name: str, finding: str) -> InputError:
    return InputError(
        f"{name}: the function does not act on each place alone: {finding}. On cells that a curve "
        "cuts, places come in several batches, with points of weight zero: compute numbers such "
        "as a mean or a largest value beforehand"
    )
