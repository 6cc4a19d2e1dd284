r"""Feet by displacements alone, and the derivatives of the map to them by differences.

Positions are followed by the classical Runge-Kutta method. In each row of nodes the one where the
inner stages :math:`k_2, k_3` differ most is followed again with halved steps: the largest
difference, summed over the steps, estimates the error of all feet (Hairer, Norsett and Wanner,
Solving Ordinary Differential Equations I, 1993, section II.4). Derivatives are central differences
of the displacements, of order 8, where the neighbours' paths stay inside; other nodes follow the
equations of `cip.characteristics.flow_derivatives`.

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
            without_place,
        )

        rates, self._held = without_place(stage.system.rates[: len(stage.moving)])
        source = formula_source(rates, stage.moving, len(self._held))
        self.kernel = kernel_of(source, sin=fast_sin, cos=fast_cos)
        self._values = numpy_function(self._held, ["t"])
        self.sizes, self.at = np.zeros(1, np.int64), np.zeros(stage.grid.size, np.int64)
        self.origin, self.unit = [0.0, 0.0], [1.0, 1.0]

    def box(self, t: float) -> Array:
        with np.errstate(all="ignore"):
            return np.array([*self._values(np.float64(t)), 0.0], dtype=float)

    def breaks(self, start: float, end: float) -> list[float]:
        return []


class _SplineFlow:
    def __init__(self, field: Snapshots, stage: Stage, block: int) -> None:
        from cip.engines.cpu_loops import kernel_of
        from cip.engines.displacement_loops import spline_source

        self._field, self._components = field, list(stage.moving)
        moving, data, lines = stage.moving, field.grid, stage.lines(block)
        self.kernel = kernel_of(spline_source(field.degrees[1], len(moving)))
        self._matrices = [
            field.cardinal(axis) if axis in moving else field.values_at(axis, line)
            for axis, line in enumerate(lines)
        ]
        self.origin = [data.bounds[axis][0] for axis in moving]
        self.unit = [float(data.widths[axis][0]) for axis in moving]
        self._tables: dict[int, Array] = {}
        counts = [matrix.shape[0] for matrix in self._matrices]
        self.at = np.zeros(stage.grid.size, np.int64)
        row = 2 * counts[-1]
        if stage.axis is not None:
            row = int(np.prod(counts[stage.axis + 1 :]))
            block_size = stage.grid.nodes[stage.axis] * row
            o = np.arange(stage.grid.size)
            self.at = o // block_size * (counts[stage.axis] * row) + o % row
        flags = [(data.cells[axis], int(data.periodic[axis])) for axis in moving]
        self.sizes = np.array([*(n for pair in flags for n in pair), row])

    def _table(self, m: int) -> Array:
        """The coefficients of the time's B-spline m as the kernel reads them."""
        found = self._tables.get(m)
        if found is None:
            parts = []
            for axis, h in zip(self._components, self.unit, strict=True):
                part = self._field.coefficients[axis, m] / h
                for q, matrix in enumerate(self._matrices):
                    moved = np.moveaxis(part, q, 0)
                    shape = (-1, *moved.shape[1:])
                    product = matrix @ moved.reshape(len(moved), -1)
                    part = np.moveaxis(product.reshape(shape), 0, q)
                parts.append(part)
            found = np.ascontiguousarray(np.stack(parts, axis=-1)).reshape(-1)
            while len(self._tables) > 6:  # those of one time and of the next interval
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
        inside = times[(times > start) & (times < end)]
        return [] if self._field.degrees[0] > 1 else [float(t) for t in inside]


class TooCoarse(Exception):
    """The sub-steps are too long."""


class Unsmooth(Exception):
    """Differences do not give the derivatives of the feet to the tolerance."""


class Displacements:
    """The feet of a stage of an unsteady velocity; `serves` tells for which stages."""

    def __init__(self, stage: Stage, path: Any) -> None:
        self.stage, self.grid, self._path = stage, stage.grid, path
        self._flows: dict[int, _Flow] = {}
        self._exact = snapshots_of(stage.velocity) is None  # data have no derivatives of their own

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
        `TooCoarse` or `Unsmooth`."""
        stage, size = self.stage, self.grid.size
        t_start, t_end = t + stage.begin * dt, t + stage.end * dt
        rows = np.empty((len(stage.blocks), len(stage.jets), size))
        exits = []
        for row, block in zip(rows, stage.blocks, strict=True):
            if block not in self._flows:
                field = snapshots_of(stage.velocity)
                self._flows[block] = (
                    _FormulaFlow(stage) if field is None else _SplineFlow(field, stage, block)
                )
            self._follow(self._flows[block], block, row, t_start, t_end, count)
            self._differentiate(row)
            exits.append(self._repair(row, block, t_start, t_end, 2 * count))
        counts = (count,) * len(exits)
        return StageFeet(rows.reshape(-1), exits, t_start, t_end, counts)

    @cached_property
    def _others(self) -> list[int]:
        return [axis for axis in range(3) if axis not in self.stage.moving]

    def _points(self, flow: _Flow, block: int) -> list[Array]:
        """Coordinates of the points, those that move first, in the units of the flow."""
        points = [x.ravel() for x in self.stage.points(block)]
        points += [np.zeros(self.grid.size)] * (3 - self.grid.dim)
        found = [
            (points[axis] - low) / unit
            for axis, low, unit in zip(self.stage.moving, flow.origin, flow.unit, strict=False)
        ]
        return [np.ascontiguousarray(x) for x in (*found, *(points[axis] for axis in self._others))]

    def _bounds(self, flow: _Flow) -> Array:
        found = []
        for axis, origin, unit in zip(self.stage.moving, flow.origin, flow.unit, strict=False):
            low, high = self.grid.bounds[axis]
            h = self.grid.spacing[axis]
            margin = (FEET.cells if self.grid.periodic[axis] else FEET.wall) * h
            found += [(low - margin - origin) / unit, (high + margin - origin) / unit]
        return np.array(found)

    def _follow(
        self, flow: _Flow, block: int, out: Array, t_start: float, t_end: float, count: int
    ) -> None:
        """Write the displacements, in cells, to the first rows of `out`."""
        from cip.engines import displacement_loops
        from cip.engines.cpu_loops import share
        from skfem_adini.ground.jit import loop_over

        size, moving, row = self.grid.size, len(self.stage.moving), self.grid.nodes[-1]
        run = loop_over(displacement_loops.run_substep, flow=flow.kernel)
        points = [*self._points(flow, block), flow.at]
        ends = [self._bounds(flow), flow.sizes]
        cells = [
            unit / self.grid.spacing[axis]
            for axis, unit in zip(self.stage.moving, flow.unit, strict=False)
        ]
        old, new, error = np.zeros(moving * size), np.empty(moving * size), 0.0
        begin, last = t_end, flow.box(t_end)
        for step in _steps(t_start, t_end, flow.breaks(t_start, t_end), count):
            boxes = [last, *(flow.box(begin - q * step) for q in (0.25, 0.5, 0.75, 1.0))]
            begin, last = begin - step, boxes[-1]
            chosen = np.full(size // row, -1)
            head = (row, size, moving, step, old, new, chosen)
            given = (*head, *points, *ends, *boxes[::2])
            share(lambda a, b, given=given: run(a, b, *given), chosen.size, size)  # type: ignore[misc]
            some = chosen[chosen >= 0]
            again = old.reshape(moving, -1)[:, some].reshape(-1)
            near = [np.ascontiguousarray(x[some]) for x in points]
            for part in (boxes[:3], boxes[2:]):
                before, again = again, np.empty_like(again)
                head = (some.size, some.size, moving, 0.5 * step, before, again, np.array([-1]))
                run(0, 1, *head, *near, *ends, *part)
            change = np.abs(again.reshape(moving, -1) - new.reshape(moving, -1)[:, some])
            worst = np.max(change, axis=1, where=np.isfinite(change), initial=0.0)
            error += float(np.max(worst * cells))
            if error > self.stage.foot_error + self._rounding:
                raise TooCoarse
            old, new = new, old
        for d, h, to in zip(old.reshape(moving, -1), cells, out, strict=False):
            np.multiply(d, h, out=to)

    @cached_property
    def _rounding(self) -> float:
        """Rounding error of feet, in cells."""
        grid = self.grid
        far = [max(map(abs, grid.bounds[axis])) / grid.spacing[axis] for axis in self.stage.moving]
        return 256.0 * float(np.finfo(float).eps) * max(far)

    def _differentiate(self, rows: Array) -> None:
        """Write all derivatives from the displacements in the first rows."""
        jets = self.stage.jets
        place = {jet: q for q, jet in enumerate(jets)}
        for jet, row in zip(jets, rows, strict=True):
            if jet == LOG_DETERMINANT:
                J = [[rows[place[foot(c, axis)]] for axis in (0, 1)] for c in (0, 1)]
                np.multiply(J[0][0], J[1][1], out=row)
                row -= J[0][1] * J[1][0]
            if not any(jet.orders):
                continue
            axis = max(q for q in range(3) if jet.orders[q])
            i, j, k, _ = (order - (q == axis) for q, order in enumerate(jet.orders))
            lower = Jet(jet.component, (i, j, k, 0))
            first = jet.component < 3 and not any(lower.orders)
            h = self.grid.spacing[axis]
            length = self.grid.spacing[jet.component] if first else 1.0
            plus = 1.0 if first and jet.component == axis else 0.0
            worst = self._difference(rows[place[lower]], row, axis, length / h, plus)
            # Second derivatives are per length, and so compared after multiplication by it.
            if self._exact and worst * (1.0 if first else h) > self.stage.limit:
                raise Unsmooth

    def _difference(self, a: Array, out: Array, axis: int, factor: float, plus: float) -> float:
        """The difference of an array of all nodes; returns the largest error in it."""
        from cip.engines.cpu_loops import share
        from cip.engines.displacement_loops import run_difference

        n, stride = self.grid.nodes[axis], int(np.prod(self.grid.nodes[axis + 1 :]))
        said, periodic = np.empty(self.grid.size // stride), int(self.grid.periodic[axis])

        given = (a, out, said, n, stride, periodic, factor, plus)
        share(lambda a, b: run_difference(a, b, *given), said.size, self.grid.size)
        return abs(factor) * float(said.max())

    def _repair(
        self, rows: Array, block: int, t_start: float, t_end: float, count: int
    ) -> Exits | None:
        """Solve the equations of the derivatives at nodes without, and find the paths that begin on
        walls."""
        walls = not all(self.grid.periodic[axis] for axis in self.stage.moving)
        if not walls and np.isfinite(rows[0].sum()):
            return None
        bad = np.flatnonzero(np.isnan(rows).any(axis=0))
        if not bad.size:
            return None
        stage, points = self.stage, [x.ravel()[bad] for x in self.stage.points(block)]
        found, said = self._path(stage, points, t_end, t_end - t_start, count)
        rows[:, bad] = found
        gone = (said != 0) | ~np.isfinite(found).all(axis=0)
        if not gone.any():
            return None
        left, points = bad[gone], [x[gone] for x in points]
        more = integrate(
            self.grid, stage.velocity, stage.system, points, t_end, t_end - t_start,
            stage.tolerance, places=left,
        )  # fmt: skip
        exits = more.exits
        if exits is not None:
            exits = replace(exits, nodes=left[exits.nodes])
        check_inside(self.grid, exits, set(stage.walls), t_end)
        rows[:, left] = stage.components(more.jets, points, left)
        return exits


def _steps(start: float, end: float, breaks: Sequence[float], count: int) -> list[float]:
    """Lengths of the sub-steps from `end` back to `start`: equal ones, about `count`, between times
    at which the velocity is not smooth."""
    times = [end, *reversed(breaks), start]
    found = []
    for high, low in pairwise(times):
        parts = max(1, int(np.ceil(count * (high - low) / (end - start) - 1e-9)))
        found += [(high - low) / parts] * parts
    return found
