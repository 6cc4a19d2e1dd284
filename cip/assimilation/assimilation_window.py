"""A window of time with its unknowns: what a control vector means and what sensors then read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.assimilation.covariance import Covariance
from cip.assimilation.linearised import Layout, Linearised
from cip.assimilation.sensors import Reports, Sensors
from cip.characteristics.feet import check_step
from cip.errors import InputError
from cip.output.trajectory import Trajectory
from cip.reals import real_number
from cip.solver.derivatives import derivative
from cip.solver.solver import Solver
from cip.stages.state import State, state_of

Array = NDArray[np.float64]
# Reports this close to the start, as a fraction of dt, are of the start.
_START = 1e-9


@dataclass(frozen=True)
class Path:
    """The states that belong to a control vector."""

    solver: Solver  # with the parameters of this control
    states: tuple[State, ...]  # at the start and at each interval's end, with its model error
    runs: tuple[Trajectory, ...]  # one for each interval
    residuals: Array  # reports minus values, over deviations


class AssimilationWindow:
    """The unknowns of a window with their prior, and the map from them to the sensors. The
    arguments are those of `cip.four_d_var`, checked here.
    """

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
        self.solver, self.background, self.dt = solver, background.host(), check_step(dt)
        self.covariance = _fitting(covariance, solver, "covariance")
        self.sensors = sensors
        self.reports: Reports = sensors.reports(solver.grid, solver.profile)
        self.first, self.ends = _intervals(sensors.times, background.t, self.dt)
        self.errors = _errors(model_error, solver, len(self.ends))
        self.names, self.spreads = _parameters(parameters, solver)
        known = list(solver.parameters)
        self._columns = np.array([known.index(name) for name in self.names], dtype=np.int64)
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
        """The derivative of the reports in the control at a path."""
        return Linearised(
            self.layout, self.covariance, self.errors, self.reports,
            [derivative(path.solver, run) for run in path.runs], self._columns,
            self.spreads, self.first, path.solver._kernels.xp,
        )  # fmt: skip

    def _moved(self, state: State, change: Any) -> State:
        data = state.data + np.reshape(change, state.data.shape)
        return state_of(state.grid, state.profile, data, state.t)


def _fitting(covariance: Any, solver: Solver, name: str) -> Covariance:
    if not isinstance(covariance, Covariance):
        raise InputError(f"{name}: expected a Covariance, got {type(covariance).__name__}")
    grid = covariance.grid
    same = grid is solver.grid or (
        grid.nodes == solver.grid.nodes
        and grid.periodic == solver.grid.periodic
        and all(np.array_equal(a, b) for a, b in zip(grid.edges, solver.grid.edges, strict=True))
    )
    if covariance.profile != solver.profile or not same:
        raise InputError(
            f"{name}: it is of {covariance.profile!r} on {grid}, the solver of "
            f"{solver.profile!r} on {solver.grid}"
        )
    return covariance


def _intervals(times: Array, start: float, dt: float) -> tuple[bool, list[float]]:
    """Whether the first reports are of the start, and the ends of the intervals."""
    first = bool(abs(times[0] - start) <= _START * dt)
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
    spreads = np.array([real_number(given[n], f"parameters: {n!r}") for n in names])
    if not (np.isfinite(spreads).all() and np.all(spreads > 0.0)):
        raise InputError(f"parameters: expected positive prior deviations, got {given!r}")
    return names, spreads.astype(float)
