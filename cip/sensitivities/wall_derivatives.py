r"""Derivatives of the moments that come from data on walls, with respect to parameters.

A path that begins on a wall is followed back over whole sub-steps and then over one of a length h
that ends on the wall: :math:`n \cdot X(p, h) = b`. So
:math:`h' = -(n \cdot X_p) / (n \cdot X_h)`, and place, time and derivatives of the path there
change by :math:`y_p + y_h h'`. Both derivatives are those of the Runge-Kutta steps themselves,
carried forward together with them; the moments follow from the formulas of `cip.stages.walls`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cip.characteristics.feet import Exits, time_scale
from cip.formulas.expression import COORDINATES, Expression, constant, variable
from cip.formulas.straight_line_code import numpy_function
from cip.stages.stage import Correction, Stage, StageFeet
from cip.stages.walls import MIDDLE, WallMoments

Array = np.ndarray[Any, np.dtype[np.float64]]
_SHIFT = (0.0, 0.5, 0.5, 1.0)
_WEIGHT = (1.0, 2.0, 2.0, 1.0)


def wall_derivatives(stage: Stage, feet: StageFeet) -> list[Correction]:
    """The derivatives of `Stage.corrections` in the stage's `wall_parameters`.

    Parameters
    ----------
    stage : Stage
    feet : StageFeet
        With the number of sub-steps that led to them.

    Returns
    -------
    list of Correction
        Their values have shape (parameters, places).
    """
    names = stage.wall_parameters
    if not feet.bounded or not names:
        return []
    wall, found = stage.wall_moments(feet.t_end), []
    for block, exits in zip(stage.blocks, feet.exits, strict=True):
        if exits is None:
            continue
        slopes = _exit_derivatives(stage, feet, block, exits)
        # Parameters that only the data hold do not move the paths.
        more = np.zeros((len(slopes), len(names) - slopes.shape[1], exits.nodes.size))
        slopes = np.concatenate([slopes, more], axis=1)
        count = len(names), exits.nodes.size
        flux = np.zeros(count) if stage.conservative else None
        values: Array = np.zeros((count[0], 0, count[1]))
        for axis, side in stage.walls:
            on = (exits.axis == axis) & (exits.side == side)
            if on.any():
                part = _Wall(stage, wall, axis, side, exits, feet, slopes, on)
                moments = part.moments()
                if not values.size:
                    values = np.zeros((count[0], len(moments), count[1]))
                values[..., on] = np.moveaxis(moments, 0, 1)
                if flux is not None:
                    flux[:, on] = part.flux()
        found += stage.placed(block, exits.nodes, values, flux)
    return found


def _along(node: Expression, names: Sequence[str]) -> Expression:
    """The derivative of a formula along changes ``d_name`` of these variables."""
    total = constant(0.0)
    for name in names:
        total = total + node.derivative(name) * variable(f"d_{name}")
    return total


class _Wall:
    """The paths that begin on one wall, with their derivatives `slopes` in the parameters."""

    def __init__(
        self, stage: Stage, wall: WallMoments, axis: int, side: int, exits: Exits,
        feet: StageFeet, slopes: Array, on: Any,
    ) -> None:  # fmt: skip
        self.system, self.wall, self.place = stage.system, wall, (axis, side)
        self.parameters = stage.wall_parameters
        self.feet, self.ages = feet, exits.ages[on]
        self.middle = 0.5 * (feet.t_start + feet.t_end)
        self.names = [*COORDINATES, *(jet.name for jet in self.system.jets)]
        self.point = [x[on] for x in exits.points]
        self.point += [np.zeros(())] * (3 - len(self.point))
        self.jets = [exits.jets[jet][on] for jet in self.system.jets]
        self.slopes = slopes[..., on]
        # Along the wall the place changes as the displacement; normal to it not at all.
        self.moves: list[Any] = [0.0, 0.0, 0.0]
        for q, s in enumerate(self.system.moving):
            if s != axis:
                self.moves[s] = self.slopes[q]

    def moments(self) -> Array:
        """Derivatives of the new moments, shape (moments, parameters, paths)."""
        nodes = self.wall.formulas(*self.place)
        function = self._directional(nodes)
        t = self.feet.t_end - self.ages
        moves = [*self.moves, self.slopes[-1], *self.slopes[:-1], *_units(len(self.parameters))]
        rows = function(*self.point, t, *self.jets, self.middle, *moves)
        return _rows(rows, self.slopes.shape[1:])

    def flux(self) -> Array:
        """Derivatives of the integral of the influx until each path begins."""
        node = self.wall.influx(*self.place)
        functions = self.wall.functions(*self.place, [node])
        rate = numpy_function([node], [*COORDINATES, MIDDLE], functions)
        slope = self._directional([node])
        start, d_end = self.feet.t_start, self.slopes[-1]
        length = (self.feet.t_end - self.ages) - start
        places, weights = np.polynomial.legendre.leggauss(8)
        total = np.zeros(d_end.shape)
        for place, weight in zip(places, weights, strict=True):
            part = 0.5 * (1.0 + place)
            t = start + part * length
            (value,) = rate(*self.point, t, self.middle)
            moves = [*self.moves, part * d_end, *self.slopes[:-1]]
            moves += _units(len(self.parameters))
            (change,) = slope(*self.point, t, *self.jets, self.middle, *moves)
            total += 0.5 * weight * (d_end * value + length * change)
        return total

    def _directional(self, nodes: list[Expression]) -> Any:
        moved = [*self.names, *self.parameters]
        changes = [_along(node, moved) for node in nodes]
        functions = self.wall.functions(*self.place, changes)
        arguments = [*self.names, MIDDLE, *(f"d_{name}" for name in moved)]
        return numpy_function(changes, arguments, functions)


def _exit_derivatives(stage: Stage, feet: StageFeet, block: int, exits: Exits) -> Array:
    """Derivatives in the parameters of the unknowns on the wall and, last, of the time there.

    Shape (unknowns + 1, parameters, paths).
    """
    system, length = stage.system, feet.t_end - feet.t_start
    base = [x.ravel()[exits.nodes] for x in stage.points(block)]
    run = _Steps(stage, base, feet.t_end)
    step = length / feet.substeps
    # The sub-step in which each path meets the wall; only its length depends on parameters.
    last = np.minimum((exits.ages / step).astype(np.int64), feet.substeps - 1)
    start = np.array([system.start(jet) for jet in system.jets])
    y = np.repeat(start[:, None], exits.nodes.size, axis=1)
    slopes = np.zeros((len(y), len(system.parameters) + 1, exits.nodes.size))
    for n in range(int(last.max()) + 1):
        own = np.clip(exits.ages - n * step, 0.0, step)
        change = np.zeros(slopes.shape[1:])
        change[-1] = last == n
        y, slopes = run.advance(y, slopes, n * step, own, change)
    normal = np.array([system.moving.index(int(axis)) for axis in exits.axis])
    across = slopes[normal, :, np.arange(normal.size)].T
    with np.errstate(all="ignore"):  # `State.require_finite` reports what is not finite
        own_change = np.where(across[:-1] == 0.0, 0.0, -across[:-1] / across[-1])
    found = slopes[:, :-1] + slopes[:, -1:] * own_change
    return np.concatenate([found, -own_change[None]])


class _Steps:
    """Runge-Kutta steps of own lengths, with the derivatives of their results carried forward."""

    def __init__(self, stage: Stage, base: list[Array], t_end: float) -> None:
        self.system, self.base, self.t_end = stage.system, base, t_end
        system, grid = stage.system, stage.grid
        exact = all(c.exact for c in stage.velocity)
        clock = 1.0 if exact else time_scale(grid, stage.velocity, t_end)
        steps = (*grid.spacing, *([1.0] * (3 - grid.dim)), clock)
        names = [*COORDINATES, *(jet.name for jet in system.jets)]
        moved = [*names, *system.parameters]
        changes = [_along(rate, moved) for rate in system.rates]
        functions: dict[str, Any] = {}
        for c in stage.velocity:
            functions.update(c.functions([*system.rates, *changes], steps))
        self.rates = numpy_function(system.rates, names, functions)
        self.changes = numpy_function(changes, [*names, *(f"d_{n}" for n in moved)], functions)

    def advance(
        self, y: Array, slopes: Array, tau: float, own: Array, change: Array
    ) -> tuple[Array, Array]:
        """The unknowns after steps of lengths `own`, whose derivatives are `change`."""
        k, dk = np.zeros_like(y), np.zeros_like(slopes)
        total, d_total = np.zeros_like(y), np.zeros_like(slopes)
        units = _units(len(self.system.parameters), 1)
        for shift, weight in zip(_SHIFT, _WEIGHT, strict=True):
            at = y + shift * own * k
            d_at = slopes + shift * (change * k[:, None] + own * dk)
            point, moves = self._point(at, d_at)
            t = self.t_end - tau - shift * own
            k = _rows(self.rates(*point, t, *at), y.shape[1:])
            dk = _rows(
                self.changes(*point, t, *at, *moves, -shift * change, *d_at, *units),
                slopes.shape[1:],
            )
            total, d_total = total + weight * k, d_total + weight * dk
        return y + own / 6.0 * total, slopes + (change * total[:, None] + own * d_total) / 6.0

    def _point(self, at: Array, d_at: Array) -> tuple[list[Any], list[Any]]:
        point: list[Any] = [*self.base, *([np.zeros(())] * (3 - len(self.base)))]
        moves: list[Any] = [0.0, 0.0, 0.0]
        for q, axis in enumerate(self.system.moving):
            point[axis], moves[axis] = self.base[axis] + at[q], d_at[q]
        return point, moves


def _units(count: int, more: int = 0) -> list[Array]:
    """The change of each parameter along all of them, with `more` rows in which none changes."""
    return list(np.eye(count, count + more)[:, :, None])


def _rows(values: Sequence[Any], shape: tuple[int, ...]) -> Array:
    found = np.empty((len(values), *shape))
    for row, value in zip(found, values, strict=True):
        row[:] = value
    return found
