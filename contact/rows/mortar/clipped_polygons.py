"""Segments of an interface in space: facets of one side cut by those of the other.

Corners of mortar facets are projected along averaged normals onto the mean plane of the non-mortar
facet, where the polygon that a pair has in common is found by clipping, all pairs at once.
Triangles from one of its corners carry Gauss points x. From there the line along the averaged
normal meets the mortar facet in y: the force of a contact point acts on both bodies along one line,
so that moments cancel whatever the gap. On a flat interface these are the polygons of M. A. Puso
and T. A. Laursen (Comput. Methods Appl. Mech. Engrg. 193 (2004)), who project along the normal of
the plane. On a curved one with a gap their y - x is not along the averaged normal, and facets of
second order are not covered up to their curved edges.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import roots_jacobi

from contact.errors import InputError
from contact.rows.mortar.convex_polygons import anticlockwise, common, measured, triangles
from contact.rows.mortar.face_maps import FaceMaps
from contact.rows.mortar.facet_planes import FacetPlanes
from contact.rows.mortar.interface_quadrature import InterfaceQuadrature
from contact.rows.mortar.nearest_polygons import nearest_polygons
from contact.rows.outline import reference_corners

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FACING = 0.25  # least cosine between a normal and the one opposite it
BLOCK = 1_000_000  # pairs looked at together
SLIVER = 1e-13  # part of the smaller facet below which a polygon is rounding


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
    planes = FacetPlanes.of(first, outward[0])
    facet, other = _pairs(planes, second, outward, 1.0)
    polygon, size = _common(planes, second, facet, other)
    area, middle = measured(polygon, size)
    least = SLIVER * np.minimum(planes.area()[facet], _extent(second)[other] ** 2)
    kept = area > least
    if not kept.any():
        same = _pairs(planes, second, outward, -1.0)[0].size
        raise InputError(
            "others: the normals of the two boundaries point the same way; a contact boundary must "
            "face the surface of the other body"
            if same
            else "others: no facet lies opposite the contact boundary, along its normals; check "
            "the places of the bodies and the names of the boundaries"
        )
    on = np.flatnonzero(kept)
    gap = _gaps(planes, second, outward[1], facet[on], other[on], middle[on].T)
    on = on[_within_reach(gap, first, second)]
    facet, other = facet[on], other[on]

    def distance(k: Index, place: Array) -> Array:
        return np.abs(_gaps(planes, second, outward[1], facet[k], other[k], place))

    polygon, size, k = nearest_polygons(polygon[on], size[on], facet, planes.area(), distance)
    at, place, w = _points(polygon, size, degree)
    facet, other = facet[k[at]], other[k[at]]
    X = planes.inverse(facet, place)
    x, n = first.at(facet, X), first.direction(facet, X)
    Y = second.met(other, x, n)
    return InterfaceQuadrature(
        x, second.at(other, Y), n, w * planes.stretch(facet, X), facet, other, X, Y
    )


def _within_reach(gap: Array, first: FaceMaps, second: FaceMaps) -> NDArray[np.bool_]:
    """Where the gap is no larger than the boundaries, and the overlap than half of that."""
    reach = [float(np.linalg.norm(np.ptp(side.nodes, axis=(1, 2)))) for side in (first, second)]
    near = (gap <= max(reach)) & (gap >= -0.5 * min(reach))
    if not near.any():
        raise InputError(
            f"others: no facet lies opposite the contact boundary, along its normals within "
            f"{max(reach):g}; check the places of the bodies and the names of the boundaries"
        )
    return np.asarray(near)


def _gaps(
    planes: FacetPlanes, second: FaceMaps, outward: Array, facet: Index, other: Index, place: Array
) -> Array:
    """Gaps at places (2, n) of the mean planes to the tangent planes of mortar facets."""
    X = planes.inverse(facet, place)
    x, n = planes.maps.at(facet, X), planes.maps.direction(facet, X)
    off = second.nodes[:, other, : second.corners].mean(axis=2) - x
    against = np.minimum(np.sum(outward[:, other] * n, axis=0), -0.5 * FACING)
    return np.asarray(np.sum(off * outward[:, other], axis=0) / against)


def _pairs(
    planes: FacetPlanes, second: FaceMaps, outward: tuple[Array, Array], facing: float
) -> tuple[Index, Index]:
    """Pairs whose normals are opposite (or, with -1, point the same way) and which may overlap."""
    first, spread = planes.maps, planes.spread()
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
        room = radii[0][here, None] + radii[1] + np.abs(lift) * spread[here, None]
        f, g = np.nonzero(towards & (aside <= room))
        found.append(np.array([here[f], g]))
    facet, other = np.hstack(found)
    return facet, other


def _extent(side: FaceMaps) -> Array:
    return np.asarray(np.ptp(side.nodes[:, :, : side.corners], axis=2).max(axis=0))


def _common(
    planes: FacetPlanes, second: FaceMaps, facet: Index, other: Index
) -> tuple[Array, Index]:
    """The common polygon of each pair, padded, and its number of corners."""
    count = second.corners
    y = second.nodes[:, other, :count].reshape(3, -1)
    image = planes.image(np.repeat(facet, count), y).reshape(2, -1, count)
    window, polygon = (
        anticlockwise(flat.transpose(1, 2, 0)) for flat in (planes.polygon[:, facet], image)
    )
    sides = np.full(facet.size, window.shape[1])
    return common(polygon, np.full(facet.size, count), window, sides)


def _points(polygon: Array, size: Index, degree: int) -> tuple[Index, Array, Array]:
    """Polygon, place in its plane (2, n) and weight of each Gauss point."""
    corner = polygon[:, 0]
    one, two, area = triangles(polygon, size, corner)
    at, k = np.nonzero(area > 0)
    points, weights = _collapsed_rule(degree)
    place = (
        corner[at][..., None]
        + one[at, k][..., None] * points[0]
        + two[at, k][..., None] * points[1]
    )
    w = 2.0 * area[at, k][:, None] * weights
    return np.repeat(at, weights.size), place.transpose(1, 0, 2).reshape(2, -1), w.ravel()


def _collapsed_rule(degree: int) -> tuple[Array, Array]:
    """Positive points and weights on the reference triangle, exact to the last digit.

    Those of a square whose one side is collapsed (A. H. Stroud, Approximate Calculation of Multiple
    Integrals, Prentice-Hall 1971, section 2.4).
    """
    count = degree // 2 + 1
    (u, wu), (v, wv) = (roots_jacobi(count, power, 0) for power in (1, 0))
    x, y = 0.5 * (1.0 + u)[:, None], 0.5 * (1.0 + v)
    points = np.array([x + 0.0 * y, (1.0 - x) * y]).reshape(2, -1)
    return points, 0.125 * np.outer(wu, wv).ravel()


def middle_normals(maps: FaceMaps, at_corners: Array) -> Array:
    """Outward unit normals in the middle of facets, (3, nfacets), given those at the corners."""
    facets = np.arange(maps.nodes.shape[1])
    place = reference_corners(3, maps.corners).mean(axis=1)
    n = maps.normal(facets, np.repeat(place[:, None], facets.size, axis=1))
    return np.asarray(n * np.sign(np.sum(n * at_corners.sum(axis=2), axis=0)))
