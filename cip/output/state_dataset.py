"""States at several times as variables of an xarray.Dataset."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from cip.errors import MissingDependency
from cip.profiles.catalogue import moments
from cip.stages.state import State


def state_dataset(states: Sequence[State]) -> Any:
    """An xarray.Dataset of the states of one grid and profile: each moment over t and the
    coordinates. Averaged directions have the midpoints of cells, ``x_cell``, ``y_cell``,
    ``z_cell``."""
    xarray, first = xarray_module(), states[0]
    grid = first.grid
    axes = ["x", "y", "z"][: grid.dim]
    data, coordinates = {}, {"t": np.array([state.t for state in states])}
    coordinates.update(zip(axes, grid.coordinates, strict=True))
    for moment in moments(first.profile, grid.dim):
        places = list(axes)
        for axis in moment.averaged:
            places[axis] += "_cell"
            coordinates[places[axis]] = grid.edges[axis][:-1] + 0.5 * grid.widths[axis]
        values = np.stack([state[moment.name] for state in states])
        data[moment.name] = (["t", *places], values)
    return xarray.Dataset(data, coordinates, {"profile": first.profile})


def xarray_module() -> Any:
    """The module xarray, or `MissingDependency`."""
    try:
        return importlib.import_module("xarray")
    except ImportError as error:
        raise MissingDependency("to_xarray needs xarray: pip install 'skfem-adini[io]'") from error
