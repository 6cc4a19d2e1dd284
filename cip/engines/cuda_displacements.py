"""Feet by displacements on a CUDA device, as in `cip.engines.displacements`, by classical steps.

One kernel follows all nodes through a sub-step, a second one repeats the node of each group where
the inner stages differ most with halved steps. Periodic planes without determinants are then
updated by a kernel that takes the differences of displacements in shared memory; else the
derivatives are stored. The few nodes that need other paths are those of the host. Displacements
and their differences are float64 for moments of any precision.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from cip.characteristics.flow_derivatives import LOG_DETERMINANT
from cip.engines.cuda_kernels import compiled
from cip.engines.displacement_source import (
    THREADS,
    TILE,
    TIMES,
    FollowSource,
    combine_source,
    difference_source,
    update_source,
)
from cip.engines.displacements import Displacements, TooCoarse, clock
from cip.formulas.snapshots import snapshots_of

Array = Any


class DeviceDisplacements(Displacements):
    """As `Displacements`, with feet on the device of an engine."""

    def __init__(self, stage: Any, flows: dict[Any, Any], engine: Any) -> None:
        super().__init__(stage, flows)
        self.xp, self._engine, self.least = engine.xp, engine, 1
        self.field = snapshots_of(stage.velocity)
        # Nodes of which one is repeated, about a row as on the host: its number replaces the low
        # bits of a float.
        self.group = min(max(1 << (self.grid.nodes[-1] - 1).bit_length(), 64), 2048)
        self._lines: dict[int, list[Array]] = {}  # coordinates of each block
        self._kernels: dict[Any, Any] = {}
        self._tables: dict[Any, Array] = {}
        self._boxes: dict[int, tuple[float, Array]] = {}
        self._updates: dict[int, Any] = {}
        advects = LOG_DETERMINANT in stage.jets
        self.fused = (
            stage.axis is None and not advects and all(self.grid.periodic)
            and all(self.grid.uniform) and min(self.grid.nodes) >= max(TILE) + 4
        )  # fmt: skip

    @property
    def fits(self) -> bool:
        """Whether a kernel has enough arguments, 4 KiB, for the numbers of a formula."""
        held = [] if self.field else self._flow(self.stage.blocks[0]).held
        return len(TIMES) * len(held) <= 400

    def _displace(self, row: Array, block: int, times: tuple[float, float], count: int) -> None:
        found, said = self.follow(block, times, count)
        self.judge(said.get())
        row[: len(found)] = found

    def judge(self, said: Any) -> bool:
        """Whether some nodes have no derivatives; raises `TooCoarse`."""
        if float(said[1:].view(np.float32).sum()) > self._limit:
            raise TooCoarse
        return bool(said[0])

    def follow(self, block: int, times: tuple[float, float], count: int) -> tuple[Array, Array]:
        """The displacements of a block in cells, shape (directions, nodes), NaN where they leave
        the grid; and an array whose numbers after the first are the errors of the sub-steps."""
        xp, size, flow = self.xp, self.grid.size, self._flow(block)
        if block not in self._lines:
            self._lines[block] = self._coordinates(flow, block)
        blocks, groups = -(-size // THREADS), -(-size // self.group)
        whole = self._engine.whole
        steps = list(pairwise(clock(*times, flow.breaks(*times), count)))
        said = xp.zeros(1 + len(steps), np.int32)
        old = new = xp.empty((len(self.cells), size))
        for q, (begin, end) in enumerate(steps):
            new = xp.empty_like(old) if q else old
            chosen = xp.zeros(groups, np.uint32)
            head = (old, new, chosen, *self._lines[block], float(begin - end), whole(q == 0))
            three, five, tables = self._velocity(flow, block, begin, end)
            if (block, tables) not in self._kernels:
                made = FollowSource(self, flow, tables, self._engine.index)
                self._kernels[block, tables] = compiled(made.every()), compiled(made.halved())
            follow, check = self._kernels[block, tables]
            follow((blocks,), (THREADS,), (*head, *three))
            check((-(-groups // 32),), (32,), (*head, said[1 + q :], *five))
            old = new
        return new, said

    def _coordinates(self, flow: Any, block: int) -> list[Array]:
        """Coordinates in each direction, in the units of the flow."""
        lines = list(self.stage.lines(block))
        for q, axis in enumerate(self.stage.moving):
            lines[axis] = (lines[axis] - flow.origin[q]) / flow.unit[q]
        return [self.xp.asarray(line) for line in lines]

    def _velocity(
        self, flow: Any, block: int, begin: float, end: float
    ) -> tuple[list[Any], list[Any], int]:
        """The arguments of both kernels for the velocity in a sub-step, and how many arrays of
        coefficients those of the second one are."""
        times = [*(begin - part * (begin - end) for part in TIMES[:-1]), end]
        if self.field is None:
            values = np.array(flow.boxes(*times))[:, :-1]
            return values[::2].ravel().tolist(), values.ravel().tolist(), 0
        found = [self.field.time_weights(t) for t in times]
        first = min(number for number, _ in found)
        count = max(number - first + own.size for number, own in found)
        weights = np.zeros((len(times), count))
        for row, (number, own) in zip(weights, found, strict=True):
            row[number - first : number - first + own.size] = own
        tables = [self._table(flow, block, first + q) for q in range(count)]
        known = self._boxes.get(block)
        if known is None or known[0] != begin:
            known = begin, self._combined(tables, weights[[0, 0]])[0]
        middle, last = self._combined(tables, weights[[2, 4]])
        self._boxes[block] = end, last
        return [known[1], middle, last], [*tables, *weights.ravel().tolist()], count

    def _table(self, flow: Any, block: int, m: int) -> Array:
        """Coefficients on the device, the components of planes one after the other."""
        if (block, m) not in self._tables:
            table = flow.table(m)
            if self.stage.axis is None:
                table = np.ascontiguousarray(table.reshape(-1, 2).T).reshape(-1)
            while len(self._tables) >= 8 * len(self.stage.blocks):
                self._tables.pop(next(iter(self._tables)))
            self._tables[block, m] = self.xp.asarray(table)
        return self._tables[block, m]

    def _combined(self, tables: list[Array], weights: Any) -> tuple[Array, Array]:
        """The sums of tables with two sets of weights."""
        size, xp = tables[0].size, self.xp
        two = xp.empty_like(tables[0]), xp.empty_like(tables[0])
        values = weights.ravel().tolist()
        kernel = compiled(combine_source(len(tables)))
        kernel((-(-size // 256),), (256,), (*two, *tables, np.int64(size), *values))
        return two

    def _difference(
        self, a: Array, out: Array, axis: int, factor: float, plus: float, limit: float
    ) -> bool:
        grid, whole = self.grid, self._engine.whole
        n, stride = grid.nodes[axis], int(np.prod(grid.nodes[axis + 1 :]))
        said = self.xp.zeros(1, np.int32)
        kernel = compiled(difference_source(self._engine.index))
        sizes = (whole(grid.size), whole(n), whole(stride), whole(grid.periodic[axis]))
        numbers = (float(factor), float(plus), float(limit / abs(factor)))
        kernel((-(-grid.size // 256),), (256,), (a, out, said, *sizes, *numbers))
        return bool(said.get()[0])

    def most(self, component: int, axis: int) -> float:
        """Largest change of a difference from that of order 6, also of one along the second
        direction of those along the first."""
        return self._slopes * self.grid.spacing[axis] / self.grid.spacing[component]

    def update(self, m: Array, out: Array, t: float, dt: float, count: int) -> bool:
        """Update the moments of all fields; False where some nodes need other derivatives. Raises
        `TooCoarse`."""
        engine, stage = self._engine, self.stage
        d, said = self.follow(0, (t + stage.begin * dt, t + stage.end * dt), count)
        fields = len(engine.fields(m))
        if fields not in self._updates:
            types = engine.limiter, engine.real, engine.index
            source = update_source(self, engine.name(stage), *types, fields)
            self._updates[fields] = compiled(source)
        (nx, ny), (rows, columns) = self.grid.nodes, TILE
        blocks = -(-ny // columns), -(-nx // rows)
        self._updates[fields](blocks, TILE[::-1], (m, out, d, said))
        return not self.judge(said.get())
