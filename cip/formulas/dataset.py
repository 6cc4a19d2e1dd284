"""Winds in an xarray.Dataset: names, axes, dates, and the arrays, read when they are needed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cip.errors import InputError
from cip.grid import AXES, Array, Grid
from skfem_adini.ground.arguments import real_array


class _Reader(NamedTuple):
    """Reads arrays of one time, shape (names) + nodes, or of a slice of them."""

    data: Any
    names: tuple[str, ...]
    axes: tuple[str, ...]
    time: str
    falling: tuple[int, ...]  # directions to be reversed, counted from the last

    def __call__(self, chosen: Any) -> Array:
        data = self.data.isel({self.time: chosen})
        dims = (self.time, *self.axes) if isinstance(chosen, slice) else self.axes
        values = np.stack([_reals(data, name, *dims) for name in self.names], -len(self.axes) - 1)
        return np.flip(values, self.falling)


def gridded_arrays(
    data: Any, names: Sequence[str], axes: Sequence[str], time: str, periodic: Any
) -> tuple[Array, _Reader, Grid]:
    """Times, a function that reads the arrays of some, and the grid, from variables of an
    xarray.Dataset. Falling coordinates, as of latitudes, are reversed; dates become seconds since
    the first; a periodic direction does not repeat its first value."""
    if not (hasattr(data, "data_vars") and hasattr(data, "coords")):
        raise InputError(f"winds: expected an xarray.Dataset, got {type(data).__name__}")
    names, axes = _names(names, "components"), _names(axes, "axes")
    if not 1 <= len(axes) <= 3 or len(names) != len(axes):
        raise InputError(f"axes: expected one for each of 1 to 3 components, got {axes!r}")
    for name in (*names, *axes, time):
        if name not in data:
            known = ", ".join(map(str, (*data.data_vars, *data.coords)))
            raise InputError(f"winds: the dataset has no {name!r}; it has {known}")
    for name in names:
        if set(data[name].dims) != {time, *axes}:
            raise InputError(
                f"winds: {name!r} has the dimensions {tuple(data[name].dims)}, expected {time} and "
                f"{', '.join(axes)}; select one level by .sel or .isel before"
            )
        speed = str(data[name].attrs.get("units", ""))
        for along in axes:
            length = str(data[along].attrs.get("units", ""))
            if length.startswith("deg") and not speed.startswith("deg"):
                raise InputError(
                    f"winds: {along!r} is in degrees, {name!r} in {speed or 'no unit'}; convert "
                    "the axis to metres, or take SphereSolver"
                )
            if (length[:1], speed[:1]) in (("k", "m"), ("m", "k")):
                raise InputError(
                    f"winds: {along!r} is in {length}, {name!r} in {speed}; convert one"
                )
    closed = _closed(periodic, len(axes))
    lines: list[Any] = []
    falling = []
    for axis, name in enumerate(axes):
        if data[name].dims != (name,):
            raise InputError(
                f"winds: the coordinate {name!r} has the dimensions {tuple(data[name].dims)}, "
                f"expected {name} alone; interpolate to a grid of lines before"
            )
        line = _reals(data, name, name)
        if line.size > 1 and line[1] < line[0]:
            line = line[::-1]
            falling.append(axis - len(axes))
        if closed[axis] and line.size > 1:
            line = np.append(line, 2.0 * line[-1] - line[-2])
        lines.append(line)
    y, z = (*lines[1:], None, None)[:2]
    return (
        seconds(data[time].values, f"winds: {time!r}"),
        _Reader(data, names, axes, time, tuple(falling)),
        Grid.from_coordinates(lines[0], y, z, closed),
    )


def meaning(data: Any, axes: Sequence[str], time: str) -> tuple[Any, dict[str, str]]:
    """The date of the first time, None for numbers, and the units of coordinates by x, y, z."""
    first = data[time].values.flat[0]
    start = first if isinstance(first, np.datetime64) else None
    units = {own: data[name].attrs.get("units") for own, name in zip(AXES, axes, strict=False)}
    return start, {own: str(unit) for own, unit in units.items() if unit is not None}


def _names(given: Any, label: str) -> tuple[str, ...]:
    """Names of variables or coordinates; a string is one name."""
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
    return real_array(f"winds: {name!r}", data[name].transpose(*dims).values).astype(float)


def seconds(times: Any, name: str, since: Any = None) -> Array:
    """Times as numbers: durations in seconds, dates in seconds since the date `since` (by default
    the first of them), numbers as given. Messages of `InputError` call them `name`."""
    if np.ma.is_masked(times):
        raise InputError(f"{name} holds masked times; leave them out")
    found, second = np.asarray(times), np.timedelta64(1, "s")
    if since is not None and found.dtype.kind != "M":
        raise InputError(f"since: {name} holds {found.dtype}, no dates; leave since out")
    if found.dtype.kind == "M":
        found = (found - (found.flat[0] if since is None else date_of(since, "since"))) / second
    elif found.dtype.kind == "m":
        found = found / second
    elif found.dtype.kind not in "fiu":
        raise InputError(
            f"{name} holds {found.dtype}, expected numbers, datetime64 or timedelta64; "
            "convert dates of other calendars to seconds before"
        )
    return found.astype(float)


def date_of(given: Any, name: str) -> np.datetime64:
    """The argument `name` as a date."""
    try:
        found = np.datetime64(given, "ns")
    except (TypeError, ValueError):
        found = np.datetime64("NaT")
    if isinstance(given, int | np.integer) or np.isnat(found):
        raise InputError(f"{name}: expected a date such as '2010-05-04T12:00', got {given!r}")
    return found
