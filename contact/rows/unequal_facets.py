r"""Correction of the normal rows where straight facets of unequal size approximate a curve.

The normal displacement at a contact point is :math:`\bar n \cdot u`, with the mean normal of its
facets and the displacement at their vertex. Where one facet is longer than the other, the mean
normal is that of a point beside the vertex, :math:`\bar n = n + \beta t`, and a displacement u_t
along the curve is counted as normal displacement :math:`\beta u_t`: of first order in the lengths
of the facets, with a sign that changes from vertex to vertex. The pressure then oscillates, by an
amplitude that refinement does not reduce.

The mean normals themselves must stay, because a uniform pressure loads the polygon along them. So
each facet adds :math:`\omega_k (n_k - \tfrac1\omega \sum_j \omega_j n_j)` times one displacement,
that of the point whose smooth normal is the normal of the facet (in 2-D its middle), to the row of
its corner k, where n_k is the smooth normal at its corner k: the sum over its corners is zero, so
that a uniform pressure has the same load as before, and the sum over the facets of a vertex turns
:math:`\bar n` into n, to second order. In two dimensions and on rectangles this is complete.

On triangles the normal of the plane is not the smooth normal of the middle. By the divergence
theorem, a straight edge ij in place of a parabola adds
:math:`\nu l \, (n_i - n_j) \cdot (x_i - x_j) / 36`, with the normal :math:`\nu` of the edge, away
from the opposite corner; the terms of the two triangles at an edge have opposite signs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.rows.functionals import FacetFunctional
from contact.rows.outline import Outline
from contact.rows.shares import Shares

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# ``centroid`` evaluates the displacement at a sixth of a facet from the vertex, which leaves two
# thirds of the correction.
_OF_MEAN = 2.0 / 3.0


@dataclass(frozen=True)
class Leaning:
    """Terms with displacements of vertices that are added to the rows of contact points.

    Attributes
    ----------
    point, vertex : ndarray of int, shape (n,)
        Contact point and mesh vertex of each term.
    part : ndarray, shape (dim, n)
        Vectors that multiply the displacement of the vertex, divided by the weight of the point.
    """

    point: Index
    vertex: Index
    part: Array

    @classmethod
    def of(cls, outline: Outline, form: FacetFunctional, shares: Shares) -> Leaning:
        """The terms of the facets of a boundary."""
        dim, slot = outline.body.dim, form.corners
        bent = np.flatnonzero(outline.bent & (slot.size > 0))
        if not bent.size:
            nowhere = np.zeros(0, dtype=np.int64)
            return cls(nowhere, nowhere, np.zeros((dim, 0)))
        corners, number = outline.corners[bent], shares.number[bent][:, slot]
        normal, omega = outline.turned[:, bent], shares.omega[bent][:, slot]
        mean = np.sum(omega * normal, axis=2) / omega.sum(axis=1)
        part = omega * (normal - mean[:, :, None]) * (_OF_MEAN if shares.mean else 1.0)
        count = corners.shape[1]
        shape = len(bent), count, count
        point = [np.broadcast_to(number[:, :, None], shape).ravel()]
        vertex = [np.broadcast_to(corners[:, None], shape).ravel()]
        share = _at_their_normals(normal, outline.at_corners[:, bent].mean(axis=2))
        parts = [(part[..., None] * share[:, None]).reshape(dim, -1)]
        if count == 3:
            for k, v, moved in _edges(outline, corners, number, normal):
                point.append(k)
                vertex.append(v)
                parts.append(moved)
        k = np.concatenate(point)
        return cls(k, np.concatenate(vertex), np.hstack(parts) / shares.weights[k])

    def turn(self, count: int) -> Array:
        """Change of the normals of the contact points, shape (dim, count)."""
        return np.array([np.bincount(self.point, part, count) for part in self.part])

    def rows(self, value: Index, shape: tuple[int, int]) -> sparse.csr_array:
        """The terms as a sparse matrix.

        Parameters
        ----------
        value : ndarray of int, shape (nvertices,)
            Scalar dof of the value at each vertex.
        shape : tuple of int
            (m, ndofs).
        """
        dim = len(self.part)
        column = dim * value[self.vertex] + np.arange(dim)[:, None]
        place = np.broadcast_to(self.point, column.shape).ravel(), column.ravel()
        return sparse.coo_array((self.part.ravel(), place), shape=shape).tocsr()


def _at_their_normals(normal: Array, own: Array) -> Array:
    """Barycentric weights of the point where the smooth normal is the normal of the facet.

    Of several such points it is the one nearest to the middle; shape (nfacets, ncorners). A polygon
    that shrinks evenly has no tangential displacement there.

    Parameters
    ----------
    normal : ndarray, shape (dim, nfacets, ncorners)
    own : ndarray, shape (dim, nfacets)
    """
    count = normal.shape[2]
    lean = normal - own[:, :, None]
    lean = lean - np.sum(lean * own[:, :, None], axis=0) * own[:, :, None]
    lean = lean.transpose(1, 0, 2)
    lean = lean / np.linalg.norm(lean, axis=(1, 2), keepdims=True)
    equations = np.concatenate((lean, np.full((len(lean), 1, count), 1.0)), axis=1)
    wrong = np.concatenate((-lean.mean(axis=2), np.zeros((len(lean), 1))), axis=1)
    # Directions with hardly any curvature do not determine the point: rcond drops them. A point far
    # outside the facet is replaced by the middle.
    off = np.einsum("fkc,fc->fk", np.linalg.pinv(equations, rcond=0.05), wrong)
    off = np.where(np.abs(off).max(axis=1, keepdims=True) < 1.0, off, 0.0)
    return np.asarray(off + 1.0 / count)


def _edges(
    outline: Outline, corners: Index, number: Index, normal: Array
) -> list[tuple[Index, Index, Array]]:
    """Terms of the corner opposite to each edge of a triangle, at the two ends of the edge."""
    x = outline.body.mesh.p[:, corners]
    across = np.cross(x[:, :, 1] - x[:, :, 0], x[:, :, 2] - x[:, :, 0], axis=0)
    across /= np.linalg.norm(across, axis=0)
    apex, i, j = np.arange(3), np.array([1, 2, 0]), np.array([2, 0, 1])
    edge, step = x[..., j] - x[..., i], normal[..., j] - normal[..., i]
    out = np.cross(edge, across[..., None], axis=0)  # l times nu
    size = np.sum(edge * step, axis=0) / 36.0
    ends = np.sort(np.stack((corners[:, i], corners[:, j])), axis=0).reshape(2, -1)
    _, which, met = np.unique(ends, axis=1, return_inverse=True, return_counts=True)
    which = which.ravel()
    order = np.argsort(which, kind="stable")
    one, two = order[met[which[order]] == 2].reshape(-1, 2).T
    out, size = out.reshape(3, -1), size.ravel()
    moved = 0.5 * (out[:, one] - out[:, two]) * 0.5 * (size[one] + size[two])
    point = number[:, apex].ravel()
    found = []
    for end in ends:
        found.append((point[one], end[one], -0.5 * moved))
        found.append((point[two], end[one], 0.5 * moved))
    return found
