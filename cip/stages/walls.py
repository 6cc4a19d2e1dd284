r"""Data on the walls: moments of nodes whose characteristic begins there.

Where the backward path of a node ends at the place b of a wall with the normal direction n at the
time t*, the field near (b, t*) has the tangential and time derivatives of the data g and, by the
equation itself, the normal one

.. math::
    u_n = -(g_t + c_s g_s [+ g \, \mathrm{div}\, c]) / c_n,

and so on for higher ones (the Cauchy-Kovalevskaya procedure). The moments at the node then follow
by the same chain rule as from an interior foot, with the derivatives of the path from (b, t*). In
one dimension this is u_x = -g'(t*) / c(x).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np

from cip.characteristics.feet import Exits
from cip.characteristics.flow_derivatives import ZERO, Composite, Jet
from cip.errors import InputError, NotSupported
from cip.formulas.expression import (
    COORDINATES,
    Expression,
    Orders,
    apply,
    derived,
    numpy_function,
    opaque,
    ordered,
    raised,
    variable,
    with_names,
)
from cip.formulas.formula import Formula, functions_of
from cip.formulas.source import Source
from cip.formulas.traced_function import portable, timed
from cip.grid import Array, Grid, wall_name

Wall = tuple[int, int]
_FIELD = "w"
GAUSS_TIMES = np.polynomial.legendre.leggauss(8)  # exact to degree 15
CLOSED = "closed"  # a wall that nothing passes
# Time variables of data changed by sources and decay or by other sweeps: those of the step.
CLOCKS = _BEGIN, MIDDLE, _END = "begin", "middle", "end"


def walls(boundary: Any, grid: Grid) -> dict[Wall, Formula]:
    """The data of each wall that has any, from the argument `boundary` of the solver. Keys are
    (axis, side), side 0 for the lower and 1 for the upper end."""
    if boundary is None:
        return {}
    known = {wall_name(*wall): wall for wall in product(range(grid.dim), (0, 1))}
    if not isinstance(boundary, Mapping):
        boundary = {name: boundary for name, (axis, _) in known.items() if not grid.periodic[axis]}
    found = {}
    for name, value in boundary.items():
        if name not in known:
            raise InputError(f"boundary: {name!r} is no wall; walls are {', '.join(known)}")
        axis, side = known[name]
        if grid.periodic[axis]:
            raise InputError(f"boundary: data for {name!r}, but the grid is periodic there")
        if value is None or (isinstance(value, str) and value in ("outflow", CLOSED)):
            continue
        found[axis, side] = _formula(value, grid, f"boundary {name!r}")
    return found


def closed_walls(boundary: Any, grid: Grid) -> list[Wall]:
    """The walls that the argument `boundary` of the solver closes; `walls` checks its names."""
    found = []
    for axis, side in product(range(grid.dim), (0, 1)):
        given = boundary.get(wall_name(axis, side)) if isinstance(boundary, Mapping) else boundary
        if not grid.periodic[axis] and isinstance(given, str) and given == CLOSED:
            found.append((axis, side))
    return found


def _formula(value: Any, grid: Grid, name: str) -> Formula:
    if not isinstance(value, Source):
        return Formula.of(timed(value), grid.bounds, name, time=True)
    if value.gridded:
        raise InputError(
            f"{name}: expected a number, a formula or a callable, got a Source made of arrays"
        )
    named = Source.of(value, name)
    assert named is not None
    return named.on(grid)


def portable_boundary(boundary: Any, grid: Grid) -> Any:
    """The argument `boundary` of the solver in a picklable form."""

    def part(value: Any) -> Any:
        if isinstance(value, Source) or (isinstance(value, str) and value in ("outflow", CLOSED)):
            return value

        def trace() -> dict[tuple[str, ...], Any]:
            formula = Formula.of(timed(value), grid.bounds, "boundary", time=True)
            names = (*COORDINATES[: grid.dim], "t")
            return {names: [formula.expression]} if formula.exact else {}

        return portable(value, "boundary", trace)

    if isinstance(boundary, Mapping):
        return {name: portable_boundary(value, grid) for name, value in boundary.items()}
    return part(boundary)


def check_split(data: Mapping[Wall, Formula], advect: bool, profile: str) -> None:
    """Refuse data with a splitting for a profile with slopes, unless exact for each sweep: slopes
    from data with an error of order dt^2 have one of order dt, and spoil the values in the end."""
    for (axis, side), formula in data.items():
        node = formula.expression
        zero = node.op == "constant" and node.value == 0.0
        # A number, possibly a function of parameters.
        number = all(one.op != "opaque" for one in ordered([node]))
        number = number and not node.variables() & {*COORDINATES}
        if not (zero if advect else number):
            needed = "zero" if advect else "constant"
            raise NotSupported(
                f"boundary: with splitting {profile!r} needs {needed} data on the wall "
                f"{wall_name(axis, side)}; take 'csl2' or 'csl4' with form='advection', or a "
                "direct profile ('adini', 'bicubic') for other data"
            )


class SplitData(Formula):
    r"""The data g of a wall as a sweep at the time t takes them. The step has applied the sweeps
    along other directions b, :math:`L_b g = -(c_b g)_b` or :math:`-c_b g_b`, up to the times
    :math:`t_b`, variables `clocks` by b; so the split flow has :math:`g + \sum_b (t_b - t) L_b g`
    there, up to an error of order dt^2. It is clipped to `bounds`, as it may leave those of g."""

    def __init__(
        self,
        data: Formula,
        velocity: Sequence[Formula],
        advect: bool,
        clocks: Mapping[int, str],
        bounds: tuple[float, float],
    ) -> None:
        self._data, g = data, data.expression
        node = g
        for b, clock in clocks.items():
            c, x = velocity[b].expression, COORDINATES[b]
            rate = (c * g).derivative(x) if advect else c * g.derivative(x)
            node = node - (variable(clock) - variable("t")) * rate
        for limit, sign in zip(bounds, (1.0, -1.0), strict=True):
            if node is not g and np.isfinite(limit):
                node = 0.5 * (node + limit + sign * apply("abs", node - limit))
        super().__init__(node, data.dim)

    def functions(self, nodes: Sequence[Expression], steps: Sequence[float]) -> dict[str, Any]:
        """The callables and numbers in `nodes` of the data; `WallMoments` knows the velocity's."""
        return self._data.functions(nodes, steps)


@dataclass(frozen=True)
class Spread:
    """Points across a sweep, over which data are averaged: `shifts` from each path's place on the
    wall, shape (points, 3, paths), and their weights."""

    shifts: Array
    weights: Array

    def mean(
        self, function: Any, point: Sequence[Array], on: Any, *more: Any, rank: int = 1
    ) -> list[Any]:
        """Averages of all results of function(x1, x2, x3, *more), arrays with `rank` axes, for the
        paths `on` at `point`."""
        shifts, each = self.shifts[..., on], (self.weights.size, *([1] * rank))
        shifts = shifts.reshape(*shifts.shape[:2], *([1] * (rank - 1)), -1)
        found = function(*(x + shifts[:, axis] for axis, x in enumerate(point)), *more)
        shapes = (np.broadcast_shapes(np.shape(value), each) for value in found)
        rows = (np.broadcast_to(value, shape) for value, shape in zip(found, shapes, strict=True))
        return [np.tensordot(self.weights, row, 1) for row in rows]


class WallMoments:
    """New moments, derivatives of `orders`, at the nodes whose characteristic begins on a wall.
    `steps` are spacings and a time, for difference quotients of functions known only by their
    values."""

    def __init__(
        self,
        grid: Grid,
        velocity: Sequence[Formula],
        moving: Sequence[int],
        advect: bool,
        data: Mapping[Wall, Formula],
        orders: Sequence[Orders],
        steps: Sequence[float],
    ) -> None:
        self._velocity, self._moving, self._advect = velocity, tuple(moving), advect
        self._data, self._steps = data, steps
        composite = Composite(moving, advect)
        self._outputs = [composite.moment(order) for order in orders]
        names = set().union(*(node.variables() for node in self._outputs))
        self._fields = sorted(name for name in names if name.startswith("f"))
        self._jets = sorted(name for name in names if name.startswith("j"))
        self._combine = numpy_function(self._outputs, [*self._fields, *self._jets])

    def values(
        self, exits: Exits, t_end: float, clocks: tuple[float, ...], spread: Spread
    ) -> Array:
        """One row for each moment, one column for each path that begins on a wall. `clocks` are
        the values of `CLOCKS`."""
        result = np.zeros((len(self._outputs), exits.nodes.size))
        for axis, side in self._data:
            on = (exits.axis == axis) & (exits.side == side)
            if not on.any():
                continue
            point = [x[on] for x in exits.points]
            point += [np.zeros(())] * (3 - len(point))
            jets = [exits.jets[Jet.named(name)][on] for name in self._jets]
            with np.errstate(all="ignore"):  # `State.require_finite` reports what is not finite
                wall, times = self._wall(axis, side), t_end - exits.ages[on]
                fields = spread.mean(wall, point, on, times, *clocks)
                for row, value in zip(result, self._combine(*fields, *jets), strict=True):
                    row[on] = value
        return result

    def flux(
        self, exits: Exits, t_start: float, t_end: float, clocks: tuple[float, ...], spread: Spread
    ) -> Array:
        """Signed integral of c g, normal velocity and data, from `t_start` until each path begins.
        The data are averaged, the velocity is that of the path, as in the interior."""
        result = np.zeros(exits.nodes.size)
        places, weights = GAUSS_TIMES
        for axis, side in self._data:
            on = (exits.axis == axis) & (exits.side == side)
            node = self._data[axis, side].expression
            if not on.any() or (node.op == "constant" and node.value == 0.0):
                continue
            length = (t_end - exits.ages[on]) - t_start
            point = [x[on] for x in exits.points]
            point += [np.zeros(())] * (3 - len(point))
            t = t_start + 0.5 * (1.0 + places[:, None]) * length
            c = self._velocity[axis].derivative(ZERO, self._steps)(*point, t)
            (g,) = spread.mean(self._on(axis, side, [node]), point, on, t, *clocks, rank=2)
            result[on] += 0.5 * length * np.tensordot(weights, c * g, 1)
        return result

    def formulas(self, axis: int, side: int) -> list[Expression]:
        """The moments from the data of a wall, in place and time on it, jets and parameters."""
        fields = self._fields_on(axis, side)
        table = {variable(name): node for name, node in zip(self._fields, fields, strict=True)}
        return with_names(self._outputs, table)

    def influx(self, axis: int, side: int) -> list[Expression]:
        """The normal velocity and the data, whose product enters through a wall per area."""
        return [self._velocity[axis].expression, self._data[axis, side].expression]

    def functions(self, axis: int, side: int, nodes: Sequence[Expression]) -> dict[str, Any]:
        """The callables and the numbers of parameters in these formulas, by names in code."""
        formulas = [self._data[axis, side], *self._velocity]
        return functions_of(formulas, nodes, self._steps)

    @lru_cache  # noqa: B019
    def _wall(self, axis: int, side: int) -> Any:
        nodes = self._fields_on(axis, side)
        return self._on(axis, side, nodes)

    def _on(self, axis: int, side: int, nodes: list[Expression]) -> Any:
        """Formulas on a wall as a function of x1, x2, x3, t and the times of the step."""
        functions = self.functions(axis, side, nodes)
        return numpy_function(nodes, (*COORDINATES, *CLOCKS), functions)

    def _fields_on(self, axis: int, side: int) -> list[Expression]:
        """The field and its derivatives on a wall, in the order of `_fields`."""
        nodes = []
        for name in self._fields:
            i, j, k = (int(digit) for digit in name[2:])
            nodes.append(self._on_wall(opaque(_FIELD, (i, j, k, 0)), axis, self._data[axis, side]))
        return nodes

    def _on_wall(self, node: Expression, axis: int, formula: Formula) -> Expression:
        """Replace derivatives of the field by those of the data on the wall."""
        while True:
            fields = [n for n in ordered([node]) if n.op == "opaque" and n.value[0] == _FIELD]
            if not fields:
                return node
            table = {}
            for field in fields:
                orders = field.value[1]
                if orders[axis] == 0:
                    table[field] = derived(formula.expression, orders)
                else:
                    table[field] = derived(self._normal(axis), raised(orders, axis, -1))
            (node,) = with_names([node], table)

    def _normal(self, axis: int) -> Expression:
        field = opaque(_FIELD, ZERO)
        rate = field.derivative("t")
        for s in self._moving:
            name = COORDINATES[s]
            c = self._velocity[s].expression
            if s != axis:
                rate = rate + c * field.derivative(name)
            if self._advect:
                rate = rate + c.derivative(name) * field
        return -rate / self._velocity[axis].expression
