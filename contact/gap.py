"""The gap between a contact boundary and an obstacle, under the functional of the trace."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError, numbers
from contact.functionals import FacetFunctional
from contact.obstacles import Gap, evaluate_gap

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GapRule:
    """How a contact boundary reads a gap: with the same functional as the displacement.

    Attributes
    ----------
    x, normals : ndarray, shape (dim, nfacets, npoints)
        Evaluation points of each facet, and outward normals there.
    form : FacetFunctional
    number : ndarray of int, shape (nfacets, nvalues)
        Contact point of each value of a facet, before sorting; -1 for a dropped one.
    x_nominal, mean_normals : ndarray, shape (dim, m)
        Of the contact points, before sorting.
    order : ndarray of int, shape (m,)
        Sorts the contact points.
    offset : ndarray, shape (dim, m), optional
        From the vertex to the point, before sorting, of the functional ``centroid``.
    """

    x: Array
    normals: Array
    form: FacetFunctional
    number: NDArray[np.int64]
    x_nominal: Array
    mean_normals: Array
    order: NDArray[np.int64]
    offset: Array | None = None

    def __call__(self, obstacle: Gap) -> Array:
        """Gap of every contact point, shape (m,); ``inf`` where there is no obstacle.

        Raises
        ------
        InputError
            NaN, minus infinity or a wrong shape.
        """
        if isinstance(obstacle, np.ndarray | list | tuple):
            return self._given(obstacle)
        if self.offset is not None:
            return self._extrapolated(obstacle, self.offset)[self.order]
        at = evaluate_gap(obstacle, self.x, self.normals)
        open_ = np.isinf(at)
        of_facet = np.where(open_, 0.0, at) @ self.form.C.T
        of_facet[(open_.astype(float) @ (self.form.C != 0).T) > 0] = np.inf
        gap = np.empty(self.order.size)
        used = self.number >= 0
        gap[self.number[used]] = of_facet[used]
        shared = np.unique(self.number[:, self.form.shared])
        shared = shared[shared >= 0]  # these see the obstacle along their own, mean normal
        if shared.size:
            where = self.x_nominal[:, shared], self.mean_normals[:, shared]
            gap[shared] = evaluate_gap(obstacle, *where)
        return gap[self.order]

    def _extrapolated(self, obstacle: Gap, offset: Array) -> Array:
        """d plus its slope times the offset, as for the displacement; exact for quadratic d."""
        vertex = self.x_nominal - offset
        here, half, there = (
            evaluate_gap(obstacle, vertex + part * offset, self.mean_normals)
            for part in (0.0, 0.5, 1.0)
        )
        open_ = np.isinf(here) | np.isinf(half) | np.isinf(there)
        here, half, there = (np.where(open_, 0.0, d) for d in (here, half, there))
        return np.where(open_, np.inf, 4 * half - 2 * here - there)

    def _given(self, obstacle: Gap) -> Array:
        """One gap for each contact point, in their order."""
        given, x = numbers("obstacle", obstacle), self.x_nominal
        if given.shape not in ((), x.shape[1:]):
            raise InputError(f"obstacle: {given.size} gaps given for {x.shape[1]} contact points")
        return evaluate_gap(given, x, x)
