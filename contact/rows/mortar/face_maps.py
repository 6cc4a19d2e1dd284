"""Contact facets in space as images of the reference facet, at rest or displaced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError
from contact.rows.outline import Outline, reference_corners

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_STEPS, _SETTLED = 30, 1e-14
# Rounding of places, relative to the facet, and of unit normals.
AFFINE = 1e-11
# Nodes of a facet of second order with 3 and with 4 corners.
_SECOND = {3: 6, 4: 9}


def _grid(order: int) -> Index:
    """Nodes of a quadrilateral in steps of a side: corners, then second-order ones, in rings."""
    k = order
    ring = [(0, 0), (k, 0), (k, k), (0, k)]
    if k == 2:
        ring += [(1, 0), (2, 1), (1, 2), (0, 1), (1, 1)]
    rest = [(i, j) for j in range(k + 1) for i in range(k + 1) if (i, j) not in ring]
    return np.array(ring + rest)


_GRIDS = {(order + 1) ** 2: (order, _grid(order)) for order in (1, 2, 3)}


@dataclass(frozen=True)
class FaceMaps:
    """Facets of a boundary in space, by the Lagrange polynomials of their nodes."""

    nodes: Array  # corners in ring order, middles of edges, the others; (3, nfacets, k)
    normals: Array  # averaged unit normals at the corners, shape (3, nfacets, ncorners)

    @classmethod
    def of(cls, outline: Outline, moved: Array | None = None) -> FaceMaps:
        """Facets of an outline, at rest or with `moving_nodes` displaced by (3, nfacets, k)."""
        corners = outline.corners.shape[1]
        X = reference_nodes(outline) if moved is None else moving_nodes(outline)
        nodes = np.asarray(outline.body.basis.mapping.G(X, find=outline.facets))
        if moved is None:
            return cls(nodes, outline.turned)
        still = cls(nodes, outline.turned)
        nodes = nodes + moved
        maps = cls(nodes, outline.turned)
        at = reference_corners(3, corners)
        facets, own = np.arange(nodes.shape[1]), []
        for k in range(corners):
            place = np.repeat(at[:, k : k + 1], facets.size, axis=1)
            outward = np.sign(np.sum(still.normal(facets, place) * outline.at_corners[..., k], 0))
            own.append(outward * maps.normal(facets, place))
        averaged = outline.averaged(np.stack(own, axis=2), nodes[:, :, :corners])
        return cls(nodes, averaged)

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
        noise = AFFINE * size + 16.0 * np.spacing(np.abs(self.nodes).max())
        return bool(np.all(np.linalg.norm(off, axis=0).max(axis=1) <= noise))

    @property
    def flat(self) -> bool:
        """Whether averaged normals do not vary along a facet."""
        return bool(np.abs(self.normals - self.normals[:, :, :1]).max() <= AFFINE)

    def at(self, facet: Index, X: Array) -> Array:
        """Places on facets, shape (3, n)."""
        return np.einsum("dnk,kn->dn", self.nodes[:, facet], shapes(X, self.nodes.shape[2])[0])

    def tangents(self, facet: Index, X: Array) -> Array:
        """Derivatives of the places with respect to X, shape (3, 2, n)."""
        return np.einsum("dnk,kin->din", self.nodes[:, facet], shapes(X, self.nodes.shape[2])[1])

    def area(self, facet: Index, X: Array) -> Array:
        """Area of the facet per area of the reference facet, shape (n,)."""
        one, two = self.tangents(facet, X).transpose(1, 0, 2)
        return np.asarray(np.linalg.norm(np.cross(one, two, axis=0), axis=0))

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
        """Reference coordinates, (2, n), where lines through places x meet facets or beyond them.
        Newton's method; raises InputError where a distorted facet has no crossing with its line."""
        X = np.full((2, facet.size), 1.0 / 3.0 if self.corners == 3 else 0.5)
        size = np.ptp(self.nodes[:, facet, : self.corners], axis=2).max(axis=0)
        least = _SETTLED + 4.0 * np.spacing(np.abs(x).max(initial=0.0)) / size.min(initial=np.inf)
        for _ in range(_STEPS):
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


def reference_nodes(outline: Outline) -> Array:
    """Nodes of the reference facet of an outline's mesh, shape (2, k): 3, 4, 6 or 9 of them."""
    count = outline.corners.shape[1]
    if type(outline.body.mesh).__name__ in ("MeshTet2", "MeshHex2"):
        count = _SECOND[count]
    return _lagrange_nodes(count)


def moving_nodes(outline: Outline) -> Array:
    """Reference nodes of displaced facets, shape (2, k), which describe their displacement."""
    name, count = type(outline.body.element).__name__, outline.corners.shape[1]
    if name in ("ElementTetP1", "ElementHex1"):
        return reference_nodes(outline)
    return _lagrange_nodes(_SECOND[count] if name in ("ElementTetP2", "ElementHex2") else 16)


def _lagrange_nodes(count: int) -> Array:
    """Places of 3, 4, 6, 9 or 16 nodes on the reference facet, shape (2, count)."""
    if count in (3, 6):
        corner = reference_corners(3, 3)
        middle = 0.5 * (corner + np.roll(corner, -1, axis=1))
        return corner if count == 3 else np.hstack((corner, middle))
    order, places = _GRIDS[count]
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
    order, grid = _GRIDS[nodes]
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
