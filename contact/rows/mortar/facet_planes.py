r"""Mean planes of facets in space, in which facets are cut by those of the other side.

The corners of a facet, projected onto its mean plane along the normal in its middle, span a
straight polygon; a place X of the reference facet has its image p(X) there by the (bi)linear map of
the corners. A facet of second order, or a warped one, is taken to the polygon by way of X, so that
all of it is covered, and two facets agree about the edge between them.

A place y of the other side is taken to p(X) where the averaged normal n(X) from the facet meets it,

.. math:: x(X) + g \, n(X) = y,

by fixed-point steps. Beyond the facet n and the height of x above the plane are those of the
nearest place of the facet. So every place has an image, also where normals diverge, and
neighbouring facets of the other side have neighbouring images, which neither overlap nor leave
gaps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contact.rows.mortar.face_maps import FaceMaps, shapes

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# The error falls by gap over radius of curvature a step. Where that is large nothing is in contact.
STEPS, SETTLED = 40, 1e-14
# Least cosine between an averaged normal and that of the plane which is used as it is.
STEEP = 0.1


@dataclass(frozen=True)
class FacetPlanes:
    """The mean planes of the facets of a boundary.

    Attributes
    ----------
    maps : FaceMaps
    origin : ndarray, shape (3, nfacets)
        Means of the corners.
    axes : ndarray, shape (3, 3, nfacets)
        Orthonormal; the last is the outward normal.
    polygon : ndarray, shape (2, nfacets, ncorners)
        The corners in the plane, in ring order.
    """

    maps: FaceMaps
    origin: Array
    axes: Array
    polygon: Array

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
        """Images of places y of the other side, along averaged normals, shape (2, n)."""
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
