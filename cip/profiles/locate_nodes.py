"""The cells of the feet of all nodes, by the kernel `locate` of the steps."""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.grid import Grid

Array = np.ndarray[Any, Any]


def cells_of(grid: Grid, axis: int, displacement: Array) -> tuple[Array, Array, Array]:
    """Left and right node of the cell of each foot in a direction, and the place in it.

    Parameters
    ----------
    grid : Grid
    axis : int
    displacement : ndarray
        From each node of the grid to its foot, in cells.
    """
    from cip.jit import loop_over
    from cip.profiles import line_profiles

    size = grid.size
    left, right, place = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size)
    run = loop_over(_locate_all, locate=line_profiles.locate)
    index = np.ascontiguousarray(np.indices(grid.nodes)[axis].ravel())
    run(index, displacement, grid.nodes[axis], int(grid.periodic[axis]), left, right, place)
    return left, right, place


# `loop_over` replaces it by the kernel.
locate: Any = None


def _locate_all(
    index: Array, displacement: Array, n: int, periodic: int, left: Array, right: Array,
    place: Array,
) -> None:  # fmt: skip
    for o in range(index.size):
        k, r, s = locate(index[o], displacement[o], n, periodic)
        left[o] = k
        right[o] = r
        place[o] = s
