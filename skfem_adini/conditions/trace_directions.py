"""Split of the dofs into directions that a boundary trace depends on and the others."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from skfem_adini.assembly.csr_scatter import index_type
from skfem_adini.conditions.boundary_edges import Array, BoundaryEdges, Indices

Mask = NDArray[np.bool_]

_STRAIGHT_SQUARED_SINE = 1e-12  # edges that turn by less than 1e-6 are in line


class TraceDirections:
    r"""Orthonormal directions of vertex dofs (names, components, vertices), seen by edges or not.
    The trace on the edges, of tangents :math:`t_k`, sees u and the gradient along the
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
        """Return the free directions, the seen ones, and the eigenvalues of the latter (1 for u).
        The columns (dofs, directions) are an orthonormal basis, single dofs where edges are
        axis-parallel."""
        touched = np.einsum("cvii->cv", self.projector) > 0
        u = self.dofs[0][touched]
        gradient = self.dofs[1 : 1 + self.dim, touched].T
        eigenvalues, axes = np.linalg.eigh(self.projector[touched])
        axes = axes.transpose(0, 2, 1)
        largest = np.take_along_axis(axes, np.abs(axes).argmax(axis=2)[..., None], axis=2)
        axes = axes * np.sign(largest)
        hidden = eigenvalues <= _STRAIGHT_SQUARED_SINE * eigenvalues[:, -1:]

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
