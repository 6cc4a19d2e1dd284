"""Points of a block of layers: the layer and cell that each lies in, and the functions there."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from contact.body.layers.layers import PER_NODE, Layer
from contact.errors import InputError

Array = NDArray[np.float64]


class Layered(Protocol):
    """What is asked of a `LayeredBlock`; `cell_bodies` are bodies of one cell, one a layer."""

    width: float
    height: float
    columns: int
    layers: list[Layer]
    cell_bodies: list[Any]


def located(block: Layered, points: Array) -> tuple[NDArray[np.int64], Array, Array]:
    """Layer of each point, and its place in units of that layer's cells, three of shape (npoints,).

    Raises
    ------
    InputError
        A point lies outside the block.
    """
    x, y = points
    width, height = block.width, block.height
    slack = 1e-12 * max(width, height)  # rounding of the coordinates
    outside = (x < -slack) | (x > width + slack) | (y < -slack) | (y > height + slack)
    if np.any(outside):
        raise InputError(f"points: {points[:, np.argmax(outside)]} lies outside the block")
    bottoms, size = np.array([(l.bottom, l.height / l.cells) for l in block.layers]).T
    at = np.clip(np.searchsorted(bottoms, y, side="right") - 1, 0, None)
    return at, x * block.columns / width, (y - bottoms[at]) / size[at]


def shape_functions(
    block: Layered, u: Array, points: Array
) -> Iterator[tuple[NDArray[np.int64], Any, Array]]:
    """For each layer and local basis function: points in it, the function, its dof's values."""
    at, columns, rows = located(block, points)
    for k, (layer, cell) in enumerate(zip(block.layers, block.cell_bodies, strict=True)):
        here = np.flatnonzero(at == k)
        if here.size == 0:
            continue
        i = np.clip(columns[here].astype(np.int64), 0, block.columns - 1)
        j = np.clip(rows[here].astype(np.int64), 0, layer.cells - 1)
        X = np.stack((columns[here] - i, rows[here] - j))
        corner = (block.columns + 1) * (layer.first + j) + i
        above = block.columns + 1
        nodes = (corner, corner + 1, corner + above + 1, corner + above)
        basis = cell.basis
        for local in range(basis.Nbfun):
            field = basis.elem.gbasis(basis.mapping, X, local)[0]
            yield here, field, u[PER_NODE * nodes[local // PER_NODE] + local % PER_NODE]
