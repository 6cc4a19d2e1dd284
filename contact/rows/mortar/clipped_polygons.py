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

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import roots_jacobi

from contact.errors import InputError
from contact.rows.mortar.face_maps import FaceMaps, shapes
from contact.rows.mortar.interface_quadrature import InterfaceQuadrature
from contact.rows.outline import reference_corners

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FACING = 0.25  # least cosine between a normal and the one opposite it
BLOCK = 1_000_000  # pairs looked at together
SLIVER = 1e-13  # part of the smaller facet below which a polygon is rounding


def polygon_quadrature(
    first: FaceMaps, second: FaceMaps, outward: tuple[Array, Array], degree: int
) -> InterfaceQuadrature:
    """Gauss points on the common polygons of all facing pairs, exact up to a degree in the plane.
    `outward` holds the unit normals in the middle of the facets of either side, (3, nfacets).
    Raises InputError where no facet faces another one with an opposite normal."""
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
    """Positive points and weights on the reference triangle: a Gauss rule of the square, collapsed.
    A. H. Stroud, Approximate Calculation of Multiple Integrals, Prentice-Hall 1971, section 2.4."""
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


# Part of the area of a facet that two polygons may have in common by rounding.
OVERLAP = 1e-10


def nearest_polygons(
    polygon: Array,
    size: Index,
    facet: Index,
    area: Array,
    distance: Callable[[Index, Array], Array],
) -> tuple[Array, Index, Index]:
    """Cut from the polygons of each facet, (n, k, 2), the parts that nearer polygons hide.
    The nearer of two has the smaller `distance(k, place)` in the middle of their overlap.
    Returns the remaining pieces, their numbers of corners, and the polygon each comes from."""
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


# Convex polygons in the plane: padded corners, (n, k, 2), and the number of corners of each, (n,).


def anticlockwise(corners: Array) -> Array:
    """Polygons, shape (n, k, 2), with the interior on the left."""
    x, y = corners[..., 0], corners[..., 1]
    area = np.sum(x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y, axis=1)
    return np.where((area < 0)[:, None, None], corners[:, ::-1], corners)


def clipped(polygon: Array, size: Index, a: Array, b: Array) -> tuple[Array, Index]:
    """The part of each polygon on the left of the line from a to b, shapes (n, 2).
    I. E. Sutherland and G. W. Hodgman, Reentrant polygon clipping, Comm. ACM 17 (1974)."""
    count, width = polygon.shape[:2]
    index = np.arange(width)
    real = index < size[:, None]
    after = np.where(index + 1 < size[:, None], index + 1, 0)
    following = np.take_along_axis(polygon, after[..., None], axis=1)
    way = b - a

    def height(p: Array) -> Array:
        off = p - a[:, None]
        return np.asarray(way[:, None, 0] * off[..., 1] - way[:, None, 1] * off[..., 0])

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


def edges(polygon: Array, size: Index, k: int) -> tuple[Array, Array]:
    """Ends of edge k of each polygon, shapes (n, 2); the last edge of those with fewer."""
    rows = np.arange(size.size)
    start = np.minimum(k, np.maximum(size, 1) - 1)
    end = np.where(start + 1 < size, start + 1, 0)
    return polygon[rows, start], polygon[rows, end]


def common(polygon: Array, size: Index, window: Array, sides: Index) -> tuple[Array, Index]:
    """The part of each polygon inside a convex window, another padded polygon."""
    for k in range(window.shape[1]):
        polygon, size = clipped(polygon, size, *edges(window, sides, k))
    return polygon, size


def outside(polygon: Array, size: Index, window: Array, sides: Index) -> list[tuple[Array, Index]]:
    """The part of each polygon outside a window, as convex pieces, one for every edge.
    Piece k lies beyond edge k and within the edges before it."""
    pieces = []
    for k in range(window.shape[1]):
        a, b = edges(window, sides, k)
        beyond, corners = clipped(polygon, size, b, a)
        pieces.append((beyond, np.where(k < sides, corners, 0)))
        polygon, size = clipped(polygon, size, a, b)
    return pieces


def measured(polygon: Array, size: Index) -> tuple[Array, Array]:
    """Area and middle of the corners of each polygon, shapes (n,) and (n, 2)."""
    real = np.arange(polygon.shape[1]) < size[:, None]
    middle = np.sum(np.where(real[..., None], polygon, 0.0), axis=1) / np.maximum(size, 1)[:, None]
    return triangles(polygon, size, middle)[2].sum(axis=1), middle


def triangles(polygon: Array, size: Index, middle: Array) -> tuple[Array, Array, Array]:
    """Edges of the polygons from the middle, and areas of the triangles; zero where padded."""
    index = np.arange(polygon.shape[1])
    after = np.where(index + 1 < size[:, None], index + 1, 0)
    one = polygon - middle[:, None]
    two = np.take_along_axis(polygon, after[..., None], axis=1) - middle[:, None]
    area = 0.5 * (one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0])
    return one, two, np.where(index < size[:, None], area, 0.0)


def padded(polygon: Array, width: int) -> Array:
    """Polygons with room for a given number of corners."""
    return np.pad(polygon, ((0, 0), (0, width - polygon.shape[1]), (0, 0)))


# Fixed-point steps; each reduces the error by gap over radius of curvature, small near contact.
STEPS, SETTLED = 40, 1e-14
# Least cosine between an averaged normal and that of the plane; smaller ones are raised to it.
STEEP = 0.1


@dataclass(frozen=True)
class FacetPlanes:
    r"""Mean planes of the facets of a boundary, in which facets of the other side cut them.
    The image p(X) of a place of the reference facet is the (bi)linear map of the projected corners;
    a place y of the other side maps to p(X) where it lies on the averaged normal at X:

    .. math:: x(X) + g \, n(X) = y .

    Beyond the facet, n and the height of x are those of its nearest place, so that images of
    neighbouring facets neither overlap nor leave gaps."""

    maps: FaceMaps
    origin: Array  # means of the corners, shape (3, nfacets)
    axes: Array  # orthonormal, the last outward, shape (3, 3, nfacets)
    polygon: Array  # corners in the plane, in ring order, shape (2, nfacets, ncorners)

    @classmethod
    def of(cls, maps: FaceMaps, outward: Array) -> FacetPlanes:
        """The planes of facets with given unit normals in their middle, shape (3, nfacets)."""
        corners = maps.nodes[:, :, : maps.corners]
        origin = corners.mean(axis=2)
        side = corners[:, :, 1] - corners[:, :, 0]
        one = side - np.sum(side * outward, axis=0) * outward
        one /= np.linalg.norm(one, axis=0)
        axes = np.stack((one, np.cross(outward, one, axis=0), outward), axis=1)
        polygon = np.einsum("daf,dfk->afk", axes[:, :2], corners - origin[..., None])
        return cls(maps, origin, axes, polygon)

    def area(self) -> Array:
        """Areas of the polygons, shape (nfacets,)."""
        x, y = self.polygon
        turn = x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y
        return np.abs(0.5 * turn.sum(axis=1))

    def spread(self) -> Array:
        """Largest tangent of the angles between averaged normals and that of the plane."""
        up = np.maximum(np.einsum("df,dfk->fk", self.axes[:, 2], self.maps.normals), STEEP)
        return np.asarray((np.sqrt(np.maximum(1.0 - up**2, 0.0)) / up).max(axis=1))

    def place(self, facet: Index, X: Array) -> Array:
        """Images p(X) in the plane, shape (2, n)."""
        return np.einsum("ank,kn->an", self.polygon[:, facet], shapes(X, self.maps.corners)[0])

    def stretch(self, facet: Index, X: Array) -> Array:
        """Area of the facet over that of the polygon, shape (n,)."""
        slope = shapes(X, self.maps.corners)[1]
        flat = np.einsum("ank,kin->ain", self.polygon[:, facet], slope)
        t = self.maps.tangents(facet, X)
        area = np.linalg.norm(np.cross(t[:, 0], t[:, 1], axis=0), axis=0)
        return np.asarray(area / np.abs(flat[0, 0] * flat[1, 1] - flat[0, 1] * flat[1, 0]))

    def inverse(self, facet: Index, p: Array) -> Array:
        """Coordinates X of places p of the plane, shape (2, n); some X where p has none."""
        ring = self.polygon[:, facet]
        q, b = p - ring[..., 0], ring[..., 1] - ring[..., 0]
        c = ring[..., -1] - ring[..., 0]
        if self.maps.corners == 3:
            turn = _cross(b, c)
            return np.array([_cross(q, c) / turn, _cross(b, q) / turn])
        # q = s b + t c + s t d gives a quadratic equation for t. The determinant of the map is its
        # derivative at the root, which therefore has the sign of the ring.
        d = ring[..., 2] - ring[..., 1] - c
        sign = np.sign(_cross(b, c) + 0.5 * (_cross(b, d) + _cross(d, c)))
        two, one, none = -_cross(c, d) * sign, (_cross(q, d) + _cross(b, c)) * sign, _cross(q, b)
        none = none * sign
        root = np.sqrt(np.maximum(one**2 - 4.0 * two * none, 0.0))
        small = one < 0
        above = np.where(small, root - one, -2.0 * none)
        below = np.where(small, 2.0 * two, one + root)
        t = above / np.where(below == 0, 1.0, below)
        along = b + t * d
        length = np.sum(along**2, axis=0)
        s = np.sum((q - t * c) * along, axis=0) / np.where(length == 0, 1.0, length)
        return np.array([s, t])

    def image(self, facet: Index, y: Array) -> Array:
        """Images of places y of the other side by fixed-point steps, shape (2, n)."""
        origin, axes = self.origin[:, facet], self.axes[:, :, facet]
        off = np.einsum("dan,dn->an", axes, y - origin)
        size = np.sqrt(self.area()[facet])
        least = SETTLED + 8.0 * np.spacing(np.abs(y).max(initial=0.0)) / size
        p = off[:2]
        for _ in range(STEPS):
            X = self._within(self.inverse(facet, p))
            n = np.einsum("dan,dn->an", axes, self.maps.direction(facet, X))
            lift = np.einsum("dan,dn->an", axes, self.maps.at(facet, X) - origin)
            lift[:2] -= self.place(facet, X)
            gap = (off[2] - lift[2]) / np.maximum(n[2], STEEP)
            new = off[:2] - lift[:2] - gap * n[:2]
            change = np.abs(new - p).max(axis=0) / size
            p = new
            if np.all(change <= least):
                break
        return p

    def _within(self, X: Array) -> Array:
        """The nearest place of the reference facet, or one next to it."""
        if self.maps.corners == 4:
            return np.clip(X, 0.0, 1.0)
        L = np.maximum(np.array([1.0 - X[0] - X[1], X[0], X[1]]), 0.0)
        return np.asarray((L / L.sum(axis=0))[1:])


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[0] * b[1] - a[1] * b[0])
