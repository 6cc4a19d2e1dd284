"""B-splines on a box: functions with free coefficients, and formulas that are sums of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError
from cip.formulas.expression import Expression, constant, opaque, ordered
from cip.formulas.formula import Formula, Orders
from cip.formulas.parameters import parameter
from cip.grid import Grid

Array = NDArray[np.float64]
# Begins the names of basis functions in formulas. They do not tell whose basis it is: formulas of
# one shape share their graphs, and `SplineFormula.functions` knows the splines.
_NAME = "spline_"


class SplineBasis:
    """The tensor products of uniform B-splines on the box of a grid, periodic where it is.

    Parameters
    ----------
    grid : Grid
        Its box and periodic directions.
    pieces : tuple of int
        Number of polynomial pieces in each direction.
    degree : int

    Attributes
    ----------
    counts : tuple of int
        Number of functions in each direction: as many as pieces in periodic directions, `degree`
        more in others.
    """

    def __init__(self, grid: Grid, pieces: tuple[int, ...], degree: int) -> None:
        self.bounds, self.periodic = grid.bounds, grid.periodic
        self.pieces, self.degree = pieces, degree
        self.counts = tuple(
            n if periodic else n + degree for n, periodic in zip(pieces, self.periodic, strict=True)
        )
        # The points of the last call, and the values there by direction and order.
        self._last: tuple[tuple[Any, ...], dict[tuple[int, int], Array]] = ((None,) * 3, {})

    def __getstate__(self) -> dict[str, Any]:
        kept = {name: value for name, value in self.__dict__.items() if name != "_splines"}
        return {**kept, "_last": ((None,) * 3, {})}

    @property
    def size(self) -> int:
        """Number of functions."""
        return int(np.prod(self.counts))

    @cached_property
    def _splines(self) -> list[Any]:
        """All functions of each direction as one spline with an array as value."""
        from scipy.interpolate import BSpline

        found, k = [], self.degree
        for (low, high), n, count in zip(self.bounds, self.pieces, self.counts, strict=True):
            knots = low + (high - low) / n * (np.arange(n + 2 * k + 1) - k)
            one = np.eye(count)[np.arange(n + k) % count]  # equal coefficients a period apart
            found.append(BSpline(knots, one, k))
        return found

    def matrix(self, axis: int, order: int, x: Array) -> Array:
        """Derivatives of the functions of one direction at points, shape (points, functions)."""
        low, high = self.bounds[axis]
        if self.periodic[axis]:
            x = low + (x - low) % (high - low)
        return np.asarray(self._splines[axis](np.clip(x, low, high), nu=order))

    def function(self, number: int, orders: Orders) -> Callable[..., Any]:
        """A derivative of one of the functions, as a function of (x1, x2, x3, t).

        Values at the points of the last call are kept: an evaluation of a velocity calls all
        functions with the same arrays.
        """
        places = np.unravel_index(number, self.counts)
        wanted = [((axis, orders[axis]), int(q)) for axis, q in enumerate(places)]

        def values(x1: Any, x2: Any, x3: Any, t: Any) -> Any:
            known, rows = self._last
            if not (known[0] is x1 and known[1] is x2 and known[2] is x3):
                known, rows = (x1, x2, x3), {}
                self._last = known, rows
            found: Any = None
            for key, q in wanted:
                row = rows.get(key)
                if row is None:
                    x = np.asarray(known[key[0]], dtype=float)
                    matrix = np.ascontiguousarray(self.matrix(*key, x.ravel()).T)
                    row = rows[key] = matrix.reshape(-1, *x.shape)
                found = row[q] if found is None else found * row[q]
            return found

        return values

    def fit(self, values: Array, grid: Grid) -> Array:
        """Coefficients of the sum that is closest to nodal values on a grid, shape `counts`."""
        for axis, line in enumerate(grid.coordinates):
            matrix = self.matrix(axis, 0, line)
            flat = np.moveaxis(values, axis, 0)
            solved: Any = np.linalg.lstsq(matrix, flat.reshape(line.size, -1), rcond=None)[0]
            values = np.moveaxis(solved.reshape(-1, *flat.shape[1:]), 0, axis)
        return values


class SplineFormula(Formula):
    """A sum of basis functions (or of a derivative of them), each times a named parameter.

    Parameters
    ----------
    basis : SplineBasis
    names : sequence of str
        The parameter of each function.
    orders : tuple of int
        Orders of the derivative in x1, x2, x3, t.
    sign : float
    parameters : mapping
        Values by names.
    """

    def __init__(
        self,
        basis: SplineBasis,
        names: Sequence[str],
        orders: Orders,
        sign: float,
        parameters: Mapping[str, float],
    ) -> None:
        total: Expression = constant(0.0)
        for k, name in enumerate(names):
            total = total + parameter(name) * opaque(f"{_NAME}{k}", orders)
        super().__init__(constant(sign) * total, len(basis.counts), parameters=parameters)
        self.basis, self.names, self._shape = basis, tuple(names), (orders, sign)

    @property
    def exact(self) -> bool:
        """False: its functions are not compiled; their derivatives are exact."""
        return False

    def with_numbers(self, parameters: Mapping[str, float]) -> SplineFormula:
        """The same sum with other coefficients."""
        return SplineFormula(self.basis, self.names, *self._shape, parameters)

    def functions(self, nodes: Sequence[Expression], steps: Sequence[float]) -> dict[str, Any]:
        """The numbers of the parameters and the basis functions in `nodes`, by names in code."""
        found: dict[str, Any] = dict(self.numbers)
        for node in ordered(list(nodes)):
            if node.op == "opaque" and node.value[0].startswith(_NAME):
                name, orders = node.value
                label = f"{name}_{''.join(map(str, orders))}"
                found[label] = self.basis.function(int(name.removeprefix(_NAME)), orders)
        return found


def check_pieces(pieces: Any, grid: Grid, degree: int) -> tuple[int, ...]:
    """The argument `pieces` as a number for each direction."""
    try:
        found = np.atleast_1d(np.asarray(pieces))
    except ValueError as error:
        raise InputError(f"pieces: expected whole numbers, got {pieces!r}") from error
    if found.dtype.kind not in "iu" or found.shape not in ((1,), (grid.dim,)):
        raise InputError(
            f"pieces: expected a whole number, or one for each of {grid.dim} directions, got "
            f"{pieces!r}"
        )
    counts = np.broadcast_to(found, (grid.dim,))
    for axis, (n, cells, periodic) in enumerate(
        zip(counts, grid.cells, grid.periodic, strict=True)
    ):
        # Not more functions than nodes; a periodic function does not overlap itself.
        least, most = (degree + 1, cells) if periodic else (1, cells + 1 - degree)
        if not least <= n <= most:
            raise InputError(
                f"pieces: expected {least} to {most} in direction {'xyz'[axis]}, where the grid "
                f"has {cells} cells, got {n}"
            )
    return tuple(int(n) for n in counts)
