r"""Derivatives of the moments that come from data on walls, with respect to parameters.

A path that begins on a wall is followed back over whole sub-steps and then over one of a length h
that ends on the wall: :math:`n \cdot X(p, h) = b`. So
:math:`h' = -(n \cdot X_p) / (n \cdot X_h)`, and place, time and derivatives of the path there
change by :math:`y_p + y_h h'`. Both derivatives are those of the Runge-Kutta steps themselves,
carried forward together with them; the moments follow from the formulas of `cip.stages.walls`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from cip.characteristics.feet import Exits, functions_at
from cip.engines.path_kernel import PATH
from cip.formulas.expression import (
    COORDINATES,
    Expression,
    constant,
    numpy_function,
    rows_of,
    variable,
)
from cip.grid import Array
from cip.stages.stage import Correction, Stage, StageFeet
from cip.stages.walls import CLOCKS, GAUSS_TIMES, Spread, WallMoments


class WallDerivatives:
    """The derivatives of `Stage.corrections` in the stage's `wall_parameters`. Their formulas are
    derived once for each wall and serve all steps."""

    def __init__(self, stage: Stage) -> None:
        self._stage, self._steps = stage, _Steps(stage)
        self._walls: dict[tuple[int, int], _Wall] = {}

    def of(self, feet: StageFeet) -> list[Correction]:
        """The corrections' derivatives of a step, with values of shape (parameters, places); the
        feet have their numbers of sub-steps."""
        stage, found = self._stage, list[Correction]()
        if not feet.bounded or not stage.wall_parameters:
            return []
        for block, exits, count in zip(stage.blocks, feet.exits, feet.substeps, strict=True):
            if exits is not None:
                slopes = self._steps.exit_derivatives(feet, block, exits, count)
                found += self._placed(feet, block, exits, slopes)
        return found

    def _placed(self, feet: StageFeet, block: int, exits: Exits, slopes: Array) -> list[Correction]:
        """The derivatives of the moments that paths of a block of feet transport from all walls."""
        stage, shape = self._stage, (len(self._stage.wall_parameters), exits.nodes.size)
        # Parameters that occur only in the data do not move the paths.
        more = np.zeros((len(slopes), shape[0] - slopes.shape[1], shape[1]))
        slopes = np.concatenate([slopes, more], axis=1)
        flux = np.zeros(shape) if stage.conservative else None
        values: Array = np.zeros((shape[0], 0, shape[1]))
        for axis, side in stage.walls:
            on = (exits.axis == axis) & (exits.side == side)
            if not on.any():
                continue
            wall = self._wall(axis, side, feet.t_end)
            paths = _Paths(stage, block, axis, exits, feet, slopes, on)
            moments = wall.moments(paths)
            if not values.size:
                values = np.zeros((shape[0], len(moments), shape[1]))
            values[..., on] = np.moveaxis(moments, 0, 1)
            if flux is not None:
                flux[:, on] = wall.flux(paths)
        return stage.placed(block, exits.nodes, values, flux)

    def _wall(self, axis: int, side: int, t: float) -> _Wall:
        if (axis, side) not in self._walls:
            wall = self._stage.wall_moments(t)
            self._walls[axis, side] = _Wall(self._stage, wall, axis, side)
        return self._walls[axis, side]


def _along(node: Expression, names: Sequence[str]) -> Expression:
    """The derivative of a formula along changes ``d_name`` of these variables."""
    total = constant(0.0)
    for name in names:
        total = total + node.derivative(name) * variable(f"d_{name}")
    return total


class _Paths:
    """The paths of a step that begin on one wall, with their derivatives `slopes`."""

    def __init__(
        self, stage: Stage, block: int, axis: int, exits: Exits, feet: StageFeet, slopes: Array,
        on: Any,
    ) -> None:  # fmt: skip
        system, nodes = stage.system, exits.nodes[on]
        self.feet, self.ages = feet, exits.ages[on]
        self.clocks, self.spread = stage.clocks(feet), stage.spread(block, nodes)
        self.here = stage.spread(0, nodes)
        self.point = [x[on] for x in exits.points]
        self.point += [np.zeros(())] * (3 - len(self.point))
        self.jets = [exits.jets[jet][on] for jet in system.jets]
        self.slopes = slopes[..., on]
        # Along the wall the place changes as the displacement; normal to it not at all.
        self.moves: list[Any] = [0.0, 0.0, 0.0]
        for q, s in enumerate(system.moving):
            if s != axis:
                self.moves[s] = self.slopes[q]

    def along(self, function: Any, spread: Spread, t: Any, d_time: Any) -> Sequence[Any]:
        """Evaluate a function from `_Wall.directional` at time t, which changes by `d_time`."""
        units = _units(self.slopes.shape[1])
        moves = [*self.moves, d_time, *self.slopes[:-1], *units]
        more = (t, *self.jets, *self.clocks, *moves)
        return spread.mean(function, self.point, slice(None), *more, rank=2)


class _Wall:
    """The derived formulas of the inflow through one wall."""

    def __init__(self, stage: Stage, wall: WallMoments, axis: int, side: int) -> None:
        self._wall, self._place = wall, (axis, side)
        self._parameters = stage.wall_parameters
        self._names = [*COORDINATES, *(jet.name for jet in stage.system.jets)]

    def moments(self, paths: _Paths) -> Array:
        """Derivatives of the new moments, shape (moments, parameters, paths)."""
        t = paths.feet.t_end - paths.ages
        rows = paths.along(self._moments, paths.spread, t, paths.slopes[-1])
        return rows_of(rows, paths.slopes.shape[1:])

    def flux(self, paths: _Paths) -> Array:
        """Derivatives of the integral of the influx until each path begins."""
        start, d_end = paths.feet.t_start, paths.slopes[-1]
        length = (paths.feet.t_end - paths.ages) - start
        places, weights = GAUSS_TIMES
        total = np.zeros(d_end.shape)
        for place, weight in zip(places, weights, strict=True):
            part = 0.5 * (1.0 + place)
            t = start + part * length
            # Normal velocity of the path and data, averaged: values and changes.
            ends, spreads = [], (paths.here, paths.spread)
            for (rate, slope), spread in zip(self._influx, spreads, strict=True):
                ends += spread.mean(rate, paths.point, slice(None), t, *paths.clocks)
                ends += paths.along(slope, spread, t, part * d_end)
            c, d_c, g, d_g = ends
            total += 0.5 * weight * (d_end * c * g + length * (c * d_g + d_c * g))
        return total

    @cached_property
    def _moments(self) -> Any:
        return self._directional(self._wall.formulas(*self._place))

    @cached_property
    def _influx(self) -> list[tuple[Any, Any]]:
        found = []
        for node in self._wall.influx(*self._place):
            functions = self._wall.functions(*self._place, [node])
            rate = numpy_function([node], [*COORDINATES, *CLOCKS], functions)
            found.append((rate, self._directional([node])))
        return found

    def _directional(self, nodes: list[Expression]) -> Any:
        moved = [*self._names, *self._parameters]
        changes = [_along(node, moved) for node in nodes]
        functions = self._wall.functions(*self._place, changes)
        arguments = [*self._names, *CLOCKS, *(f"d_{name}" for name in moved)]
        return numpy_function(changes, arguments, functions)


class _Steps:
    """Runge-Kutta steps with a length for each path, and the derivatives of their results."""

    def __init__(self, stage: Stage) -> None:
        self.stage, self.system = stage, stage.system
        names = [*COORDINATES, *(jet.name for jet in stage.system.jets)]
        moved = [*names, *stage.system.parameters]
        self._changes = [_along(rate, moved) for rate in stage.system.rates]
        self._arguments = names, [*names, *(f"d_{name}" for name in moved)]
        self._exact = all(c.exact for c in stage.velocity)
        self._functions: tuple[Any, Any] | None = None

    def _rates(self, t: float) -> tuple[Any, Any]:
        """The rates and their changes; steps of difference quotients depend on the time t."""
        if self._functions is None or not self._exact:
            rates, changes = self.system.rates, self._changes
            nodes, (names, more) = [*rates, *changes], self._arguments
            functions = functions_at(self.stage.grid, self.stage.velocity, nodes, t)
            self._functions = (
                numpy_function(rates, names, functions),
                numpy_function(changes, more, functions),
            )
        return self._functions

    def exit_derivatives(self, feet: StageFeet, block: int, exits: Exits, substeps: int) -> Array:
        """Derivatives in the parameters of the unknowns on the wall and, last, of the time there,
        shape (unknowns + 1, parameters, paths)."""
        system, length = self.system, feet.t_end - feet.t_start
        base = [x.ravel()[exits.nodes] for x in self.stage.points(block)]
        functions, step = self._rates(feet.t_end), length / substeps
        # The sub-step in which each path meets the wall; only its length depends on parameters.
        last = np.minimum((exits.ages / step).astype(np.int64), substeps - 1)
        start = np.array([system.start(jet) for jet in system.jets])
        y = np.repeat(start[:, None], exits.nodes.size, axis=1)
        slopes = np.zeros((len(y), len(system.parameters) + 1, exits.nodes.size))
        for n in range(int(last.max()) + 1):
            own = np.clip(exits.ages - n * step, 0.0, step)
            change = np.zeros(slopes.shape[1:])
            change[-1] = last == n
            y, slopes = self._advance(
                functions, base, y, slopes, feet.t_end - n * step, own, change
            )
        normal = np.array([system.moving.index(int(axis)) for axis in exits.axis])
        across = slopes[normal, :, np.arange(normal.size)].T
        with np.errstate(all="ignore"):  # `State.require_finite` reports what is not finite
            own_change = np.where(across[:-1] == 0.0, 0.0, -across[:-1] / across[-1])
        found = slopes[:, :-1] + slopes[:, -1:] * own_change
        return np.concatenate([found, -own_change[None]])

    def _advance(
        self, functions: tuple[Any, Any], base: list[Array], y: Array, slopes: Array, begin: float,
        own: Array, change: Array,
    ) -> tuple[Array, Array]:  # fmt: skip
        """The unknowns after steps back from `begin` of lengths `own`, which change by `change`."""
        rates, changes = functions
        k, dk = np.zeros_like(y), np.zeros_like(slopes)
        total, d_total = np.zeros_like(y), np.zeros_like(slopes)
        units = _units(len(self.system.parameters), 1)
        for shift, weight in zip(PATH.shift, PATH.weight, strict=True):
            at = y + shift * own * k
            d_at = slopes + shift * (change * k[:, None] + own * dk)
            point, moves = self._point(base, at, d_at)
            t = begin - shift * own
            k = rows_of(rates(*point, t, *at), y.shape[1:])
            moved = changes(*point, t, *at, *moves, -shift * change, *d_at, *units)
            dk = rows_of(moved, slopes.shape[1:])
            total, d_total = total + weight * k, d_total + weight * dk
        return y + own / 6.0 * total, slopes + (change * total[:, None] + own * d_total) / 6.0

    def _point(self, base: list[Array], at: Array, d_at: Array) -> tuple[list[Any], list[Any]]:
        point: list[Any] = [*base, *([np.zeros(())] * (3 - len(base)))]
        moves: list[Any] = [0.0, 0.0, 0.0]
        for q, axis in enumerate(self.system.moving):
            point[axis], moves[axis] = base[axis] + at[q], d_at[q]
        return point, moves


def _units(count: int, more: int = 0) -> list[Array]:
    """The unit vectors of the parameters, each followed by `more` zeros."""
    return list(np.eye(count, count + more)[:, :, None])
