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


def add_whole_cells(
    grid: Grid, axis: int, pairs: tuple[Array, Array], weight: Array, back: Array
) -> None:
    """Add to weights of the old means, `back`, those that the new ones, `weight`, give to whole
    cells; both have shape (nodes,), `pairs` come from `whole_cells`.
    """
    owner, whole = pairs
    given = np.bincount(whole, per_width(grid, axis, weight)[owner], grid.size)
    back += _times(grid, axis, given, _widths(grid, axis))


def whole_cells(grid: Grid, axis: int, displacement: Array, xp: Any = np) -> tuple[Array, Array]:
    """The new cells whose means contain whole old ones, and these, for all such pairs. The
    displacement, shape (nodes,), from each node to its foot is in cells.
    """
    n, cells = grid.nodes[axis], grid.cells[axis]
    lines = xp.moveaxis(xp.arange(grid.size).reshape(grid.nodes), axis, -1).reshape(-1, n)
    ends = xp.floor(xp.moveaxis(displacement.reshape(grid.nodes), axis, -1).reshape(-1, n))
    first = xp.arange(n + 1) + xp.concatenate([ends, ends[:, :1]], axis=1).astype(np.int64)
    if not grid.periodic[axis]:
        first = xp.clip(first, 0, cells - 1)
    first, end = first[:, :cells], first[:, 1 : cells + 1]
    lengths = xp.where(end == first, 0, xp.maximum(end - first, 1)).ravel()
    stops = xp.cumsum(lengths)
    pairs = xp.arange(int(stops[-1]))
    if xp is np:
        cell = np.repeat(np.arange(stops.size), lengths)
    else:  # which repeats entries by counts on the host alone
        cell = xp.searchsorted(stops, pairs, side="right")
    inside = pairs - (stops - lengths)[cell]
    stride = int(np.prod(grid.nodes[axis + 1 :]))
    whole = lines[cell // cells, 0] + (first.ravel()[cell] + inside) % n * stride
    return lines[:, :cells].ravel()[cell], whole


def per_width(grid: Grid, axis: int, values: Array, xp: Any = np) -> Array:
    """Values by cells over their widths; 0 at the end of a line that is not periodic."""
    width = _widths(grid, axis)
    inverse = np.divide(1.0, width, np.zeros_like(width), where=width > 0.0)
    return _times(grid, axis, values, xp.asarray(inverse))


def _widths(grid: Grid, axis: int) -> Array:
    """The width of the cell that begins at each node of a line; 0 where none begins."""
    width = np.zeros(grid.nodes[axis])
    width[: grid.cells[axis]] = grid.widths[axis]
    return width


def _times(grid: Grid, axis: int, values: Array, line: Array) -> Array:
    """Values of shape (nodes,) times those of an entry of each node of a line along the axis."""
    shape = [1] * grid.dim
    shape[axis] = -1
    return (values.reshape(grid.nodes) * line.reshape(shape)).ravel()
