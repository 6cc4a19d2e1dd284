"""The gap between a contact boundary and an obstacle, under the functional of the displacement."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError, numbers
from contact.obstacles.shapes import ObstacleLike, evaluate_gap
from contact.rows.shares import Shares

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GapRule:
    """Evaluates the gap of a contact boundary with the same functional as the displacement.

    Attributes
    ----------
    x, normals : ndarray, shape (dim, nfacets, npoints)
        Evaluation points of each facet, and outward normals there.
    shares : Shares
        Contributions of the facets to the contact points.
    x_nominal, mean_normals : ndarray, shape (dim, m)
        Nominal places and normals of the contact points, before sorting.
    slant : ndarray, shape (m,)
        Length of the mean of the facets' normals at each point, as in the rows: 1 where they
        agree.
    sharp : ndarray of bool, shape (m,)
        Facets meet there in a sharp corner.
    order : ndarray of int, shape (m,)
        Sorts the contact points.
    offset : ndarray, shape (dim, m), optional
        Vector from the vertex to the point, before sorting; for the functional ``centroid``.
    raised : ndarray, shape (dim, nfacets, npoints), optional
        Points above `x` on the curve that the facets approximate; see `Outline.raised`.
    aside : pair of ndarray, shape (dim, m), optional
        Normals along which the gap is evaluated, and those of the rows; see
        `contact.rows.unequal_facets`.
    """

    x: Array
    normals: Array
    shares: Shares
    x_nominal: Array
    mean_normals: Array
    slant: Array
    sharp: NDArray[np.bool_]
    order: NDArray[np.int64]
    offset: Array | None = None
    raised: Array | None = None
    aside: tuple[Array, Array] | None = None

    def __call__(self, obstacle: ObstacleLike) -> Array:
        """Gap of every contact point, shape (m,); ``inf`` where there is no obstacle.

        Raises
        ------
        InputError
            NaN, minus infinity or a wrong shape.
        """
        if isinstance(obstacle, np.ndarray | list | tuple):
            return given_gaps(obstacle, self.x_nominal)
        if self.offset is not None:
            gap = self._extrapolated(obstacle, self.offset)
        else:
            gap = self._read(obstacle)
        return (gap + self._turned(obstacle))[self.order]

    def rise(self, obstacle: ObstacleLike) -> Array:
        """Gap from the curve that the facets approximate, minus the gap from them, shape (m,)."""
        if self.raised is None or not np.any(self.raised != self.x):
            return np.zeros(self.order.size)
        here, there = self(obstacle), replace(self, x=self.raised)(obstacle)
        both = np.isfinite(here) & np.isfinite(there)
        return np.where(both, np.where(both, there, 0.0) - np.where(both, here, 0.0), 0.0)

    def _read(self, obstacle: ObstacleLike) -> Array:
        """Mean of the gaps of the facets at each point, before sorting."""
        shares, count = self.shares, self.order.size
        at = evaluate_gap(obstacle, self.x, self.normals)
        open_ = np.isinf(at)
        value = np.einsum("fsp,fp->fs", shares.C, np.where(open_, 0.0, at))
        blind = np.einsum("fsp,fp->fs", shares.C != 0, open_.astype(float)) > 0
        own = ~shares.lent

        def total(part: Array) -> Array:
            return np.bincount(shares.number[own], part[own], count).astype(np.float64)

        # Values of neighbouring facets are left out: they are the same where the gap is smooth, and
        # a kink or a step of the obstacle affects its own facet only.
        gap = total(value) / total(shares.omega)
        unseen = total(blind.astype(float)) > 0
        alone = np.bincount(shares.number[own], minlength=count) == 1
        gap[unseen & alone] = np.inf
        # In a corner the normals of the facets meet the obstacle at distant places, or not at all:
        # the gap is taken along their mean.
        seek = np.flatnonzero(~alone & (unseen | self.sharp))
        if seek.size:
            where = self.x_nominal[:, seek], self.mean_normals[:, seek]
            gap[seek] = evaluate_gap(obstacle, *where) * self.slant[seek]
        return gap

    def _turned(self, obstacle: ObstacleLike) -> Array:
        """Gap along the normals of the rows minus that along the facets' mean, before sorting."""
        longer = np.zeros(self.order.size)
        if self.aside is not None:
            # Normals that differ by 1e-12 at most are the same up to rounding.
            turned = np.flatnonzero(np.abs(self.aside[1] - self.aside[0]).max(axis=0) > 1e-12)
            where = self.x_nominal[:, turned]
            one, two = (evaluate_gap(obstacle, where, n[:, turned]) for n in self.aside)
            both = np.isfinite(one) & np.isfinite(two)
            one, two = np.where(both, one, 0.0), np.where(both, two, 0.0)
            longer[turned] = self.slant[turned] * (two - one)
        return longer

    def _extrapolated(self, obstacle: ObstacleLike, offset: Array) -> Array:
        """d plus its derivative along the offset, as for u; exact for quadratic d."""
        vertex = self.x_nominal - offset
        here, half, there = (
            evaluate_gap(obstacle, vertex + part * offset, self.mean_normals)
            for part in (0.0, 0.5, 1.0)
        )
        open_ = np.isinf(here) | np.isinf(half) | np.isinf(there)
        here, half, there = (np.where(open_, 0.0, d) for d in (here, half, there))
        return np.where(open_, np.inf, 4 * half - 2 * here - there)


def given_gaps(obstacle: ObstacleLike, x: Array) -> Array:
    """Gaps given as one number for each contact point, in their order; x has the shape (dim, m).

    Raises
    ------
    InputError
        A wrong number of gaps, NaN or minus infinity.
    """
    given = numbers("obstacle", obstacle)
    if given.shape not in ((), x.shape[1:]):
        raise InputError(f"obstacle: {given.size} gaps given for {x.shape[1]} contact points")
    return evaluate_gap(given, x, x)
