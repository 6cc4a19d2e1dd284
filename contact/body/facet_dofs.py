"""Dofs on facets, and the edges of facets, found without numbering all edges of the mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import Mesh

Index = NDArray[np.int64]


def dofs_on_facets(basis: Any, facets: Index) -> Index:
    """What ``basis.get_dofs(facets).flatten()`` returns: ascending dofs of vertices, edges, facets.
    scikit-fem numbers all edges of a mesh in space for it, also where they carry no dofs."""
    dofs, mesh = basis.dofs, basis.mesh
    if mesh.dim() == 3 and mesh.bndelem is None:
        return np.asarray(basis.get_dofs(facets).flatten(), dtype=np.int64)
    held = [dofs.nodal_dofs[:, np.unique(mesh.facets[:, facets])]]
    if len(dofs.facet_dofs):
        held.append(dofs.facet_dofs[:, facets])
    if mesh.dim() == 3 and len(dofs.edge_dofs):
        held.append(dofs.edge_dofs[:, np.unique(edges_of_facets(mesh, facets))])
    return np.unique(np.concatenate([part.ravel() for part in held])).astype(np.int64)


def edges_of_facets(mesh: Mesh, facets: Index) -> Index:
    """Edges of facets of a mesh in space, ascending, shape (edges of a facet, nfacets).
    They are those edges of a facet's cell with both ends in the facet."""
    corners, cells = mesh.facets[:, facets], mesh.f2t[0, facets]
    edges = mesh.t2e[:, cells]
    ends = mesh.edges[:, edges]  # (2, edges of a cell, nfacets)
    inside = (ends[:, :, None] == corners).any(axis=2).all(axis=0)
    count = len(corners)  # a ring has as many edges as corners
    return np.asarray(np.sort(np.where(inside, edges, mesh.nedges), axis=0)[:count], dtype=np.int64)
