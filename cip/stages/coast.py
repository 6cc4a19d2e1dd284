"""Coasts: edges of land and closed walls, where paths of a sweep stop and nothing passes.

Each line of a sweep falls into stretches of open cells. A path that would leave its stretch stops
at the coast: nothing came from there, so the new value is 0. A node on a coast stays where it is,
so the integral over each stretch is kept up to rounding whatever the velocity. Where the flow runs
against the coast, what it brings gathers in the coastal cell; where it runs off, the cell empties.
The value on such a coast is the mean of its cell.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.characteristics.feet import FEET, Exits
from cip.errors import InputError
from cip.grid import Array, Grid
from cip.profiles.catalogue import moments
from skfem_adini.ground.arguments import own_array

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Stops:
    """Nodes of a block of feet whose paths stop at a coast; those of them that lie on it take as
    new values, at indices `values` of the flat moments, the means at `means`."""

    nodes: NDArray[np.int64]
    values: NDArray[np.int64]
    means: NDArray[np.int64]


@dataclass(frozen=True)
class _Stretch:
    """Of each node of a block of lines: whether it is open, and how many open cells come before
    (negative) and after it, infinite up to an open wall."""

    open: Mask
    low: Array
    high: Array
    sides: Array  # 1 where no slope is to be taken from before the node, 2 from after it, or 3


class Coast:
    """The coasts of a grid with `land`, one boolean for each cell, and `closed` walls."""

    def __init__(self, grid: Grid, land: Mask | None, closed: Collection[tuple[int, int]]) -> None:
        self.grid, self.closed, self.land = grid, closed, land
        self._stretches: dict[tuple[int, int], _Stretch] = {}

    def open(self, bits: int) -> Mask:
        """Whether a cell around the place of each moment is sea, shape ``grid.nodes``; `bits` are
        the directions over which the moment is averaged."""
        found = np.ones(self.grid.cells, bool) if self.land is None else ~self.land
        for axis, periodic in enumerate(self.grid.periodic):
            along = np.moveaxis(found, axis, 0)
            none = np.zeros_like(along[:1])
            before, after = np.concatenate([none, along]), np.concatenate([along, none])
            if periodic:
                before, after = np.roll(along, 1, 0), along
            found = np.moveaxis(after if bits >> axis & 1 else before | after, 0, axis)
        return found

    @lru_cache(1)  # noqa: B019
    def sea(self, profile: str) -> Mask:
        """`open` for all moments of a profile."""
        every = moments(profile, self.grid.dim)
        return np.stack([self.open(sum(1 << axis for axis in one.averaged)) for one in every])

    def stopped(
        self, axis: int, bits: int, rows: Array, exits: Exits | None, mean: int
    ) -> tuple[Stops, Exits | None, Array]:
        """Stop the paths of a block of feet, whose components `rows` are changed; what stops, the
        paths that still begin on a wall, and for the kernels the side of each node from which no
        slope is to be taken. `mean` is the number of the moment of means."""
        stretch, size = self._stretch(axis, bits), self.grid.size
        wanted = rows[0].copy()
        if exits is not None:
            wanted[exits.nodes] = np.where(exits.side == 0, -np.inf, np.inf)
        coast = (stretch.low == 0.0) | (stretch.high == 0.0) | ~stretch.open
        moves = np.abs(wanted) > FEET.wall
        stops = (wanted < stretch.low - FEET.wall) | (wanted > stretch.high + FEET.wall)
        stops |= (moves & coast) | ~stretch.open
        rows[0] = np.clip(rows[0], stretch.low, stretch.high)
        rows[0, coast] = 0.0
        rows[1:, stops] = 0.0
        nodes = np.flatnonzero(stretch.open & moves & coast)
        index = np.arange(size).reshape(self.grid.nodes)
        before, after = (np.roll(index, by, axis).ravel()[nodes] for by in (1, -1))
        first = stretch.low[nodes] == 0.0
        cells, next_nodes = np.where(first, nodes, before), np.where(first, after, before)
        if exits is not None:
            exits = exits.kept(~stops[exits.nodes])
        # A cell in which the field gathers would bend the profiles beside it and hold them back.
        sides = stretch.sides.copy()
        against = (wanted[nodes] > 0.0) == first
        free = against & (sides[next_nodes] == 0.0)
        sides[next_nodes[free]] = np.where(first, 1.0, 2.0)[free]
        found = Stops(np.flatnonzero(stops), bits * size + nodes, mean * size + cells)
        return found, exits, sides

    def _stretch(self, axis: int, bits: int) -> _Stretch:
        if (axis, bits) not in self._stretches:
            self._stretches[axis, bits] = self._new_stretch(axis, bits)
        return self._stretches[axis, bits]

    def _new_stretch(self, axis: int, bits: int) -> _Stretch:
        grid, n = self.grid, self.grid.nodes[axis]
        after = np.moveaxis(self.open(bits | 1 << axis), axis, 0)
        before, sides = np.roll(after, 1, 0), (1 - np.roll(after, 1, 0)) + 2 * (1 - after)
        if not grid.periodic[axis]:
            after, before = after.copy(), before.copy()
            after[-1], before[0] = ((axis, side) not in self.closed for side in (1, 0))
            # A slope at a wall is taken from two cells.
            sides[0], sides[-1] = 1 - after[1], 2 * (1 - after[-3])
        high, low = np.full(after.shape, np.inf), np.full(after.shape, -np.inf)
        for k in reversed(range(2 * n)):  # twice around a periodic line
            at, back = k % n, -1 - k % n
            last = not grid.periodic[axis] and at == n - 1
            high[at] = np.where(after[at], np.inf if last else high[(at + 1) % n] + 1.0, 0.0)
            low[back] = np.where(before[back], -np.inf if last else low[(back - 1) % n] - 1.0, 0.0)
        flat = (np.moveaxis(one, 0, axis).ravel() for one in (low, high, sides))
        return _Stretch(self.open(bits).ravel(), *flat)


def coast_of(grid: Grid, land: Any, closed: Collection[tuple[int, int]]) -> Coast | None:
    """The coasts of a solver from its argument `land`, checked; None if there are none."""
    if land is None:
        return Coast(grid, None, closed) if closed else None
    mask = own_array("land", land)
    if mask.dtype != bool or mask.shape != grid.cells:
        raise InputError(
            f"land: expected one True or False for each cell, shape {grid.cells}, got {mask.dtype} "
            f"of shape {mask.shape}"
        )
    if mask.all():
        raise InputError("land: every cell is land; leave at least one to the field")
    return Coast(grid, mask if mask.any() else None, closed) if mask.any() or closed else None
