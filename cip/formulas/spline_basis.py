"""B-splines on a box: functions with free coefficients, and formulas that are sums of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from cip.errors import InputError
from cip.formulas.expression import Expression, Orders, constant, linear, ordered
from cip.formulas.formula import Formula
from cip.formulas.parameters import parameter
from cip.grid import Array, Grid
from skfem_adini.ground.arguments import real_array


class SplineBasis:
    """The tensor products of uniform B-splines on the box of a grid, periodic where it is, with
    `pieces` polynomials in each direction. `counts`, the functions in each direction, equals
    `pieces` if it is periodic, else `degree` more."""

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
            one = np.eye(count)[np.arange(n + k) % count]  # equal coefficients one period apart
            found.append(BSpline(knots, one, k))
        return found

    def matrix(self, axis: int, order: int, x: Array) -> Array:
        """Derivatives of the functions of one direction at points, shape (points, functions)."""
        low, high = self.bounds[axis]
        if self.periodic[axis]:
            x = low + (x - low) % (high - low)
        return np.asarray(self._splines[axis](np.clip(x, low, high), nu=order))

    def rows(self, point: tuple[Any, ...], axis: int, order: int) -> Array:
        """Derivatives of the functions of one direction, shape (functions, points). Values at the
        points of the last call are kept, as a velocity takes all derivatives at the same arrays."""
        known, rows = self._last
        if not all(one is other for one, other in zip(known, point, strict=True)):
            known, rows = point, {}
            self._last = known, rows
        if (axis, order) not in rows:
            x = np.asarray(known[axis], dtype=float).ravel()
            rows[axis, order] = np.ascontiguousarray(self.matrix(axis, order, x).T)
        return rows[axis, order]

    def function(self, number: int, orders: Orders) -> Callable[..., Any]:
        """A derivative of one of the functions, as a function of (x1, x2, x3, t)."""
        places = np.unravel_index(number, self.counts)

        def values(x1: Any, x2: Any, x3: Any, t: Any) -> Any:
            point = (x1, x2, x3)
            found: Any = 1.0
            for axis, q in enumerate(places):
                row = self.rows(point, axis, orders[axis])[q]
                found = found * row.reshape(np.shape(point[axis]))
            return found

        return values

    def sum(self, coefficients: Array, orders: Orders) -> Callable[..., Any]:
        """A derivative of the sum of all functions times coefficients of shape `counts`, as a
        function of (x1, x2, x3, t), whose arrays broadcast against each other."""
        last = len(self.counts) - 1

        def values(x1: Any, x2: Any, x3: Any, t: Any) -> Any:
            point = (x1, x2, x3)
            if len({np.shape(x) for x in point[: last + 1]}) > 1:
                point = (*np.broadcast_arrays(*point[: last + 1]), *point[last + 1 :])
            found: Any = coefficients @ self.rows(point, last, orders[last])
            for axis in range(last - 1, -1, -1):
                rows = self.rows(point, axis, orders[axis])
                found = np.einsum("...ip,ip->...p", found, rows)
            return found.reshape(np.shape(point[0]))

        return values

    def weighted(self, point: tuple[Any, ...], orders: Orders, weight: Array) -> Array:
        """The transpose of `sum`: for each function, shape (functions,), the sum over the points of
        its values times the weights."""
        axes = range(len(self.counts))
        first, *others = (self.rows(point, axis, orders[axis]) for axis in axes)
        found = first * np.ravel(weight)
        if not others:
            return np.asarray(found.sum(axis=1))
        for rows in others[:-1]:
            found = (found[:, None] * rows).reshape(-1, rows.shape[1])
        return np.asarray(found @ others[-1].T).ravel()

    def fit(self, values: Array, grid: Grid) -> Array:
        """Coefficients of the sum that is closest to nodal values on a grid, shape `counts`."""
        for axis, line in enumerate(grid.coordinates):
            matrix = self.matrix(axis, 0, line)
            flat = np.moveaxis(values, axis, 0)
            solved: Any = np.linalg.lstsq(matrix, flat.reshape(line.size, -1), rcond=None)[0]
            values = np.moveaxis(solved.reshape(-1, *flat.shape[1:]), 0, axis)
        return values


class SplineFormula(Formula):
    """A sum of basis functions, or of their derivative of `orders` in x1, x2, x3, t, each times a
    named parameter; `label` names the sum in formulas."""

    def __init__(
        self,
        basis: SplineBasis,
        names: Sequence[str],
        orders: Orders,
        sign: float,
        parameters: Mapping[str, float],
    ) -> None:
        # Begins the names of sums and (with a number) of functions in formulas. Formulas of one
        # shape share graphs; `functions` assigns the basis.
        self.label = f"splines_of_{names[0]}_"
        total = linear(self.label, orders, [parameter(name) for name in names])
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
            if node.op not in ("linear", "opaque") or not node.value[0].startswith(self.label):
                continue
            name, orders = node.value
            label = f"{name}_{''.join(map(str, orders))}"
            if node.op == "linear":
                own = np.array([self.numbers[one.value] for one in node.args], dtype=float)
                found[label] = self.basis.sum(own.reshape(self.basis.counts), orders)
            else:
                number = int(name.removeprefix(self.label))
                found[label] = self.basis.function(number, orders)
        return found


def check_pieces(pieces: Any, grid: Grid, degree: int) -> tuple[int, ...]:
    """The argument `pieces` as a number for each direction."""
    try:
        found = np.atleast_1d(real_array("pieces", pieces))
    except InputError as error:
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
