r"""Fields given by arrays at several times: tensor-product splines in space and time.

The interpolant is :math:`c(t, x) = \sum_{mjkl} a_{mjkl} B_m(t) B_j(x_1) B_k(x_2) B_l(x_3)` with the
not-a-knot (or periodic) B-splines of de Boor (A Practical Guide to Splines, 1978, chapters IX and
XIII), cubic in time. Its derivatives are those of the splines, so the characteristics and their
derivatives are those of one field, which is twice differentiable also at the times of the
snapshots: a step may cross them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from cip.errors import InputError, NotSupported
from cip.formulas.expression import Orders, opaque
from cip.formulas.formula import Formula, spline_along
from cip.grid import Array, Grid, check_grid
from skfem_adini.ground.arguments import real_array


class _Limits(NamedTuple):
    window: int = 12  # snapshots before and after one whose spline's coefficient they make: to 1e-7


LIMITS = _Limits()
_IN_TIME = {"linear": 1, "cubic": 3}  # degrees


class Snapshots:
    """The splines through arrays at several times; the arguments are those of
    `Velocity.from_snapshots`. `coefficients` has shape (components, times, coefficients in each
    direction); `degrees` and `knots` are those in time and in each direction."""

    def __init__(
        self,
        times: Any,
        arrays: Any,
        grid: Any,
        degree: Any,
        components: int | None = None,
        time: Any = "cubic",
    ) -> None:
        from scipy.interpolate import make_interp_spline

        self._begin(times, grid, degree, time, components)
        values = np.moveaxis(_values(arrays, self.times, grid, self.components), 1, 0)
        in_time = make_interp_spline(self.times, np.eye(self.times.size), k=self.degrees[0])
        values = self._in_space(product_along(np.asarray(in_time.c), values, 1), 2)
        self.coefficients = np.ascontiguousarray(values)

    def _begin(self, times: Any, grid: Any, degree: Any, time: Any, components: Any) -> None:
        """Check all but the arrays; keep degrees, knots and the matrices that fit in space."""
        from scipy.interpolate import make_interp_spline

        check_grid(grid)
        if np.ndim(degree) or degree not in (3, 5):
            raise InputError(f"degree: expected 3 or 5, got {degree!r}")
        if min(grid.cells) < degree + 1:
            raise InputError(
                f"degree: splines of degree {degree} need {degree + 1} cells in each direction, "
                f"the grid of the arrays has {grid.cells}"
            )
        if not isinstance(time, str) or time not in _IN_TIME:
            raise InputError(f"time: expected 'linear' or 'cubic', got {time!r}")
        self.grid, self.times = grid, increasing(times, 2)
        self.components: int = components or grid.dim
        self._last: tuple[list[Any], dict[Any, Any]] = ([np.array(np.nan)], {})
        self.degrees = (min(_IN_TIME[time], self.times.size - 1), *([int(degree)] * grid.dim))
        some = make_interp_spline(self.times, np.zeros(self.times.size), k=self.degrees[0])
        self.knots: list[Array] = [np.asarray(some.t, dtype=float)]
        # A product of matrices is several times faster than the solution for so many lines.
        self._fits: list[Array] = []
        for axis in range(grid.dim):
            one = spline_along(grid, axis, np.eye(grid.nodes[axis]), self.degrees[axis + 1])
            self.knots.append(np.asarray(one.t, dtype=float))
            self._fits.append(np.asarray(one.c))

    def _in_space(self, values: Array, first: int) -> Array:
        """Coefficients in place of values along the axes from `first` on."""
        for axis, fit in enumerate(self._fits):
            values = product_along(fit, values, axis + first)
        return values

    def coefficient(self, m: int) -> Array:
        """The coefficients of the B-spline m in time, shape (components, ..)."""
        return self.coefficients[:, m]

    @cached_property
    def table(self) -> Array:
        """All numbers that a kernel needs, as `cip.engines.snapshot_kernel` reads them: for time
        and each direction the number of coefficients, of halvings in the search of an interval, and
        the period or 0; the knots of each; the coefficients."""
        head: list[float] = []
        for axis, (knots, k) in enumerate(zip(self.knots, self.degrees, strict=True)):
            count = knots.size - k - 1
            periodic = axis > 0 and self.grid.periodic[axis - 1]
            period = knots[-k - 1] - knots[k] if periodic else 0.0
            head += [count, int(np.ceil(np.log2(max(count - k, 2)))) + 1, period]
        return np.concatenate([np.array(head), *self.knots, self.coefficients.ravel()])

    def derivative(self, component: int, orders: Orders) -> Callable[..., Array]:
        """A partial derivative of a component as a function of (x1, x2, x3, t)."""
        from cip.formulas.spline_loops import run_sums

        dim, nu = self.grid.dim, (orders[3], *orders[: self.grid.dim])

        def values(*point: Any) -> Array:
            shape = np.broadcast_shapes(*(np.shape(x) for x in (*point[:dim], point[3])))
            given = (point[3], *point[:dim])
            rows = [self._basis(axis, given, shape, order) for axis, order in enumerate(nu)]
            size = rows[0][0].size
            none = np.zeros(size, np.int64), np.ones((size, 1))
            low = int(rows[0][0].min(initial=self.times.size))
            high = int(rows[0][0].max(initial=0)) + self.degrees[0] + 1
            data = self._between(component, low, max(low, high))
            data = data.reshape((1,) * (3 - dim) + data.shape)  # ones, time and directions
            rows[0] = rows[0][0] - low, rows[0][1]
            rows = [none] * (3 - dim) + rows
            found = np.empty(size)
            first = np.array([row[0] for row in rows])
            sums: Any = (data, first, *(row[1] for row in rows), found)
            run_sums(0, size, *sums)
            return found.reshape(shape)

        return values

    def _between(self, component: int, low: int, high: int) -> Array:
        """Coefficients of a component for the B-splines in time from `low` to before `high`."""
        return self.coefficients[component, low:high]

    def _basis(self, axis: int, given: Any, shape: Any, order: int) -> Any:
        """The B-splines of an axis at points; those of the last points are kept, as equations ask
        for many derivatives at the same ones."""
        from cip.formulas.spline_loops import basis

        last = self._last  # another thread may replace it
        if not all(map(np.array_equal, last[0], given)):
            last = self._last = ([np.array(x) for x in given], {})
        if (axis, order) not in last[1]:
            x = np.ravel(np.broadcast_to(np.asarray(given[axis], dtype=float), shape))
            if axis > 0 and self.grid.periodic[axis - 1]:
                low, high = self.grid.bounds[axis - 1]
                x = low + (x - low) % (high - low)
            last[1][axis, order] = basis(self.knots[axis], self.degrees[axis], x, order)
        return last[1][axis, order]

    def time_weights(self, t: float) -> tuple[int, Array]:
        """The B-splines in time that are not zero at t: number of the first, and their values, by
        de Boor's recursion (that of SciPy takes longer than a step on a device)."""
        knots, k = self.knots[0], self.degrees[0]
        t = min(max(t, float(self.times[0])), float(self.times[-1]))
        left = int(np.searchsorted(knots[k + 1 : -k - 1], t, side="right")) + k
        near, found = knots[left - k : left + k + 2].tolist(), [1.0]
        for d in range(1, k + 1):
            parts = [
                weight / (near[k + 1 + j] - near[k + 1 + j - d]) for j, weight in enumerate(found)
            ]
            found = [0.0] * (d + 1)
            for j, part in enumerate(parts):
                found[j] += part * (near[k + 1 + j] - t)
                found[j + 1] += part * (t - near[k + 1 + j - d])
        return left - k, np.array(found)

    def values_at(self, axis: int, points: Array) -> Any:
        """The sparse matrix that takes coefficients of a direction to values at these points."""
        return self._applied(axis, points, (1.0,))

    def cardinal(self, axis: int) -> Any:
        """The sparse matrix that takes coefficients of a uniform direction to those of all uniform
        B-splines that meet the box, by the dual functionals of de Boor and Fix (1973), for splines
        at their knots 1 - h^2 D^2 / 6 (cubic) and 1 - h^2 D^2 / 4 + h^4 D^4 / 30 (quintic)."""
        beyond = (self.degrees[axis + 1] - 1) // 2
        steps = np.arange(-beyond, self.grid.cells[axis] + beyond + 1)
        points = self.grid.bounds[axis][0] + self.grid.widths[axis][0] * steps
        return self._applied(axis, points, (1.0, -1 / 6) if beyond == 1 else (1.0, -1 / 4, 1 / 30))

    def _applied(self, axis: int, points: Array, factors: Sequence[float]) -> Any:
        """The matrix from coefficients to a sum of even derivatives times powers of the width."""
        from scipy.interpolate import BSpline
        from scipy.sparse import csr_array

        knots, k = self.knots[axis + 1], self.degrees[axis + 1]
        ends: Any = "periodic" if self.grid.periodic[axis] else True
        one = BSpline(knots, np.eye(knots.size - k - 1), k, extrapolate=ends)
        h = self.grid.widths[axis][0]
        return csr_array(sum(f * h ** (2 * q) * one(points, 2 * q) for q, f in enumerate(factors)))

    def on(self, grid: Grid) -> tuple[Formula, ...]:
        """One formula for each component; raises unless the data cover the grid."""
        self.check_cover(grid, "velocity")
        return tuple(SnapshotFormula(self, q) for q in range(grid.dim))

    def check_cover(self, grid: Grid, name: str) -> None:
        """Raise `InputError` unless the data cover the grid; messages begin with `name`."""
        if grid.dim != self.grid.dim:
            raise InputError(
                f"{name}: snapshots in {self.grid.dim} directions on a grid of {grid.dim}"
            )
        for axis, (mine, theirs) in enumerate(zip(self.grid.bounds, grid.bounds, strict=True)):
            letter, length = "xyz"[axis], mine[1] - mine[0]
            slack = 1e-9 * length  # for the rounding of ends that should agree
            if not self.grid.periodic[axis]:
                if grid.periodic[axis]:
                    raise InputError(
                        f"{name}: the grid is periodic in {letter}, the snapshots are not"
                    )
                if theirs[0] < mine[0] - slack or theirs[1] > mine[1] + slack:
                    raise InputError(
                        f"{name}: the snapshots cover {letter} from {mine[0]:.6g} to "
                        f"{mine[1]:.6g}, the grid lies from {theirs[0]:.6g} to {theirs[1]:.6g}"
                    )
            elif grid.periodic[axis]:
                turns = (theirs[1] - theirs[0]) / length
                if abs(turns - round(turns)) > 1e-9 * turns or round(turns) < 1:
                    raise InputError(
                        f"{name}: the period of the grid in {letter} is {turns:.6g} periods of the "
                        "snapshots; it must be a whole number of them"
                    )

    def check_times(self, start: float, end: float, name: str = "velocity") -> None:
        """Raise `InputError` if the snapshots do not cover the time from `start` to `end`."""
        first, last = float(self.times[0]), float(self.times[-1])
        slack = 1e-12 * max(last - first, abs(first), abs(last))  # for rounded sums of steps
        if start < first - slack or end > last + slack:
            raise InputError(
                f"t: the snapshots of the {name} cover {first:.6g} to {last:.6g}, not "
                f"{start:.6g} to {end:.6g}; stop earlier or give later snapshots"
            )


class LazySnapshots(Snapshots):
    """Splines whose arrays are read as times ask for them: ``read(k)`` is snapshot k, of shape
    (components, nodes). A coefficient of the cubic spline in time is the sum of the snapshots
    around it, whose weights fall by 3.7 from one to the next."""

    def __init__(self, times: Any, read: Any, grid: Grid, degree: Any, time: Any) -> None:
        self._begin(times, grid, degree, time, None)
        self._read = read
        self._remember()

    def _remember(self) -> None:
        """Caches of what one interval needs."""
        k = self.degrees[0]
        width = 1 if k == 1 else 2 * LIMITS.window + 1
        self._snapshot = lru_cache(min(self.times.size, width))(self._checked)
        self.coefficient = lru_cache(k + 3)(self._fitted)  # type: ignore[method-assign]

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in vars(self).items() if k not in ("_snapshot", "coefficient")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._remember()

    def _checked(self, k: int) -> Array:
        found = self._read(k)[None]
        return _values(found, self.times[k : k + 1], self.grid, self.components, k)[0]

    def _fitted(self, m: int) -> Array:
        from scipy.interpolate import make_interp_spline

        if self.degrees[0] == 1:
            return self._in_space(self._snapshot(m), 1)
        # Splines through some times have the same knots and, in the middle, coefficients.
        size = min(self.times.size, 2 * LIMITS.window + 1)
        low = int(np.clip(m - LIMITS.window, 0, self.times.size - size))
        near = make_interp_spline(self.times[low : low + size], np.eye(size), k=self.degrees[0])
        pairs = enumerate(np.asarray(near.c)[m - low], low)
        return self._in_space(sum(weight * self._snapshot(k) for k, weight in pairs), 1)

    def _between(self, component: int, low: int, high: int) -> Array:
        none = np.empty((0, *(fit.shape[0] for fit in self._fits)))
        return np.array([self.coefficient(m)[component] for m in range(low, high)] or none)

    @property
    def table(self) -> Array:
        """All numbers at once, which lazy data do not have."""
        raise NotSupported(
            "winds: a profile whose feet kernels compute ('adini' and 'bicubic' on uneven grids, "
            "on a device beside walls, and one-dimensional ones) needs all times in memory; pass "
            "lazy=False, or take 'bicubic', 'csl2' or 'csl4' on uniform grids in the plane or in "
            "space"
        )


class SnapshotFormula(Formula):
    """One component of `Snapshots`, with the derivatives of the splines. It is compiled; in code
    `name` precedes the number of the component."""

    def __init__(self, field: Snapshots, component: int, name: str = "snapshots") -> None:
        # The name does not depend on the data: one kernel serves all data.
        super().__init__(opaque(f"{name}{component}", (0, 0, 0, 0)), field.grid.dim)
        self.field, self.component = field, component

    @property
    def steady(self) -> bool:
        """False: it depends on t."""
        return False

    def _opaque(self, orders: Orders, steps: Sequence[float]) -> Callable[..., Array]:
        return self.field.derivative(self.component, orders)


def snapshots_of(formulas: Sequence[Formula]) -> Snapshots | None:
    """The splines of a velocity from snapshots, None for others."""
    first = formulas[0]
    return first.field if isinstance(first, SnapshotFormula) else None


def product_along(matrix: Array, values: Array, axis: int) -> Array:
    """The product of a matrix with arrays along an axis."""
    moved = np.moveaxis(values, axis, 0)
    found = matrix @ moved.reshape(len(moved), -1)
    return np.moveaxis(found.reshape(-1, *moved.shape[1:]), 0, axis)


def increasing(times: Any, least: int = 1, name: str = "times") -> Array:
    """The argument `times` as increasing, finite numbers, at least so many."""
    found = np.atleast_1d(real_array(name, times).astype(float))
    if found.ndim != 1 or found.size < least:
        raise InputError(
            f"{name}: expected at least {least} times in one row, got shape {found.shape}"
        )
    if not np.isfinite(found).all() or np.any(np.diff(found) <= 0.0):
        raise InputError(f"{name}: expected finite, increasing times, got {times!r}")
    return found


def _values(arrays: Any, times: Array, grid: Grid, components: int, first: int = 0) -> Array:
    """The checked arrays, of shape (times, components, nodes), from the snapshot `first` on."""
    found = real_array("arrays", arrays).astype(float)
    shape = (times.size, components, *grid.nodes)
    if components == 1 and found.shape == (times.size, *grid.nodes):
        found = found[:, None]
    if found.shape != shape:
        raise InputError(
            f"arrays: expected shape {shape} (times, components, nodes), got {found.shape}"
        )
    bad = ~np.isfinite(found)
    if bad.any():
        time, component, *place = (int(q) for q in np.argwhere(bad)[0])
        raise InputError(
            f"arrays: NaN or infinity in snapshot {first + time}, component {component}, node "
            f"{tuple(place)}; fill the gaps before"
        )
    return found
