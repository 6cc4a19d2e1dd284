"""The place of a surface of flat facets that is nearest to each of many points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from contact.obstacles.box_tree import BoxTree
from contact.obstacles.facet_rays import coordinates, facet_normals

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Nearest:
    """The nearest places of a surface.

    Attributes
    ----------
    foot : ndarray, shape (npoints, dim)
    facet : ndarray, shape (npoints,)
    part : ndarray, shape (npoints,)
        Where on the facet: 0 within it, then its edges (in 3-D, the first from the first corner to
        the second), then its corners.
    """

    foot: Array
    facet: Index
    part: Index


def nearest_on_facets(
    corners: Array, tree: BoxTree, vertices: scipy.spatial.KDTree, x: Array
) -> Nearest:
    """Nearest places of facets (nfacets, dim, dim) to x (npoints, dim); of two, the first facet.

    The nearest of the vertices and a facet in boxes near x bound the distance: among small facets
    and beside large ones.
    """
    normals = facet_normals(corners)
    facet = tree.one_near(x)
    foot, part = _on_each(corners[facet], normals[facet], x)
    square = _square(x - foot)
    bound = np.minimum(square, vertices.query(x)[0] ** 2)
    for place, candidate in tree.near_points(x, bound):
        if not place.size:
            continue
        there, where = _on_each(corners[candidate], normals[candidate], x[place])
        away = _square(x[place] - there)
        first = _least(place, away, candidate)
        one, new, away = place[first], candidate[first], away[first]
        nearer = (away < square[one]) | ((away == square[one]) & (new < facet[one]))
        one, first = one[nearer], first[nearer]
        square[one], facet[one] = away[nearer], new[nearer]
        foot[one], part[one] = there[first], where[first]
        np.minimum(bound, square, out=bound)
    return Nearest(foot, facet, part)


def _least(place: Index, away: Array, facet: Index) -> Index:
    """For each place the pair of the least distance; of equal ones, that of the first facet."""
    order = np.lexsort((facet, away, place))
    return np.asarray(order[np.flatnonzero(np.diff(place[order], prepend=-1))])


def _on_each(c: Array, normal: Array, x: Array) -> tuple[Array, Index]:
    """Nearest place of one facet for each x, and the part of the facet that it lies on.

    References
    ----------
    C. Ericson, Real-Time Collision Detection, Morgan Kaufmann 2005, section 5.1.
    """
    dim = c.shape[2]
    if dim == 2:
        foot, s = _on_segment(c[:, 0], c[:, 1], x)
        return foot, np.where(s <= 0, 1, np.where(s >= 1, 2, 0))
    area = _square(normal)
    height = np.einsum("fi,fi->f", x - c[:, 0], normal) / area
    foot = x - height[:, None] * normal
    part = np.zeros(len(x), dtype=np.int64)
    beside = np.flatnonzero(np.any(coordinates(c, normal, x) <= 0, axis=1))
    least = np.full(beside.size, np.inf)
    for i in range(3):
        there, s = _on_segment(c[beside, i], c[beside, i - 2], x[beside])
        away = _square(x[beside] - there)
        nearer = away < least
        at = beside[nearer]
        least[nearer], foot[at], s = away[nearer], there[nearer], s[nearer]
        part[at] = np.where(s <= 0, 4 + i, np.where(s >= 1, 4 + (i + 1) % 3, 1 + i))
    return foot, part


def _on_segment(start: Array, end: Array, x: Array) -> tuple[Array, Array]:
    edge = end - start
    s = np.einsum("fi,fi->f", x - start, edge) / _square(edge)
    s = np.clip(s, 0.0, 1.0)
    foot = start + s[:, None] * edge
    return np.where((s >= 1)[:, None], end, foot), s


def _square(vectors: Array) -> Array:
    return np.asarray(np.einsum("fi,fi->f", vectors, vectors))
