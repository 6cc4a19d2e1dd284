r"""Feet by displacements alone, and the derivatives of the map to them by differences.

Positions are followed by the classical Runge-Kutta method. In each row of nodes the one where the
inner stages :math:`k_2, k_3` differ most is followed again with halved steps: the largest
difference, summed over the steps, estimates the error of all feet (Hairer, Norsett and Wanner,
Solving Ordinary Differential Equations I, 1993, section II.4). Derivatives are central differences
of the displacements, of order 8; near walls, and where those of orders 6 and 8 disagree, of paths
that end within a fraction of a cell around the node. Paths that begin on walls follow the equations
of `cip.characteristics.flow_derivatives`.

The splines of snapshots are combined in time once for a stage of the method, and on a line also
across it, so a node reads the coefficients around it in the directions that move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from cip.characteristics.feet import FEET, Exits, check_inside, integrate
from cip.characteristics.flow_derivatives import LOG_DETERMINANT, Jet, foot
from cip.formulas.expression import numpy_function
from cip.formulas.snapshots import Snapshots, snapshots_of
from cip.stages.stage import Stage, StageFeet

Array = Any


class _Flow(Protocol):
    """The backward velocity in the directions that move, at the points of a block of feet."""

    kernel: Any  # ``flow`` of `cip.engines.displacement_loops`
    sizes: Array
    at: Array  # for each point, where its line begins
    origin: list[float]  # for each direction that moves: the zero of its coordinate ..
    unit: list[float]  # .. and the length of its unit

    def box(self, t: float) -> Array:
        """What the kernel reads of the velocity at a time."""

    def breaks(self, start: float, end: float) -> list[float]:
        """Times between these at which the velocity is not smooth."""


class _FormulaFlow:
    def __init__(self, stage: Stage) -> None:
        from cip.engines.cpu_loops import kernel_of
        from cip.engines.displacement_loops import (
            fast_cos,
            fast_sin,
            formula_source,
            of_half_angles,
            without_place,
        )

        rates = of_half_angles(stage.system.rates[: len(stage.moving)])
        rates, self.held = without_place(rates)
        self.source = formula_source(rates, stage.moving, len(self.held))
        self.kernel = kernel_of(self.source, sin=fast_sin, cos=fast_cos)
        self._values = numpy_function(self.held, ["t"])
        self.sizes, self.at = np.zeros(1, np.int64), np.zeros(stage.grid.size, np.int64)
        self.origin, self.unit = [0.0, 0.0], [1.0, 1.0]

    def box(self, t: float) -> Array:
        return np.append(self.boxes([t])[0], 0.0)

    def boxes(self, times: Sequence[float]) -> Array:
        """The numbers at some times, shape (times, numbers)."""
        with np.errstate(all="ignore"):
            found = self._values(np.array(times))
        return np.array([np.broadcast_to(one, len(times)) for one in found], float).T

    def breaks(self, start: float, end: float) -> list[float]:
        return []


class _SplineFlow:
    def __init__(self, field: Snapshots, stage: Stage, block: int) -> None:
        from cip.engines.cpu_loops import kernel_of
        from cip.engines.displacement_loops import numbers, spline_source

        self._field, self._components = field, list(stage.moving)
        moving, data, lines = stage.moving, field.grid, stage.lines(block)
        self.kernel = kernel_of(spline_source(field.degrees[1], len(moving)), numbers=numbers)
        self._matrices = [
            field.cardinal(axis) if axis in moving else field.values_at(axis, line)
            for axis, line in enumerate(lines)
        ]
        self.origin = [data.bounds[axis][0] for axis in moving]
        self.unit = [float(data.widths[axis][0]) for axis in moving]
        self._tables: dict[int, Array] = {}
        counts = [matrix.shape[0] for matrix in self._matrices]
        self.at = np.zeros(stage.grid.size, np.int64)
        row, self.count = 2 * counts[-1], int(np.prod(counts))  # of coefficients of a component ..
        if stage.axis is not None:
            row = int(np.prod(counts[stage.axis + 1 :]))
            self.count = counts[stage.axis] * row  # .. or of the lines of a block
            block_size = stage.grid.nodes[stage.axis] * row
            o = np.arange(stage.grid.size)
            self.at = o // block_size * self.count + o % row
        flags = [(data.cells[axis], int(data.periodic[axis])) for axis in moving]
        self.sizes = np.array([*(n for pair in flags for n in pair), row, field.degrees[1] + 1])
        # The same where the components of a plane are one after the other.
        self.sizes_apart = [*self.sizes.tolist(), self.count]
        self.sizes_apart[-3] = row // 2 if stage.axis is None else row

    def _table(self, m: int) -> Array:
        """The coefficients of the time's B-spline m as the kernel reads them."""
        found = self._tables.get(m)
        if found is None:
            parts = []
            for axis, h in zip(self._components, self.unit, strict=True):
                part = self._field.coefficient(m)[axis] / h
                for q, matrix in enumerate(self._matrices):
                    moved = np.moveaxis(part, q, 0)
                    shape = (-1, *moved.shape[1:])
                    product = matrix @ moved.reshape(len(moved), -1)
                    part = np.moveaxis(product.reshape(shape), 0, q)
                parts.append(part)
            found = np.ascontiguousarray(np.stack(parts, axis=-1)).reshape(-1)
            while len(self._tables) > self._field.degrees[0] + 3:  # of one time and of the next
                self._tables.pop(next(iter(self._tables)))
            self._tables[m] = found
        return found

    def box(self, t: float) -> Array:
        from cip.engines import cpu_loops
        from cip.engines.displacement_loops import run_combine

        first, weights = self._field.time_weights(t)
        tables = [self._table(first + q) for q in range(weights.size)]
        tables += [tables[0]] * (4 - weights.size)
        weights, found = np.append(weights, np.zeros(4 - weights.size)), np.empty_like(tables[0])

        given: Any = (*tables, weights, found)
        cpu_loops.share(lambda a, b: run_combine(a, b, *given), found.size, found.size)
        return found

    def breaks(self, start: float, end: float) -> list[float]:
        times = self._field.times
        inside = times[(times > min(start, end)) & (times < max(start, end))]
        return [] if self._field.degrees[0] > 1 else [float(t) for t in inside]


class TooCoarse(Exception):
    """The sub-steps are too long."""


# Nodes whose derivatives the grid does not give take differences of order 4 over these cells: near
# enough for kinks of cubic splines, with rounding errors of 1e-9 in second derivatives.
_NEAR = np.arange(-2, 3) / 64
_WEIGHTS = np.array([[0, 0, 12, 0, 0], [1, -8, 0, 8, -1], [-1, 16, -30, 16, -1]]) / 12
_WEIGHTS *= 64.0 ** np.arange(3)[:, None]


class Displacements:
    """The feet of a stage of an unsteady velocity; `serves` tells for which stages."""

    xp: Any = np  # the module of the arrays of feet

    def __init__(self, stage: Stage) -> None:
        self.stage, self.grid = stage, stage.grid
        self._flows: dict[int, _Flow] = {}
        self.cells = [self.grid.spacing[axis] for axis in stage.moving]
        # A slope moves a value by a tenth of a cell or so, and data have no slopes of their own.
        given = snapshots_of(stage.velocity) is not None
        self._slopes = 100.0 * stage.foot_error if given else stage.limit

    @staticmethod
    def serves(stage: Stage, least: int) -> bool:
        """Whether the stage has feet of nodes or of middles of cells, with first derivatives, and a
        velocity from snapshots on a uniform grid, or a formula without parameters on `least` nodes
        or more; those with parameters are differentiated as their equations are solved."""
        grid, field = stage.grid, snapshots_of(stage.velocity)
        uniform = all(grid.uniform[axis] for axis in stage.moving)
        shape = stage.axis is None or (stage.conservative and not stage.carries_slopes)
        if not (uniform and shape):
            return False
        if field is not None:
            return all(field.grid.uniform[axis] for axis in stage.moving)
        return stage.formula and not stage.system.parameters and grid.size >= least

    def feet(self, t: float, dt: float, count: int) -> StageFeet:
        """The feet with `count` sub-steps, or more where the velocity has kinks in time. Raises
        `TooCoarse`."""
        stage, xp = self.stage, self.xp
        times = t + stage.begin * dt, t + stage.end * dt
        rows = xp.empty((len(stage.blocks), len(stage.jets), self.grid.size))
        exits: list[Exits | None] = []
        for row, block in zip(rows, stage.blocks, strict=True):
            self._displace(row, block, times, count)
            flagged = self._differentiate(row)
            outside = not bool(xp.isfinite(row[0].sum()))
            exits.append(self._mend(row, block, times, count) if flagged or outside else None)
        return StageFeet(rows.reshape(-1), exits, *times, (count,) * len(exits))

    def _flow(self, block: int) -> Any:
        if block not in self._flows:
            field = snapshots_of(self.stage.velocity)
            made = _SplineFlow(field, self.stage, block) if field else _FormulaFlow(self.stage)
            self._flows[block] = made
        return self._flows[block]

    def _displace(self, row: Array, block: int, times: tuple[float, float], count: int) -> None:
        """Write the displacements of a block to the first rows. Raises `TooCoarse`."""
        flow = self._flow(block)
        given = flow, self._points(flow, block), self.bounds(flow), self.grid.nodes[-1]
        found = self._follow(*given, times, count, self._limit)
        row[: len(found)] = found

    def _mend(self, row: Array, block: int, times: tuple[float, float], count: int) -> Exits | None:
        """Write the feet of the nodes that have none; the paths of them that begin on walls."""
        flow = self._flow(block)
        bad = self.xp.flatnonzero(self.xp.isnan(row).any(axis=0))
        nodes, left = self._host(bad), np.isnan(self._host(row[0, bad]))
        near = [x[nodes] for x in self._points(flow, block)]
        part = self._closely(flow, near, times, count, left)
        exits = self._to_walls(part, block, times, nodes)
        row[:, bad] = self.xp.asarray(part)
        return exits

    def _host(self, a: Array) -> Array:
        return a

    def _points(self, flow: _Flow, block: int) -> list[Array]:
        """Coordinates of the points, those that move first, in the units of the flow, and where
        their lines begin."""
        moving = self.stage.moving
        points = [x.ravel() for x in self.stage.points(block)]
        points += [np.zeros(self.grid.size)] * (3 - self.grid.dim)
        found = [(points[a] - flow.origin[q]) / flow.unit[q] for q, a in enumerate(moving)]
        others = [points[axis] for axis in range(3) if axis not in moving]
        return [np.ascontiguousarray(x) for x in (*found, *others, flow.at)]

    def bounds(self, flow: _Flow) -> Array:
        """Lowest and highest coordinates of paths in the units of the flow, by direction."""
        found = []
        for q, axis in enumerate(self.stage.moving):
            margin = (FEET.cells if self.grid.periodic[axis] else FEET.wall) * self.cells[q]
            low, high = self.grid.bounds[axis]
            found += [low - margin - flow.origin[q], high + margin - flow.origin[q]]
        return np.array(found) / np.repeat(flow.unit[: len(self.cells)], 2)

    def _follow(
        self, flow: _Flow, points: list[Array], bounds: Array, row: int,
        times: tuple[float, float], count: int, limit: float = np.inf,
    ) -> Array:  # fmt: skip
        """The displacements of points, in cells, shape (directions, points); NaN beyond `bounds`.
        Raises `TooCoarse` if their error, estimated in each `row` of points, exceeds a finite
        `limit`."""
        from cip.engines import displacement_loops
        from cip.engines.cpu_loops import share
        from skfem_adini.ground.jit import loop_over

        size, moving = points[0].size, len(self.cells)
        run = loop_over(displacement_loops.run_substep, flow=flow.kernel)
        units = np.array(flow.unit[:moving]) / self.cells
        old, new, error = np.zeros(moving * size), np.empty(moving * size), 0.0
        begin, last = times[1], flow.box(times[1])
        for step in steps_between(*times, flow.breaks(*times), count):
            boxes = [last, *(flow.box(begin - q * step) for q in (0.5, 1.0))]
            chosen = np.full(size // row, -1)
            head = (row, size, moving, step, old, new, chosen)
            given = (*head, *points, bounds, flow.sizes, *boxes)
            share(lambda a, b, given=given: run(a, b, *given), chosen.size, size)  # type: ignore[misc]
            if limit < np.inf:
                some = chosen[chosen >= 0]
                again = old.reshape(moving, -1)[:, some].reshape(-1)
                near = [np.ascontiguousarray(x[some]) for x in points]
                inner = [flow.box(begin - q * step) for q in (0.25, 0.75)]
                for part in ((boxes[0], inner[0], boxes[1]), (boxes[1], inner[1], boxes[2])):
                    before, again = again, np.empty_like(again)
                    head = (some.size, some.size, moving, 0.5 * step, before, again, np.array([-1]))
                    run(0, 1, *head, *near, bounds, flow.sizes, *part)
                change = np.abs(again.reshape(moving, -1) - new.reshape(moving, -1)[:, some])
                worst = np.max(change, axis=1, where=np.isfinite(change), initial=0.0)
                error += float(np.max(worst * units))
                # The limit is below the tolerance: worst nodes of rows are not quite the worst.
                if error > limit:
                    raise TooCoarse
            begin, last = begin - step, boxes[-1]
            old, new = new, old
        return old.reshape(moving, -1) * units[:, None]

    @cached_property
    def _limit(self) -> float:
        """Largest estimate of the error of the feet, in cells."""
        return 0.5 * self.stage.foot_error + self._rounding

    @cached_property
    def _rounding(self) -> float:
        """Rounding error of feet, in cells."""
        bounds = [self.grid.bounds[axis] for axis in self.stage.moving]
        far = [max(map(abs, pair)) / h for pair, h in zip(bounds, self.cells, strict=True)]
        return 256.0 * float(np.finfo(float).eps) * max(far)

    def _differentiate(self, rows: Array) -> bool:
        """Write all derivatives from the displacements in the first rows; NaN at nodes near walls
        or where they are not exact. Returns whether there are such nodes."""
        jets, flagged = self.stage.jets, False
        place = {jet: q for q, jet in enumerate(jets)}
        for jet, row in zip(jets, rows, strict=True):
            if jet == LOG_DETERMINANT:
                J = [[rows[place[foot(c, axis)]] for axis in (0, 1)] for c in (0, 1)]
                self.xp.multiply(J[0][0], J[1][1], out=row)
                row -= J[0][1] * J[1][0]
            if not any(jet.orders):
                continue
            axis = max(q for q in range(3) if jet.orders[q])
            i, j, k, _ = (order - (q == axis) for q, order in enumerate(jet.orders))
            lower = Jet(jet.component, (i, j, k, 0))
            h, limit = self.grid.spacing[axis], self._slopes
            factor, plus = 1.0 / h, 0.0
            if jet.component < 3 and not any(lower.orders):
                factor, plus = self.grid.spacing[jet.component] / h, float(jet.component == axis)
            else:
                limit = limit / h  # of derivatives per length
            flagged |= self._difference(rows[place[lower]], row, axis, factor, plus, limit)
        return flagged

    def _difference(
        self, a: Array, out: Array, axis: int, factor: float, plus: float, limit: float
    ) -> bool:
        """The difference of an array of all nodes; whether its error exceeds the limit anywhere."""
        from cip.engines.cpu_loops import share
        from cip.engines.displacement_loops import run_difference

        n, stride = self.grid.nodes[axis], int(np.prod(self.grid.nodes[axis + 1 :]))
        said, periodic = np.empty(self.grid.size // stride), int(self.grid.periodic[axis])
        given = (a, out, said, n, stride, periodic, factor, plus, limit)
        share(lambda a, b: run_difference(a, b, *given), said.size, self.grid.size)
        return bool(said.any())

    def _closely(
        self, flow: _Flow, points: list[Array], times: tuple[float, float], count: int, left: Array
    ) -> Array:
        """All components of the feet of some nodes from paths that end within a fraction of a cell
        around each; NaN where the path of the node has `left` the grid."""
        moving, size = self.stage.moving, points[0].size
        offsets = np.array(np.meshgrid(*[_NEAR] * len(moving), indexing="ij"))
        around, count_of = [], offsets[0].size
        for q, x in enumerate(points):
            spread = np.broadcast_to(x, (count_of, size))
            if q < len(moving):
                spread = spread + offsets[q].reshape(-1, 1) * (self.cells[q] / flow.unit[q])
            around.append(np.ascontiguousarray(spread).reshape(-1))
        bounds = np.tile([-np.inf, np.inf], 2)
        d = self._follow(flow, around, bounds, size, times, count)
        d[:, np.tile(left, count_of)] = np.nan
        d = d.reshape(-1, *offsets[0].shape, size)
        place = d + offsets[..., None]

        def derivative(c: int, orders: Sequence[int]) -> Array:
            found, unit = place[moving.index(c)], self.grid.spacing[c]
            for axis in moving:
                found = np.tensordot(_WEIGHTS[orders[axis]], found, 1)
                unit /= self.grid.spacing[axis] ** orders[axis]
            return found * unit

        rows = np.empty((len(self.stage.jets), size))
        for jet, row in zip(self.stage.jets, rows, strict=True):
            i, j, *_ = jet.orders
            if jet.component == 3:  # the determinant, by the rule of Leibniz
                row[:] = sum(
                    derivative(0, (p + 1, q)) * derivative(1, (i - p, j - q + 1))
                    - derivative(0, (p, q + 1)) * derivative(1, (i - p + 1, j - q))
                    for p in range(i + 1)
                    for q in range(j + 1)
                )
            elif any(jet.orders):
                row[:] = derivative(jet.component, jet.orders)
            else:
                row[:] = d[moving.index(jet.component)][(2,) * len(moving)]
        return rows

    def _to_walls(
        self, part: Array, block: int, times: tuple[float, float], nodes: Array
    ) -> Exits | None:
        """Replace what is not finite at some nodes by the solution of the equations of the
        derivatives up to the walls; the paths that begin there."""
        stage, grid = self.stage, self.grid
        here = np.flatnonzero(~np.isfinite(part).all(axis=0))
        if not here.size:
            return None
        left = nodes[here]
        points, length = [x.ravel()[left] for x in stage.points(block)], times[1] - times[0]
        given = (points, times[1], length, stage.tolerance)
        found = integrate(grid, stage.velocity, stage.system, *given, places=left)
        exits = found.exits
        if exits is not None:
            exits = replace(exits, nodes=left[exits.nodes])
        check_inside(grid, exits, set(stage.walls), times[1])
        part[:, here] = stage.components(found.jets, points, left)
        return exits


def steps_between(start: float, end: float, breaks: Sequence[float], count: int) -> list[float]:
    """Lengths of the sub-steps from `end` back to `start`: equal ones, about `count`, between times
    at which the velocity is not smooth."""
    times = [end, *sorted(breaks, reverse=bool(end > start)), start]
    found = []
    for high, low in pairwise(times):
        parts = max(1, int(np.ceil(count * (high - low) / (end - start) - 1e-9)))
        found += [(high - low) / parts] * parts
    return found
