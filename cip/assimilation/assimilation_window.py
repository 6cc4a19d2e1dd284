"""The map from a control vector to the states of a time window and the values at the sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator

from cip.assimilation.covariance import Covariance
from cip.assimilation.sensors import Reports, Sensors
from cip.characteristics.feet import check_step
from cip.errors import InputError
from cip.grid import Array, same_grid
from cip.output.trajectory import Trajectory
from cip.sensitivities.window import Window
from cip.solver.derivatives import derivative
from cip.solver.solver import Solver
from cip.stages.state import State, one_field, state_of
from skfem_adini.ground.arguments import real_number
from skfem_adini.ground.arrays import host


@dataclass(frozen=True)
class Path:
    """The run of the model for a control vector."""

    solver: Solver  # with the parameters of this control
    states: tuple[State, ...]  # at the start and at each interval's end, with its model error
    runs: tuple[Trajectory, ...]  # one for each interval
    residuals: Array  # reports minus values, over deviations


class AssimilationWindow:
    """The unknowns of a window with their prior, and the map from them to the sensors. The
    arguments are those of `cip.four_d_var`, checked here."""

    def __init__(
        self,
        solver: Any,
        background: Any,
        covariance: Any,
        sensors: Any,
        dt: float,
        parameters: Mapping[str, float] | None,
        model_error: Any,
    ) -> None:
        if not isinstance(solver, Solver):
            raise InputError(f"solver: expected a Solver, got {type(solver).__name__}")
        if not isinstance(sensors, Sensors):
            raise InputError(f"sensors: expected Sensors, got {type(sensors).__name__}")
        solver._accept(background)
        one_field(background, "background: analyses")
        self.solver, self.background, self.dt = solver, background.host(), check_step(dt)
        self.covariance = _fitting(covariance, solver, "covariance")
        self.sensors = sensors
        self.reports: Reports = sensors.reports(solver.grid, solver.profile)
        self.first, self.ends = _intervals(sensors.times, background.t, self.dt)
        self.errors = _errors(model_error, solver, len(self.ends))
        self.names, self.spreads = _parameters(parameters, solver)
        known = list(solver.parameters)
        self.columns = np.array([known.index(name) for name in self.names], dtype=np.int64)
        self.layout = Layout(self.covariance, len(self.names), self.errors)

    @property
    def linear(self) -> bool:
        """Whether the reports depend linearly on the unknowns."""
        return not self.names

    def parameters(self, control: Array) -> dict[str, float]:
        """The solver's parameters of a control."""
        prior = self.solver.parameters
        moved = self.spreads * control[self.layout.parameters]
        return {name: prior[name] + float(d) for name, d in zip(self.names, moved, strict=True)}

    def path(self, control: Array) -> Path:
        """The states of a control and the residuals of the reports there."""
        solver = self.solver
        if self.names:
            solver = solver.with_parameters(**self.parameters(control))
        change = self.covariance.root.matvec(control[self.layout.background])
        state = self._moved(self.background, change)
        states, runs = [state], []
        for k, end in enumerate(self.ends):
            runs.append(solver.run(state, end, dt=self.dt))
            state = runs[-1].final
            error = self.errors[k]
            if error is not None:
                state = self._moved(state, error.root.matvec(control[self.layout.errors[k]]))
            states.append(state)
        seen = states if self.first else states[1:]
        parts = [
            (value - rows @ one.data.ravel()) / deviation
            for value, rows, deviation, one in zip(
                self.reports.values,
                self.reports.operators,
                self.reports.deviations,
                seen,
                strict=True,
            )
        ]
        return Path(solver, tuple(states), tuple(runs), np.concatenate(parts))

    def linearised(self, path: Path) -> Linearised:
        """The derivative of the predicted reports in the control vector at a path."""
        derivatives = [derivative(path.solver, run) for run in path.runs]
        return Linearised(self, derivatives, path.solver._kernels.xp)

    def _moved(self, state: State, change: Any) -> State:
        data = state.data + np.reshape(change, state.data.shape)
        return state_of(state.grid, state.profile, data, state.t)


def _fitting(covariance: Any, solver: Solver, name: str) -> Covariance:
    if not isinstance(covariance, Covariance):
        raise InputError(f"{name}: expected a Covariance, got {type(covariance).__name__}")
    grid = covariance.grid
    if covariance.profile != solver.profile or not same_grid(grid, solver.grid):
        raise InputError(
            f"{name}: it is of {covariance.profile!r} on {grid}, the solver of "
            f"{solver.profile!r} on {solver.grid}"
        )
    return covariance


def _intervals(times: Array, start: float, dt: float) -> tuple[bool, list[float]]:
    """Whether the first reports are at the start, and the end times of the intervals."""
    first = bool(abs(times[0] - start) <= 1e-9 * dt)  # up to rounding
    ends = [float(t) for t in times[first:]]
    if times[0] < start and not first:
        raise InputError(
            f"sensors: their first time is {times[0]:.6g}, before the background's {start:.6g}"
        )
    return first, ends


def _errors(given: Any, solver: Solver, count: int) -> list[Covariance | None]:
    if given is None:
        return [None] * count
    if isinstance(given, Covariance):
        given = [given] * count
    if not isinstance(given, Sequence) or len(given) != count:
        raise InputError(
            f"model_error: expected a Covariance, or one or None for each of {count} intervals"
        )
    return [
        None if one is None else _fitting(one, solver, f"model_error: interval {k}")
        for k, one in enumerate(given)
    ]


def _parameters(given: Any, solver: Solver) -> tuple[list[str], Array]:
    if given is None:
        return [], np.zeros(0)
    if not isinstance(given, Mapping):
        raise InputError(f"parameters: expected prior deviations by names, got {given!r}")
    unknown = sorted(set(given) - set(solver.parameters))
    if unknown:
        raise InputError(f"parameters: the solver has no parameter {unknown[0]!r}")
    names = [name for name in solver.parameters if name in given]
    spreads = np.array([real_number(f"parameters: {n!r}", given[n]) for n in names])
    if not (np.isfinite(spreads).all() and np.all(spreads > 0.0)):
        raise InputError(f"parameters: expected positive prior deviations, got {given!r}")
    return names, spreads.astype(float)


class Layout:
    """The parts of the control vector: background, parameters, and the model error of each interval
    (None where the model is taken as exact)."""

    def __init__(
        self, background: Covariance, parameters: int, errors: Sequence[Covariance | None]
    ) -> None:
        ranks = [0 if one is None else one.root.shape[1] for one in errors]
        ends = np.cumsum([background.root.shape[1], parameters, *ranks])
        starts = [0, *ends[:-1]]
        parts = [slice(int(a), int(b)) for a, b in zip(starts, ends, strict=True)]
        self.background, self.parameters, self.errors = parts[0], parts[1], parts[2:]
        self.size = int(ends[-1])


class Readings:
    """The sensors' values of a state on the host or a device, divided by their deviations. Only the
    entries that they need are copied from a device, so the sums are the same as on the host."""

    def __init__(self, rows: csr_array, deviations: Array, xp: Any) -> None:
        entries = rows.data / np.repeat(deviations, np.diff(rows.indptr))
        read, places = np.unique(rows.indices, return_inverse=True)
        self._rows = csr_array((entries, places, rows.indptr), shape=(rows.shape[0], read.size))
        self._xp, self._read = xp, xp.asarray(read)
        self.count = rows.shape[0]

    def of(self, state: Any) -> Array:
        """The reports, shape (m,), from all moments of a state."""
        return np.asarray(self._rows @ host(state[self._read]))

    def add_to(self, weight: Any, reports: Array) -> None:
        """Add the transpose of `of` to the weights of all moments."""
        weight[self._read] += self._xp.asarray(self._rows.T @ reports)


class Linearised:
    """The operator :math:`A = R^{-1/2} H M S` of a window, from the derivatives of its runs, and
    its transpose. Columns for parameters are computed once, by one tangent run each; other columns
    are applied by tangent runs. `xp`: array module."""

    def __init__(self, window: AssimilationWindow, derivatives: list[Window], xp: Any) -> None:
        self._xp, self._layout, reports = xp, window.layout, window.reports
        self._background, self._errors = window.covariance, window.errors
        self._derivatives, self._columns = derivatives, window.columns
        self._spreads = window.spreads
        self._runs = [one.state_operator() for one in derivatives]
        found: list[Readings | None] = [
            Readings(rows, deviation, xp)
            for rows, deviation in zip(reports.operators, reports.deviations, strict=True)
        ]
        # One for the start, one for the end of each interval.
        self._readings = found if window.first else [None, *found]
        self.reports = sum(len(one) for one in reports.deviations)
        self._size = window.covariance.root.shape[0]

    def operator(self) -> LinearOperator:
        """A as a linear operator."""
        shape = (self.reports, self._layout.size)
        return LinearOperator(shape, self.forward, rmatvec=self.backward, dtype=np.float64)

    def forward(self, control: Any) -> Array:
        """The change of all reports, over their deviations."""
        xp, control = self._xp, np.ravel(control)
        change = xp.asarray(self._background.root.matvec(control[self._layout.background]))
        states = [change]
        for k, run in enumerate(self._runs):
            change = xp.asarray(run.matvec(change))
            error = self._errors[k]
            if error is not None:
                own = error.root.matvec(control[self._layout.errors[k]])
                change = change + xp.asarray(own)
            states.append(change)
        return self._read(states) + self.by_parameters @ control[self._layout.parameters]

    @cached_property
    def by_parameters(self) -> Array:
        """The columns of A for the parameters, shape (reports, parameters)."""
        xp, found = self._xp, np.empty((self.reports, self._columns.size))
        if not self._columns.size:
            return found
        operators = [one.operator() for one in self._derivatives]
        for column, place, spread in zip(found.T, self._columns, self._spreads, strict=True):
            moved = np.zeros(len(self._derivatives[0].parameters))
            moved[place] = spread
            states = [xp.zeros(self._size)]
            for one in operators:
                given = xp.concatenate([states[-1], xp.asarray(moved)])
                states.append(xp.asarray(one.matvec(given)))
            column[:] = self._read(states)
        return found

    def _read(self, states: list[Any]) -> Array:
        """The changes of the reports for states at the start and at the end of each interval."""
        pairs = zip(self._readings, states, strict=True)
        return np.concatenate([one.of(state) for one, state in pairs if one is not None])

    def backward(self, reports: Any) -> Array:
        """The transpose of `forward`."""
        weights = np.ravel(reports)
        counts = [0 if one is None else one.count for one in self._readings]
        parts = np.split(weights, np.cumsum(counts)[:-1])
        found = np.zeros(self._layout.size)
        back = self._xp.zeros(self._size)
        for k in range(len(self._runs), -1, -1):
            readings = self._readings[k]
            if readings is not None:
                readings.add_to(back, parts[k])
            if k == 0:
                break
            error = self._errors[k - 1]
            if error is not None:
                found[self._layout.errors[k - 1]] = error.root.rmatvec(host(back))
            back = self._xp.asarray(self._runs[k - 1].rmatvec(back))
        found[self._layout.background] = self._background.root.rmatvec(host(back))
        found[self._layout.parameters] = self.by_parameters.T @ weights
        return found
