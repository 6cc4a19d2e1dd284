r"""The blocks of feet of a stage, each with the moments that it moves.

A sweep of a conservative profile in several dimensions moves each pair of a value and its mean
along the sweep by separate feet, as the scheme in one dimension does on each line. All other stages
have one block, which moves all moments.

With the integral :math:`L_j` of the old profile of a conservative one from the left end of the cell
of foot j to the foot, the new mean of cell i along a line is :math:`(L_{i+1} - L_i + \text{whole
cells between}) / h_i`, so it suffices to differentiate the integrals, foot by foot. Arrays have an
entry for each node of the grid; the lines run along `axis`.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from cip.grid import Grid
from cip.profiles.plain import slope_weights
from cip.stages.stage import Stage

Array = Any  # arrays of NumPy or CuPy


class Block:
    """A block of feet: number `number` of a stage, which moves the moments `rows`, with the
    `components` of its feet among those of all blocks."""

    def __init__(self, stage: Stage, number: int, xp: Any = np) -> None:
        self.stage, self.number, self._xp = stage, number, xp
        self.bits, count = stage.blocks[number], len(stage.jets)
        self.components = slice(number * count, (number + 1) * count)
        self.rows = slice(None)
        if self.paired:
            assert stage.axis is not None
            step = 1 << stage.axis
            self.rows = slice(self.bits, self.bits + step + 1, step)

    @property
    def paired(self) -> bool:
        """Whether the block moves a value and a mean among other moments."""
        return self.stage.conservative and self.stage.grid.dim > 1

    @property
    def scheme(self) -> tuple[str, bool, int, int | None]:
        """Arguments of `cip.sensitivities.profile_derivatives.traced`."""
        stage = self.stage
        return stage.profile, stage.advect, stage.grid.dim, stage.axis

    @cached_property
    def _slopes(self) -> NodeSlopes | None:
        if not (self.paired and self.stage.profile == "csl4"):
            return None
        return NodeSlopes(self.stage.grid, self.stage.axis or 0, self._xp)

    def read(self, z: Array) -> Array:
        """Read the moments of the block, with slopes of csl4 between value and mean."""
        own = z[self.rows]
        if self._slopes is None:
            return own
        return self._xp.stack([own[0], self._slopes.of(own[0], own[1]), own[1]])

    def read_transposed(self, weight: Array) -> Array:
        """The transpose of `read`: weights of the moments of the block."""
        if self._slopes is None:
            return weight
        on_values, on_means = self._slopes.transposed(weight[1])
        return self._xp.stack([weight[0] + on_values, weight[2] + on_means])


def blocks_of(stage: Stage, xp: Any = np) -> list[Block]:
    """The blocks of a stage; `xp` is their array module."""
    return [Block(stage, number, xp) for number in range(len(stage.blocks))]


class NodeSlopes:
    """The slopes that csl4 takes from values and means along an axis, at all nodes, as a linear map
    with transpose."""

    def __init__(self, grid: Grid, axis: int, xp: Any = np) -> None:
        self._grid, self._axis, self._xp = grid, axis, xp
        place, weights = slope_weights(grid, axis)
        forward = [_Rows(place[:3], weights[:3]), _Rows(place[:2], weights[3:])]
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
    """Rows of a matrix with equally many entries; `place` holds columns, both (entries, rows)."""

    def __init__(self, place: Array, weight: Array) -> None:
        self.place, self.weight = place, weight

    def on(self, xp: Any) -> _Rows:
        """The same with arrays of another module."""
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
    """Add to weights of the old means, `back`, the contributions of whole cells to the new ones,
    whose weights are `weight`; both have shape (nodes,), `pairs` come from `whole_cells`."""
    owner, whole = pairs
    given = np.bincount(whole, per_width(grid, axis, weight)[owner], grid.size)
    back += _times(grid, axis, given, _widths(grid, axis))


def whole_cells(grid: Grid, axis: int, displacement: Array, xp: Any = np) -> tuple[Array, Array]:
    """All pairs of a new cell and a whole old cell that its mean contains. The displacement, shape
    (nodes,), from each node to its foot is in cells."""
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
    """Values per cell divided by cell widths; 0 at the end of a line that is not periodic."""
    width = _widths(grid, axis)
    inverse = np.divide(1.0, width, np.zeros_like(width), where=width > 0.0)
    return _times(grid, axis, values, xp.asarray(inverse))


def _widths(grid: Grid, axis: int) -> Array:
    """The width of the cell that begins at each node of a line; 0 where none begins."""
    width = np.zeros(grid.nodes[axis])
    width[: grid.cells[axis]] = grid.widths[axis]
    return width


def _times(grid: Grid, axis: int, values: Array, line: Array) -> Array:
    """Multiply values of shape (nodes,) by an entry for each node of a line along the axis."""
    shape = [1] * grid.dim
    shape[axis] = -1
    return (values.reshape(grid.nodes) * line.reshape(shape)).ravel()
