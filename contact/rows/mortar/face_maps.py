"""Contact facets in space as images of the reference facet, and segments of an interface.

Corners of mortar facets are projected along averaged normals onto the mean plane of the non-mortar
facet, where the common polygon of each pair is found by clipping. Its triangles carry Gauss points
x.
The line from x along the averaged normal meets the mortar facet in y: contact forces act on both
bodies along this line, so that moments cancel for any gap. On a flat interface the polygons are
those of M. A. Puso and T. A. Laursen (Comput. Methods Appl. Mech. Engrg. 193 (2004)), who project
along the normal of the plane. On a curved one with a gap, their y - x is not along the averaged
normal, and facets of second order are not covered up to their curved edges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import roots_jacobi

from contact.errors import InputError
from contact.rows.mortar.facet_trace import FACETS, InterfaceQuadrature, none_opposite
from contact.rows.outline import Outline, reference_corners

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@cache
def _grid(count: int) -> tuple[int, Index]:
    """Order of a quadrilateral of 4, 9 or 16 nodes, and the nodes' integer coordinates, in
    rings."""
    k = round(count**0.5) - 1
    ring = [(0, 0), (k, 0), (k, k), (0, k)]
    if k == 2:
        ring += [(1, 0), (2, 1), (1, 2), (0, 1), (1, 1)]
    rest = [(i, j) for j in range(k + 1) for i in range(k + 1) if (i, j) not in ring]
    return k, np.array(ring + rest)


@dataclass(frozen=True)
class FaceMaps:
    """Facets of a boundary in space as Lagrange interpolants of their nodes."""

    nodes: Array  # corners in ring order, edge nodes, others; (3, nfacets, k)
    normals: Array  # averaged unit normals at the corners, shape (3, nfacets, ncorners)
    at_rest: Array  # outward unit normals at the corners of undeformed facets, same shape

    @classmethod
    def of(cls, outline: Outline, moved: Array | None = None) -> FaceMaps:
        """Facets of an outline, undeformed or with `moving_nodes` displaced by (3, nfacets, k)."""
        corners = outline.corners.shape[1]
        X = reference_nodes(outline) if moved is None else moving_nodes(outline)
        nodes = np.asarray(outline.body.basis.mapping.G(X, find=outline.facets))
        still = cls(nodes, outline.turned, outline.at_corners)
        if moved is None:
            return still
        nodes = nodes + moved
        maps = replace(still, nodes=nodes)
        at = reference_corners(3, corners)
        facets, own = np.arange(nodes.shape[1]), []
        for k in range(corners):
            place = np.repeat(at[:, k : k + 1], facets.size, axis=1)
            outward = np.sign(np.sum(still.normal(facets, place) * outline.at_corners[..., k], 0))
            own.append(outward * maps.normal(facets, place))
        averaged = outline.averaged(np.stack(own, axis=2), nodes[:, :, :corners])
        return replace(maps, normals=averaged)

    @property
    def corners(self) -> int:
        """Corners of a facet, 3 or 4."""
        return int(self.normals.shape[2])

    @property
    def affine(self) -> bool:
        """Whether all facets are affine images of the reference facet."""
        corner = self.nodes[:, :, : self.corners]
        X = _lagrange_nodes(self.nodes.shape[2])
        slopes = corner[:, :, [1, -1]] - corner[:, :, :1]
        off = corner[:, :, :1] + slopes @ X - self.nodes
        size = np.linalg.norm(slopes, axis=0).max(axis=1)
        noise = FACETS.affine * size + 16.0 * np.spacing(np.abs(self.nodes).max())
        return bool(np.all(np.linalg.norm(off, axis=0).max(axis=1) <= noise))

    @property
    def flat(self) -> bool:
        """Whether averaged normals are constant on each facet."""
        return bool(np.abs(self.normals - self.normals[:, :, :1]).max() <= FACETS.affine)

    def added(self, other: FaceMaps, rest: tuple[FaceMaps, FaceMaps]) -> int:
        """Degrees added to the Gauss rules of an interface beyond those of the traces."""
        if not (rest[0].affine and rest[1].affine):
            # Traces are not polynomials: with these degrees uniform pressures are exact to 1e-13 if
            # corners are displaced by a quarter of a side.
            return 8
        return 0 if self is rest[0] and self.flat else FACETS.curved

    @cached_property
    def middles(self) -> Array:
        """Outward unit normals in the middle of facets, shape (3, nfacets)."""
        facets = np.arange(self.nodes.shape[1])
        place = reference_corners(3, self.corners).mean(axis=1)
        n = self.normal(facets, np.repeat(place[:, None], facets.size, axis=1))
        return np.asarray(n * np.sign(np.sum(n * self.at_rest.sum(axis=2), axis=0)))

    def at(self, facet: Index, X: Array) -> Array:
        """Places on facets, shape (3, n)."""
        return np.einsum("dnk,kn->dn", self.nodes[:, facet], shapes(X, self.nodes.shape[2])[0])

    def tangents(self, facet: Index, X: Array) -> Array:
        """Derivatives of the places with respect to X, shape (3, 2, n)."""
        return np.einsum("dnk,kin->din", self.nodes[:, facet], shapes(X, self.nodes.shape[2])[1])

    def measure(self, facet: Index, X: Array) -> Array:
        """Area of the facet per area of the reference facet, shape (n,)."""
        one, two = self.tangents(facet, X).transpose(1, 0, 2)
        return np.asarray(np.linalg.norm(np.cross(one, two, axis=0), axis=0))

    def relaxed(self, rest: FaceMaps, facet: Index, X: Array, w: Array) -> Array:
        """Quadrature weights on displaced facets, converted to the undeformed facets."""
        return w / (self.measure(facet, X) / rest.measure(facet, X))

    def normal(self, facet: Index, X: Array) -> Array:
        """Unit normals of the facets themselves, of either sign, shape (3, n)."""
        along = self.tangents(facet, X)
        n = np.cross(along[:, 0], along[:, 1], axis=0)
        return np.asarray(n / np.linalg.norm(n, axis=0))

    def direction(self, facet: Index, X: Array) -> Array:
        """Averaged normals, interpolated between the corners, of unit length, shape (3, n)."""
        hat = shapes(X, self.corners)[0]
        n = np.einsum("dnk,kn->dn", self.normals[:, facet], hat)
        return np.asarray(n / np.linalg.norm(n, axis=0))

    def met(self, facet: Index, x: Array, direction: Array) -> Array:
        """Reference coordinates, (2, n), where lines through points x meet (extended) facets.
        By Newton's method; raises InputError if a distorted facet does not meet its line."""
        X = np.full((2, facet.size), 1.0 / 3.0 if self.corners == 3 else 0.5)
        size = np.ptp(self.nodes[:, facet, : self.corners], axis=2).max(axis=0)
        least = 1e-14 + 4.0 * np.spacing(np.abs(x).max(initial=0.0)) / size.min(initial=np.inf)
        for _ in range(30):
            one, two = self.tangents(facet, X).transpose(1, 0, 2)
            off = x - self.at(facet, X)
            # Cramer's rule for off = one s + two t + direction r.
            beside = np.cross(two, direction, axis=0), np.cross(direction, one, axis=0)
            turn = np.sum(one * beside[0], axis=0)
            step = np.array([np.sum(off * side, axis=0) for side in beside])
            step /= np.where(turn == 0, 1.0, turn)
            X = X + step
            if np.all(np.abs(step) <= least):
                break
        off = x - self.at(facet, X)
        off -= np.sum(off * direction, axis=0) * direction
        if np.any(np.linalg.norm(off, axis=0) > 1e-9 * size + 1e-12 * np.abs(x).max(initial=0.0)):
            raise InputError("facets: one is so distorted that lines along the normals miss it")
        return X

    def cut(self, second: FaceMaps, degree: int) -> InterfaceQuadrature:
        """Gauss points on the common polygons of all facing pairs, exact up to `degree`.
        Raises InputError if no facet faces another one with an opposite normal."""
        planes = FacetPlanes.of(self)
        facet, other = _pairs(planes, second, 1.0)
        polygon, size = _common(planes, second, facet, other)
        area, middle = measured(polygon, size)
        least = FACETS.sliver * np.minimum(planes.area()[facet], _extent(second)[other] ** 2)
        kept = area > least
        if not kept.any():
            same = _pairs(planes, second, -1.0)[0].size
            raise none_opposite(bool(same))
        on = np.flatnonzero(kept)
        gap = _gaps(planes, second, facet[on], other[on], middle[on].T)
        on = on[_within_reach(gap, self, second)]
        facet, other = facet[on], other[on]

        def distance(k: Index, place: Array) -> Array:
            return np.abs(_gaps(planes, second, facet[k], other[k], place))

        polygon, size, k = nearest_polygons(polygon[on], size[on], facet, planes.area(), distance)
        at, place, w = _points(polygon, size, degree)
        facet, other = facet[k[at]], other[k[at]]
        X = planes.inverse(facet, place)
        x, n = self.at(facet, X), self.direction(facet, X)
        Y = second.met(other, x, n)
        return InterfaceQuadrature(
            x, second.at(other, Y), n, w * planes.stretch(facet, X), facet, other, X, Y
        )


def reference_nodes(outline: Outline) -> Array:
    """Nodes of the reference facet of an outline's mesh, shape (2, k): 3, 4, 6 or 9 of them."""
    count = outline.corners.shape[1]
    if type(outline.body.mesh).__name__ in ("MeshTet2", "MeshHex2"):
        count = {3: 6, 4: 9}[count]
    return _lagrange_nodes(count)


def moving_nodes(outline: Outline) -> Array:
    """Reference nodes of displaced facets, shape (2, k), which describe their displacement."""
    name, count = type(outline.body.element).__name__, outline.corners.shape[1]
    if name in ("ElementTetP1", "ElementHex1"):
        return reference_nodes(outline)
    return _lagrange_nodes({3: 6, 4: 9}[count] if name in ("ElementTetP2", "ElementHex2") else 16)


def _lagrange_nodes(count: int) -> Array:
    """Places of 3, 4, 6, 9 or 16 nodes on the reference facet, shape (2, count)."""
    if count in (3, 6):
        corner = reference_corners(3, 3)
        middle = 0.5 * (corner + np.roll(corner, -1, axis=1))
        return corner if count == 3 else np.hstack((corner, middle))
    order, places = _grid(count)
    return np.asarray(places.T / order)


def shapes(X: Array, nodes: int) -> tuple[Array, Array]:
    """Lagrange polynomials of facets of 3, 4, 6, 9 or 16 nodes at X (2, n), and derivatives.
    Shapes (nodes, n) and (nodes, 2, n)."""
    x, y = X
    one, zero = np.ones_like(x), np.zeros_like(x)
    if nodes in (3, 6):
        L = np.array([1 - x - y, x, y])
        D = np.array([[-one, -one], [one, zero], [zero, one]])
        if nodes == 3:
            return L, D
        k = np.array([1, 2, 0])
        values = np.vstack((L * (2 * L - 1), 4 * L * L[k]))
        slopes = np.concatenate(
            ((4 * L - 1)[:, None] * D, 4 * (L[:, None] * D[k] + L[k][:, None] * D))
        )
        return values, slopes
    order, grid = _grid(nodes)
    (u, du), (v, dv) = (_line(s, order) for s in (x, y))
    i, j = grid.T
    return u[i] * v[j], np.stack((du[i] * v[j], u[i] * dv[j]), axis=1)


def _line(s: Array, order: int) -> tuple[Array, Array]:
    """Lagrange polynomials of order + 1 equidistant places, and their derivatives."""
    values, slopes = np.ones((2, order + 1, s.size))
    slopes[:] = 0.0
    for k in range(order + 1):
        for other in set(range(order + 1)) - {k}:
            step = order / (k - other)
            slopes[k] = slopes[k] * (s - other / order) * step + values[k] * step
            values[k] *= (s - other / order) * step
    return values, slopes


def _within_reach(gap: Array, first: FaceMaps, second: FaceMaps) -> NDArray[np.bool_]:
    """Whether the gap is at most the size of the boundaries, and the overlap at most half of it."""
    reach = [float(np.linalg.norm(np.ptp(side.nodes, axis=(1, 2)))) for side in (first, second)]
    near = (gap <= max(reach)) & (gap >= -0.5 * min(reach))
    if not near.any():
        raise none_opposite(within=f" within {max(reach):g}")
    return np.asarray(near)


def _gaps(planes: FacetPlanes, second: FaceMaps, facet: Index, other: Index, place: Array) -> Array:
    """Gaps from points (2, n) on the mean planes to the tangent planes of mortar facets."""
    X = planes.inverse(facet, place)
    x, n = planes.maps.at(facet, X), planes.maps.direction(facet, X)
    off = second.nodes[:, other, : second.corners].mean(axis=2) - x
    outward = second.middles[:, other]
    against = np.minimum(np.sum(outward * n, axis=0), -0.5 * FACETS.facing)
    return np.asarray(np.sum(off * outward, axis=0) / against)


def _pairs(planes: FacetPlanes, second: FaceMaps, facing: float) -> tuple[Index, Index]:
    """Pairs that may overlap and whose normals are opposite, or with -1 parallel."""
    first, spread = planes.maps, planes.spread()
    middles = [side.nodes[:, :, : side.corners].mean(axis=2) for side in (first, second)]
    radii = [
        np.linalg.norm(side.nodes - m[..., None], axis=0).max(axis=1)
        for side, m in zip((first, second), middles, strict=True)
    ]
    found: list[Index] = []
    count, others = middles[0].shape[1], middles[1].shape[1]
    step = max(1, 1_000_000 // others)  # pairs processed at once
    for start in range(0, count, step):
        here = np.arange(start, min(count, start + step))
        n = first.middles[:, here]
        towards = -facing * (n.T @ second.middles) > FACETS.facing
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
    """Polygon, plane coordinates (2, n) and weight of each Gauss point."""
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


def nearest_polygons(
    polygon: Array,
    size: Index,
    facet: Index,
    area: Array,
    distance: Callable[[Index, Array], Array],
) -> tuple[Array, Index, Index]:
    """Remove from the polygons of each facet, (n, k, 2), the parts behind nearer polygons.
    The nearer of two has the smaller `distance(k, place)` in the middle of their overlap.
    Returns the remaining pieces, their numbers of corners, and the polygon each comes from."""
    source = np.arange(size.size)
    overlap = 1e-10  # relative overlap of two polygons that is rounding
    while True:
        own = facet[source]
        covered = np.bincount(own, measured(polygon, size)[0], area.size)
        a, b = _neighbours(own, covered > area * (1.0 + overlap))
        both, corners = common(polygon[a], size[a], polygon[b], size[b])
        shared, middle = measured(both, corners)
        real = (shared > overlap * area[own[a]]) & (source[a] != source[b])
        a, b, middle = a[real], b[real], middle[real]
        far = np.where(distance(source[a], middle.T) > distance(source[b], middle.T), a, b)
        # Cut out one nearer polygon at a time.
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
        kept = measured(polygon, size)[0] > overlap * area[facet[source]]
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
    # Each corner is followed by the intersection of its edge with the line.
    points = np.stack((polygon, cut), axis=2).reshape(count, 2 * width, 2)
    keep = np.stack((real & (here >= 0), crossing), axis=2).reshape(count, 2 * width)
    order = np.argsort(~keep, axis=1, kind="stable")
    size = keep.sum(axis=1)
    width = max(3, int(size.max(initial=0)))
    return np.take_along_axis(points, order[..., None], axis=1)[:, :width], size


def edges(polygon: Array, size: Index, k: int) -> tuple[Array, Array]:
    """Ends of edge k of each polygon, or of its last edge if it has fewer, shapes (n, 2)."""
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
    """Area and mean corner of each polygon, shapes (n,) and (n, 2)."""
    real = np.arange(polygon.shape[1]) < size[:, None]
    middle = np.sum(np.where(real[..., None], polygon, 0.0), axis=1) / np.maximum(size, 1)[:, None]
    return triangles(polygon, size, middle)[2].sum(axis=1), middle


def triangles(polygon: Array, size: Index, middle: Array) -> tuple[Array, Array, Array]:
    """Corners relative to the middle, and areas of the triangles; zero for padding."""
    index = np.arange(polygon.shape[1])
    after = np.where(index + 1 < size[:, None], index + 1, 0)
    one = polygon - middle[:, None]
    two = np.take_along_axis(polygon, after[..., None], axis=1) - middle[:, None]
    area = 0.5 * (one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0])
    return one, two, np.where(index < size[:, None], area, 0.0)


def padded(polygon: Array, width: int) -> Array:
    """Polygons padded to a given number of corners."""
    return np.pad(polygon, ((0, 0), (0, width - polygon.shape[1]), (0, 0)))


@dataclass(frozen=True)
class FacetPlanes:
    r"""Mean planes of the facets of a boundary, in which facets are intersected.
    The image p(X) of a reference point is the (bi)linear map of the projected corners; a point y of
    the other side maps to p(X) if it lies on the averaged normal at X:

    .. math:: x(X) + g \, n(X) = y .

    Beyond the facet, n and the height of x are those of its nearest point, so that images of
    neighbouring facets neither overlap nor leave gaps."""

    maps: FaceMaps
    origin: Array  # means of the corners, shape (3, nfacets)
    axes: Array  # orthonormal axes, the last one outward, shape (3, 3, nfacets)
    polygon: Array  # corners in the plane, in ring order, shape (2, nfacets, ncorners)

    @classmethod
    def of(cls, maps: FaceMaps) -> FacetPlanes:
        """The planes of facets, orthogonal to the normals at the middles."""
        outward = maps.middles
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
        up = np.maximum(np.einsum("df,dfk->fk", self.axes[:, 2], self.maps.normals), FACETS.steep)
        return np.asarray((np.sqrt(np.maximum(1.0 - up**2, 0.0)) / up).max(axis=1))

    def place(self, facet: Index, X: Array) -> Array:
        """Images p(X) in the plane, shape (2, n)."""
        return np.einsum("ank,kn->an", self.polygon[:, facet], shapes(X, self.maps.corners)[0])

    def stretch(self, facet: Index, X: Array) -> Array:
        """Area of the facet over that of the polygon, shape (n,)."""
        slope = shapes(X, self.maps.corners)[1]
        flat = np.einsum("ank,kin->ain", self.polygon[:, facet], slope)
        area = self.maps.measure(facet, X)
        return np.asarray(area / np.abs(flat[0, 0] * flat[1, 1] - flat[0, 1] * flat[1, 0]))

    def inverse(self, facet: Index, p: Array) -> Array:
        """Coordinates X of points p of the plane, shape (2, n); arbitrary X if there are none."""
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
        least = 1e-14 + 8.0 * np.spacing(np.abs(y).max(initial=0.0)) / size
        p = off[:2]
        # The convergence factor is gap over radius of curvature, small near contact.
        for _ in range(40):
            X = self._within(self.inverse(facet, p))
            n = np.einsum("dan,dn->an", axes, self.maps.direction(facet, X))
            lift = np.einsum("dan,dn->an", axes, self.maps.at(facet, X) - origin)
            lift[:2] -= self.place(facet, X)
            gap = (off[2] - lift[2]) / np.maximum(n[2], FACETS.steep)
            new = off[:2] - lift[:2] - gap * n[:2]
            change = np.abs(new - p).max(axis=0) / size
            p = new
            if np.all(change <= least):
                break
        return p

    def _within(self, X: Array) -> Array:
        """The nearest point of the reference facet, approximately."""
        if self.maps.corners == 4:
            return np.clip(X, 0.0, 1.0)
        L = np.maximum(np.array([1.0 - X[0] - X[1], X[0], X[1]]), 0.0)
        return np.asarray((L / L.sum(axis=0))[1:])


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[0] * b[1] - a[1] * b[0])
