"""Whether a velocity is periodic where its grid is: the same on opposite sides of the box."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from cip.errors import InputError, PeriodicityWarning
from cip.formulas.expression import COORDINATES
from cip.formulas.formula import Formula
from cip.formulas.snapshots import SnapshotFormula
from cip.formulas.spline_basis import SplineFormula
from cip.grid import AXES, Array, Grid

# Jumps relative to the largest value in the box: below the first, rounding (of difference quotients
# too); above the second, the field is not periodic.
_ROUNDING, _JUMP = 1e-6, 1e-3
_KINK = 1e-3
# Arbitrary numbers, no zeros or periods of usual functions (roots of 1/7, 2 and 11).
_CLOCKS = (0.3779644730092272, 1.4142135623730951, 3.3166247903554)
# About so many points on a side, at uneven places along it, so that narrow streams are seen.
_NODES = 256
_PLACES = (np.sqrt(2.0) * np.arange(1, 8) + 0.17) % 1.0


def check_periodic(velocity: Sequence[Formula], grid: Grid) -> None:
    """Raise `InputError` if a velocity jumps between opposite sides of a periodic direction. Warn
    of a small jump, or of one of the derivative across the side.
    """
    for axis in range(grid.dim):
        if not grid.periodic[axis]:
            continue
        for q, formula in enumerate(velocity):
            if isinstance(formula, SplineFormula):  # its basis is periodic where the grid is
                continue
            if COORDINATES[axis] in formula.expression.variables():
                _compare(formula, f"c{q + 1}", grid, axis)


def _clocks(formula: Formula) -> Sequence[float]:
    if isinstance(formula, SnapshotFormula):
        return tuple(float(t) for t in np.quantile(formula.field.times, (0.0, 0.4, 1.0)))
    return _CLOCKS[:1] if formula.exact and formula.steady else _CLOCKS


def _compare(formula: Formula, name: str, grid: Grid, axis: int) -> None:
    """The values on both sides, and the derivatives across them."""
    low, high = grid.bounds[axis]
    lines = [a + (b - a) * _PLACES for a, b in grid.bounds]
    most = _NODES if grid.dim == 2 else int(_NODES**0.5)
    for q, x in enumerate(grid.coordinates):
        more = (low, high) if q == axis else x[:: -(-x.size // most)]
        lines[q] = np.sort([*lines[q], *more])
    points = np.meshgrid(*lines, indexing="ij")
    for clock in _clocks(formula):
        floor = 0.0
        for order, allowed in ((0, _ROUNDING), (1, _KINK)):
            try:
                values = np.moveaxis(_values(formula, order, axis, grid, points, clock), axis, 0)
            except InputError:  # a callable that is not defined on the sides themselves
                return
            if not np.isfinite(values).all():
                break
            jump, size = np.abs(values[-1] - values[0]), float(np.abs(values).max())
            worst = np.unravel_index(int(np.argmax(jump)), jump.shape)
            if jump[worst] > max(allowed * size, floor):  # a narrow field lies between the places
                inside = _values(formula, order, axis, grid, grid.mesh(), clock)
                size = float(np.max(np.abs(inside), where=np.isfinite(inside), initial=size))
            if jump[worst] <= max(allowed * size, floor):
                # Difference quotients of a velocity that hardly varies are rounding themselves.
                floor = _ROUNDING * size / (high - low)
                continue
            places = [np.moveaxis(x, axis, 0)[(0, *worst)] for x in points]
            ends = values[(0, *worst)], values[(-1, *worst)]
            text = _text(name, axis, order, places, ends, high)
            if order == 0 and jump[worst] > _JUMP * size:
                raise InputError(f"{text}; {_remedy(grid, axis)}")
            warnings.warn(
                f"{text}, and the field is less accurate near there; {_remedy(grid, axis)}",
                PeriodicityWarning,
                stacklevel=4,
            )
            return


def _values(
    formula: Formula, order: int, axis: int, grid: Grid, points: Sequence[Array], clock: float
) -> Array:
    """The velocity, or its derivative in the direction of an axis, at points of the box."""
    i, j, k = (order * (axis == q) for q in range(3))
    steps = (*grid.spacing, *([1.0] * (4 - grid.dim)))
    point = [*points, *([np.zeros(())] * (3 - grid.dim))]
    found = formula.derivative((i, j, k, 0), steps)(*point, clock)
    return np.broadcast_to(found, points[0].shape)


def _remedy(grid: Grid, axis: int) -> str:
    flags = tuple(periodic and q != axis for q, periodic in enumerate(grid.periodic))
    given = flags if any(flags) else False
    return (
        f"pass a velocity with the period of the box, or make the grid not periodic in "
        f"{AXES[axis]} (periodic={given}) and pass the solver data for what then comes in through "
        f"the walls (boundary=0.0, or a dict with '{AXES[axis]}-' and '{AXES[axis]}+')"
    )


def _text(
    name: str, axis: int, order: int, places: Any, ends: tuple[float, float], high: float
) -> str:
    what = f"the derivative of {name} across the side" if order else name
    at = ", ".join(f"{x:.6g}" for x in places)
    return (
        f"velocity: {what} is not periodic in {AXES[axis]}, as the grid is: {ends[0]:.6g} at "
        f"({at}), {ends[1]:.6g} at {AXES[axis]} = {high:.6g}"
    )
