"""Where lines along the normals of a body meet the flat facets of a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from contact.obstacles.arguments import GRAZING
from contact.obstacles.box_tree import BoxTree

Array = NDArray[np.float64]
_ENTERS, _FACES = 1, 2  # a line enters the obstacle there, by so small an angle or a larger one


def facet_normals(corners: Array) -> Array:
    """Normals of segments or triangles (nfacets, dim, dim), as long as the facet is large.
    Triangles turn counter-clockwise seen from outside; the outside of a segment is on the right
    of the way from its first to its second end, so that a counter-clockwise outline is solid."""
    edge = corners[:, 1] - corners[:, 0]
    if corners.shape[2] == 2:
        return np.stack((edge[:, 1], -edge[:, 0]), axis=1)
    return np.cross(edge, corners[:, 2] - corners[:, 0])


def gap_to_facets(corners: Array, tree: BoxTree, x: Array, n: Array) -> Array:
    """Gap along n from x, both (npoints, dim), to the facet ahead that the line enters, or inf.
    If it entered behind x, x lies inside: negative. Between two layers of an open surface the
    nearer counts (Moeller and Trumbore, Journal of Graphics Tools 2 (1997), 21-28)."""
    line, facet = tree.near_lines(x, n)
    c, normal = corners[facet], facet_normals(corners)[facet]
    slope = np.sum(normal * n[line], axis=1)
    size = np.linalg.norm(normal, axis=1)
    steep = np.abs(slope) > 1e-12 * size
    faces = np.where(slope < -GRAZING * size, _FACES, np.where(slope < 0, _ENTERS, 0))
    line, c, normal, slope = line[steep], c[steep], normal[steep], slope[steep]
    d = np.sum(normal * (c[:, 0] - x[line]), axis=1) / slope
    foot = x[line] + d[:, None] * n[line]
    inside = np.all(coordinates(c, normal, foot) >= -1e-10, axis=1)
    line, d, enters = line[inside], d[inside], faces[steep][inside]
    ahead, ahead_enters = _nearest(len(x), line, d, enters, d >= 0)
    behind, behind_enters = _nearest(len(x), line, -d, enters, d < 0)
    nearer = (behind_enters >= _ENTERS) & (behind < ahead)
    last = np.where(behind_enters == _FACES, -behind, np.inf)
    first = np.where(ahead_enters == _FACES, ahead, np.inf)
    return np.where((ahead_enters >= _ENTERS) & ~nearer, first, last)


def _nearest(
    count: int, line: NDArray[np.int64], d: Array, enters: NDArray[np.int64], among: Array
) -> tuple[Array, NDArray[np.int64]]:
    """Least d of each line, inf if there is none, and how the line enters there."""
    line, d, enters = line[among], d[among], enters[among]
    order = np.lexsort((-enters, d, line))
    first, at = np.unique(line[order], return_index=True)
    least, entering = np.full(count, np.inf), np.zeros(count, dtype=np.int64)
    least[first], entering[first] = d[order][at], enters[order][at]
    return least, entering


def coordinates(c: Array, normal: Array, foot: Array) -> Array:
    """Barycentric coordinates of places in the planes of the facets."""
    if c.shape[2] == 2:
        edge = c[:, 1] - c[:, 0]
        s = np.sum((foot - c[:, 0]) * edge, axis=1) / np.sum(edge * edge, axis=1)
        return np.stack((1.0 - s, s), axis=1)
    area = np.einsum("fi,fi->f", normal, normal)
    parts = [
        np.einsum("fi,fi->f", np.cross(normal, c[:, i] - c[:, i - 1]), foot - c[:, i - 1]) / area
        for i in range(3)
    ]
    return np.stack(parts, axis=1)
