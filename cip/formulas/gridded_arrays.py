"""Winds and other fields from xarray: their times, arrays and grid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError
from cip.formulas.seconds import seconds
from cip.grid import Grid
from cip.reals import real_array

Array = NDArray[np.float64]


def gridded_arrays(
    data: Any, names: Sequence[str], axes: Sequence[str], time: str, periodic: Any
) -> tuple[Array, Array, Grid]:
    """Times, arrays of shape (times, names) + nodes, and the grid of variables of a dataset.

    Coordinates that fall, as latitudes often do, are turned round; dates become seconds since the
    first. In a periodic direction the last value is not the first one again.

    Parameters
    ----------
    data : xarray.Dataset
    names : sequence of str
        The variables.
    axes : sequence of str
        Coordinates in the order of x1, x2, x3.
    time : str
        The coordinate of time.
    periodic : bool or sequence of bool

    Raises
    ------
    InputError
        A variable or coordinate that is missing, has other dimensions than these, or is not real.
    """
    if not (hasattr(data, "data_vars") and hasattr(data, "coords")):
        raise InputError(f"winds: expected an xarray.Dataset, got {type(data).__name__}")
    names, axes = _names(names, "components"), _names(axes, "axes")
    if not 1 <= len(axes) <= 3 or len(names) != len(axes):
        raise InputError(f"axes: expected one for each of 1 to 3 components, got {axes!r}")
    for name in (*names, *axes, time):
        if name not in data:
            known = ", ".join(map(str, (*data.data_vars, *data.coords)))
            raise InputError(f"winds: the dataset has no {name!r}; it has {known}")
    parts = []
    for name in names:
        if set(data[name].dims) != {time, *axes}:
            raise InputError(
                f"winds: {name!r} has the dimensions {tuple(data[name].dims)}, expected {time} and "
                f"{', '.join(axes)}; select one level by .sel or .isel before"
            )
        parts.append(_reals(data, name, time, *axes))
    values: Array = np.stack(parts, axis=1)
    closed = _closed(periodic, len(axes))
    lines: list[Any] = []
    for axis, name in enumerate(axes):
        if data[name].dims != (name,):
            raise InputError(
                f"winds: the coordinate {name!r} has the dimensions {tuple(data[name].dims)}, "
                f"expected {name} alone; interpolate to a grid of lines before"
            )
        line = _reals(data, name, name)
        if line.size > 1 and line[1] < line[0]:
            line, values = line[::-1], np.flip(values, axis + 2)
        if closed[axis] and line.size > 1:
            line = np.append(line, 2.0 * line[-1] - line[-2])
        lines.append(line)
    y, z = (*lines[1:], None, None)[:2]
    return (
        seconds(data[time].values, f"winds: {time!r}"),
        values,
        Grid.from_coordinates(lines[0], y, z, closed),
    )


def _names(given: Any, label: str) -> tuple[str, ...]:
    """Names of variables or coordinates; a text is not taken for a sequence of letters."""
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise InputError(f"{label}: expected a sequence of names, got {given!r}")
    if not all(isinstance(one, str) for one in given):
        raise InputError(f"{label}: expected names, got {given!r}")
    return tuple(given)


def _closed(periodic: Any, count: int) -> list[bool]:
    """The argument `periodic` for each direction."""
    given = periodic if isinstance(periodic, Sequence | np.ndarray) else [periodic] * count
    if len(given) != count or not all(isinstance(one, bool | np.bool_) for one in given):
        raise InputError(
            f"periodic: expected True or False, or one for each of {count} axes, got {periodic!r}"
        )
    return [bool(one) for one in given]


def _reals(data: Any, name: str, *dims: str) -> Array:
    """A variable or coordinate as real numbers."""
    return real_array(data[name].transpose(*dims).values, f"winds: {name!r}").astype(float)
