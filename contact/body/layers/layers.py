"""Layers of equal cells, read and checked, and the tensor grid that they make."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from skfem import MeshQuad

from contact.body.axisymmetry import AXISYMMETRIC
from contact.body.elasticity import lame
from contact.body.material import checked_plane
from contact.errors import InputError
from skfem_adini.ground.arguments import finite_number, numbers

Array = NDArray[np.float64]
PER_NODE = 6  # u, v, u_x, v_x, u_y, v_y


class Layer(NamedTuple):
    """Height, number of cell rows, Young's modulus, Poisson's ratio and lower ordinate."""

    height: float
    cells: int
    E: float
    nu: float
    bottom: float
    first: int


class CellRows(NamedTuple):
    """A layer: ``height`` rows of cells with the same element matrix."""

    stiffness: Array  # (24, 24); nodes bottom left, bottom right, top right, top left
    height: int


def read_layers(layers: Any) -> list[Layer]:
    """Check ``[(height, cells, E, nu), ...]``, from the bottom up."""
    if not isinstance(layers, list | tuple) or not layers:
        raise InputError(f"layers={layers!r}: expected a list of (height, cells, E, nu)")
    found: list[Layer] = []
    bottom, first = 0.0, 0
    for k, entry in enumerate(layers):
        if not isinstance(entry, list | tuple) or len(entry) != 4:
            raise InputError(f"layers[{k}]={entry!r}: expected (height, cells, E, nu)")
        height, cells, E, nu = (
            finite_number(f"layers[{k}]: {name}", value)
            for name, value in zip(("height", "cells", "E", "nu"), entry, strict=True)
        )
        if not height > 0:
            raise InputError(f"layers[{k}]: the height must be positive, got {height}")
        if cells < 1 or cells != int(cells):
            raise InputError(f"layers[{k}]: cells must be a whole number from 1, got {cells}")
        try:
            lame(E, nu)
        except InputError as error:
            raise InputError(f"layers[{k}]: {error}") from None
        found.append(Layer(height, int(cells), E, nu, bottom, first))
        bottom, first = bottom + height, first + int(cells)
    return found


def flat_plane(plane: Any, dim: int) -> str | None:
    """The plane of layers; InputError for an unknown one, or "axisymmetric"."""
    if (known := checked_plane(plane, dim)) == AXISYMMETRIC:
        raise InputError(f"plane={plane!r}: layers have no radii; take an ElasticBody")
    return known


def read_lengths(lengths: Any, layers: Sequence[Layer]) -> tuple[float, float]:
    """Width and height; a given height must be the sum of the layers'."""
    given = numbers("lengths", lengths)
    if given.shape not in ((), (1,), (2,)) or not np.all(np.isfinite(given)) or np.any(given <= 0):
        raise InputError(f"lengths={lengths!r}: expected a positive width, or width and height")
    height = sum(layer.height for layer in layers)
    if given.shape == (2,) and abs(given[1] - height) > 1e-9 * height:
        raise InputError(f"lengths={lengths!r}: the layers are {height:.12g} high together")
    return float(given.ravel()[0]), height


def read_columns(columns: Any, width: float, layer: Layer) -> int:
    """Number of cells in a row; None makes the layer's cells as square as can be."""
    if columns is None:
        return max(1, round(width * layer.cells / layer.height))
    count = finite_number("columns", columns)
    if count < 1 or count != int(count):
        raise InputError(f"columns={columns!r}: expected a whole number from 1")
    return int(count)


def each_side(sides: Any) -> tuple[Any, ...]:
    """One entry per side, from any form of the argument `sides`."""
    given = tuple(sides) if isinstance(sides, list | tuple) else (sides,)
    for entry in given:
        numbered = isinstance(entry, list | tuple) and all(isinstance(c, int) for c in entry)
        if not numbered and not isinstance(entry, str | int | None):
            raise InputError(f"sides={sides!r}: expected 'periodic', components, None, or a pair "
                             "of these")  # fmt: skip
    return given


def checked_path(path: Any) -> None:
    """Raise InputError unless `path` is a condensation path or None."""
    if not isinstance(path, str | None) or path not in (None, "fourier"):
        raise InputError(f"path={path!r}: expected None or 'fourier'")


def read_sides(sides: Any) -> tuple[Any, Any]:
    """Components fixed on the left and on the right."""
    if sides is None or isinstance(sides, str):
        return sides, sides
    if not isinstance(sides, list | tuple) or len(sides) != 2:
        raise InputError(f"sides={sides!r}: expected components, None, or a pair of these")
    return sides[0], sides[1]


def grid(x: Array, y: Array) -> MeshQuad:
    """Tensor mesh whose vertices run along x first, its four sides named."""
    columns, rows = x.size - 1, y.size - 1
    X, Y = np.meshgrid(x, y)
    i, j = np.meshgrid(np.arange(columns), np.arange(rows))
    corner = (i + (columns + 1) * j).ravel()
    t = np.vstack((corner, corner + 1, corner + columns + 2, corner + columns + 1))
    mesh = MeshQuad(np.vstack((X.ravel(), Y.ravel())), t, sort_t=False)
    ends = {"left": (0, x[0]), "right": (0, x[-1]), "bottom": (1, y[0]), "top": (1, y[-1])}
    return named_by_place(mesh, ends)


def named_by_place(mesh: Any, ends: dict[str, tuple[int, float]]) -> Any:
    """A tensor mesh with named sides; `ends` gives the axis and coordinate of each.
    Facet middles have exactly this coordinate, however flat a cell is."""
    return mesh.with_boundaries(
        {name: lambda x, axis=axis, at=at: x[axis] == at for name, (axis, at) in ends.items()}
    )
