"""Reactions between the fields of a state, as a part of a step like sources and decay.

At each place the values obey u' = R(u, x, t), their derivatives what the chain rule makes of it,
and means follow from values at nodes and in the middle of cells by the rules of `Products`. The
classical Runge-Kutta method keeps linear invariants of R, so also their integrals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cip.errors import InputError, NotConverged
from cip.formulas.expression import COORDINATES, Expression, constant, numpy_function, variable
from cip.formulas.parameters import checked, parameter
from cip.formulas.parsing import parse
from cip.grid import GridLike, places_of
from cip.profiles.catalogue import moments
from cip.sources.reaction import Products

TOLERANCE = 1e-9  # of a half step, relative to the largest value of a field or of a derivative
SUBSTEPS = 4096  # of a half step, at most
Orders = tuple[int, ...]


class Kinetics:
    """The rates of change of the fields of a state, formulas by name in the fields, the coordinates
    and t; fields without one do not react."""

    def __init__(
        self,
        grid: GridLike,
        profile: str,
        fields: Sequence[str],
        rates: Mapping[str, Any],
        xp: Any,
    ) -> None:
        self._xp, self._fields = xp, tuple(fields)
        self._products = Products(grid, profile, xp)
        nodes = [
            parse(str(rates.get(name, 0.0)), f"reactions: {name!r}", fields) for name in fields
        ]
        carried = moments(profile, grid.dim)
        # Rows of values and derivatives at nodes belong together, one in middles of cells alone.
        together = [q for q, moment in enumerate(carried) if not moment.averaged]
        alone = [[q] for q, moment in enumerate(carried) if moment.averaged]
        groups = [together, *alone] if together else alone
        self._parts = []
        for rows in groups:
            orders = [carried[q].orders[:3] for q in rows]
            lines = places_of(grid, carried[rows[0]].averaged)
            mesh = np.meshgrid(*lines, indexing="ij", sparse=True)
            point = [xp.asarray(x) for x in mesh] + [0.0] * (3 - grid.dim)
            self._parts.append((rows, point, self._rates(nodes, orders)))

    def _rates(self, nodes: Sequence[Expression], orders: Sequence[Orders]) -> Any:
        """The rates of all fields' derivatives of these orders as one function of x1, x2, x3, t and
        these derivatives."""

        def name(field: str, order: Orders) -> str:
            value = str(parameter(field).value)
            return f"{value}__{''.join(map(str, order))}" if any(order) else value

        def total(node: Expression, axis: int) -> Expression:
            found = node.derivative(COORDINATES[axis])
            for field in self._fields:
                for order in orders:
                    slope = node.derivative(name(field, order))
                    if slope.op != "constant" or slope.value != 0.0:
                        above = tuple(k + (q == axis) for q, k in enumerate(order))
                        found = found + slope * variable(name(field, above))
            return found

        outputs = []
        for node in nodes:
            known: dict[Orders, Expression] = {(0, 0, 0): node}
            for order in orders:
                if order not in known:
                    axis = max(q for q in range(3) if order[q])
                    below = tuple(k - (q == axis) for q, k in enumerate(order))
                    known[order] = total(known[below], axis)
                outputs.append(known[order] + constant(0.0))
        names = [name(field, order) for field in self._fields for order in orders]
        return numpy_function(outputs, [*COORDINATES, *names])

    def applied(self, data: Any, t: float, length: float, sea: Any = None) -> Any:
        """The moments of all fields, shape (fields, moments, *nodes), after a time; 0 but at sea,
        if a mask of moments is given."""
        points = self._xp.stack([self._products.to_points(field) for field in data])
        for rows, point, rates in self._parts:
            points[:, rows] = self._integrated(points[:, rows], point, rates, t, length)
        found = [self._products.to_moments(field) for field in points]
        made = self._xp.stack(found).astype(data.dtype)
        return made if sea is None else made * sea

    def _integrated(self, y: Any, point: list[Any], rates: Any, t: float, length: float) -> Any:
        """Values after a time, by as many steps as their error asks for."""
        xp, shape = self._xp, y.shape
        flat = y.reshape(-1, *shape[2:])

        def f(s: float, z: Any) -> Any:
            out = xp.empty_like(z)
            for row, rate in zip(out, rates(*point, s, *z), strict=True):
                row[...] = rate
            return out

        def steps(count: int) -> Any:
            z, h = flat, length / count
            for n in range(count):
                s = t + n * h
                k1 = f(s, z)
                k2 = f(s + 0.5 * h, z + 0.5 * h * k1)
                k3 = f(s + 0.5 * h, z + 0.5 * h * k2)
                z = z + h / 6.0 * (k1 + 2.0 * (k2 + k3) + f(s + h, z + h * k3))
            return z

        axes = tuple(range(1, flat.ndim))
        count, coarse = 1, None
        with np.errstate(all="ignore"):  # what is not finite is no convergence
            while count <= SUBSTEPS:
                fine = steps(count)
                if coarse is not None:
                    size = abs(fine).max(axis=axes)
                    # Richardson: the finer result is 15 times nearer than they differ.
                    if bool((abs(fine - coarse).max(axis=axes) <= 15.0 * TOLERANCE * size).all()):
                        return fine.reshape(shape)
                coarse, count = fine, 2 * count
        raise NotConverged(
            f"reactions: not resolved by {SUBSTEPS} sub-steps in {length:.3g} from t = {t:.6g}; "
            "rates that are this stiff or not finite (a root of a negative value), or a field that "
            "grows without bound: take a smaller dt, or other rates"
        )


def kinetics(
    grid: GridLike, profile: str, fields: Sequence[str], value: Any, xp: Any
) -> Kinetics | None:
    """The reactions of a solver for a state of these fields, from its argument; None without."""
    if value is None:
        return None
    if not isinstance(value, Mapping) or not value:
        raise InputError(f"reactions: expected formulas by names of fields, got {value!r}")
    unknown = [name for name in value if name not in fields]
    if unknown:
        known = ", ".join(fields) or "one without a name"
        raise InputError(f"reactions: {unknown[0]!r} is no field of the state, which has {known}")
    checked(dict.fromkeys(fields, 0.0))
    return Kinetics(grid, profile, fields, value, xp)
