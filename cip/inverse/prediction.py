"""What a solver with given parameters predicts for the data, and its derivative in them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError, LeftDomain, NotConverged, NotFinite
from cip.formulas.velocity import Velocity
from cip.inverse.observations import Data
from cip.solver.solver import Solver
from cip.stages.state import State, on_host

Array = NDArray[np.float64]


class Prediction:
    """Runs from one observed time to the next; results for the last parameters are kept.

    Parameters
    ----------
    solver : Solver
        Its velocity has the parameters.
    start : State
    data : Data
    dt : float
    names : sequence of str
        Of the parameters that vary.

    Attributes
    ----------
    runs : int
        How often the model was run.
    """

    def __init__(
        self, solver: Solver, start: State, data: Data, dt: float, names: Sequence[str]
    ) -> None:
        self._solver, self._start, self._data, self._dt = solver, start, data, dt
        self.names, self.runs = tuple(names), 0
        self._last: tuple[bytes, Solver, list[Any]] | None = None
        self._slope: tuple[bytes, Array] | None = None

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
        for operator, run in zip(self._data.operators, runs, strict=True):
            tangent, columns = solver.tangent(run), np.vstack([change, given]).T
            moved = [tangent.matvec(solver._kernels.xp.asarray(column)) for column in columns]
            change = np.stack([on_host(one) for one in moved], axis=1)
            found.append(operator @ change)
        return np.concatenate(found)

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
