r"""Derivatives of the means of conservative profiles on lines.

With the integral :math:`L_j` of the old profile from the left end of the cell of foot j to the
foot, the new mean of cell i is :math:`(L_{i+1} - L_i + \text{whole cells between}) / h_i`. So it
suffices to differentiate the integrals :math:`L_j`, foot by foot.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.grid import Grid

Array = np.ndarray[Any, np.dtype[np.float64]]


def mean_changes(grid: Grid, change: Array) -> Array:
    """The change of all new means for changes of the integrals L, both of shape (nodes,)."""
    found = np.roll(change, -1) - change
    return np.asarray(_per_width(grid, found))


def integral_weights(grid: Grid, weight: Array) -> Array:
    """The transpose of `mean_changes`: weights of the integrals L from weights of the means."""
    each = _per_width(grid, weight)
    return np.asarray(np.roll(each, 1) - each)


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
    n, cells = grid.nodes[0], grid.cells[0]
    index = np.arange(n + 1)
    first = index + np.floor(np.append(displacement, displacement[0])).astype(np.int64)
    if not grid.periodic[0]:
        first = np.clip(first, 0, cells - 1)
    first, end = first[:cells], first[1 : cells + 1]
    lengths = np.where(end == first, 0, np.maximum(end - first, 1))
    starts = np.repeat(first - np.append(0, np.cumsum(lengths)[:-1]), lengths)
    whole = (starts + np.arange(lengths.sum())) % n
    share = np.repeat(_per_width(grid, weight)[:cells], lengths)
    np.add.at(back, whole, share * grid.widths[0][whole])


def _per_width(grid: Grid, values: Array) -> Array:
    """Values by cells over their widths; 0 at the end of a line that is not periodic."""
    found = np.zeros(grid.size)
    found[: grid.cells[0]] = values[: grid.cells[0]] / grid.widths[0]
    return found
