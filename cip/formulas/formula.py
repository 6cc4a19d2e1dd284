"""Scalar functions of space and time with their derivatives, from text, callables or arrays."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError
from cip.formulas.expression import (
    COORDINATES,
    Expression,
    Orders,
    derived,
    numpy_function,
    opaque,
    ordered,
    raised,
    traced,
)
from cip.formulas.parameters import bound
from cip.formulas.parsing import parse
from cip.formulas.sphere_spline import at_places
from cip.grid import Array, Grid, GridLike, Sphere
from skfem_adini.ground.arguments import real_array, real_number

# Time at which callables are tested: 1 / sqrt(7), neither zero nor a period of usual functions.
CLOCK = 0.3779644730092272


class Formula:
    """A function f(x1, .., t) with exact derivatives if its formula is known, else differences.
    `expression` may be an opaque node that stands for `known`: callables of (x1, .., t) by orders,
    (0, 0, 0, 0) for the value. `parameters` are values by names."""

    def __init__(
        self,
        expression: Expression,
        dim: int,
        known: dict[Orders, Callable[..., Any]] | None = None,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        self.expression, self.dim, self.known = expression, dim, known or {}
        self.numbers = bound(parameters or {})

    @classmethod
    def of(
        cls,
        value: Any,
        box: Box,
        name: str,
        time: bool = False,
        sparse: bool = False,
        parameters: Mapping[str, float] | None = None,
    ) -> Formula:
        """A formula from a number, a text with `parameters`, or a callable of the coordinates (and
        of t, if `time`), defined on `box`. It is tested with flat arrays or, if `sparse`, with one
        array for each direction, which broadcast."""
        dim = len(box)
        names = [*COORDINATES[:dim], *(["t"] if time else [])]
        if isinstance(value, str):
            expression = parse(value, name, parameters or ())
        elif callable(value):
            expression = traced(value, names)  # type: ignore[assignment]
            if expression is None or not agree([expression], value, box, time):
                formula = cls.by_values(value, dim, name, time)
                formula.check_pointwise(box, name, time, sparse)
                return formula
        else:
            kinds = f"{name}: expected a number, a text or a callable"
            expression = parse(repr(real_number(kinds, value)), name)
        if beyond := expression.variables() & {*COORDINATES[dim:3]}:
            raise InputError(f"{name}: {sorted(beyond)} occur, but the grid has {dim} directions")
        return cls(expression, dim, parameters=parameters)

    @classmethod
    def by_values(
        cls,
        function: Callable[..., Any],
        dim: int,
        name: str,
        time: bool = False,
        derivatives: dict[Orders, Callable[..., Any]] | None = None,
        hint: str = "",
    ) -> Formula:
        """A formula from a callable that is known only by its values (and some derivatives)."""
        arguments = ", ".join([*COORDINATES[:dim], *(["t"] if time else [])])

        def checked(original: Callable[..., Any]) -> Callable[..., Any]:
            def values(*point: Any) -> Array:
                point = (*point[:dim], *(point[3:] if time else ()))
                try:
                    with np.errstate(all="ignore"):
                        result = real_array(name, original(*point))
                except InputError:
                    raise
                except Exception as error:  # whatever a user's function raises
                    raise InputError(
                        f"{name}: called with the arrays {arguments} it raised "
                        f"{type(error).__name__}: {error}{hint}"
                    ) from error
                shape = np.broadcast_shapes(*(np.shape(x) for x in point))
                fits = result.ndim <= len(shape) and all(
                    n in (1, m) for n, m in zip(result.shape[::-1], shape[::-1], strict=False)
                )
                if result.dtype.kind not in "fiub" or not fits:
                    raise InputError(
                        f"{name}: called with the arrays {arguments} it must return real values "
                        f"of shape {shape}, got {result.dtype} of shape {result.shape}"
                    )
                return result.astype(float, copy=False)

            return values

        known = {(0, 0, 0, 0): checked(function)}
        known.update({orders: checked(given) for orders, given in (derivatives or {}).items()})
        return cls(opaque(_label(name, known), (0, 0, 0, 0)), dim, known)

    def check_pointwise(self, box: Box, name: str, time: bool, sparse: bool = False) -> None:
        """Raise `InputError` if the value at a point depends on the other points of the call."""
        for known in self.known.values():
            samples = Samples(box, sparse, CLOCK if time else None)

            def values(*point: Any, known: Callable[..., Any] = known) -> Any:
                return known(*padded(point, self.dim, time))

            check_pointwise(values, samples, name)

    def with_numbers(self, parameters: Mapping[str, float]) -> Formula:
        """The same formula with other values of its parameters."""
        return Formula(self.expression, self.dim, self.known, parameters)

    @property
    def exact(self) -> bool:
        """Whether all derivatives come from a formula."""
        return not self.known

    @property
    def steady(self) -> bool:
        """Whether t does not occur; a function known by its values counts as steady."""
        return not self.exact or "t" not in self.expression.variables()

    def functions(self, nodes: Sequence[Expression], steps: Sequence[float]) -> dict[str, Any]:
        """The callables of opaque functions and the numbers of parameters in `nodes`, by the names
        in code; `steps` as for `derivative`."""
        found: dict[str, Any] = dict(self.numbers)
        for node in ordered(list(nodes)):
            if node.op == "opaque" and node.value[0] == self._name:
                orders = node.value[1]
                label = f"{self._name}_{''.join(map(str, orders))}"
                found[label] = self._opaque(orders, steps)
        return found

    def derivative(self, orders: Orders, steps: Sequence[float]) -> Callable[..., Array]:
        """A partial derivative as a function of (x1, x2, x3, t). `steps` are lengths in x1, x2, x3,
        t over which the function changes little; difference quotients take a quarter of these."""
        return self.evaluator(derived(self.expression, orders), steps)

    def evaluator(self, node: Expression, steps: Sequence[float]) -> Callable[..., Array]:
        """A formula built from this one as a function of (x1, x2, x3, t); `steps` as above."""
        compute = numpy_function([node], COORDINATES, self.functions([node], steps))

        def values(*point: Any) -> Array:
            # As arrays: Python's own numbers raise where NumPy's give infinity.
            with np.errstate(all="ignore"):
                result = np.asarray(compute(*map(np.asarray, point))[0], dtype=float)
            shape = np.broadcast_shapes(*(np.shape(x) for x in point))
            return np.array(np.broadcast_to(result, shape))

        return values

    @property
    def _name(self) -> str:
        return str(self.expression.value[0]) if self.expression.op == "opaque" else ""

    def _opaque(self, orders: Orders, steps: Sequence[float]) -> Callable[..., Array]:
        if orders in self.known:
            return self.known[orders]
        place = max(q for q in range(4) if orders[q])
        # The truncation error is below that of the profiles, the rounding error about 4 eps / h.
        return _difference(
            self._opaque(raised(orders, place, -1), steps), place, 0.25 * steps[place]
        )


def functions_of(
    formulas: Sequence[Formula], nodes: Sequence[Expression], steps: Sequence[float]
) -> dict[str, Any]:
    """`Formula.functions` of several formulas together."""
    found: dict[str, Any] = {}
    for formula in formulas:
        found.update(formula.functions(nodes, steps))
    return found


def padded(point: Sequence[Any], dim: int, time: bool) -> list[Any]:
    """x1, x2, x3 and t from `dim` coordinates and, if `time`, a time after them; else zeros."""
    clock = point[-1] if time else np.zeros(())
    return [*point[:dim], *([np.zeros(())] * (3 - dim)), clock]


def agree(
    formulas: Sequence[Expression], function: Callable[..., Any], box: Box, time: bool
) -> bool:
    """Whether a callable and the formulas traced from it have the same values on two samples. False
    also if the callable raises, or if none of the values is finite."""
    compute = numpy_function(formulas, COORDINATES)
    finite = False
    for point in Samples(box, t=CLOCK if time else None):
        with np.errstate(all="ignore"):
            expected = compute(*map(np.asarray, padded(point, len(box), time)))
            try:
                called = function(*point)
                found = [called] if len(formulas) == 1 and np.ndim(called) < 2 else list(called)
                found = [real_array("", one) for one in found]
            except Exception:  # whatever a user's function raises
                return False
        if len(found) != len(formulas):
            return False
        for one, other in zip(found, expected, strict=True):
            if one.ndim > 1 or one.size not in (1, point[0].size):
                return False
            # The formula does the same operations except that powers become products and constant
            # factors are combined, so the values differ by rounding, far below 1e-9.
            if not alike(one, other, 1e-9).all():
                return False
            finite = finite or bool(np.isfinite(one).any())
    return finite


def _difference(function: Callable[..., Any], place: int, step: float) -> Callable[..., Array]:
    def slope(*point: Any) -> Array:
        total: Any = 0.0
        for k, weight in ((1, 45.0 / 60.0), (2, -9.0 / 60.0), (3, 1.0 / 60.0)):  # sixth order
            ahead, behind = list(point), list(point)
            ahead[place] = point[place] + k * step
            behind[place] = point[place] - k * step
            total = total + weight * (np.asarray(function(*ahead)) - np.asarray(function(*behind)))
        return total / step

    return slope


def spline(
    values: Any, grid: GridLike, name: str, of: Sequence[int] = (0, 0, 0), factor: float = 1.0
) -> Formula:
    """The tensor spline through nodal values, one `spline_along` each direction; or its derivative
    of the orders `of`, times a factor. On a sphere that of values in cells, without derivatives."""
    from scipy.interpolate import NdBSpline

    array = real_array(name, values)
    if array.dtype.kind not in "fiu" or array.shape != grid.nodes:
        raise InputError(
            f"{name}: expected real values at the nodes, shape {grid.nodes}, got {array.dtype} of "
            f"shape {array.shape}"
        )
    if not np.isfinite(array).all():
        at = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InputError(f"{name}: NaN or infinity at node {at}")
    if isinstance(grid, Sphere):
        whole = array.astype(float)
        lone = {(0, 0, 0, 0): lambda lon, lat, *rest: at_places(whole, lon, lat)}
        return Formula(opaque(_label(name, lone), (0, 0, 0, 0)), grid.dim, lone)
    coefficients, lines = array.astype(float), []
    for axis in range(grid.dim):
        lines.append(spline_along(grid, axis, np.moveaxis(coefficients, axis, 0)))
        coefficients = np.moveaxis(np.asarray(lines[-1].c), 0, axis)
    interpolant = NdBSpline(
        tuple(line.t for line in lines), coefficients, tuple(line.k for line in lines)
    )

    def derivative(orders: Orders) -> Callable[..., Any]:
        def evaluate(*point: Any) -> Any:
            shape = np.broadcast_shapes(*(np.shape(x) for x in point[: grid.dim]))
            places = []
            for axis, x in enumerate(point[: grid.dim]):
                low, high = grid.bounds[axis]
                x = np.broadcast_to(x, shape)
                inside = low + (x - low) % (high - low) if grid.periodic[axis] else x
                places.append(np.clip(inside, low, high))
            nu = [q + more for q, more in zip(orders, of, strict=False)][: grid.dim]
            return factor * interpolant(np.stack(places, axis=-1), nu=nu)

        return evaluate

    counts = [range(4 if axis < grid.dim else 1) for axis in range(3)]
    every = [(i, j, k, 0) for i, j, k in product(*counts) if i + j + k <= 3]
    known = {orders: derivative(orders) for orders in every}
    return Formula(opaque(_label(name, known), (0, 0, 0, 0)), grid.dim, known)


def spline_along(grid: Grid, axis: int, values: Array, degree: int | None = None) -> Any:
    """The interpolating spline of nodal values along a direction of a grid, which is the first of
    the array; by default quintic, or cubic in a direction of fewer than 6 cells."""
    from scipy.interpolate import make_interp_spline

    if periodic := grid.periodic[axis]:
        values = np.concatenate([values, values[:1]])
    k = degree or (5 if grid.cells[axis] >= 6 else 3)
    return make_interp_spline(grid.edges[axis], values, k, bc_type="periodic" if periodic else None)


def _label(name: str, known: dict[Orders, Callable[..., Any]]) -> str:
    """A name for the function in generated code, unique while `known` exists."""
    return f"{re.sub(r'[^A-Za-z0-9]', '_', name)}_{id(known)}"


Box = Sequence[tuple[float, float]]


class Samples:
    """Two sets of points of a box that have some points in common: flat arrays of the coordinates
    of all points or, if `sparse`, one array for each direction, which broadcast; then `t`, if
    given."""

    def __init__(self, box: Box, sparse: bool = False, t: float | None = None) -> None:
        lines, others, self._shared = [], [], []
        # Multiples of these irrational numbers, modulo 1, are spread over (0, 1) without order: the
        # golden ratio and the two numbers of the analogous sequence in the plane. The second sample
        # has a new point, then every other point of the first in reverse order.
        ratios = (0.6180339887498949, 0.7548776662466927, 0.5698402909980532)
        counts = ((8,), (4, 2), (2, 2, 2))[len(box) - 1]
        for ratio, count, (low, high) in zip(ratios, counts, box, strict=False):
            parts = (0.31 + ratio * np.arange(count + 1)) % 1.0
            line = low + (high - low) * parts
            again = np.arange(count)[::-1][::2]
            lines.append(line[:count])
            others.append(np.concatenate([line[count:], line[again]]))
            self._shared.append(again)
        self.points = []
        for axes in (lines, others):
            mesh = np.meshgrid(*axes, indexing="ij", sparse=sparse)
            time = [] if t is None else [t]
            self.points.append([*(x if sparse else x.ravel() for x in mesh), *time])
        self._shapes = [tuple(len(line) for line in axes) for axes in (lines, others)]

    def __iter__(self) -> Iterator[list[Any]]:
        return iter(self.points)

    def differ(self, first: Any, second: Any) -> str | None:
        """Describe the first common point with different values on both samples, or return None."""
        a, b = (
            np.reshape(np.broadcast_to(x, np.broadcast_shapes(*map(np.shape, point))), shape)
            for x, point, shape in zip((first, second), self, self._shapes, strict=True)
        )
        a, b = a[np.ix_(*self._shared)], b[(slice(1, None),) * b.ndim]
        # Vectorised loops and the scalar loops at the end of an array round differently.
        wrong = ~alike(a, b, 1e-12)
        if not wrong.any():
            return None
        place = tuple(int(q) for q in np.argwhere(wrong)[0])
        return f"{a[place]:.6g} among {np.size(first)} and {b[place]:.6g} among {np.size(second)}"


def alike(a: Any, b: Any, tolerance: float) -> NDArray[np.bool_]:
    """For each entry, whether a and b agree within `tolerance` times the largest finite one of a.
    NaN equals NaN, and infinity equals infinity of the same sign."""
    a, b = np.broadcast_arrays(np.asarray(a, dtype=float), np.asarray(b, dtype=float))
    with np.errstate(all="ignore"):
        largest = np.abs(a[np.isfinite(a)]).max(initial=0.0)
        near = np.abs(a - b) <= tolerance * largest
    return np.asarray(near | (a == b) | (np.isnan(a) & np.isnan(b)))


def check_pointwise(function: Callable[..., Any], samples: Samples, name: str) -> None:
    """Raise `InputError` if values at a point depend on the other points of the call, which tracing
    cannot detect: along a characteristic a callable is evaluated at other points than the nodes."""
    where = samples.differ(*(function(*point) for point in samples))
    if where is not None:
        raise InputError(
            f"{name}: it is no function of the place: at one point it gives {where} points, as a "
            "mean, a shift or a sum along the array does; pass its values at the nodes as an array"
        )
