"""Cells of the feet of all nodes and nodes around these, by the kernels of the steps."""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.grid import Grid
from cip.profiles.records import Line

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


def nodes_around(grid: Grid, axis: int, left: Array) -> tuple[Array, Array]:
    """Four nodes along a direction around each cell, and their places from its left node.

    Parameters
    ----------
    grid : Grid
    axis : int
    left : ndarray of int
        Left nodes of the cells.

    Returns
    -------
    tuple of ndarray
        Both of shape (4, cells).
    """
    from cip.jit import loop_over
    from cip.profiles import line_profiles

    nodes, places = np.empty((4, left.size), np.int64), np.empty((4, left.size))
    run = loop_over(_around_all, around=line_profiles.around)
    line = Line(grid.widths[axis], 0, 1, grid.nodes[axis], int(grid.periodic[axis]))
    run(tuple(line), left, nodes, places)
    return nodes, places


# `loop_over` replaces them by the kernels.
locate: Any = None
around: Any = None


def _around_all(line: Any, left: Array, nodes: Array, places: Array) -> None:
    line = Line(*line)
    for o in range(left.size):
        n0, n1, n2, n3, x0, x1, x2, x3 = around(line, left[o])
        nodes[0, o], nodes[1, o], nodes[2, o], nodes[3, o] = n0, n1, n2, n3
        places[0, o], places[1, o], places[2, o], places[3, o] = x0, x1, x2, x3


def _locate_all(
    index: Array, displacement: Array, n: int, periodic: int, left: Array, right: Array,
    place: Array,
) -> None:  # fmt: skip
    for o in range(index.size):
        k, r, s = locate(index[o], displacement[o], n, periodic)
        left[o] = k
        right[o] = r
        place[o] = s
