"""Feet of the characteristics and their derivatives, integrated backward together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cip.characteristics.flow_derivatives import Jet, System
from cip.errors import InputError, LeftDomain, NotConverged, NotFinite
from cip.formulas.expression import Expression, rows_of
from cip.formulas.formula import Formula, functions_of
from cip.grid import Array, Grid, node_name, wall_name
from skfem_adini.ground.arguments import real_number


class _Feet(NamedTuple):  # limits of characteristics
    # Largest error of the feet, in cells, and relative error of their derivatives: below the
    # rounding of a float64 profile in some hundred steps, above that of the velocity.
    tolerance: float = 1e-10
    unsteady: float = 1e-8  # the same for unsteady velocities, whose feet each step computes
    data: float = 1e-5  # of snapshots, whose interpolation in time errs by as much
    wall: float = 1e-9  # a foot outside by at most this, in cells, counts as on the wall
    cells: float = 2.0**30  # largest displacement: kernels count cells in 32-bit integers
    substeps: int = 8192  # of a step: with more the velocity is not smooth, or dt far too long
    sample: int = 1024  # nodes on which the first number of sub-steps is found
    few: int = 4096  # nodes below which estimates of errors leave more room


FEET = _Feet()


@dataclass(frozen=True)
class Exits:
    """Characteristics that begin on a wall, with place, time and derivatives there."""

    nodes: NDArray[np.int64]  # indices of their end points among the given points
    ages: Array  # time between the wall and the node
    points: tuple[Array, ...]  # coordinates on the wall
    axis: NDArray[np.int64]  # direction normal to the wall
    side: NDArray[np.int64]  # 0 for its lower or 1 for its upper end
    jets: dict[Jet, Array]  # derivatives of the foot at the wall

    def kept(self, keep: NDArray[np.bool_]) -> Exits | None:
        """Those of the paths that are to be kept; None for none."""
        if not keep.any():
            return None
        points, jets = (x[keep] for x in self.points), self.jets.items()
        ends = self.nodes[keep], self.ages[keep], tuple(points), self.axis[keep], self.side[keep]
        return Exits(*ends, {jet: values[keep] for jet, values in jets})


@dataclass(frozen=True)
class Feet:
    """Displacements (in units of the coordinates) and derivatives of the feet of all points."""

    jets: dict[Jet, Array]  # flat arrays, an entry for each point
    exits: Exits | None  # the paths that begin on a wall, if any
    substeps: int  # number of sub-steps of the accepted result


def integrate(
    grid: Grid,
    formulas: Sequence[Formula],
    system: System,
    points: Sequence[Array],
    t_end: float,
    dt: float,
    tolerance: float = FEET.tolerance,
    substeps: int | None = None,
    known: Mapping[str, Any] | None = None,
    places: NDArray[np.int64] | None = None,
) -> Feet:
    """Follow the characteristics through `points` from `t_end` back by `dt` (forward where it is
    negative), or to a wall, in `substeps` equal steps or as many as the tolerance asks for.
    `known` are numbers and functions in the rates that the velocity does not have, by their names
    in code; `places` the nodes of the points for messages, if they are not all nodes."""
    functions = functions_at(grid, formulas, system.rates, t_end)
    rates = system.evaluator({**(known or {}), **functions})
    flat = [np.ravel(x) for x in points]
    run = _Run(grid, system, rates, flat, t_end, dt, places)
    if substeps is not None:
        return Feet(*run.follow(substeps), substeps)
    count = run.first_guess()
    coarse = run.follow(count)
    # With 2 n sub-steps both results could sample a velocity of period dt / n at the same phases.
    one_more = int(not all(formula.steady for formula in formulas))
    while True:
        count = 2 * count + one_more
        fine = run.follow(count)
        if run.difference(coarse, fine) <= 15.0 * tolerance:
            break
        if 2 * count > FEET.substeps:
            raise NotConverged(
                f"characteristics: after {count} sub-steps over dt = {dt:.6g} from t = {t_end:.6g} "
                f"the error estimate is {run.difference(coarse, fine) / 15.0:.1e} cells, above "
                f"{tolerance:.1e}; is the velocity smooth? Take a smaller dt, or a larger "
                "foot_tolerance of the solver"
            )
        coarse = fine
    return Feet(*fine, count)


def functions_at(
    grid: Grid, formulas: Sequence[Formula], nodes: Sequence[Expression], t: float
) -> dict[str, Any]:
    """The callables and the numbers of parameters in `nodes`, by their names in code. Callables
    known by their values change with the time t: it sets the length of difference quotients."""
    exact = all(formula.exact for formula in formulas)
    clock = 1.0 if exact else time_scale(grid, formulas, t)
    return functions_of(formulas, nodes, (*grid.spacing, *([1.0] * (3 - grid.dim)), clock))


def time_scale(grid: Grid, formulas: Sequence[Formula], t: float) -> float:
    """Time scale of the field at a point: the least time to cross a cell."""
    speed = 0.0
    points = grid.mesh()
    for formula, h in zip(formulas, grid.spacing, strict=True):
        values = formula.derivative((0, 0, 0, 0), (1.0,) * 4)(
            *points, *([np.zeros(())] * (3 - grid.dim)), t
        )
        finite = np.abs(values[np.isfinite(values)])
        speed = max(speed, float(finite.max(initial=0.0)) / h)
    return 1.0 / speed if speed > 0.0 else min(grid.spacing)


def check_inside(grid: Grid, exits: Exits | None, allowed: set[tuple[int, int]], t: float) -> None:
    """Raise `LeftDomain` when a path ends at a wall without boundary data."""
    if exits is None:
        return
    for axis, side in sorted({(int(a), int(s)) for a, s in zip(exits.axis, exits.side)}):  # noqa: B905
        if (axis, side) in allowed:
            continue
        first = int(np.flatnonzero((exits.axis == axis) & (exits.side == side))[0])
        where = ", ".join(f"{x[first]:.6g}" for x in exits.points)
        wall, node = wall_name(axis, side), int(exits.nodes[first]) % grid.size
        raise LeftDomain(
            f"boundary: the characteristic of {node_name(grid, node)} at t = {t:.6g} comes in "
            f"through the wall {wall!r} at ({where}), t = {t - exits.ages[first]:.6g}, where no "
            f"data is given; pass boundary={{{wall!r}: value}}"
        )


_Result = tuple[dict[Jet, Array], "Exits | None"]


class _Run:
    def __init__(
        self,
        grid: Grid,
        system: System,
        rates: object,
        flat: list[Array],
        t_end: float,
        dt: float,
        places: NDArray[np.int64] | None,
    ) -> None:
        self.grid, self.system, self.flat, self.dt, self.places = grid, system, flat, dt, places
        self.t_end = np.float64(t_end)  # Python floats raise on overflow, NumPy's give infinity
        self.rates = rates
        self.size = flat[0].size
        self.walls = [axis for axis in system.moving if not grid.periodic[axis]]

    def _named(self, point: int) -> str:
        node = point if self.places is None else int(self.places[point])
        return node_name(self.grid, node % self.grid.size)

    def first_guess(self) -> int:
        y = self._start(np.arange(self.size))
        with np.errstate(all="ignore"):
            steepest = 0.0
            for jet, rate in zip(self.system.jets, self._rates(y, self.flat, 0.0), strict=True):
                if sum(jet.orders) == 1 and jet.component < 3:
                    steepest = max(steepest, float(np.max(np.abs(rate))))
        if not np.isfinite(steepest):
            steepest = 0.0  # `follow` reports the node where the velocity is not finite
        return int(np.clip(np.ceil(2.0 * steepest * abs(self.dt)), 1, FEET.substeps // 4))

    @np.errstate(all="ignore")  # `_check` names what is not finite
    def follow(self, count: int) -> _Result:
        result = self._start(np.arange(self.size))
        active = np.arange(self.size)
        y, base = result.copy(), self.flat
        found: list[tuple[NDArray[Any], ...]] = []
        step = self.dt / count
        for n in range(count):
            tau = n * step
            moved = self._advance(y, base, tau, np.full(active.size, step))
            self._check(moved, active, tau + step)
            if self.walls:
                outside = self._outside(moved, base) > 0.0
                if outside.any():
                    part, where = y[:, outside], [x[outside] for x in base]
                    crossed = self._beyond_each(moved[:, outside], where) > FEET.wall
                    age, at = self._to_the_wall(part, where, crossed, tau, step)
                    self._check(at, active[outside], tau + step)
                    found.append((active[outside], age, at, crossed))
                    keep = ~outside
                    result[:, active[keep]] = moved[:, keep]
                    active, moved = active[keep], moved[:, keep]
                    base = [x[keep] for x in base]
            y = moved
        result[:, active] = y
        exits = self._exits(found, result) if found else None
        return dict(zip(self.system.jets, result, strict=True)), exits

    def difference(self, coarse: _Result, fine: _Result) -> float:
        """Largest difference of two results: of feet in cells, of derivatives relative to the
        largest one, of the times of exits relative to dt. Paths that begin on a wall in one result
        only are left out."""
        aged = np.zeros((2, self.size))
        for row, (_, exits) in zip(aged, (coarse, fine), strict=True):
            if exits is not None:
                row[exits.nodes] = exits.ages
        same = (aged[0] != 0) == (aged[1] != 0)
        worst = float(np.max(np.abs(aged[0] - aged[1])[same], initial=0.0)) / abs(self.dt)
        for jet in self.system.jets:
            change = np.max(np.abs(coarse[0][jet] - fine[0][jet])[same], initial=0.0)
            if sum(jet.orders) == 0 and jet.component < 3:
                largest = self.grid.spacing[jet.component]
                # A displacement over many cells is rounded to some 1e-15 of its size.
                change -= 1e-15 * np.max(np.abs(fine[0][jet]), initial=0.0)
            else:
                largest = max(1.0, float(np.max(np.abs(fine[0][jet]), initial=0.0)))
            worst = max(worst, float(change / largest))
        return worst

    def _start(self, index: NDArray[np.int64]) -> Array:
        y = np.empty((len(self.system.jets), index.size))
        for row, jet in zip(y, self.system.jets, strict=True):
            row[:] = self.system.start(jet)
        return y

    def _rates(self, y: Array, base: Sequence[Array], tau: Array | float) -> list[Array]:
        point: list[Array] = []
        moving = list(self.system.moving)
        for axis in range(3):
            if axis >= self.grid.dim:
                point.append(np.zeros(()))
            elif axis in moving:
                point.append(base[axis] + y[moving.index(axis)])
            else:
                point.append(base[axis])
        return list(self.rates(*point, self.t_end - tau, *y))  # type: ignore[operator]

    def _advance(self, y: Array, base: Sequence[Array], tau: float, step: Array) -> Array:
        """One step of the classical Runge-Kutta method; every point has its own step length."""
        shape = y.shape[1:]
        k1 = rows_of(self._rates(y, base, tau), shape)
        k2 = rows_of(self._rates(y + 0.5 * step * k1, base, tau + 0.5 * step), shape)
        k3 = rows_of(self._rates(y + 0.5 * step * k2, base, tau + 0.5 * step), shape)
        k4 = rows_of(self._rates(y + step * k3, base, tau + step), shape)
        return y + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    def _outside(self, y: Array, base: Sequence[Array]) -> Array:
        """Cells by which each point lies beyond the nearest wall; not positive inside."""
        worst = self._beyond_each(y, base).max(axis=(0, 1))
        return np.where(worst > FEET.wall, worst, np.minimum(worst, 0.0))

    def _to_the_wall(
        self, y: Array, base: list[Array], crossed: NDArray[np.bool_], tau: float, step: float
    ) -> tuple[Array, Array]:
        """Age and unknowns where the paths meet the wall, by the Illinois method (false position).
        Only the walls that the step has crossed count: a path may run along others."""

        def outside(y: Array) -> Array:
            worst: Array = np.where(crossed, self._beyond_each(y, base), -np.inf).max(axis=(0, 1))
            return worst

        low, high = np.zeros(y.shape[1]), np.full(y.shape[1], step)
        f_low = np.minimum(outside(y), 0.0)
        f_high = outside(self._advance(y, base, tau, high))
        age = np.where(f_low == 0.0, 0.0, high)
        # Tolerance in cells: the rounding of the coordinates at the walls.
        far = [max(map(abs, self.grid.bounds[a])) / self.grid.spacing[a] for a in self.walls]
        close = max(1e-13, 8.0 * np.finfo(float).eps * max(far))
        for _ in range(60):  # halving alone would reach rounding after 53
            width = f_high - f_low
            age = np.where(width > 0, low - f_low * (high - low) / np.where(width > 0, width, 1), 0)
            at = self._advance(y, base, tau, age)
            beyond = outside(at)
            if np.all((np.abs(beyond) <= close) | (abs(high - low) <= 1e-15 * abs(step))):
                break
            right = beyond > 0.0
            f_low = np.where(right, 0.5 * f_low, beyond)
            f_high = np.where(right, beyond, 0.5 * f_high)
            low, high = np.where(right, low, age), np.where(right, age, high)
        return tau + age, self._advance(y, base, tau, age)

    def _beyond_each(self, y: Array, base: Sequence[Array]) -> Array:
        """Signed distance in cells beyond the lower and upper walls, shape (3, 2, points)."""
        beyond = np.full((3, 2, y.shape[1]), -np.inf)
        for axis in self.walls:
            x = base[axis] + y[self.system.moving.index(axis)]
            low, high = self.grid.bounds[axis]
            beyond[axis] = np.stack([low - x, x - high]) / self.grid.spacing[axis]
        return beyond

    def _exits(self, found: list[tuple[NDArray[Any], ...]], result: Array) -> Exits:
        nodes, ages, at, crossed = (np.concatenate(part, axis=-1) for part in zip(*found))  # noqa: B905
        points = [x[nodes] for x in self.flat]
        distance = np.full((3, 2, nodes.size), np.inf)
        for place, axis in enumerate(self.system.moving):
            points[axis] = points[axis] + at[place]
            if axis in self.walls:
                low, high = self.grid.bounds[axis]
                distance[axis, 0] = np.abs(points[axis] - low) / self.grid.spacing[axis]
                distance[axis, 1] = np.abs(points[axis] - high) / self.grid.spacing[axis]
        # In a corner, and along a wall, the nearest wall may be one that the path does not cross.
        distance[~crossed] = np.inf
        wall = np.argmin(distance.reshape(6, -1), axis=0)
        for axis in self.walls:
            for side in (0, 1):
                hit = wall == 2 * axis + side
                points[axis] = np.where(hit, self.grid.bounds[axis][side], points[axis])
        result[:, nodes] = at
        jets = dict(zip(self.system.jets, at, strict=True))
        return Exits(nodes, ages, tuple(points), wall // 2, wall % 2, jets)

    def _check(self, y: Array, index: NDArray[np.int64], tau: float) -> None:
        bad = ~np.isfinite(y).all(axis=0)
        if bad.any():
            node = int(index[np.argmax(bad)])
            raise NotFinite(
                f"velocity: the characteristic of {self._named(node)} is not finite at t = "
                f"{self.t_end - tau:.6g} (from t = {self.t_end:.6g} backward); the velocity or a "
                "derivative of it overflows or is undefined there"
            )
        for row, axis in zip(y, self.system.moving, strict=False):
            far = np.abs(row) > FEET.cells * self.grid.spacing[axis]
            if self.grid.periodic[axis] and far.any():
                node = int(index[np.argmax(far)])
                raise NotFinite(
                    f"velocity: the characteristic of {self._named(node)} goes more than "
                    f"{FEET.cells:.0e} cells from t = {self.t_end:.6g} back to t = "
                    f"{self.t_end - tau:.6g}, too far to tell places in a cell apart; take a "
                    "smaller dt"
                )


def check_step(dt: float, name: str = "dt") -> float:
    """The time step as a float; raises `InputError` unless it is positive and finite."""
    value = signed_step(dt, name)
    if value < 0.0:
        raise InputError(f"{name}: expected a positive, finite time, got {dt!r}")
    return value


def signed_step(dt: float, name: str = "dt") -> float:
    """The same for a step that may lead back in time."""
    value = real_number(f"{name}: expected a number other than zero", dt)
    if not np.isfinite(value) or value == 0.0:
        raise InputError(f"{name}: expected a finite time other than zero, got {dt!r}")
    return value
