"""Contact facets in the plane as curves of first or second order, at rest or displaced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contact.rows.outline import Outline

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Rounding of the distance of a middle from its chord, over the chord; of places, over coordinates.
STRAIGHT, ROUNDING = 1e-12, 16 * np.finfo(float).eps


@dataclass(frozen=True)
class FacetCurves:
    """Facets of a boundary as curves ``(1 - s) a + s b + s (1 - s) c`` of s in [0, 1]."""

    ends: Array  # places a and b, shape (2, nfacets, 2)
    bulge: Array  # vectors c, zero on straight facets, shape (2, nfacets)
    sign: Array  # 1 where the outward normal is the tangent turned by -90 degrees, else -1
    normals: Array  # averaged unit normals at the ends, shape (2, nfacets, 2)

    @classmethod
    def of(cls, outline: Outline, nodes: Array | None = None) -> FacetCurves:
        """Facets of an outline with their nodes at given places, else at those of the mesh.
        Nodes, shape (2, nfacets, 2 or 3): the ends, and the middle between them on second order."""
        at_rest = facet_nodes(outline)
        nodes = at_rest if nodes is None else nodes
        ends, at_ends = nodes[:, :, [0, -1]], outline.at_corners
        along = at_rest[:, :, -1] - at_rest[:, :, 0]
        sign = np.sign(along[1] * at_ends.sum(axis=2)[0] - along[0] * at_ends.sum(axis=2)[1])
        bulge = (
            4.0 * nodes[:, :, 1] - 2.0 * ends.sum(axis=2) if nodes.shape[2] == 3 else 0.0 * along
        )
        noise = STRAIGHT * _length(ends) + ROUNDING * np.abs(nodes).max()
        flat = np.linalg.norm(bulge, axis=0) <= noise
        curves = cls(ends, np.where(flat, 0.0, bulge), sign, np.zeros_like(ends))
        facets = np.arange(sign.size)
        own = [curves.outward(facets, np.full(sign.size, s)) for s in (0.0, 1.0)]
        return cls(ends, curves.bulge, sign, outline.averaged(np.stack(own, axis=2), ends))

    @property
    def length(self) -> Array:
        """Lengths of the chords, shape (nfacets,)."""
        return _length(self.ends)

    @property
    def curved(self) -> bool:
        """Whether normals vary along a facet."""
        bent = np.abs(self.normals[..., 1] - self.normals[..., 0]).max() > STRAIGHT
        return bool(bent or np.any(self.bulge))

    def at(self, facet: Index, s: Array) -> Array:
        """Places on facets, shape (2, n)."""
        a, b = self.ends[:, facet, 0], self.ends[:, facet, 1]
        return np.asarray(a + s * (b - a) + s * (1.0 - s) * self.bulge[:, facet])

    def slope(self, facet: Index, s: Array) -> Array:
        """Derivatives of the places with respect to s, shape (2, n)."""
        a, b = self.ends[:, facet, 0], self.ends[:, facet, 1]
        return np.asarray(b - a + (1.0 - 2.0 * s) * self.bulge[:, facet])

    def outward(self, facet: Index, s: Array) -> Array:
        """Outward unit normals of the facets themselves, shape (2, n)."""
        x, y = self.slope(facet, s)
        turned = self.sign[facet] * np.array([y, -x])
        return np.asarray(turned / np.linalg.norm(turned, axis=0))

    def direction(self, facet: Index, s: Array) -> Array:
        """Averaged normals, linear between the ends and not of unit length, shape (2, n)."""
        one, two = self.normals[:, facet, 0], self.normals[:, facet, 1]
        return np.asarray((1.0 - s) * one + s * two)


def facet_nodes(outline: Outline) -> Array:
    """Places of the ends and of the middle of each facet of a plane mesh, shape (2, nfacets, 3)."""
    mesh = outline.body.mesh
    ends = mesh.p[:, outline.corners]
    middle = outline.body.basis.mapping.G(np.array([[0.5]]), find=outline.facets)
    return np.concatenate((ends[:, :, :1], middle, ends[:, :, 1:]), axis=2)


def _length(ends: Array) -> Array:
    return np.asarray(np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=0))
