"""Flat facets with what a search among them needs: boxes, normals of their parts, the border."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from contact.obstacles.box_tree import BoxTree
from contact.obstacles.facet_checks import edges_of, is_free
from contact.obstacles.facet_distance import Nearest, nearest_on_facets
from contact.obstacles.facet_rays import facet_normals

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class FlatFacets:
    """Facets with what is looked for beside them.

    Attributes
    ----------
    corners : ndarray, shape (nfacets, dim, dim)
    pseudonormals : ndarray, shape (nfacets, nparts, dim)
        Unit normals of the facet, its edges in 3-D, and its corners, as `Nearest.part` counts them.
    border : ndarray of bool, shape (nfacets, nparts)
        Parts on the border of a sheet.
    size : float
        Diagonal of the box around them.
    """

    corners: Array
    tree: BoxTree
    vertices: scipy.spatial.KDTree
    pseudonormals: Array
    border: NDArray[np.bool_]
    size: float

    @classmethod
    def of(cls, points: Array, facets: Index) -> FlatFacets:
        """Search structures for checked points (dim, npoints) and facets (dim, nfacets)."""
        corners = np.ascontiguousarray(points.T[facets.T])
        dim, count = facets.shape
        flat = facet_normals(corners)
        flat = flat / np.linalg.norm(flat, axis=1)[:, None] + 0.0  # no -0
        free = is_free(facets)
        at_corner = _unit_sums(facets.reshape(1, -1), np.tile(flat, (dim, 1)), _angles(corners))
        at_border = np.isin(facets, edges_of(facets)[:, free]).T
        normals, border = [flat[:, None], at_corner], [np.zeros((count, 1), bool), at_border]
        if dim == 3:
            edges = np.sort(edges_of(facets), axis=0)
            at_edge = _unit_sums(edges, np.tile(flat, (3, 1)), np.ones(3 * count))
            normals, border = (
                [normals[0], at_edge, normals[1]],
                [border[0], free.reshape(3, -1).T, border[1]],
            )
        tree, vertices = BoxTree(corners), scipy.spatial.KDTree(points.T)
        size = float(np.linalg.norm(np.ptp(points, axis=1)))
        return cls(corners, tree, vertices, np.concatenate(normals, 1), np.hstack(border), size)

    def nearest(self, x: Array) -> Nearest:
        """Nearest places to x (npoints, dim)."""
        return nearest_on_facets(self.corners, self.tree, self.vertices, x)


def _unit_sums(keys: Index, normals: Array, weights: Array) -> Array:
    """Unit sums of weighted normals over equal keys (k, n); (nfacets, n / nfacets, dim)."""
    key = keys[0] * (int(keys.max()) + 1) + keys[-1]
    _, number = np.unique(key, return_inverse=True)
    total = np.stack([np.bincount(number, weights * part) for part in normals.T], axis=1)[number]
    length = np.linalg.norm(total, axis=1)
    sharp = length < 1e-12 * weights  # facets folded onto each other: any of them
    unit = np.where(sharp[:, None], normals, total / np.where(sharp, 1.0, length)[:, None])
    dim = normals.shape[1]  # as many edges and as many corners
    return np.asarray(unit.reshape(dim, -1, dim).transpose(1, 0, 2))


def _angles(corners: Array) -> Array:
    """Angles of the facets at their corners, corner by corner; ones in 2-D."""
    if corners.shape[2] == 2:
        return np.ones(2 * len(corners))
    angles = []
    for i in range(3):
        one, two = corners[:, i - 2] - corners[:, i], corners[:, i - 1] - corners[:, i]
        across = np.linalg.norm(np.cross(one, two), axis=1)
        angles.append(np.arctan2(across, np.sum(one * two, axis=1)))
    return np.concatenate(angles)
