r"""Derivatives of the means of conservative profiles on lines.

With the integral :math:`L_j` of the old profile from the left end of the cell of foot j to the
foot, the new mean of cell i is :math:`(L_{i+1} - L_i + \text{whole cells between}) / h_i`. So it
suffices to differentiate the integrals :math:`L_j`, foot by foot.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.grid import Grid

Array = Any  # arrays of NumPy or CuPy


def mean_changes(grid: Grid, change: Array, xp: Any = np) -> Array:
    """The change of all new means for changes of the integrals L, both of shape (nodes,)."""
    return per_width(grid, xp.roll(change, -1) - change, xp)


def integral_weights(grid: Grid, weight: Array, xp: Any = np) -> Array:
    """The transpose of `mean_changes`: weights of the integrals L from weights of the means."""
    each = per_width(grid, weight, xp)
    return xp.roll(each, 1) - each


def add_whole_cells(grid: Grid, displacement: Array, weight: Array, back: Array) -> None:
    """Add to weights of the old means those that the new ones give to whole cells.

    Parameters
    ----------
    grid : Grid
        In one dimension.
    displacement : ndarray, shape (nodes,)
        From each node to its foot, in cells.
    weight : ndarray, shape (nodes,)
        Of the new means.
    back : ndarray, shape (nodes,)
    """
    owner, whole = whole_cells(grid, displacement)
    np.add.at(back, whole, per_width(grid, weight)[owner] * grid.widths[0][whole])


def whole_cells(grid: Grid, displacement: Array) -> tuple[Array, Array]:
    """The new cells whose means contain whole old ones, and these, for all such pairs.

    Parameters
    ----------
    grid, displacement
        As for `add_whole_cells`.
    """
    n, cells = grid.nodes[0], grid.cells[0]
    index = np.arange(n + 1)
    first = index + np.floor(np.append(displacement, displacement[0])).astype(np.int64)
    if not grid.periodic[0]:
        first = np.clip(first, 0, cells - 1)
    first, end = first[:cells], first[1 : cells + 1]
    lengths = np.where(end == first, 0, np.maximum(end - first, 1))
    starts = np.repeat(first - np.append(0, np.cumsum(lengths)[:-1]), lengths)
    whole = (starts + np.arange(lengths.sum())) % n
    return np.repeat(np.arange(cells), lengths), whole


def per_width(grid: Grid, values: Array, xp: Any = np) -> Array:
    """Values by cells over their widths; 0 at the end of a line that is not periodic.

    `xp` is the module of the values, NumPy or CuPy.
    """
    found = xp.zeros(grid.size)
    found[: grid.cells[0]] = values[: grid.cells[0]] / xp.asarray(grid.widths[0])
    return found
