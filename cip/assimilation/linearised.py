"""A window linearised around a run: from independent control numbers to reports over deviations."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator

from cip.assimilation.covariance import Covariance
from cip.assimilation.sensors import Reports
from cip.sensitivities.window import Window
from cip.stages.state import on_host

Array = NDArray[np.float64]


class Layout:
    """The parts of the control vector: background, parameters, and the model error of each interval
    (None where the model is taken as exact).
    """

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
    """What sensors read of a state on the host or a device, over their deviations. Only the entries
    that they read come from a device, so that their sums are those of the host.
    """

    def __init__(self, rows: csr_array, deviations: Array, xp: Any) -> None:
        entries = rows.data / np.repeat(deviations, np.diff(rows.indptr))
        read, places = np.unique(rows.indices, return_inverse=True)
        self._rows = csr_array((entries, places, rows.indptr), shape=(rows.shape[0], read.size))
        self._xp, self._read = xp, xp.asarray(read)
        self.count = rows.shape[0]

    def of(self, state: Any) -> Array:
        """The reports, shape (m,), from all moments of a state."""
        return np.asarray(self._rows @ on_host(state[self._read]))

    def add_to(self, weight: Any, reports: Array) -> None:
        """Add the transpose of `of` to the weights of all moments."""
        weight[self._read] += self._xp.asarray(self._rows.T @ reports)


class Linearised:
    """The operator :math:`A = R^{-1/2} H M S` of a window and its transpose. Columns for parameters
    come from one tangent run each and are kept; the others are applied by runs in the state.
    `first`: the first reports belong to the start; `xp` is the module of tangents."""

    def __init__(
        self,
        layout: Layout,
        background: Covariance,
        errors: Sequence[Covariance | None],
        reports: Reports,
        derivatives: Sequence[Window],
        columns: NDArray[np.int64],
        spreads: Array,
        first: bool,
        xp: Any = np,
    ) -> None:
        self._xp, self._layout = xp, layout
        self._background, self._errors = background, errors
        self._derivatives, self._columns, self._spreads = derivatives, columns, spreads
        self._runs = [one.state_operator() for one in derivatives]
        found: list[Readings | None] = [
            Readings(rows, deviation, xp)
            for rows, deviation in zip(reports.operators, reports.deviations, strict=True)
        ]
        # One for the start, one for the end of each interval.
        self._readings = found if first else [None, *found]
        self.reports = sum(len(one) for one in reports.deviations)
        self._size = background.root.shape[0]

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
        """The reports of the states at the start and at the end of each interval."""
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
                found[self._layout.errors[k - 1]] = error.root.rmatvec(on_host(back))
            back = self._xp.asarray(self._runs[k - 1].rmatvec(back))
        found[self._layout.background] = self._background.root.rmatvec(on_host(back))
        found[self._layout.parameters] = self.by_parameters.T @ weights
        return found
