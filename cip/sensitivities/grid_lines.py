"""The lines of a grid as loops over all nodes take them."""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.grid import Grid
from cip.profiles.records import Line


def lines_of(grid: Grid) -> list[tuple[Any, ...]]:
    """The first line in each direction: a `Line` as a tuple."""
    strides = [grid.size // int(np.prod(grid.nodes[: axis + 1])) for axis in range(grid.dim)]
    return [
        tuple(Line(np.asarray(h, dtype=float), 0, stride, n, int(periodic)))
        for h, stride, n, periodic in zip(
            grid.widths, strides, grid.nodes, grid.periodic, strict=True
        )
    ]
