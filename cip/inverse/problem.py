"""The least-squares problem: arguments checked, model, data and seminorm together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.characteristics.feet import check_step
from cip.errors import InputError, LeftDomain, NotConverged, NotFinite
from cip.formulas.expression import COORDINATES, Expression
from cip.formulas.parameters import parameter
from cip.formulas.spline_velocity import SplineVelocity
from cip.formulas.velocity import Velocity
from cip.grid import Grid
from cip.inverse.observations import Data
from cip.inverse.weight import Linearised, by_discrepancy, by_l_curve
from cip.solver.solver import Solver
from cip.stages.state import State
from skfem_adini.ground.arguments import real_array, real_number
from skfem_adini.ground.arrays import host

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Problem:
    """Model, data and seminorm."""

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
        """Root mean square of the components; at least a cell in the time of the data."""
        grid = self.solver.grid
        weight = grid.weights.ravel()
        found = float(np.sqrt(np.sum(weight * values**2) / weight.sum()))
        return max(found, min(grid.spacing) / (self.data.times[-1] - self.t))


def problem_of(
    solver: Any, start: Any, data: Any, dt: float, noise: Any, regularization: Any
) -> Problem:
    """The arguments of `identify_velocity`, checked."""
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
    if kind is not None and not (isinstance(kind, str) and kind in ORDERS):
        raise InputError(
            f"regularization: expected 'auto', 'H1', 'H2' or None, got {regularization!r}"
        )
    solver._accept(start)
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
        """How many feet lie on edges of cells, where derivatives are the mean of both sides."""
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


ORDERS = {"H1": 1, "H2": 2}


class Roughness:
    r"""The rows whose sum of squares is the seminorm of `kind` ("H1", "H2", None: no rows) of the
    velocity at time `t`; their parameters are `names`. It is the sum over components of
    :math:`\int |\nabla c|^2` (H1), :math:`\int |\nabla^2 c|^2` (H2), by the weights of the grid. A
    constant velocity costs nothing, unlike in the L2 norm, which draws all velocities to zero.
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
