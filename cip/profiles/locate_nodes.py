"""The cells of the feet of all nodes of a line, by the kernel `locate` of the steps."""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.grid import Grid

Array = np.ndarray[Any, Any]


def cells_of(grid: Grid, displacement: Array) -> tuple[Array, Array, Array]:
    """Left and right node of the cell of each foot, and the place in it.

    Parameters
    ----------
    grid : Grid
        In one dimension.
    displacement : ndarray
        From each node to its foot, in cells.
    """
    from cip.jit import loop_over
    from cip.profiles import line_profiles

    size = grid.size
    left, right, place = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size)
    run = loop_over(_locate_all, locate=line_profiles.locate)
    run(displacement, size, int(grid.periodic[0]), left, right, place)
    return left, right, place


# `loop_over` replaces it by the kernel.
locate: Any = None


def _locate_all(
    displacement: Array, n: int, periodic: int, left: Array, right: Array, place: Array
) -> None:
    for i in range(n):
        k, r, s = locate(i, displacement[i], n, periodic)
        left[i] = k
        right[i] = r
        place[i] = s
