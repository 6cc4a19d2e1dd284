"""Segments of an interface in space: facets of one side cut by those of the other.

Both facets of a pair are projected along the normal in the middle of the non-mortar one onto its
mean plane, where the polygon that they have in common is found by clipping (I. E. Sutherland and G.
W. Hodgman, Reentrant polygon clipping, Comm. ACM 17 (1974)), all pairs at once. Triangles from its
middle carry Gauss points. From there, lines along the same normal meet both facets, curved or not
(M. A. Puso and T. A. Laursen, Comput. Methods Appl. Mech. Engrg. 193 (2004)).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTri

from contact.errors import InputError
from contact.rows.mortar.face_maps import FaceMaps
from contact.rows.mortar.interface_quadrature import InterfaceQuadrature
from contact.rows.outline import reference_corners

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FACING = 0.25  # least cosine between a normal and the one opposite it
BLOCK = 1_000_000  # pairs looked at together
SLIVER = 1e-12  # part of the smaller facet below which a polygon is rounding


def polygon_quadrature(
    first: FaceMaps, second: FaceMaps, outward: tuple[Array, Array], degree: int
) -> InterfaceQuadrature:
    """Gauss points on all polygons of an interface in space.

    Parameters
    ----------
    first, second : FaceMaps
        Non-mortar and mortar side.
    outward : pair of ndarray, shapes (3, nfacets)
        Outward unit normals in the middle of the facets of either side.
    degree : int
        Of polynomials in the plane to be integrated exactly.

    Raises
    ------
    InputError
        No facet faces another one, or only such as have normals that point the same way.
    """
    facet, other = _pairs(first, second, outward, 1.0)
    frame = _frames(first, outward[0], facet)
    polygon, size = _common(first, second, facet, other, frame)
    area, middle = _measured(polygon, size)
    least = SLIVER * np.minimum(_extent(first)[facet], _extent(second)[other]) ** 2
    kept = area > least
    if not kept.any():
        same = _pairs(first, second, outward, -1.0)[0].size
        raise InputError(
            "others: the normals of the two boundaries point the same way; a contact boundary must "
            "face the surface of the other body"
            if same
            else "others: no facet lies opposite the contact boundary, along its normals; check "
            "the places of the bodies and the names of the boundaries"
        )
    facet, other, polygon, size, middle = (
        facet[kept], other[kept], polygon[kept], size[kept], middle[kept],
    )  # fmt: skip
    frame = frame[0][:, kept], frame[1][:, :, kept]
    at, place, w = _points(polygon, size, middle, degree)
    origin, axes = frame[0][:, at], frame[1][:, :, at]
    x = origin + np.einsum("dan,an->dn", axes[:, :2], place)
    facet, other, along = facet[at], other[at], axes[:, 2]
    X, Y = first.met(facet, x, along), second.met(other, x, along)
    slant = np.abs(np.sum(first.normal(facet, X) * along, axis=0))
    quadrature = InterfaceQuadrature(
        first.at(facet, X), second.at(other, Y), first.direction(facet, X), w / slant,
        facet, other, X, Y,
    )  # fmt: skip
    return _within_reach(quadrature, first, second)


def _within_reach(q: InterfaceQuadrature, first: FaceMaps, second: FaceMaps) -> InterfaceQuadrature:
    """Points whose gap is no larger than the boundaries, and whose overlap than half of that."""
    reach = [float(np.linalg.norm(np.ptp(side.nodes, axis=(1, 2)))) for side in (first, second)]
    near = (q.gap <= max(reach)) & (q.gap >= -0.5 * min(reach))
    if not near.any():
        raise InputError(
            f"others: no facet lies opposite the contact boundary, along its normals within "
            f"{max(reach):g}; check the places of the bodies and the names of the boundaries"
        )
    points = q.x[:, near], q.y[:, near], q.n[:, near], q.w[near]
    return InterfaceQuadrature(*points, q.facet[near], q.other[near], q.X[:, near], q.Y[:, near])


def _pairs(
    first: FaceMaps, second: FaceMaps, outward: tuple[Array, Array], facing: float
) -> tuple[Index, Index]:
    """Pairs whose normals are opposite (or, with -1, point the same way) and which may overlap."""
    middles = [side.nodes[:, :, : side.corners].mean(axis=2) for side in (first, second)]
    radii = [
        np.linalg.norm(side.nodes - m[..., None], axis=0).max(axis=1)
        for side, m in zip((first, second), middles, strict=True)
    ]
    found: list[Index] = []
    count, others = middles[0].shape[1], middles[1].shape[1]
    step = max(1, BLOCK // others)
    for start in range(0, count, step):
        here = np.arange(start, min(count, start + step))
        n = outward[0][:, here]
        towards = -facing * (n.T @ outward[1]) > FACING
        off = middles[1][:, None] - middles[0][:, here, None]
        lift = np.einsum("df,dfg->fg", n, off)
        aside = np.sqrt(np.maximum(np.sum(off * off, axis=0) - lift**2, 0.0))
        f, g = np.nonzero(towards & (aside <= radii[0][here, None] + radii[1]))
        found.append(np.array([here[f], g]))
    facet, other = np.hstack(found)
    return facet, other


def _frames(first: FaceMaps, outward: Array, facet: Index) -> tuple[Array, Array]:
    """Middle of each non-mortar facet, (3, n), and axes, the last its normal, (3, 3, n)."""
    middle = first.nodes[:, :, : first.corners].mean(axis=2)
    side = first.nodes[:, :, 1] - first.nodes[:, :, 0]
    one = side - np.sum(side * outward, axis=0) * outward
    one /= np.linalg.norm(one, axis=0)
    axes = np.stack((one, np.cross(outward, one, axis=0), outward), axis=1)
    return middle[:, facet], axes[:, :, facet]


def _extent(side: FaceMaps) -> Array:
    return np.asarray(np.ptp(side.nodes[:, :, : side.corners], axis=2).max(axis=0))


def _common(
    first: FaceMaps, second: FaceMaps, facet: Index, other: Index, frame: tuple[Array, Array]
) -> tuple[Array, Index]:
    """The common polygon of each pair, padded, shape (n, 8, 2), and its number of corners."""
    origin, axes = frame
    flat = [
        np.einsum(
            "dan,dnk->nka", axes[:, :2], side.nodes[:, on, : side.corners] - origin[..., None]
        )
        for side, on in ((first, facet), (second, other))
    ]
    window, polygon = (_anticlockwise(corners) for corners in flat)
    size = np.full(len(polygon), polygon.shape[1])
    for k in range(window.shape[1]):
        a, b = window[:, k], window[:, (k + 1) % window.shape[1]]
        polygon, size = _clipped(polygon, size, a, b)
    return polygon, size


def _anticlockwise(corners: Array) -> Array:
    """Polygons, shape (n, k, 2), with the interior on the left."""
    x, y = corners[..., 0], corners[..., 1]
    area = np.sum(x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y, axis=1)
    return np.where((area < 0)[:, None, None], corners[:, ::-1], corners)


def _clipped(polygon: Array, size: Index, a: Array, b: Array) -> tuple[Array, Index]:
    """The part of each polygon on the left of the line from a to b."""
    count, width = polygon.shape[:2]
    index = np.arange(width)
    real = index < size[:, None]
    after = np.where(index + 1 < size[:, None], index + 1, 0)
    following = np.take_along_axis(polygon, after[..., None], axis=1)
    way = b - a

    def height(p: Array) -> Array:
        off = p - a[:, None]
        return way[:, None, 0] * off[..., 1] - way[:, None, 1] * off[..., 0]

    here, there = height(polygon), height(following)
    crossing = real & ((here >= 0) != (there >= 0))
    share = here / np.where(crossing, here - there, 1.0)
    cut = polygon + share[..., None] * (following - polygon)
    # Each corner is followed by the place where its edge meets the line.
    points = np.stack((polygon, cut), axis=2).reshape(count, 2 * width, 2)
    keep = np.stack((real & (here >= 0), crossing), axis=2).reshape(count, 2 * width)
    order = np.argsort(~keep, axis=1, kind="stable")
    size = keep.sum(axis=1)
    width = max(3, int(size.max(initial=0)))
    return np.take_along_axis(points, order[..., None], axis=1)[:, :width], size


def _measured(polygon: Array, size: Index) -> tuple[Array, Array]:
    """Area and middle of the corners of each polygon, shapes (n,) and (n, 2)."""
    real = np.arange(polygon.shape[1]) < size[:, None]
    middle = np.sum(np.where(real[..., None], polygon, 0.0), axis=1) / np.maximum(size, 1)[:, None]
    return _triangles(polygon, size, middle)[2].sum(axis=1), middle


def _triangles(polygon: Array, size: Index, middle: Array) -> tuple[Array, Array, Array]:
    """Edges of the polygons from the middle, and areas of the triangles; zero where padded."""
    index = np.arange(polygon.shape[1])
    after = np.where(index + 1 < size[:, None], index + 1, 0)
    one = polygon - middle[:, None]
    two = np.take_along_axis(polygon, after[..., None], axis=1) - middle[:, None]
    area = 0.5 * (one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0])
    return one, two, np.where(index < size[:, None], area, 0.0)


def _points(polygon: Array, size: Index, middle: Array, degree: int) -> tuple[Index, Array, Array]:
    """Polygon, place in its plane (2, n) and weight of each Gauss point."""
    one, two, area = _triangles(polygon, size, middle)
    at, k = np.nonzero(area > 0)
    points, weights = _positive_rule(degree)
    place = (
        middle[at][..., None]
        + one[at, k][..., None] * points[0]
        + two[at, k][..., None] * points[1]
    )
    w = 2.0 * area[at, k][:, None] * weights
    return np.repeat(at, weights.size), place.transpose(1, 0, 2).reshape(2, -1), w.ravel()


def _positive_rule(degree: int) -> tuple[Array, Array]:
    """Points and weights on the reference triangle; rules with negative weights are passed over."""
    while True:
        points, weights = get_quadrature(RefTri, degree)
        if np.all(weights > 0):
            return np.asarray(points), np.asarray(weights)
        degree += 1


def middle_normals(maps: FaceMaps, at_corners: Array) -> Array:
    """Outward unit normals in the middle of facets, (3, nfacets), given those at the corners."""
    facets = np.arange(maps.nodes.shape[1])
    place = reference_corners(3, maps.corners).mean(axis=1)
    n = maps.normal(facets, np.repeat(place[:, None], facets.size, axis=1))
    return np.asarray(n * np.sign(np.sum(n * at_corners.sum(axis=2), axis=0)))
