r"""Correction of the normal rows where straight facets of unequal size approximate a curve.

The normal displacement of a contact point is :math:`\bar n \cdot u` at its vertex. Where facets
differ in length the mean normal is :math:`\bar n = n + \beta t`, so that a tangential displacement
counts as :math:`\beta u_t`, of alternating sign: the pressure oscillates on any mesh.

A uniform pressure needs the mean normals. So each facet adds to the row of its corner k
:math:`\omega_k (n_k - \tfrac1\omega \sum_j \omega_j n_j)` times the displacement of the point whose
smooth normal is that of the facet, n_k being the smooth normals at corners. The sum over corners is
zero, that over the facets of a vertex turns :math:`\bar n` into n to second order.

On triangles a straight edge ij in place of a parabola adds, by the divergence theorem,
:math:`\nu l \, (n_i - n_j) \cdot (x_i - x_j) / 36`, with the edge's outward normal :math:`\nu`."""

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

# ``centroid`` evaluates u a sixth of a facet from the vertex: two thirds of the correction remain.
_OF_MEAN = 2.0 / 3.0


@dataclass(frozen=True)
class Leaning:
    """Terms with displacements of vertices that are added to the rows of contact points."""

    point: Index  # contact point of each term, shape (n,)
    vertex: Index  # mesh vertex of each term, shape (n,)
    part: Array  # factors of its displacement over the weight of the point, shape (dim, n)

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
        """The terms as a sparse matrix (m, ndofs), by the scalar dofs of the vertices' values."""
        dim = len(self.part)
        column = dim * value[self.vertex] + np.arange(dim)[:, None]
        place = np.broadcast_to(self.point, column.shape).ravel(), column.ravel()
        return sparse.coo_array((self.part.ravel(), place), shape=shape).tocsr()


def _at_their_normals(normal: Array, own: Array) -> Array:
    """Barycentric weights of the point whose smooth normal is the facet's, (nfacets, ncorners).
    Of several such points it is the one nearest to the middle. A polygon that shrinks evenly has no
    tangential displacement there."""
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
