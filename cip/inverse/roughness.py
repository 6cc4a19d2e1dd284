r"""Seminorms of the velocity that penalise its changes in space, and values of it at nodes.

The sum over components of :math:`\int |\nabla c|^2` (H1) or :math:`\int |\nabla^2 c|^2` (H2), by
the weights of the grid. A constant velocity costs nothing, unlike in the L2 norm, which draws every
velocity to zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.formulas.expression import COORDINATES, Expression
from cip.formulas.parameters import parameter
from cip.formulas.velocity import Velocity
from cip.grid import Grid

Array = NDArray[np.float64]
ORDERS = {"H1": 1, "H2": 2}


class Roughness:
    """The rows whose sum of squares is the seminorm of `kind` ("H1", "H2", or None: no rows) of the
    velocity at time `t`; their parameters are `names`.
    """

    def __init__(self, grid: Grid, kind: str | None, names: Sequence[str], t: float) -> None:
        self._grid, self._names, self._t = grid, names, t
        self._order = ORDERS.get(kind or "", 0)
        self._constant: Array | None = None

    def rows(self, velocity: Velocity) -> Array:
        """Values of the rows."""
        return np.concatenate([np.zeros(0), *(f(None) for f in self._parts(velocity))])

    def slopes(self, velocity: Velocity) -> Array:
        """Derivatives of the rows in the parameters, shape (rows, parameters)."""
        if self._constant is not None:
            return self._constant
        parts = self._parts(velocity)
        found = np.zeros((0, len(self._names)))
        if parts:
            columns = [np.concatenate([f(name) for f in parts]) for name in self._names]
            found = np.stack(columns, axis=1)
        if all(part.linear for part in parts):
            self._constant = found
        return found

    def _parts(self, velocity: Velocity) -> list[Part]:
        if not self._order:
            return []
        weight = np.sqrt(self._grid.weights)
        axes = list(product(range(self._grid.dim), repeat=self._order))
        return [
            Part(formula, one, self._grid, self._t, weight)
            for formula in velocity.on(self._grid)
            for one in axes
        ]


class Part:
    """A derivative of a component in the directions `axes` at the nodes, times a weight."""

    def __init__(
        self, formula: Any, axes: Sequence[int], grid: Grid, t: float, weight: Any = 1.0
    ) -> None:
        node: Expression = formula.expression
        for axis in axes:
            node = node.derivative(COORDINATES[axis])
        self._node, self._formula, self._weight = node, formula, weight
        self._steps = (*grid.spacing, *([1.0] * (4 - grid.dim)))
        self._point = [*grid.mesh(), *([np.zeros(())] * (3 - grid.dim)), np.asarray(t)]

    @property
    def linear(self) -> bool:
        """Whether its derivatives in the parameters do not depend on them."""
        names = {name for name in self._node.variables() if name not in COORDINATES}
        slopes = [self._node.derivative(name) for name in names]
        return not any(slope.variables() & names for slope in slopes)

    def __call__(self, name: str | None = None) -> Array:
        """The values, or their derivative in the parameter of this name; flat."""
        node = self._node if name is None else self._node.derivative(parameter(name).value)
        values = self._formula.evaluator(node, self._steps)(*self._point)
        return np.asarray(self._weight * values).ravel()


def field(velocity: Velocity, grid: Grid, t: float) -> Array:
    """The components at the nodes, shape (components, nodes)."""
    return np.stack([Part(formula, (), grid, t)() for formula in velocity.on(grid)])


def field_slopes(velocity: Velocity, grid: Grid, t: float, names: Sequence[str]) -> Array:
    """Derivatives of the components in the parameters, shape (parameters, components, nodes)."""
    parts = [Part(formula, (), grid, t) for formula in velocity.on(grid)]
    return np.stack([np.stack([part(name) for part in parts]) for name in names])
