"""Which of the live rows belong to which contact point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class PointRows:
    """Numbers of the live rows, those that supports do not prescribe entirely.

    Attributes
    ----------
    normal : ndarray of int, shape (m,)
        Row of each point's normal; -1 where the normal displacement is prescribed.
    tangent : ndarray of int, shape (m, dim - 1)
        Rows of each point's tangents; -1 where the whole tangential displacement is prescribed.
    """

    normal: Index
    tangent: Index

    def stacked(self, of_normal: Array, of_tangent: Array) -> Array:
        """Stack values of points, shapes (m,) and (m, dim - 1), on the live rows, shape (n,)."""
        live_n, live_t = self.normal >= 0, self.tangent >= 0
        values = np.zeros(int(live_n.sum() + live_t.sum()))
        values[self.normal[live_n]] = of_normal[live_n]
        values[self.tangent[live_t]] = of_tangent[live_t]
        return values

    def lengths(self, compliance: Array) -> Array:
        """Root of the mean compliance of each point, on all its rows, shape (n,).

        All rows of a point have the same value, so that its friction ball remains a ball. Rows
        without compliance do not count in the mean; where a point has no other, the value is one.
        """
        rows = np.column_stack((self.normal, self.tangent))
        own = np.where(rows >= 0, compliance[rows], 0.0)
        count = np.maximum((own > 0).sum(axis=1), 1)
        total = np.where(own > 0, own, 0.0).sum(axis=1)
        lengths = np.ones(compliance.size)
        of_point = np.where(total > 0, np.sqrt(total / count), 1.0)
        lengths[rows[rows >= 0]] = np.broadcast_to(of_point[:, None], rows.shape)[rows >= 0]
        return lengths

    def of_points(self, of_rows: Array) -> Array:
        """Common value of the rows of each point, shape (m,); one for a point without live rows."""
        first = np.maximum(self.normal, self.tangent.max(axis=1))
        return np.where(first >= 0, of_rows[np.maximum(first, 0)], 1.0)
