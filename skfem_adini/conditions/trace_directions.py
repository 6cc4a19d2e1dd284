"""Split of the dofs into the directions that determine a boundary trace and the others."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from skfem_adini.assembly.csr_scatter import index_type
from skfem_adini.conditions.boundary_edges import Array, BoundaryEdges, Indices

Mask = NDArray[np.bool_]


class TraceDirections:
    r"""Orthonormal directions of vertex dofs (names, components, vertices), split by a trace on
    edges. The trace on edges with tangents :math:`t_k` depends on u and the gradient along the
    eigenvectors of :math:`\sum_k t_k t_k^T` with non-zero eigenvalue."""

    def __init__(self, dofs: Indices, dim: int) -> None:
        self.dofs = dofs
        self.dim = dim
        self.projector = np.zeros((*dofs.shape[1:], dim, dim))

    def add(self, component: int, edges: BoundaryEdges, tangents: tuple[Array, Array]) -> None:
        """Add the tangents (dim, edges) of edges at their two ends, for one component."""
        for node, tangent in zip(edges.vertices, tangents, strict=True):
            outer = np.einsum("ie,je->eij", tangent, tangent)
            np.add.at(self.projector[component], node, outer)

    def split(self) -> tuple[sp.csc_array, sp.csc_array, Array]:
        """Return the free directions, those of the trace, and eigenvalues of the latter (1 for u).

        The columns (dofs, directions) are an orthonormal basis, of dofs at axis-parallel edges."""
        touched = np.einsum("cvii->cv", self.projector) > 0
        u = self.dofs[0][touched]
        gradient = self.dofs[1 : 1 + self.dim, touched].T
        eigenvalues, axes = np.linalg.eigh(self.projector[touched])
        axes = axes.transpose(0, 2, 1)
        largest = np.take_along_axis(axes, np.abs(axes).argmax(axis=2)[..., None], axis=2)
        axes = axes * np.sign(largest)
        hidden = eigenvalues <= 1e-12 * eigenvalues[:, -1:]  # squared sine of the turn

        untouched = np.ones(self.dofs.size, dtype=bool)
        untouched[u] = untouched[gradient] = False
        free = self._columns(np.flatnonzero(untouched), gradient, axes, hidden)
        seen = self._columns(u, gradient, axes, ~hidden)
        return free, seen, np.concatenate([np.ones(len(u)), eigenvalues[~hidden]])

    def _columns(
        self, single: Indices, gradient: Indices, axes: Array, chosen: Mask
    ) -> sp.csc_array:
        """Return unit columns for single dofs, then the chosen axes of the gradients."""
        vertex, _ = np.nonzero(chosen)
        places, entries = gradient[vertex], axes[chosen]
        filled = entries != 0
        alone = len(single)
        size = alone + int(filled.sum())
        kind = index_type(size, self.dofs.size)
        data, rows = np.ones(size), np.empty(size, dtype=kind)
        data[alone:] = entries[filled]
        rows[:alone], rows[alone:] = single, places[filled]
        starts = np.arange(alone + len(vertex) + 1, dtype=kind)
        starts[alone + 1 :] = alone + np.cumsum(filled.sum(axis=1))
        return sp.csc_array((data, rows, starts), shape=(self.dofs.size, alone + len(vertex)))


CORNER = 0.9  # radians: facets that turn by more meet in a corner (hexagon yes, octagon no)
NOISE = 1e-3  # radians: facets that turn by less are in line, up to noise of the coordinates


def vertex_normals(mesh: Any, facets: Indices, turn: Array) -> Array:
    """Unit normals (dim, vertices), zero at corners (turned by more than `turn`) and elsewhere.
    The weights of N. Max (Weights for computing vertex normals from facet normals, J. Graphics
    Tools 4, 1999) make them exact on circles and spheres, whatever the facets' lengths."""
    vertices = mesh.facets[:, facets]
    normals = _at_corners(mesh.p[:, vertices])
    cells = mesh.t[:, mesh.f2t[0, facets]]
    outward = mesh.p[:, vertices].mean(axis=1) - mesh.p[:, cells].mean(axis=1)
    normals = normals * np.where(np.sum(normals * outward[:, None], axis=0) < 0, -1.0, 1.0)
    # Inside the mesh the first cell may be on either side: align the normals at each vertex.
    nodes, place = np.unique(vertices, return_inverse=True)
    place = place.reshape(vertices.shape)
    first = np.zeros((len(mesh.p), nodes.size))
    first[:, place] = normals
    against = (mesh.f2t[1, facets] >= 0) & (np.sum(normals * first[:, place], axis=0) < 0)
    normals = np.where(against, -normals, normals)

    mean = _mean(nodes.size, place, normals * corner_weights(mesh.p[:, vertices], axis=1))
    # A normal differs by half of the turn from the unweighted mean, in 2-D for facets of any
    # lengths. Distances are compared, because cosines do not resolve small angles.
    middle = _mean(nodes.size, place, normals) if len(mean) == 2 else mean
    off = np.linalg.norm(normals - middle[:, place], axis=0)
    corner = np.zeros(nodes.size, dtype=bool)
    np.logical_or.at(corner, place, off > 2.0 * np.sin(0.25 * turn))
    whole = np.zeros((len(mesh.p), mesh.nvertices))
    whole[:, nodes] = np.where(corner, 0.0, mean)
    return whole


def _mean(count: int, vertices: Indices, parts: Array) -> Array:
    """Return sums of vectors (dim, corners, facets) at the vertices, scaled to unit length."""
    total = np.zeros((len(parts), count))
    for row, part in zip(total, parts, strict=True):
        np.add.at(row, vertices, part)
    size = np.linalg.norm(total, axis=0)
    return total / np.where(size > 0, size, 1.0)


def corner_weights(x: Array, axis: int) -> Array:
    """Return Max's weights of facets at their corners x (dim, ...), in order along `axis`."""
    ahead, behind = np.roll(x, -1, axis) - x, np.roll(x, 1, axis) - x
    if len(x) == 2:
        return 1.0 / np.linalg.norm(ahead, axis=0)
    area = np.linalg.norm(np.cross(ahead, behind, axis=0), axis=0)
    return np.asarray(area / (np.sum(ahead**2, axis=0) * np.sum(behind**2, axis=0)))


def _at_corners(x: Array) -> Array:
    """Return unit normals, of either sign, of facets at their corners x, in the shape of x."""
    if len(x) == 2:
        side = x[:, 1:] - x[:, :1]
        length = np.linalg.norm(side, axis=0)
        normal = np.stack([side[1], -side[0]]) / length
        return np.repeat(normal, 2, axis=1)
    cross = np.cross(np.roll(x, -1, axis=1) - x, np.roll(x, 1, axis=1) - x, axis=0)
    return cross / np.linalg.norm(cross, axis=0)
