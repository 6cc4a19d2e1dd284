"""Facets of a surface: checks of its orientation, and intersections with lines along normals."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from contact.errors import InputError
from contact.obstacles.arguments import GRAZING
from contact.obstacles.box_tree import BoxTree
from skfem_adini.ground.arguments import array_of, numbers

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SAME = 1e-7  # relative distance of points that are merged, as in files of single precision
_NAMES = {2: ("segment", "end"), 3: ("triangle", "edge")}  # names of facets and their sides


def read_points(points: Any) -> Array:
    """Points (dim, npoints) as given, checked."""
    array = numbers("points", points)
    if array.ndim != 2 or array.shape[0] not in (2, 3):
        turned = array.ndim == 2 and array.shape[1] in (2, 3)
        raise InputError(
            f"points: expected shape (2, npoints) or (3, npoints), got {array.shape}"
            + ("; transpose it" if turned else "")
        )
    if not np.all(np.isfinite(array)):
        bad = int(np.flatnonzero(~np.isfinite(array).all(axis=0))[0])
        raise InputError(f"points: point {bad} is not finite: {array[:, bad].tolist()}")
    # Solid angles multiply four lengths: avoid overflow.
    if array.size and (largest := float(np.abs(array).max())) > 1e75:
        raise InputError(f"points: a coordinate is {largest:g}, expected at most 1e+75")
    return array


def read_facets(facets: Any, points: Array) -> Index:
    """Facets (dim, nfacets) as given, checked."""
    array = array_of("facets", facets)
    dim = points.shape[0]
    if array.ndim != 2 or array.shape[0] != dim or not array.shape[1]:
        turned = array.ndim == 2 and array.shape[1] == dim
        raise InputError(
            f"facets: expected shape ({dim}, nfacets), the points of each {_NAMES[dim][0]}, got "
            f"{array.shape}" + ("; transpose it" if turned else "")
        )
    if array.dtype.kind not in "iu" or np.ma.is_masked(facets):
        raise InputError(f"facets: expected whole numbers of points, got {array.dtype}")
    index = array.astype(np.int64)
    if index.min() < 0 or index.max() >= points.shape[1]:
        bad = int(np.flatnonzero(((index < 0) | (index >= points.shape[1])).any(axis=0))[0])
        raise InputError(
            f"facets: facet {bad} has the points {index[:, bad].tolist()}; there are "
            f"{points.shape[1]}, counted from 0"
        )
    if np.any(twice := _collapsed(index)):
        bad = int(np.flatnonzero(twice)[0])
        raise InputError(
            f"facets: facet {bad} names a point twice: {index[:, bad].tolist()}; leave it out"
        )
    return index


def merged(points: Array, facets: Index) -> tuple[Array, Index]:
    """Merge duplicate points; drop unused points and collapsed facets."""
    used, inverse = np.unique(facets, return_inverse=True)
    points, facets = points[:, used], inverse.reshape(facets.shape)
    count, tolerance = points.shape[1], SAME * _size(points)
    # Merge equal coordinates first: a point of many facets would make too many pairs.
    alone, at, of = np.unique(points + 0.0, axis=1, return_index=True, return_inverse=True)
    pairs = scipy.spatial.KDTree(alone.T).query_pairs(tolerance, output_type="ndarray")
    near = at[pairs].reshape(-1, 2)
    one, two = np.r_[near[:, 0], at[of.ravel()]], np.r_[near[:, 1], np.arange(count)]
    link = sparse.coo_array((np.ones(one.size), (one, two)), shape=(count, count))
    _, group = connected_components(link, directed=False)
    _, first, number = np.unique(group, return_index=True, return_inverse=True)
    facets = np.asarray(number)[facets].astype(np.int64)
    facets = facets[:, ~_collapsed(facets)]
    if not facets.size:
        raise InputError("points: all of them are one point; are they in another unit?")
    return points[:, first], facets


def is_free(facets: Index) -> NDArray[np.bool_]:
    """Whether each edge, numbered as in `edges_of`, belongs to one facet only."""
    number, count, _ = _edges(facets)
    return np.asarray(count[number] == 1)


def check_facets(points: Array, facets: Index) -> None:
    """Refuse facets that do not form an oriented surface.
    Facets need a positive area, and edges at most two facets, of equal orientation."""
    corners = points.T[facets.T]
    facet, edge = _NAMES[len(points)]
    edges = corners - np.roll(corners, -1, axis=1)
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    if len(points) == 3:
        height = np.linalg.norm(facet_normals(corners), axis=1) / longest
        if np.any(thin := height <= SAME * _size(points)):
            bad = int(np.flatnonzero(thin)[0])
            raise InputError(
                f"facets: {int(thin.sum())} have no area, the first at {_at(corners[bad])}; mend "
                "the mesh, for example by pyvista's clean() or in the program that wrote it"
            )
    number, count, forward = _edges(facets)
    if np.any(count > 2):
        bad = int(np.flatnonzero(count[number] > 2)[0] % facets.shape[1])
        raise InputError(
            f"facets: {int(np.sum(count > 2))} {edge}s belong to more than two {facet}s, one at "
            f"{_at(corners[bad])}; the surface of a solid has two at each: remove inner walls and "
            "double facets"
        )
    same = (count == 2) & (np.abs(forward) == 2)
    if np.any(same):
        bad = int(np.flatnonzero(same[number])[0] % facets.shape[1])
        raise InputError(
            f"facets: at {int(same.sum())} {edge}s the two {facet}s are turned differently, one at "
            f"{_at(corners[bad])}; orient them alike, for example by pyvista's "
            "compute_normals(consistent_normals=True)"
        )


def _edges(facets: Index) -> tuple[Index, Index, Array]:
    """Edge number of each facet's edges, facets at each edge, and the sum of their directions."""
    ends = edges_of(facets)
    turn = np.ones(ends.shape[1])
    if len(ends) == 1:
        turn[facets.shape[1] :] = -1.0
    else:
        turn[ends[0] > ends[1]] = -1.0
    ordered = np.sort(ends, axis=0).T
    key = ordered[:, 0] * (int(facets.max()) + 1) + ordered[:, -1]
    _, number, count = np.unique(key, return_inverse=True, return_counts=True)
    return number, count.astype(np.int64), np.bincount(number, turn).astype(np.float64)


def edges_of(facets: Index) -> Index:
    """Ends of edges, (2, 3 nfacets), in 3-D, or points, (1, 2 nfacets), in 2-D."""
    if len(facets) == 2:
        return facets.reshape(1, -1)
    return np.stack((facets.ravel(), np.roll(facets, -1, axis=0).ravel()))


def outwards(points: Array, facets: Index) -> Index:
    """Facets of a closed surface, oriented with outward normals.
    Parts inside one another must have alternating orientations, parts side by side the same."""
    corners = points.T[facets.T]
    number, _, _ = _edges(facets)
    of_edge = np.tile(np.arange(facets.shape[1]), len(number) // facets.shape[1])
    where = np.argsort(number, kind="stable").reshape(-1, 2)
    one, two = of_edge[where].T
    link = sparse.coo_array((np.ones(one.size), (one, two)), shape=(facets.shape[1],) * 2)
    parts, part = connected_components(link, directed=False)
    share = np.einsum("fi,fi->f", corners[:, 0] - points.mean(axis=1), facet_normals(corners))
    volume = np.bincount(part, share, parts)
    sign = 1.0 if volume.sum() >= 0 else -1.0
    if parts > 1:
        _check_nesting(corners, part.astype(np.int64), np.sign(sign * volume).astype(np.float64))
    return facets if sign > 0 else facets[::-1]


def _check_nesting(corners: Array, part: Index, turn: Array) -> None:
    order = np.argsort(part, kind="stable")
    own = np.split(corners[order], np.cumsum(np.bincount(part))[:-1])
    low = np.array([c.min(axis=(0, 1)) for c in own])
    high = np.array([c.max(axis=(0, 1)) for c in own])
    for i, c in enumerate(own):
        place = c[0].mean(axis=0)
        around = np.flatnonzero(np.all((low <= place) & (high >= place), axis=1))
        depth = sum(turn[j] * abs(_winding(own[j], place)) for j in around if j != i)
        # A part that touches another has a fractional number and may be either.
        if (depth > 0.75) if turn[i] > 0 else (depth < 0.25):
            where = "inside another part" if turn[i] > 0 else "inside no other part"
            raise InputError(
                f"facets: the closed part at {_at(c[0])} lies {where}, but is turned like "
                f"{'a solid' if turn[i] > 0 else 'a hole'}; turn its facets round, or unite parts "
                "that overlap"
            )


def _winding(c: Array, place: Array) -> float:
    """Winding number of facets around a point: their solid angle over the full angle.
    A. van Oosterom and J. Strackee, The solid angle of a plane triangle, IEEE Transactions on
    Biomedical Engineering 30 (1983), 125-126, equation (8)."""
    r = c - place
    length = np.linalg.norm(r, axis=2)
    if c.shape[2] == 2:
        cross = r[:, 0, 0] * r[:, 1, 1] - r[:, 0, 1] * r[:, 1, 0]
        return float(np.arctan2(cross, np.sum(r[:, 0] * r[:, 1], axis=1)).sum() / (2 * np.pi))
    volume = np.linalg.det(r)
    cosine = np.prod(length, axis=1)
    for i in range(3):
        cosine += np.sum(r[:, i] * r[:, i - 1], axis=1) * length[:, i - 2]
    return float(np.arctan2(volume, cosine).sum() / (2 * np.pi))


def _collapsed(facets: Index) -> NDArray[np.bool_]:
    return np.asarray(np.any(facets == np.roll(facets, 1, axis=0), axis=0))


def _size(points: Array) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=1)))


def _at(corners: Array) -> str:
    return "(" + ", ".join(f"{c:.6g}" for c in corners.mean(axis=0)) + ")"


def facet_normals(corners: Array) -> Array:
    """Normals of segments or triangles (nfacets, dim, dim), as long as the facet's length or area.
    Triangles are counter-clockwise seen from outside; the outside of a segment is on the right of
    its direction, so that a counter-clockwise outline is solid."""
    edge = corners[:, 1] - corners[:, 0]
    if corners.shape[2] == 2:
        return np.stack((edge[:, 1], -edge[:, 0]), axis=1)
    return np.cross(edge, corners[:, 2] - corners[:, 0])


def gap_to_facets(corners: Array, tree: BoxTree, x: Array, n: Array) -> Array:
    """Gap along n from x, both (npoints, dim), to the facet at which the line enters, or inf.
    It is negative if x is inside, the entry being behind x. Between two layers of an open surface
    the nearer counts (Moeller and Trumbore, Journal of Graphics Tools 2 (1997), 21-28)."""
    line, facet = tree.near_lines(x, n)
    c, normal = corners[facet], facet_normals(corners)[facet]
    slope = np.sum(normal * n[line], axis=1)
    size = np.linalg.norm(normal, axis=1)
    steep = np.abs(slope) > 1e-12 * size
    # 1 where a line enters the obstacle at a grazing angle, 2 at a larger one.
    faces = np.where(slope < -GRAZING * size, 2, np.where(slope < 0, 1, 0))
    line, c, normal, slope = line[steep], c[steep], normal[steep], slope[steep]
    d = np.sum(normal * (c[:, 0] - x[line]), axis=1) / slope
    foot = x[line] + d[:, None] * n[line]
    inside = np.all(coordinates(c, normal, foot) >= -1e-10, axis=1)
    line, d, enters = line[inside], d[inside], faces[steep][inside]
    ahead, ahead_enters = _nearest(len(x), line, d, enters, d >= 0)
    behind, behind_enters = _nearest(len(x), line, -d, enters, d < 0)
    nearer = (behind_enters >= 1) & (behind < ahead)
    last = np.where(behind_enters == 2, -behind, np.inf)
    first = np.where(ahead_enters == 2, ahead, np.inf)
    return np.where((ahead_enters >= 1) & ~nearer, first, last)


def _nearest(count: int, line: Index, d: Array, enters: Index, among: Array) -> tuple[Array, Index]:
    """Least d of each line, inf if there is none, and how the line enters there."""
    line, d, enters = line[among], d[among], enters[among]
    order = np.lexsort((-enters, d, line))
    first, at = np.unique(line[order], return_index=True)
    least, entering = np.full(count, np.inf), np.zeros(count, dtype=np.int64)
    least[first], entering[first] = d[order][at], enters[order][at]
    return least, entering


def coordinates(c: Array, normal: Array, foot: Array) -> Array:
    """Barycentric coordinates of points in the planes of the facets."""
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
