r"""Feet by displacements alone, and the derivatives of the map to them by differences.

Positions are followed by the classical Runge-Kutta method, those in winds from data by Kutta's of
order 3 where that is exact enough. In each row of nodes the one whose stages differ most is
followed again by two classical steps of half the length: the largest difference, summed over the
steps, estimates the error of all feet (Hairer, Norsett and Wanner, Solving Ordinary Differential
Equations I, 1993, section II.4). Derivatives are central differences
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
from typing import Any, NamedTuple

import numpy as np

from cip.characteristics.feet import FEET, Exits, check_inside, integrate
from cip.characteristics.flow_derivatives import LOG_DETERMINANT, Jet, foot
from cip.formulas.expression import numpy_function, raised
from cip.formulas.snapshots import Snapshots, product_along, snapshots_of
from cip.stages.stage import Stage, StageFeet
from skfem_adini.ground.arrays import host

Array = Any


class Points(NamedTuple):
    """Points in the units of a flow, as `run_substep` reads them: coordinates, those that move
    first, and where lines begin, with the places of a node's entries."""

    arrays: list[Array]
    places: Array

    def some(self, nodes: Array, row: int) -> Points:
        """Some of the points of rows of that length."""
        line, j = np.divmod(nodes, row)
        at = self.places[:8].reshape(4, 2)
        found = [a[line * n + j * m] for a, (n, m) in zip(self.arrays, at, strict=True)]
        found[3] = found[3] + j * self.places[8]
        return listed(found)


def listed(arrays: list[Array]) -> Points:
    """Points with an entry for each in every array."""
    return Points([np.ascontiguousarray(a) for a in arrays], np.array([0, 1] * 4 + [0]))


class Flow:
    """The backward velocity in the directions that move, at the points of a block of feet."""

    kernel: Any  # ``flow`` of `cip.engines.displacement_loops`
    sizes: Array
    points: Points
    origin: list[float]  # for each direction that moves: the zero of its coordinate ..
    unit: list[float]  # .. and the length of its unit

    def boxes(self, *times: float) -> list[Array]:
        """What the kernel reads of the velocity at each time."""
        raise NotImplementedError

    def few(self, t: float) -> Array:
        """The same for a few points at a time, until the next call."""
        return self.boxes(t)[0]

    def breaks(self, start: float, end: float) -> list[float]:
        """Times between these at which the velocity is not smooth."""
        return []

    def _set_points(self, stage: Stage, block: int) -> None:
        """The points of a block, whose lines all begin at 0."""
        nodes, dim = stage.grid.nodes, stage.grid.dim
        lines, rows = stage.lines(block), stage.grid.size // nodes[-1]
        index = np.unravel_index(np.arange(rows), nodes[:-1]) if dim > 1 else ()
        arrays, places = [], []
        for axis in (*stage.moving, *(a for a in range(3) if a not in stage.moving)):
            line = lines[axis] if axis < dim else np.zeros(1)
            if axis in stage.moving:
                q = stage.moving.index(axis)
                line = (line - self.origin[q]) / self.unit[q]
            arrays.append(line[index[axis]] if axis < dim - 1 else line)
            places += [int(axis < dim - 1), int(axis == dim - 1)]
        self.points = Points([*arrays, np.zeros(rows, np.int64)], np.array([*places, 1, 0, 0]))


class _FormulaFlow(Flow):
    def __init__(self, stage: Stage, block: int) -> None:
        from cip.engines.cpu_loops import kernel_of
        from cip.engines.displacement_loops import (
            fast_cos,
            fast_sin,
            formula_source,
            of_half_angles,
            without_place,
        )

        rates = of_half_angles(stage.system.rates[: len(stage.moving)])
        self.rates, self.held = without_place(rates)
        source = formula_source(self.rates, stage.moving, len(self.held))
        self.kernel = kernel_of(source, sin=fast_sin, cos=fast_cos)
        self._values = numpy_function(self.held, ["t"])
        self.sizes = np.zeros(1, np.int64)
        self.origin, self.unit = [0.0, 0.0], [1.0, 1.0]
        self._set_points(stage, block)

    def boxes(self, *times: float) -> list[Array]:
        with np.errstate(all="ignore"):
            return [np.array([*self._values(np.float64(t)), 0.0], dtype=float) for t in times]


class _SplineFlow(Flow):
    def __init__(self, field: Snapshots, stage: Stage, block: int) -> None:
        from cip.engines.cpu_loops import kernel_of
        from cip.engines.displacement_loops import HEAD, numbers, spline_source, weight_numbers

        self._field, self._components = field, list(stage.moving)
        moving, data, lines = stage.moving, field.grid, stage.lines(block)
        rooms: Any = {"numbers": numbers, "weight_numbers": weight_numbers, "down": np.floor}
        self.kernel = kernel_of(spline_source(field.degrees[1], len(moving)), **rooms)
        self._matrices = [
            field.cardinal(axis) if axis in moving else field.values_at(axis, line)
            for axis, line in enumerate(lines)
        ]
        self.origin = [data.bounds[axis][0] for axis in moving]
        self.unit = [float(data.widths[axis][0]) for axis in moving]
        counts = [matrix.shape[0] for matrix in self._matrices]
        self._set_points(stage, block)
        row, self.count = 2 * counts[-1], int(np.prod(counts))  # of coefficients of a component ..
        if stage.axis is not None:
            row = int(np.prod(counts[stage.axis + 1 :]))
            self.count = counts[stage.axis] * row  # .. or of the lines of a block
            size = stage.grid.nodes[stage.axis] * row
            first = np.arange(0, stage.grid.size, stage.grid.nodes[-1])
            self.points.arrays[3][:] = first // size * self.count + first % row
            self.points.places[8] = stage.axis < stage.grid.dim - 1
        flags = [(data.cells[axis], int(data.periodic[axis])) for axis in moving]
        self.sizes = np.array([*(n for pair in flags for n in pair), row, field.degrees[1] + 1])
        # After what `few` writes the coefficients of B-splines in time, of those of one time and of
        # the next; and what they give at the last times.
        self._slots: dict[int, int] = {}
        slots, size = field.degrees[0] + 4, int(np.prod(counts)) * len(moving)
        self._few = np.zeros(HEAD + slots * size)
        self._store = self._few[HEAD:].reshape(slots, size)
        self._boxes: dict[float, Array] = {}

    def _tables(self, t: float) -> tuple[list[int], Array]:
        """Where the coefficients of the B-splines at a time are stored, and their weights."""
        first, weights = self._field.time_weights(t)
        needed = range(first, first + weights.size)
        for m in needed:
            if m not in self._slots:
                free = len(self._slots)
                if free == len(self._store):
                    free = self._slots.pop(next(q for q in self._slots if q not in needed))
                self._store[free] = self.table(m)
                self._slots[m] = free
        return [self._slots[m] for m in needed], weights

    def table(self, m: int) -> Array:
        """The coefficients of the time's B-spline m as the kernel reads them."""
        parts = []
        for axis, h in zip(self._components, self.unit, strict=True):
            part = self._field.coefficient(m)[axis] / h
            for q, matrix in enumerate(self._matrices):
                part = product_along(matrix, part, q)
            parts.append(part)
        return np.ascontiguousarray(np.stack(parts, axis=-1)).reshape(-1)

    def boxes(self, *times: float) -> list[Array]:
        kept = {t: self._boxes[t] for t in times if t in self._boxes}
        new = [t for t in dict.fromkeys(times) if t not in kept]
        if len(new) == 2 and self._tables(new[0])[0] == self._tables(new[1])[0]:
            self._combine(*new)
        for t in new:
            if t not in self._boxes:
                self._combine(t)
        found = [kept[t] if t in kept else self._boxes[t] for t in times]
        for t in list(self._boxes)[:-4]:
            del self._boxes[t]
        return found

    def _combine(self, *times: float) -> None:
        """The coefficients at one or two times of an interval."""
        from cip.engines.cpu_loops import share
        from cip.engines.displacement_loops import HEAD, run_combine

        slots = self._tables(times[0])[0]
        more, size = 4 - len(slots), self._store.shape[1]
        tables = [self._store[slot] for slot in [*slots, *slots[:1] * more]]
        weights, made = np.zeros((2, 4)), [np.empty(0)] * 2
        for q, t in enumerate(times):
            weights[q, : len(slots)] = self._tables(t)[1]
            made[q] = self._boxes[t] = np.empty(HEAD + size)
            made[q][:3] = 1.0, HEAD, 1.0
        given: Any = (*tables, weights.ravel(), *(one[HEAD:] for one in made))
        share(lambda a, b: run_combine(a, b, *given), size, size)

    def few(self, t: float) -> Array:
        from cip.engines.displacement_loops import HEAD

        slots, weights = self._tables(t)
        self._few[0] = weights.size
        self._few[1:HEAD:2][: weights.size] = HEAD + np.array(slots) * self._store.shape[1]
        self._few[2:HEAD:2][: weights.size] = weights
        return self._few

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
    """The feet of a stage of an unsteady velocity; `serves` tells for which stages. Stages of a
    velocity in one thread share `flows`."""

    xp: Any = np  # the module of the arrays of feet

    def __init__(self, stage: Stage, flows: dict[Any, Flow]) -> None:
        self.stage, self.grid, self._flows = stage, stage.grid, flows
        self.cells = [self.grid.spacing[axis] for axis in stage.moving]
        # A slope moves a value by a tenth of a cell or so, and data have no slopes of their own.
        given = snapshots_of(stage.velocity) is not None
        self._slopes = 100.0 * stage.foot_error if given else stage.limit
        self.least = 0 if given else 1  # of data order 3 suffices for steps of a cell or so

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
        """The feet with `count` sub-steps, 0 for one of order 3, or with more where the velocity
        has kinks in time. Raises `TooCoarse`."""
        stage, xp = self.stage, self.xp
        times = t + stage.begin * dt, t + stage.end * dt
        rows = xp.empty((len(stage.blocks), len(stage.jets), self.grid.size))
        exits: list[Exits | None] = []
        for row, block in zip(rows, stage.blocks, strict=True):
            self._displace(row, block, times, count)
            flagged = self._differentiate(row)
            outside = not bool(xp.isfinite(row[0].sum()))
            exits.append(self._mend(row, block, times, count) if flagged or outside else None)
        return StageFeet(rows.reshape(-1), exits, *times, (max(count, 1),) * len(exits))

    def _flow(self, block: int) -> Any:
        key, field = (self.stage.moving, block), snapshots_of(self.stage.velocity)
        if key not in self._flows:
            given = self.stage, block
            made = _FormulaFlow(*given) if field is None else _SplineFlow(field, *given)
            self._flows[key] = made
        return self._flows[key]

    def _displace(self, row: Array, block: int, times: tuple[float, float], count: int) -> None:
        """Write the displacements of a block to the first rows. Raises `TooCoarse`."""
        flow, d = self._flow(block), row[: len(self.cells)]
        given = flow, flow.points, self.bounds(flow), self.grid.nodes[-1], times, count
        self._follow(*given, d, self._limit)

    def _mend(self, row: Array, block: int, times: tuple[float, float], count: int) -> Exits | None:
        """Write the feet of the nodes that have none; the paths of them that begin on walls."""
        flow = self._flow(block)
        bad = self.xp.flatnonzero(self.xp.isnan(row).any(axis=0))
        nodes, left = host(bad), np.isnan(host(row[0, bad]))
        near = flow.points.some(nodes, self.grid.nodes[-1]).arrays
        part = self._closely(flow, near, times, count, left)
        exits = self._to_walls(part, block, times, nodes)
        row[:, bad] = self.xp.asarray(part)
        return exits

    def bounds(self, flow: Flow) -> Array:
        """Lowest and highest coordinates of paths in the units of the flow, by direction."""
        found = []
        for q, axis in enumerate(self.stage.moving):
            margin = (FEET.cells if self.grid.periodic[axis] else FEET.wall) * self.cells[q]
            low, high = self.grid.bounds[axis]
            found += [low - margin - flow.origin[q], high + margin - flow.origin[q]]
        return np.array(found) / np.repeat(flow.unit[: len(self.cells)], 2)

    def _follow(
        self, flow: Flow, points: Points, bounds: Array, row: int, times: tuple[float, float],
        count: int, out: Array, limit: float = np.inf,
    ) -> None:  # fmt: skip
        """Write the displacements of points, in cells, to `out` of shape (directions, points); NaN
        beyond `bounds`. Raises `TooCoarse` if their error, estimated in each `row` of points,
        exceeds a finite `limit`."""
        from cip.engines import displacement_loops
        from cip.engines.cpu_loops import share
        from skfem_adini.ground.jit import loop_over

        moving, size = out.shape
        run = loop_over(displacement_loops.run_substep, flow=flow.kernel)
        units = np.array(flow.unit[:moving]) / self.cells
        marks = clock(*times, flow.breaks(*times), max(count, 1))
        new, spare = out.reshape(-1), np.empty(out.size if len(marks) > 2 else 0)
        if len(marks) % 2:  # the last sub-step writes to `out`
            new, spare = spare, new
        old, error = spare[:0], 0.0
        for begin, end in pairwise(marks):
            step, middle = begin - end, begin - 0.5 * (begin - end)
            boxes = flow.boxes(begin, middle, end)
            chosen = np.full(size // row, -1)
            head = (4 if count else 3, row, size, moving, step, old, new, chosen)
            given = (*head, *points.arrays, points.places, bounds, flow.sizes, *boxes)
            share(lambda a, b, given=given: run(a, b, *given), chosen.size, size)  # type: ignore[misc]
            if limit < np.inf:
                some = chosen[chosen >= 0]
                near, again = points.some(some, row), old.reshape(-1, size)[:, some].reshape(-1)
                for q, t in enumerate((begin - 0.25 * step, begin - 0.75 * step)):
                    before, again = again, np.empty(moving * some.size)
                    inner = boxes[q], flow.few(t), boxes[q + 1]
                    half: Any = (4, some.size, some.size, moving, 0.5 * step, before, again)
                    half += (np.array([-1]), *near.arrays, near.places, bounds, flow.sizes)
                    run(0, 1, *half, *inner)
                change = np.abs(again.reshape(moving, -1) - new.reshape(moving, -1)[:, some])
                worst = np.max(change, axis=1, where=np.isfinite(change), initial=0.0)
                error += float(np.max(worst * units))
                # The limit is below the tolerance: worst nodes of rows are not quite the worst.
                if error > limit:
                    raise TooCoarse
            old, new = new, spare if old.size == 0 else old
        out *= units[:, None]

    @cached_property
    def _limit(self) -> float:
        """Largest estimate of the error of the feet, in cells."""
        # Where nodes are few, the worst of a row has no neighbours that are nearly as bad.
        part = 0.5 if self.grid.size >= FEET.few else 0.05
        return part * self.stage.foot_error + self._rounding

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
            lower = Jet(jet.component, raised(jet.orders, axis, -1))
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
        self, flow: Flow, points: list[Array], times: tuple[float, float], count: int, left: Array
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
        d = np.empty((len(moving), around[0].size))
        self._follow(flow, listed(around), bounds, around[0].size, times, count, d)
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


def clock(start: float, end: float, breaks: Sequence[float], count: int) -> list[float]:
    """Times of the sub-steps from `end` back to `start`: equal ones, about `count`, between times
    at which the velocity is not smooth."""
    times = [end, *sorted(breaks, reverse=bool(end > start)), start]
    found = [end]
    for high, low in pairwise(times):
        parts = max(1, int(np.ceil(count * (high - low) / (end - start) - 1e-9)))
        found += [high - q * (high - low) / parts for q in range(1, parts)] + [low]
    return found
