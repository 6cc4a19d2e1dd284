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
    """Each moment over t and the coordinates.

    In a direction over which a moment is averaged its coordinate is the midpoint of the cell, named
    ``x_cell``, ``y_cell`` or ``z_cell``.

    Parameters
    ----------
    states : sequence of State
        Of one grid and profile.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    MissingDependency
        xarray is not installed.
    """
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
    """The module xarray.

    Raises
    ------
    MissingDependency
        It is not installed.
    """
    try:
        return importlib.import_module("xarray")
    except ImportError as error:
        raise MissingDependency("to_xarray needs xarray: pip install 'skfem-adini[io]'") from error
