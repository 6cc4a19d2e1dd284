"""The kernels as plain Python, for symbols and arrays in the place of numbers."""

from __future__ import annotations

from types import FunctionType
from typing import Any

import numpy as np

from cip.grid import Grid
from cip.profiles.catalogue import Line

Array = Any


def plain_kernels() -> dict[str, Any]:
    """The kernels by name, as plain Python functions that call one another."""
    from cip.profiles import (
        conservative_kernels,
        conservative_profiles,
        line_kernels,
        line_profiles,
        plane_kernels,
    )

    names: dict[str, Any] = {}
    modules = (line_profiles, line_kernels, plane_kernels, conservative_profiles)
    for module in (*modules, conservative_kernels):
        for name, value in vars(module).items():
            plain = getattr(value, "py_func", None)
            names[name] = value if plain is None else FunctionType(plain.__code__, names, name)
    return names


def slope_weights(grid: Grid, axis: int) -> tuple[Array, Array]:
    """Slopes of csl4 as a linear map: for each node the three of its quartic, shape (3, nodes), and
    the weights of their values, then of the means of the cells that begin at the first two, shape
    (5, nodes): `slope_of` for one moment that is 1 and others 0."""
    nodes, moments = 3, 5  # values at the nodes and means of the cells between
    n, widths = grid.nodes[axis], grid.widths[axis]
    node = np.arange(n)
    first = node - 1 if grid.periodic[axis] else np.clip(node - 1, 0, n - nodes)
    place = (first + np.arange(nodes)[:, None]) % n
    slope_of, weights = plain_kernels()["slope_of"], np.empty((moments, n))
    for role in range(nodes):
        own = node - first == role
        line = Line(widths[place[:2, own]], 0, 1, nodes, 0)
        for q in range(moments):
            unit = [float(p == q) for p in range(moments)]
            weights[q, own] = slope_of(unit, line, 0, nodes, role)
    return place, weights
