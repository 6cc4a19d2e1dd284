"""Where several facets of the other side lie on one line, only the nearest takes part."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from contact.rows.mortar.convex_polygons import common, measured, outside, padded

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Part of a facet that two polygons may have in common by rounding.
OVERLAP = 1e-10


def nearest_polygons(
    polygon: Array,
    size: Index,
    facet: Index,
    area: Array,
    distance: Callable[[Index, Array], Array],
) -> tuple[Array, Index, Index]:
    """Cut what is hidden by nearer polygons out of the polygons of each facet.

    Which of two is nearer is decided in the middle of what they have in common.

    Parameters
    ----------
    polygon, size
        See `contact.rows.mortar.convex_polygons`, with the interior on the left.
    facet : ndarray of int, shape (n,)
        The facet in whose plane each polygon lies.
    area : ndarray, shape (nfacets,)
    distance : callable (k, place) -> d
        Distance of polygons k from the facet at places of shape (2, len(k)).

    Returns
    -------
    polygon, size
        The pieces that are left.
    source : ndarray of int
        The polygon that each is a piece of.
    """
    source = np.arange(size.size)
    while True:
        own = facet[source]
        covered = np.bincount(own, measured(polygon, size)[0], area.size)
        a, b = _neighbours(own, covered > area * (1.0 + OVERLAP))
        both, corners = common(polygon[a], size[a], polygon[b], size[b])
        shared, middle = measured(both, corners)
        real = (shared > OVERLAP * area[own[a]]) & (source[a] != source[b])
        a, b, middle = a[real], b[real], middle[real]
        far = np.where(distance(source[a], middle.T) > distance(source[b], middle.T), a, b)
        # Of each piece one nearer one is cut out at a time.
        cut, first = np.unique(far, return_index=True)
        if not cut.size:
            return polygon, size, source
        near = np.where(far == a, b, a)[first]
        parts = [
            (part, corners, source[cut])
            for part, corners in outside(polygon[cut], size[cut], polygon[near], size[near])
        ]
        rest = np.setdiff1d(np.arange(size.size), cut)
        parts.append((polygon[rest], size[rest], source[rest]))
        width = max(part.shape[1] for part, _, _ in parts)
        polygon = np.concatenate([padded(part, width) for part, _, _ in parts])
        size, source = (np.concatenate([part[k] for part in parts]) for k in (1, 2))
        kept = measured(polygon, size)[0] > OVERLAP * area[facet[source]]
        polygon, size, source = polygon[kept], size[kept], source[kept]


def _neighbours(own: Index, crowded: NDArray[np.bool_]) -> tuple[Index, Index]:
    """All pairs of polygons of one crowded facet."""
    member = np.flatnonzero(crowded[own])
    member = member[np.argsort(own[member], kind="stable")]
    _, start, count = np.unique(own[member], return_index=True, return_counts=True)
    behind = np.repeat(start + count, count) - np.arange(member.size) - 1
    one = np.repeat(np.arange(member.size), behind)
    ahead = np.arange(one.size) - np.repeat(np.cumsum(behind) - behind, behind) + 1
    return member[one], member[one + ahead]
