"""Traces of the shape functions on edges and faces, with Gauss points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from skfem_adini.conditions.boundary_edges import Array, BoundaryEdges, Indices
from skfem_adini.elements.hermite_factors import (
    HERMITE,
    SLOPE,
    Function,
    adini_functions,
    derivatives,
)

# Exact to degree 15 in each direction. Products of two traces have degree 6; data may have a higher
# one.
_GAUSS_POINTS = 8
_EDGE: tuple[Function, ...] = (((HERMITE,),), ((SLOPE,),))
_FACE = adini_functions(2)


@dataclass(frozen=True)
class BoundaryTrace:
    r"""Trace functions of facets at their Gauss points.

    With the map :math:`F` of a facet from the unit interval or square, the trace is

    .. math::
        \sum_k u_k N_k + \sum_k \sum_j (\partial_j F(k) \cdot \nabla u_k) H_{jk}

    over the vertices k: cubic Hermite on edges, Adini's rectangle on faces.

    Attributes
    ----------
    points
        Gauss points, shape (dim, facets, points).
    dx
        Weights times surface element, shape (facets, points).
    functions
        Trace of u, u_x, u_y (, u_z) of one vertex after the other, (functions, facets, points).
    """

    points: Array
    dx: Array
    functions: Array

    @classmethod
    def of(cls, mesh: Any, vertices: Indices) -> BoundaryTrace:
        """Return the traces on facets with vertices (2 or 4, facets)."""
        s, w = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
        s, w = (s + 1) / 2, w / 2
        p = mesh.p[:, vertices]
        if len(vertices) == 2:
            edges = BoundaryEdges.of(mesh, vertices)
            side = (edges.last - edges.first)[:, :, None]
            corners = np.array([[0.0], [1.0]])
            functions = _functions(_EDGE, corners, s[None], [[side], [side]])
            return cls(edges.points(s), edges.length[:, None] * w, functions)
        X = np.array(np.meshgrid(s, s)).reshape(2, -1)
        weights = np.outer(w, w).ravel()
        corners = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
        a, b = ((p[:, k] - p[:, 0])[:, :, None] for k in (1, 3))
        c = (p[:, 2] - p[:, 3])[:, :, None] - a
        tangents = [[a + c * y, b + c * x] for x, y in corners]
        area = np.linalg.norm(np.cross(a + c * X[1], b + c * X[0], axis=0), axis=0)
        points = p[:, 0, :, None] + a * X[0] + b * X[1] + c * (X[0] * X[1])
        return cls(points, area * weights, _functions(_FACE, corners, X, tangents))


def _functions(
    reference: tuple[Function, ...], corners: Array, X: Array, tangents: list[list[Array]]
) -> Array:
    """Return N and, for each physical derivative, the sum of tangent times H."""
    rows = []
    for corner, along in zip(corners, tangents, strict=True):
        value, *slopes = derivatives(reference, corner, X, 0)
        rows.append(np.broadcast_to(value, (along[0].shape[1], len(value))))
        rows += list(sum(t * slope for t, slope in zip(along, slopes, strict=True)))
    return np.array(rows)
