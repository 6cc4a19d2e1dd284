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
    ) -> None:
        self._layout, self._background, self._errors = layout, background, errors
        self._tangents, self._columns, self._spreads = tangents, columns, spreads
        found: list[csr_array | None] = [
            _scaled(rows, deviation)
            for rows, deviation in zip(reports.operators, reports.deviations, strict=True)
        ]
        # One for the start, one for the end of each interval.
        self._rows = found if first else [None, *found]
        self.reports = sum(len(one) for one in reports.deviations)
        self._size = background.root.shape[0]

    def operator(self) -> LinearOperator:
        """A as a linear operator."""
        shape = (self.reports, self._layout.size)
        return LinearOperator(shape, self.forward, rmatvec=self.backward, dtype=np.float64)

    def forward(self, control: Any) -> Array:
        """The change of all reports, over their deviations."""
        control = np.ravel(control)
        found = []
        for rows, change in zip(self._rows, self.states(control), strict=True):
            if rows is not None:
                found.append(rows @ change)
        return np.concatenate(found)

    def states(self, control: Array) -> list[Array]:
        """The change of the states at the start and at the end of each interval."""
        change = np.asarray(self._background.root.matvec(control[self._layout.background]))
        states = [change]
        for k, tangent in enumerate(self._tangents):
            given = np.zeros(tangent.shape[1])
            given[: self._size] = change
            moved = self._spreads * control[self._layout.parameters]
            given[self._size + self._columns] = moved
            change = np.asarray(tangent.matvec(given))
            error = self._errors[k]
            if error is not None:
                change = change + error.root.matvec(control[self._layout.errors[k]])
            states.append(change)
        return states

    def backward(self, reports: Any) -> Array:
        """The transpose of `forward`."""
        weights = np.ravel(reports)
        counts = [0 if rows is None else rows.shape[0] for rows in self._rows]
        parts = np.split(weights, np.cumsum(counts)[:-1])
        found = np.zeros(self._layout.size)
        back = np.zeros(self._size)
        for k in range(len(self._tangents), -1, -1):
            rows = self._rows[k]
            if rows is not None:
                back = back + rows.T @ parts[k]
            if k == 0:
                break
            error = self._errors[k - 1]
            if error is not None:
                found[self._layout.errors[k - 1]] = error.root.rmatvec(back)
            given = np.asarray(self._tangents[k - 1].rmatvec(back))
            by_parameter = given[self._size + self._columns]
            found[self._layout.parameters] += self._spreads * by_parameter
            back = given[: self._size]
        found[self._layout.background] = self._background.root.rmatvec(back)
        return found


def _scaled(rows: csr_array, deviations: Array) -> csr_array:
    """Rows divided by the deviations of their reports."""
    counts = np.diff(rows.indptr)
    entries = rows.data / np.repeat(deviations, counts)
    return csr_array((entries, rows.indices, rows.indptr), shape=rows.shape)
