"""A window linearised around a run: from independent control numbers to reports over deviations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator

from cip.assimilation.covariance import Covariance
from cip.assimilation.sensors import Reports
from cip.stages.state import on_host

Array = NDArray[np.float64]


class Layout:
    """The parts of the control vector: background, parameters, the model error of each interval.

    Parameters
    ----------
    background : Covariance
    parameters : int
    errors : sequence of Covariance or None
        For each interval; None where the model is taken as exact.
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
    """What sensors read of a state on the host or a device, over their deviations.

    Only the entries that they read come from a device, so that their sums are those of the host.

    Parameters
    ----------
    rows : csr_array
    deviations : ndarray
    xp : module
        NumPy or CuPy, of the states.
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
    r"""The operator :math:`A = R^{-1/2} H M S` of a window and its transpose.

    Parameters
    ----------
    layout : Layout
    background : Covariance
    errors : sequence of Covariance or None
    reports : Reports
    tangents : sequence of LinearOperator
        For each interval; columns are the moments, then the solver's parameters.
    columns : ndarray of int
        Which of the solver's parameters vary.
    spreads : ndarray
        Their prior deviations.
    first : bool
        Whether the first reports belong to the start.
    xp : module
        NumPy or CuPy, of the vectors of the tangents; those of controls and reports are of NumPy.
    """

    def __init__(
        self,
        layout: Layout,
        background: Covariance,
        errors: Sequence[Covariance | None],
        reports: Reports,
        tangents: Sequence[LinearOperator],
        columns: NDArray[np.int64],
        spreads: Array,
        first: bool,
        xp: Any = np,
    ) -> None:
        self._xp, self._layout = xp, layout
        self._background, self._errors = background, errors
        self._tangents, self._columns, self._spreads = tangents, columns, spreads
        found: list[Readings | None] = [
            Readings(rows, deviation, xp)
            for rows, deviation in zip(reports.operators, reports.deviations, strict=True)
        ]
        # One for the start, one for the end of each interval.
        self._readings = found if first else [None, *found]
        self.reports = sum(len(one) for one in reports.deviations)
        self._size = background.root.shape[0]
        self._parameters = tangents[0].shape[1] - self._size if tangents else 0

    def operator(self) -> LinearOperator:
        """A as a linear operator."""
        shape = (self.reports, self._layout.size)
        return LinearOperator(shape, self.forward, rmatvec=self.backward, dtype=np.float64)

    def forward(self, control: Any) -> Array:
        """The change of all reports, over their deviations."""
        control, found = np.ravel(control), []
        for readings, change in zip(self._readings, self.states(control), strict=True):
            if readings is not None:
                found.append(readings.of(change))
        return np.concatenate(found)

    def states(self, control: Array) -> list[Any]:
        """The change of the states at the start and at the end of each interval."""
        xp, moved = self._xp, np.zeros(self._parameters)
        moved[self._columns] = self._spreads * control[self._layout.parameters]
        change = xp.asarray(self._background.root.matvec(control[self._layout.background]))
        states = [change]
        for k, tangent in enumerate(self._tangents):
            change = xp.asarray(tangent.matvec(xp.concatenate([change, xp.asarray(moved)])))
            error = self._errors[k]
            if error is not None:
                own = error.root.matvec(control[self._layout.errors[k]])
                change = change + xp.asarray(own)
            states.append(change)
        return states

    def backward(self, reports: Any) -> Array:
        """The transpose of `forward`."""
        weights = np.ravel(reports)
        counts = [0 if one is None else one.count for one in self._readings]
        parts = np.split(weights, np.cumsum(counts)[:-1])
        found = np.zeros(self._layout.size)
        back = self._xp.zeros(self._size)
        for k in range(len(self._tangents), -1, -1):
            readings = self._readings[k]
            if readings is not None:
                readings.add_to(back, parts[k])
            if k == 0:
                break
            error = self._errors[k - 1]
            if error is not None:
                found[self._layout.errors[k - 1]] = error.root.rmatvec(on_host(back))
            given = self._xp.asarray(self._tangents[k - 1].rmatvec(back))
            by_parameter = on_host(given[self._size :])[self._columns]
            found[self._layout.parameters] += self._spreads * by_parameter
            back = given[: self._size]
        found[self._layout.background] = self._background.root.rmatvec(on_host(back))
        return found
