r"""Derivatives of the means of conservative profiles along lines.

With the integral :math:`L_j` of the old profile from the left end of the cell of foot j to the
foot, the new mean of cell i is :math:`(L_{i+1} - L_i + \text{whole cells between}) / h_i`. So it
suffices to differentiate the integrals :math:`L_j`, foot by foot. Arrays have an entry for each
node of the grid; the lines run along `axis`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.grid import Grid

Array = Any  # arrays of NumPy or CuPy


def mean_changes(grid: Grid, axis: int, change: Array, xp: Any = np) -> Array:
    """The change of all new means for changes of the integrals L, both of shape (nodes,)."""
    along = change.reshape(grid.nodes)
    return per_width(grid, axis, (xp.roll(along, -1, axis) - along).ravel(), xp)


def integral_weights(grid: Grid, axis: int, weight: Array, xp: Any = np) -> Array:
    """The transpose of `mean_changes`: weights of the integrals L from weights of the means."""
    each = per_width(grid, axis, weight, xp).reshape(grid.nodes)
    return (xp.roll(each, 1, axis) - each).ravel()


def add_whole_cells(grid: Grid, axis: int, displacement: Array, weight: Array, back: Array) -> None:
    """Add to weights of the old means those that the new ones give to whole cells.

    Parameters
    ----------
    grid : Grid
    axis : int
    displacement : ndarray, shape (nodes,)
        From each node to its foot, in cells.
    weight : ndarray, shape (nodes,)
        Of the new means.
    back : ndarray, shape (nodes,)
    """
    owner, whole = whole_cells(grid, axis, displacement)
    given = np.bincount(whole, per_width(grid, axis, weight)[owner], grid.size)
    back += given * width_at(grid, axis)


def whole_cells(grid: Grid, axis: int, displacement: Array) -> tuple[Array, Array]:
    """The new cells whose means contain whole old ones, and these, for all such pairs.

    Parameters
    ----------
    grid, axis, displacement
        As for `add_whole_cells`.
    """
    n, cells = grid.nodes[axis], grid.cells[axis]
    lines = np.moveaxis(np.arange(grid.size).reshape(grid.nodes), axis, -1).reshape(-1, n)
    ends = np.floor(np.moveaxis(displacement.reshape(grid.nodes), axis, -1).reshape(-1, n))
    first = np.arange(n + 1) + np.concatenate([ends, ends[:, :1]], axis=1).astype(np.int64)
    if not grid.periodic[axis]:
        first = np.clip(first, 0, cells - 1)
    first, end = first[:, :cells], first[:, 1 : cells + 1]
    lengths = np.where(end == first, 0, np.maximum(end - first, 1)).ravel()
    total = int(lengths.sum())
    starts = np.repeat(first.ravel() - (np.cumsum(lengths) - lengths), lengths)
    owner = np.repeat(lines[:, :cells].ravel(), lengths)
    line = np.repeat(np.repeat(lines[:, 0], cells), lengths)
    stride = int(np.prod(grid.nodes[axis + 1 :]))
    return owner, line + (starts + np.arange(total)) % n * stride


def per_width(grid: Grid, axis: int, values: Array, xp: Any = np) -> Array:
    """Values by cells over their widths; 0 at the end of a line that is not periodic.

    `xp` is the module of the values, NumPy or CuPy.
    """
    width = width_at(grid, axis)
    return values * xp.asarray(np.divide(1.0, width, np.zeros_like(width), where=width > 0.0))


def width_at(grid: Grid, axis: int) -> Array:
    """The width of the cell that begins at each node along an axis; 0 where none begins."""
    width = np.zeros(grid.nodes[axis])
    width[: grid.cells[axis]] = grid.widths[axis]
    shape = [1] * grid.dim
    shape[axis] = width.size
    return np.broadcast_to(width.reshape(shape), grid.nodes).ravel()
