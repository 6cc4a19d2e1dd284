"""The least-squares problem of a velocity: model, data and seminorm, from checked arguments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, issparse

from cip.assimilation.sensors import Sensors
from cip.characteristics.feet import check_step
from cip.errors import InputError, LeftDomain, NotConverged, NotFinite
from cip.formulas.expression import COORDINATES, Expression
from cip.formulas.parameters import parameter
from cip.formulas.snapshots import increasing
from cip.formulas.spline_velocity import SplineVelocity
from cip.formulas.velocity import Velocity
from cip.grid import Array, Grid
from cip.inverse.identifiability import SEEN
from cip.solver.solver import Solver
from cip.stages.state import State, one_field
from skfem_adini.ground.arguments import masked_array, real_array, real_number
from skfem_adini.ground.arrays import host


@dataclass(frozen=True)
class Problem:
    """The least-squares problem: model, data and seminorm."""

    prediction: Prediction
    roughness: Roughness
    data: Data
    solver: Solver
    t: float  # time of the start
    kind: str | None  # the seminorm, None for none

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return self.prediction.names

    @property
    def middle(self) -> float:
        """Time at which an unsteady velocity is evaluated: it may be zero at the start."""
        return 0.5 * (self.t + self.data.times[-1])

    def velocity(self, p: Array) -> tuple[Array, Array]:
        """Components at the nodes and their derivatives in the parameters, nodes flat."""
        velocity, grid = self.prediction.velocity(p), self.solver.grid
        return (
            field(velocity, grid, self.middle),
            field_slopes(velocity, grid, self.middle, self.names),
        )

    def speed(self, values: Array) -> float:
        """Root mean square of the components; at least one cell per duration of the data."""
        grid = self.solver.grid
        weight = grid.weights.ravel()
        found = float(np.sqrt(np.sum(weight * values**2) / weight.sum()))
        return max(found, min(grid.spacing) / (self.data.times[-1] - self.t))


def problem_of(
    solver: Any, start: Any, data: Any, dt: float, noise: Any, regularization: Any
) -> Problem:
    """The problem for the checked arguments of `identify_velocity`."""
    if not isinstance(solver, Solver):
        raise InputError(f"solver: expected a Solver, got {type(solver).__name__}")
    names = tuple(solver.velocity.parameters)
    if not names:
        raise InputError(
            "solver: its velocity has no parameters; take Velocity.from_expression with "
            "parameters, or SplineVelocity"
        )
    splines = isinstance(solver.velocity, SplineVelocity)
    kind = ("H2" if splines else None) if regularization == "auto" else regularization
    if kind is not None and not (isinstance(kind, str) and kind in ("H1", "H2")):
        raise InputError(
            f"regularization: expected 'auto', 'H1', 'H2' or None, got {regularization!r}"
        )
    solver._accept(start)
    one_field(start, "start: derivatives")
    checked = Data(data, noise, solver.grid, solver.profile, start.data.shape[0], start.t)
    if checked.size < len(names) and kind is None:
        raise InputError(
            f"data: {checked.size} values for {len(names)} parameters; take regularization='H2'"
        )
    prediction = Prediction(solver, start, checked, check_step(dt), names)
    roughness = Roughness(solver.grid, kind, names, start.t)
    return Problem(prediction, roughness, checked, solver, start.t, kind)


def bounds_of(bounds: Any, problem: Problem) -> tuple[Array, Array]:
    """The argument `bounds` as arrays with an entry for each parameter."""
    count = len(problem.names)
    low, high = np.full(count, -np.inf), np.full(count, np.inf)
    if bounds is None:
        return low, high
    pairs = bounds if isinstance(bounds, Mapping) else dict.fromkeys(problem.names, bounds)
    values = problem.solver.velocity.parameters
    for name, pair in pairs.items():
        if name not in problem.names:
            raise InputError(f"bounds: {name!r} is no parameter; known: {', '.join(problem.names)}")
        found = real_array("bounds: expected (low, high)", pair)
        if found.shape != (2,) or not found[0] < found[1]:
            raise InputError(f"bounds: expected (low, high) with low < high, got {pair!r}")
        if not found[0] < values[name] < found[1]:
            raise InputError(
                f"bounds: the first guess of {name!r}, {values[name]:.6g}, is not between "
                f"{found[0]:.6g} and {found[1]:.6g}"
            )
        q = problem.names.index(name)
        low[q], high[q] = found
    return low, high


def rule_of(weight: Any, problem: Problem) -> Any:
    """The argument `weight` as a number or a function of the linearised problem."""
    if problem.kind is None:
        if weight is not None:
            raise InputError("weight: there is no seminorm to weigh with regularization=None")
        return 0.0
    if weight is None:
        weight = "discrepancy" if problem.data.known or problem.data.exact else "l-curve"
    if isinstance(weight, str):
        rules = {"discrepancy": by_discrepancy, "l-curve": by_l_curve}
        if weight not in rules:
            raise InputError(
                f"weight: expected 'discrepancy', 'l-curve' or a number, got {weight!r}"
            )
        return rules[weight]
    number = real_number("weight", weight)
    if not (np.isfinite(number) and number >= 0.0):
        raise InputError(f"weight: expected a number >= 0, got {weight!r}")
    return number


def linearised(problem: Problem, p: Array, free: NDArray[np.bool_]) -> Linearised:
    """The problem around an estimate, in the parameters that are free."""
    velocity = problem.prediction.velocity(p)
    speed, slopes = problem.velocity(p)
    weight = problem.solver.grid.weights.ravel()
    moved = np.sqrt(np.sum(weight * slopes**2, axis=(1, 2)))
    size = problem.speed(speed) * np.sqrt(weight.sum()) / np.where(moved > 0.0, moved, 1.0)
    return Linearised.of(
        problem.prediction.misfit_slope(p)[:, free],
        problem.prediction.misfit(p),
        problem.roughness.slopes(velocity)[:, free],
        problem.roughness.rows(velocity),
        size[free],
        float(np.sqrt(np.mean((problem.data.flat() * problem.data.weights) ** 2))),
        problem.data.known,
    )


class Prediction:
    """Runs of `solver`, whose velocity has the parameters, from one observed time to the next.
    Results for the last values of those in `names` are kept; `runs` counts the runs of the model.
    """

    def __init__(
        self, solver: Solver, start: State, data: Data, dt: float, names: Sequence[str]
    ) -> None:
        self._solver, self._start, self._data, self._dt = solver, start, data, dt
        self.names, self.runs = tuple(names), 0
        self._last: tuple[bytes, Solver, list[Any]] | None = None
        self._slope: tuple[bytes, Array] | None = None
        self._tangents: list[Any] = []

    def velocity(self, values: Array) -> Velocity:
        """The velocity with these values of the parameters."""
        return self._solver.velocity.with_parameters(**self._numbers(values))

    def _numbers(self, values: Array) -> dict[str, float]:
        return dict(zip(self.names, map(float, values), strict=True))

    def _ran(self, values: Array) -> tuple[Solver, list[Any]]:
        key = np.asarray(values, dtype=float).tobytes()
        if self._last is None or self._last[0] != key:
            solver = self._solver.with_parameters(**self._numbers(values))
            state, found = self._start, []
            for t in self._data.times:
                found.append(solver.run(state, t, dt=self._dt))
                state = found[-1].final
            self.runs += 1
            self._last = key, solver, found
        return self._last[1], self._last[2]

    def values(self, values: Array) -> Array:
        """The predicted data."""
        _, runs = self._ran(values)
        return np.concatenate(
            [
                operator @ run.final.data.ravel()
                for operator, run in zip(self._data.operators, runs, strict=True)
            ]
        )

    def sensitivity(self, values: Array) -> Array:
        """Derivatives of the predicted data in the parameters, shape (data, parameters)."""
        key = np.asarray(values, dtype=float).tobytes()
        if self._slope is None or self._slope[0] != key:
            self._slope = key, self._sensitivity(values)
        return self._slope[1]

    def _sensitivity(self, values: Array) -> Array:
        solver, runs = self._ran(values)
        order = [list(solver.parameters).index(name) for name in self.names]
        given = np.eye(len(solver.parameters))[:, order]
        change, found = np.zeros((self._start.data.size, len(order))), []
        self._tangents.clear()
        for operator, run in zip(self._data.operators, runs, strict=True):
            tangent, columns = solver.tangent(run), np.vstack([change, given]).T
            moved = [tangent.matvec(solver._kernels.xp.asarray(column)) for column in columns]
            change = np.stack([host(one) for one in moved], axis=1)
            self._tangents.append(tangent)
            found.append(operator @ change)
        return np.concatenate(found)

    def feet_on_edges(self, values: Array) -> int:
        """Number of feet on edges of cells, where derivatives are the mean of both sides."""
        self.sensitivity(values)
        return sum(tangent.feet_on_edges() for tangent in self._tangents)

    def misfit(self, values: Array) -> Array:
        """Predicted minus given data over the deviations; NaN where the model cannot be run."""
        try:
            found = self.values(values)
        except (InputError, LeftDomain, NotConverged, NotFinite):
            if self._last is None:
                raise
            return np.full(self._data.size, np.nan)
        return np.asarray((found - self._data.flat()) * self._data.weights)

    def misfit_slope(self, values: Array) -> Array:
        """Derivatives of `misfit` in the parameters."""
        return np.asarray(self.sensitivity(values) * self._data.weights[:, None])


class Roughness:
    r"""The rows whose sum of squares is the seminorm of `kind` ("H1", "H2", None: no rows) of the
    velocity at time `t`; `names` are its parameters. It is the sum over components of
    :math:`\int |\nabla c|^2` (H1), :math:`\int |\nabla^2 c|^2` (H2), with the weights of the grid.
    It vanishes for constant velocities, unlike the L2 norm, which draws all velocities to zero."""

    def __init__(self, grid: Grid, kind: str | None, names: Sequence[str], t: float) -> None:
        self._grid, self._names, self._t = grid, names, t
        self._order = {"H1": 1, "H2": 2}.get(kind or "", 0)
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


# The weight of the seminorm, chosen by the data.
#
# Around an estimate the problem is linear: :math:`\|J d + r\|^2 + \alpha \|L d + \rho\|^2`, with r
# in units of the noise. Only the part of the misfit that the parameters can change determines the
# weight, and of that only well determined data: fitting the noise elsewhere requires weights
# that let the velocity grow without limit. The discrepancy principle is used there, with the
# degrees of freedom that the estimate has taken: :math:`\|Q^T (J d + r)\|^2 = s^2 (n - \mathrm{tr}
# Q^T A Q)`, where the n columns of Q span these changes of the data and A maps data to predictions
# (Morozov, Soviet Math. Dokl. 7, 1966, 414-417; with these degrees of freedom Hall and
# Titterington, J. R. Statist. Soc. B 49, 1987, 184-198).
# The L-curve's corner is the point of largest curvature (Hansen, SIAM Review 34, 1992, 561-580).


@dataclass(frozen=True)
class Linearised:
    """A linear problem reduced to as many rows as parameters, and the misfit that remains."""

    J: Array  # (parameters, parameters): triangular, derivatives of the misfit
    L: Array  # likewise, of the seminorm
    Q: Array  # (parameters, n): orthonormal changes of reduced data that are well determined
    r: Array  # right-hand side of J
    rho: Array  # right-hand side of L
    rest: float  # square of the misfit that no parameters remove
    count: int  # number of data
    depends: bool  # whether some data change with a parameter, beyond rounding
    known: bool  # whether the misfit is in units of the noise

    @classmethod
    def of(
        cls,
        J: Array,
        r: Array,
        L: Array,
        rho: Array,
        size: Array,
        scale: float,
        known: bool,
    ) -> Linearised:
        """Reduce all rows. `size` are changes of the parameters that change the velocity by its own
        size; a direction is well determined if such a change is at least two deviations of data of
        known noise, and not negligible. `scale` is the rms of the data in the units of r."""
        (one, right, rest), (two, rough, _) = _reduced(J, r), _reduced(L, rho)
        U, s, _ = np.linalg.svd(one * size)
        seen = s > SEEN.faint * s[0]
        if known:
            seen &= s >= 1.0 / SEEN.deviation
        # Changes of the data that are smaller, relative to the data, are rounding.
        depends = bool(s[0] > 1e-11 * np.sqrt(len(r)) * scale)
        return cls(one, two, U[:, seen], right, rough, rest, len(r), depends, known)

    @property
    def scale(self) -> float:
        """The weight at which both terms have equal traces."""
        return float(np.sum(self.J**2) / np.sum(self.L**2))

    @property
    def variance(self) -> float:
        """Variance of the misfit that no parameters remove; at least 1 where the noise is known."""
        free = max(self.count - self.J.shape[1], 1)
        found = self.rest / free
        return max(1.0, found) if self.known else found

    def at(self, weight: float) -> tuple[float, float, float]:
        """Squares of misfit (well determined part) and seminorm, and the degrees of freedom."""
        stacked = np.vstack([self.J, np.sqrt(weight) * self.L])
        right = -np.concatenate([self.r, np.sqrt(weight) * self.rho])
        # Normalise the columns, which depend on the units of the parameters.
        size = np.linalg.norm(stacked, axis=0)
        size[size == 0.0] = 1.0
        U, s, Vt = np.linalg.svd(stacked / size, full_matrices=False)
        kept = s > np.finfo(float).eps * len(stacked) * s[0]
        U, s, Vt = U[:, kept], s[kept], Vt[kept]
        d = Vt.T @ (U.T @ right / s) / size
        n = len(self.J)
        return (
            float(np.sum((self.Q.T @ (self.J @ d + self.r)) ** 2)),
            float(np.sum((self.L @ d + self.rho) ** 2)),
            float(np.sum((self.Q.T @ U[:n]) ** 2)),
        )


def _reduced(matrix: Array, right: Array) -> tuple[Array, Array, float]:
    """Triangular factor, transformed right-hand side, and squared norm of its remainder."""
    n = matrix.shape[1]
    rows = np.zeros((max(len(right), n + 1), n + 1))
    rows[: len(right), :n], rows[: len(right), n] = matrix, right
    R: Array = np.asarray(np.linalg.qr(rows, mode="r"))
    return R[:n, :n], R[:n, n], float(R[n, n] ** 2)


def by_discrepancy(problem: Linearised) -> float:
    """The largest weight whose misfit the noise explains."""
    # Below, the seminorm is lost in rounding; above, only its null space remains.
    weights = problem.scale * np.logspace(9.0, -13.0, 111)
    unknowns, variance = problem.Q.shape[1], problem.variance

    def excess(weight: float) -> float:
        misfit, _, taken = problem.at(weight)
        return misfit - variance * (unknowns - taken)

    above = None
    for weight in weights:
        if excess(weight) <= 0.0:
            break
        above = weight
    if above is None or above == weights[-1]:
        return float(weight)
    low, high = weight, above
    while high > 1.02 * low:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if excess(middle) > 0.0 else (middle, high)
    return float(low)


def by_l_curve(problem: Linearised) -> float:
    """The weight at the corner of the curve of misfit and seminorm, both in logarithms."""
    weights: Array = problem.scale * np.logspace(-13.0, 9.0, 111)
    found: Array = np.array([problem.at(float(weight))[:2] for weight in weights])
    found[:, 0] += problem.rest + float(
        problem.r @ problem.r - np.sum((problem.Q.T @ problem.r) ** 2)
    )
    tiny = np.finfo(float).tiny
    x, y = 0.5 * np.log(found[:, 0] + tiny), 0.5 * np.log(found[:, 1] + tiny)
    dx, dy = np.gradient(x), np.gradient(y)
    turn = dx * np.gradient(dy) - dy * np.gradient(dx)
    speed = np.hypot(dx, dy)
    # Where neither changes, the curve is stationary and has no curvature.
    moving = speed > 1e-3 * speed.max()
    curvature = np.where(moving, turn / np.where(moving, speed, 1.0) ** 3, -np.inf)
    return float(weights[np.argmax(curvature)])


@runtime_checkable
class Observations(Protocol):
    """Data of `identify_velocity` other than snapshots: linear maps of states at some times."""

    times: Any  # increasing
    values: Any  # for each time the data, shape (m,)
    operators: Any  # for each time (m, N), applied to state.data.ravel()


class Data:
    """Observations, each divided by its standard deviation; all are later than `start`. `given`
    maps times to nodal values (masked: missing), or is `Sensors` or `Observations`. `weights` are 1
    / deviation, or 1 / rms of all data if the noise is 0 (`exact`) or not `known`."""

    def __init__(
        self, given: Any, noise: Any, grid: Grid, profile: str, moments: int, start: float
    ) -> None:
        if isinstance(given, Sensors):
            given = given.reports(grid, profile)
        if isinstance(given, Mapping):
            self.times, self.values, self.operators = _snapshots(given, grid, moments)
        elif isinstance(given, Observations):
            self.times, self.values, self.operators = _observed(given, grid.size * moments)
        else:
            raise InputError(
                "data: expected arrays of nodal values by times, {t: array}, Sensors, or an object "
                f"with times, values and operators, got {type(given).__name__}"
            )
        if not self.times[0] > start:
            raise InputError(
                f"data: the first time is {self.times[0]:.6g}, expected one after that of the "
                f"start, {start:.6g}"
            )
        sizes = [one.size for one in self.values]
        if not sum(sizes):
            raise InputError("data: every value is masked or missing")
        several = noise is not None and real_array("noise", noise).ndim > 0
        if isinstance(given, Mapping) and several and list(given) != sorted(given):
            raise InputError(
                "noise: with one for each time give the data in the order of time, too"
            )
        own = getattr(given, "deviations", None)
        if own is not None and noise is not None:
            raise InputError("noise: the data have deviations of their own; leave it out")
        found = _own(own, sizes) if own is not None else _deviations(noise, sizes)
        self.known = bool(np.all(found > 0.0))
        self.exact = noise is not None and not self.known
        if not self.known:
            size = float(np.sqrt(np.mean(self.flat() ** 2)))
            found = np.full(sum(sizes), size if size > 0.0 else 1.0)
        self.weights = 1.0 / found

    @property
    def size(self) -> int:
        """Number of values."""
        return self.weights.size

    def flat(self) -> Array:
        """All values as a flat array."""
        return np.concatenate(self.values)


def _snapshots(
    given: Mapping[Any, Any], grid: Grid, moments: int
) -> tuple[list[float], list[Array], list[Any]]:
    if not given:
        raise InputError("data: expected at least one snapshot")
    keys = sorted((real_number("data: times", key), key) for key in given)
    times, values, operators = [t for t, _ in keys], [], []
    if not np.isfinite(times).all():
        raise InputError("data: expected finite times")
    for t, key in keys:
        name = f"data: snapshot at t = {t:.6g}"
        array, hidden = masked_array(name, given[key])
        array = array.astype(float)
        if array.shape != grid.nodes:
            raise InputError(
                f"{name}: expected nodal values, shape {grid.nodes}, got {array.shape}"
            )
        if not np.isfinite(array).all():
            raise InputError(f"{name}: NaN or infinity; mask what is missing (numpy.ma)")
        kept = np.arange(grid.size) if hidden is None else np.flatnonzero(~hidden)
        ones = (np.ones(kept.size), (np.arange(kept.size), kept))
        values.append(array.ravel()[kept])
        operators.append(csr_array(ones, shape=(kept.size, grid.size * moments)))
    return times, values, operators


def _observed(given: Observations, size: int) -> tuple[list[float], list[Array], list[Any]]:
    times = increasing(given.times, name="data: times")
    for one in (given.values, given.operators):
        if not (hasattr(one, "__len__") and len(one) == times.size):
            raise InputError("data: expected values and an operator for each time")
    values = [real_array("data: values", one).astype(float) for one in given.values]
    for one, operator in zip(values, given.operators, strict=True):
        shape = getattr(operator, "shape", None)
        if shape != (one.size, size) or one.ndim != 1:
            raise InputError(
                f"data: expected values of shape (m,) and operators of shape (m, {size}), got "
                f"{one.shape} and {shape or type(operator).__name__}"
            )
        entries = getattr(operator, "data", None) if issparse(operator) else operator
        label = "data: entries of the operators"
        if isinstance(entries, np.ndarray) and not np.isfinite(real_array(label, entries)).all():
            raise InputError(f"{label}: NaN or infinity among them")
        if not np.isfinite(one).all():
            raise InputError("data: NaN or infinity among the values; leave missing ones out")
    return [float(t) for t in times], values, list(given.operators)


def _own(given: Any, sizes: list[int]) -> Array:
    """Standard deviations supplied with the data, flat."""
    if not (hasattr(given, "__len__") and len(given) == len(sizes)):
        raise InputError(f"data: expected deviations for each of {len(sizes)} times")
    found = [real_array("data: deviations", one).astype(float) for one in given]
    if [one.shape for one in found] != [(n,) for n in sizes]:
        raise InputError("data: expected deviations of the shapes of the values")
    flat = np.concatenate(found)
    if not (np.isfinite(flat).all() and np.all(flat > 0.0)):
        raise InputError("data: expected finite, positive deviations")
    return flat


def _deviations(noise: Any, sizes: list[int]) -> Array:
    """The argument `noise` for each value; 0 where it is unknown."""
    times = len(sizes)
    if noise is None:
        return np.zeros(sum(sizes))
    found = real_array("noise: expected standard deviations", noise).astype(float)
    if found.ndim and found.shape != (times,):
        raise InputError(f"noise: expected one number, or one for each of {times} times")
    found = np.broadcast_to(found, (times,))
    if not np.isfinite(found).all() or np.any(found < 0.0):
        raise InputError(f"noise: expected standard deviations >= 0, got {noise!r}")
    if np.any(found == 0.0) and np.any(found > 0.0):
        raise InputError("noise: expected 0 for all times or for none")
    return np.repeat(found, sizes)
