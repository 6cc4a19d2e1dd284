"""Derivatives and means of the spline through nodal values, as one matrix for each direction.

They are those that `State.from_function` takes of an array.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.grid import Grid
from cip.profiles.catalogue import moments

Array = NDArray[np.float64]
# In the place of the order of a derivative.
_MEAN = -1


class SplineDerivatives:
    """The moments of a field from its nodal values, and the transpose of that map.

    Parameters
    ----------
    grid : Grid
    profile : str
    """

    def __init__(self, grid: Grid, profile: str) -> None:
        wanted = moments(profile, grid.dim)
        self._orders = [
            tuple(
                _MEAN if axis in moment.averaged else moment.orders[axis]
                for axis in range(grid.dim)
            )
            for moment in wanted
        ]
        self.nodes, self.count = grid.nodes, len(wanted)
        needed = {(axis, n) for orders in self._orders for axis, n in enumerate(orders) if n}
        self._matrices = {key: _matrix(grid, *key) for key in needed}

    def moments(self, values: Array) -> Array:
        """The moments of nodal values, shape (moments,) + nodes."""
        return np.stack([self._one(values, orders, False) for orders in self._orders])

    def transposed(self, weights: Array) -> Array:
        """The transpose of `moments`, from shape (moments,) + nodes to nodes."""
        parts = [self._one(w, o, True) for w, o in zip(weights, self._orders, strict=True)]
        return np.asarray(sum(parts))

    def _one(self, values: Array, orders: tuple[int, ...], transposed: bool) -> Array:
        for axis, order in enumerate(orders):
            if order:
                matrix = self._matrices[axis, order]
                values = along(matrix.T if transposed else matrix, values, axis)
        return values


def along(matrix: Array, values: Array, axis: int) -> Array:
    """A matrix applied in one direction of an array."""
    return np.moveaxis(np.tensordot(matrix, values, axes=(1, axis)), 0, axis)


def _matrix(grid: Grid, axis: int, order: int) -> Array:
    """Columns: a derivative at the nodes of the spline that is 1 at one node and 0 at others.

    Or its means over the cells that begin at the nodes; where none begins, 0.
    """
    from scipy.interpolate import make_interp_spline

    n, periodic = grid.nodes[axis], grid.periodic[axis]
    ones: Any = np.eye(n)
    if periodic:
        ones = np.concatenate([ones, ones[:1]])
    degree = 5 if grid.cells[axis] >= 6 else 3
    spline = make_interp_spline(
        grid.edges[axis], ones, k=degree, bc_type="periodic" if periodic else None
    )
    if order != _MEAN:
        return np.asarray(spline(grid.coordinates[axis], nu=order))
    found = np.zeros((n, n))
    places, weights = np.polynomial.legendre.leggauss(4)  # exact to degree 7
    for place, weight in zip(places, weights, strict=True):
        inside = grid.edges[axis][:-1] + 0.5 * (1.0 + place) * grid.widths[axis]
        found[: grid.cells[axis]] += 0.5 * weight * spline(inside)
    return found
