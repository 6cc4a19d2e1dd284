"""Winds and other fields from xarray: their times, arrays and grid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError
from cip.grid import Grid

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
        A variable or coordinate that is missing, or has other dimensions than these.
    """
    if not (hasattr(data, "data_vars") and hasattr(data, "coords")):
        raise InputError(f"winds: expected an xarray.Dataset, got {type(data).__name__}")
    if not 1 <= len(axes) <= 3 or len(names) != len(axes):
        raise InputError(f"axes: expected one for each of 1 to 3 components, got {axes!r}")
    closed = [bool(one) for one in np.broadcast_to(periodic, len(axes))]
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
        parts.append(np.asarray(data[name].transpose(time, *axes).values, dtype=float))
    values: Array = np.stack(parts, axis=1)
    lines: list[Any] = []
    for axis, name in enumerate(axes):
        line = np.asarray(data[name].values, dtype=float)
        if line.size > 1 and line[1] < line[0]:
            line, values = line[::-1], np.flip(values, axis + 2)
        if closed[axis] and line.size > 1:
            line = np.append(line, 2.0 * line[-1] - line[-2])
        lines.append(line)
    y, z = (*lines[1:], None, None)[:2]
    return _seconds(data[time].values), values, Grid.from_coordinates(lines[0], y, z, closed)


def _seconds(times: Any) -> Array:
    found = np.asarray(times)
    if found.dtype.kind == "M":
        found = (found - found[0]) / np.timedelta64(1, "s")
    elif found.dtype.kind == "m":
        found = found / np.timedelta64(1, "s")
    return found.astype(float)
