"""The gap between a contact boundary and an obstacle, under the functional of the displacement."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError
from contact.obstacles.shapes import ObstacleLike, evaluate_gap, within_reach
from contact.rows.functionals import FacetFunctional
from contact.rows.outline import Outline
from contact.rows.shares import Shares
from skfem_adini.ground.arguments import numbers

Array = NDArray[np.float64]
# A gap is smooth up to this ratio of the interpolation error between the points to the excess of
# the mean over their range: 1/4 at a kink, more at a step.
_SMOOTH = 0.2


@dataclass(frozen=True)
class GapRule:
    """Evaluates the gap of a contact boundary with the same functional as the displacement.
    Negative weights are correct if the gap is a polynomial; otherwise, as at a step, a mean is
    limited to the range of its gaps."""

    x: Array  # evaluation points, shape (dim, nfacets, npoints)
    normals: Array  # outward normals there
    shares: Shares  # contributions of the facets to the contact points
    x_nominal: Array  # nominal places of the contact points, not sorted, shape (dim, m)
    mean_normals: Array  # their normals, not sorted, shape (dim, m)
    slant: Array  # length of the mean of the facets' normals, 1 where they agree, shape (m,)
    sharp: NDArray[np.bool_]  # where facets meet in a sharp corner, shape (m,)
    order: NDArray[np.int64]  # sorts the contact points, shape (m,)
    size: float  # largest extent of the body: no gap exceeds the nearest one by more
    between: Array  # interpolation to positions between the points, shape (npoints, nplaces)
    offset: Array | None = None  # offset from the vertex for ``centroid``, not sorted, (dim, m)
    raised: Array | None = None  # points above x on the curve, see `Outline.raised`
    aside: tuple[Array, Array] | None = None  # normals of the gap and of the rows, (dim, m)
    source: tuple[Outline, FacetFunctional] | None = None  # what the rule was made of

    def __call__(self, obstacle: ObstacleLike) -> Array:
        """Gap of every contact point, shape (m,); ``inf`` where there is no obstacle.
        Raises InputError for NaN, minus infinity or a wrong shape."""
        if isinstance(obstacle, np.ndarray | list | tuple):
            return given_gaps(obstacle, self.x_nominal)
        if self.offset is not None:
            gap = self._extrapolated(obstacle, self.offset)
        else:
            gap = self._read(obstacle)
        return (gap + self._turned(obstacle, _nearest(gap)))[self.order]

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
        nearest = _nearest(at)
        at = within_reach(obstacle, at, nearest, self.size)
        open_ = np.isinf(at)
        value = np.einsum("fsp,fp->fs", shares.C, np.where(open_, 0.0, at))
        blind = np.einsum("fsp,fp->fs", shares.C != 0, open_.astype(float)) > 0
        own = ~shares.lent

        def total(part: Array) -> Array:
            return np.bincount(shares.number[own], part[own], count).astype(np.float64)

        # Omit values of neighbouring facets: for a smooth gap they are equal, and a kink or step of
        # the obstacle then affects its own facet only.
        gap = self._bounded(obstacle, total(value) / total(shares.omega), np.where(open_, 0.0, at))
        unseen = total(blind.astype(float)) > 0
        alone = np.bincount(shares.number[own], minlength=count) == 1
        gap[unseen & alone] = np.inf
        # In a corner the facet normals may meet the obstacle at distant points, or not at all: take
        # the gap along their mean.
        seek = np.flatnonzero(~alone & (unseen | self.sharp))
        if seek.size:
            where = self.x_nominal[:, seek], self.mean_normals[:, seek]
            found = within_reach(obstacle, evaluate_gap(obstacle, *where), nearest, self.size)
            gap[seek] = found * self.slant[seek]
        return gap

    def _bounded(self, obstacle: ObstacleLike, gap: Array, at: Array) -> Array:
        """The means, limited to the range of their gaps where the gap is not a polynomial."""
        shares = self.shares
        least, most = np.full(gap.size, np.inf), np.full(gap.size, -np.inf)
        facet, value, point = np.nonzero((shares.C != 0) & ~shares.lent[:, :, None])
        np.minimum.at(least, shares.number[facet, value], at[facet, point])
        np.maximum.at(most, shares.number[facet, value], at[facet, point])
        k, beyond = _outside(gap, least, most)
        out = np.zeros(gap.size, dtype=bool)
        out[k] = True
        own = ~shares.lent
        seen = np.flatnonzero((out[shares.number] & own).any(axis=1))
        if seen.size:
            x, n = self.x[:, seen] @ self.between, self.normals[:, seen] @ self.between
            there = evaluate_gap(obstacle, x, n / np.linalg.norm(n, axis=0))
            missed = np.zeros(gap.size)
            off = np.abs(there - at[seen] @ self.between).max(axis=1)
            facet, value = np.nonzero(own[seen])
            np.maximum.at(missed, shares.number[seen[facet], value], off[facet])
            k = k[missed[k] > _SMOOTH * beyond]
            gap[k] = np.clip(gap[k], least[k], most[k])
        return gap

    def _turned(self, obstacle: ObstacleLike, nearest: float) -> Array:
        """Gap along the normals of the rows minus that along the facets' mean, before sorting."""
        longer = np.zeros(self.order.size)
        if self.aside is not None:
            # Normals that differ by at most 1e-12 are equal.
            turned = np.flatnonzero(np.abs(self.aside[1] - self.aside[0]).max(axis=0) > 1e-12)
            where = self.x_nominal[:, turned]
            one, two = (
                within_reach(
                    obstacle, evaluate_gap(obstacle, where, n[:, turned]), nearest, self.size
                )
                for n in self.aside
            )
            both = np.isfinite(one) & np.isfinite(two)
            one, two = np.where(both, one, 0.0), np.where(both, two, 0.0)
            longer[turned] = self.slant[turned] * (two - one)
        return longer

    def _extrapolated(self, obstacle: ObstacleLike, offset: Array) -> Array:
        """Gap d plus its derivative along the offset, as for u; exact for quadratic d."""
        vertex = self.x_nominal - offset

        def read(parts: tuple[float, ...], k: Any = slice(None)) -> Array:
            n = self.mean_normals[:, k]
            return np.array(
                [evaluate_gap(obstacle, vertex[:, k] + p * offset[:, k], n) for p in parts]
            )

        at = read((0.0, 0.5, 1.0))
        at = within_reach(obstacle, at, _nearest(at), self.size)
        open_ = np.isinf(at).any(axis=0)
        at = np.where(open_, 0.0, at)
        gap = 4 * at[1] - 2 * at[0] - at[2]
        least, most = at.min(axis=0), at.max(axis=0)
        k, beyond = _outside(gap, least, most)
        if k.size:
            quadratic = np.array([[0.375, 0.75, -0.125], [-0.125, 0.75, 0.375]]) @ at[:, k]
            missed = np.abs(read((0.25, 0.75), k) - quadratic).max(axis=0)
            # These weights are twice those of means: 1/8 at a kink, 3/16 at a step.
            k = k[missed > 0.5 * _SMOOTH * beyond]
            gap[k] = np.clip(gap[k], least[k], most[k])
        return np.where(open_, np.inf, gap)


def _outside(gap: Array, least: Array, most: Array) -> tuple[NDArray[np.int64], Array]:
    """Mask of means outside the range of their gaps, beyond rounding, and the excess."""
    beyond = np.maximum(least - gap, gap - most)
    k = np.flatnonzero(beyond > 1e-12 * np.maximum(np.abs(least), np.abs(most)))
    return k, beyond[k]


def _nearest(gap: Array) -> float:
    """Smallest absolute gap, ``inf`` if there is none."""
    return float(np.abs(gap).min(initial=np.inf))


def given_gaps(obstacle: ObstacleLike, x: Array) -> Array:
    """Check gaps given as one number per contact point x (dim, m).
    Raises InputError for a wrong number of gaps, NaN or minus infinity."""
    given = numbers("obstacle", obstacle)
    if given.shape not in ((), x.shape[1:]):
        raise InputError(f"obstacle: {given.size} gaps given for {x.shape[1]} contact points")
    return evaluate_gap(given, x, x)
