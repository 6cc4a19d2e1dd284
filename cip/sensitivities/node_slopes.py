"""The slopes that csl4 takes from values and means along lines, as a linear map and its transpose.

At each node the kernel `cip.profiles.conservative_kernels.slope_of` takes the slope of the quartic
through three nodes and the two cells between them. It is plain Python, linear in the moments: its
weights are what it gives for one moment that is 1 and others that are 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.grid import Grid
from cip.profiles.records import Line
from cip.sensitivities.profile_derivatives import plain_kernels

Array = Any  # arrays of NumPy or CuPy
# Nodes of the quartic, and its moments: values at these nodes and means of the cells between.
_NODES, _MOMENTS = 3, 5


class NodeSlopes:
    """The slopes at all nodes of a grid along an axis.

    Parameters
    ----------
    grid : Grid
    axis : int
    xp : module
        That of the arrays, NumPy or CuPy.
    """

    def __init__(self, grid: Grid, axis: int, xp: Any = np) -> None:
        self._grid, self._axis, self._xp = grid, axis, xp
        place, weights = _weights(grid, axis)
        forward = [_Rows(place[:_NODES], weights[:_NODES]), _Rows(place[:2], weights[_NODES:])]
        self._forward = [rows.on(xp) for rows in forward]
        self._backward = [rows.transposed().on(xp) for rows in forward]

    def of(self, values: Array, means: Array) -> Array:
        """The slopes from values and means, all of shape (nodes,)."""
        return sum(map(self._sum, self._forward, (values, means)))

    def transposed(self, weight: Array) -> tuple[Array, Array]:
        """The weights of values and of means from those of the slopes."""
        on_values, on_means = (self._sum(rows, weight) for rows in self._backward)
        return on_values, on_means

    def _sum(self, rows: _Rows, x: Array) -> Array:
        """For each node the sum of its row, term by term, so in a fixed order."""
        shape = [1] * self._grid.dim
        shape[self._axis] = -1
        x, total = x.reshape(self._grid.nodes), self._xp.zeros(self._grid.nodes)
        for place, weight in zip(rows.place, rows.weight, strict=True):
            total = total + weight.reshape(shape) * self._xp.take(x, place, axis=self._axis)
        return total.ravel()


class _Rows:
    """Rows of a matrix with equally many entries: in `place` the columns, both (entries, rows)."""

    def __init__(self, place: Array, weight: Array) -> None:
        self.place, self.weight = place, weight

    def on(self, xp: Any) -> _Rows:
        """The same with arrays of a module."""
        return _Rows(xp.asarray(self.place), xp.asarray(self.weight))

    def transposed(self) -> _Rows:
        """The transpose; rows with fewer entries than others are filled with zeros."""
        n = self.place.shape[1]
        column, row = self.place.ravel(), np.tile(np.arange(n), len(self.place))
        order = np.argsort(column, kind="stable")
        counts = np.bincount(column, minlength=n)
        entry = np.arange(column.size) - np.repeat(np.cumsum(counts) - counts, counts)
        place = np.zeros((counts.max(), n), np.int64)
        weight = np.zeros(place.shape)
        place[entry, column[order]] = row[order]
        weight[entry, column[order]] = self.weight.ravel()[order]
        return _Rows(place, weight)


def _weights(grid: Grid, axis: int) -> tuple[Array, Array]:
    """For each node the three nodes of its quartic and the weights of the moments of these.

    Shapes (3, nodes) and (5, nodes); the cells of the quartic begin at the first two of the nodes.
    """
    n, widths = grid.nodes[axis], grid.widths[axis]
    node = np.arange(n)
    first = node - 1 if grid.periodic[axis] else np.clip(node - 1, 0, n - _NODES)
    place = (first + np.arange(_NODES)[:, None]) % n
    slope_of, weights = plain_kernels()["slope_of"], np.empty((_MOMENTS, n))
    for role in range(_NODES):
        own = node - first == role
        line = Line(widths[place[:2, own]], 0, 1, _NODES, 0)
        for q in range(_MOMENTS):
            unit = [float(p == q) for p in range(_MOMENTS)]
            weights[q, own] = slope_of(unit, line, 0, _NODES, role)
    return place, weights
