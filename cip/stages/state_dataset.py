"""States at several times as variables of an xarray.Dataset."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from cip.errors import InputError
from cip.formulas.dataset import date_of
from cip.grid import Sphere
from cip.profiles.catalogue import moments
from skfem_adini.ground.errors import optional

_AXES, _DEGREES = {"lon": "X", "lat": "Y"}, {"lon": "degrees_east", "lat": "degrees_north"}
# Nanoseconds in each unit of time that dates are counted in.
_UNITS = {"s": 1e9, "min": 6e10, "h": 3.6e12, "d": 8.64e13}


def state_dataset(
    states: Sequence[Any], start: Any = None, units: Mapping[str, str] | None = None
) -> Any:
    """An xarray.Dataset of the states of one grid and profile: each moment over t and the
    coordinates. Averaged directions have the midpoints of cells, ``x_cell``, ``y_cell``,
    ``z_cell``. `start` and `units` as for `Trajectory.to_xarray`."""
    xarray, first = xarray_module(), states[0]
    grid = first.grid
    on_sphere = isinstance(grid, Sphere)
    axes = ["lon", "lat"] if on_sphere else ["x", "y", "z"][: grid.dim]
    data, coordinates = {}, {"t": np.array([state.t for state in states])}
    lines = map(np.degrees, grid.coordinates) if on_sphere else grid.coordinates
    coordinates.update(zip(axes, lines, strict=True))
    carried = moments(first.profile, grid.dim) * max(1, len(first.fields))
    for name, moment in zip(first.names, carried, strict=True):
        places = list(axes)
        for axis in () if on_sphere else moment.averaged:
            places[axis] += "_cell"
            coordinates[places[axis]] = grid.edges[axis][:-1] + 0.5 * grid.widths[axis]
        data[name] = (["t", *places], np.stack([state[name] for state in states]))
    found = xarray.Dataset(data, coordinates, {"profile": first.profile})
    _describe(found, {} if units is None else units, first.fields or ("u",))
    if start is not None:
        unit = (units or {}).get("t", "s")
        found = found.assign_coords(t=("t", _dates(coordinates["t"], start, unit), {"axis": "T"}))
    return found


def _describe(dataset: Any, units: Mapping[str, str], fields: Sequence[str]) -> None:
    """The attributes of the CF conventions: axes, and units of coordinates and fields."""
    known = {*dataset.coords, *fields}
    if not isinstance(units, Mapping):
        raise InputError(f"units: expected units by names, got {units!r}")
    if beyond := sorted(map(str, set(units) - known)):
        raise InputError(f"units: {beyond[0]!r} is none of {', '.join(sorted(map(str, known)))}")
    dataset.attrs["Conventions"] = "CF-1.11"
    for name in dataset.coords:
        dataset[name].attrs["axis"] = _AXES.get(str(name), str(name)[0].upper())
        if name in _AXES:
            dataset[name].attrs["units"] = _DEGREES[str(name)]
        unit = units.get(name, units.get(str(name)[0]))
        if unit is not None:
            dataset[name].attrs["units"] = unit
    for field in fields:
        mean = "mean" if fields == ("u",) else f"{field}_mean"
        for name in dataset.data_vars if field in units else ():
            if name == field or str(name).startswith(mean):
                dataset[name].attrs["units"] = units[field]


def dated(start: Any) -> Callable[[float], str]:
    """A function that names times: as numbers, or as dates if the one of t = 0 is given, in s."""
    if start is None:
        return lambda t: f"t = {t:.4g}"
    return lambda t: str(_dates(np.array(t), start, "s").astype("M8[m]")).replace("T", " ")


def _dates(times: Any, start: Any, unit: str) -> Any:
    """Times as datetime64, counted from a date."""
    if unit not in _UNITS:
        raise InputError(f"units: t of dates has one of {', '.join(_UNITS)}, got {unit!r}")
    return date_of(start, "start") + np.round(times * _UNITS[unit]).astype("timedelta64[ns]")


def xarray_module() -> Any:
    """The module xarray, or `MissingDependency`."""
    return optional("xarray", "to_xarray needs xarray: pip install 'skfem-adini[io]'")
