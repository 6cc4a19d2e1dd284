"""Dofs of a Basis, grouped by the entity of the mesh that carries them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from skfem import Basis

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def dof_entities(basis: Basis) -> tuple[Index, Array, Index]:
    """Vertex, edge, facet or cell of each dof (ndofs,), for ordering and for rigid motions.
    Also returned are the middles of all entities (dim, nentities) and those of each cell,
    (nentities a cell, ncells)."""
    dofs, mesh, dim = basis.dofs, basis.mesh, basis.elem.dim
    tables = (
        (dofs.nodal_dofs, None, "t"),
        (dofs.edge_dofs, "edges", "t2e"),  # which a mesh numbers when they are asked for
        (dofs.facet_dofs, "facets", "t2f"),
        (dofs.interior_dofs, "t", None),
    )
    entity = np.full(basis.N, -1, dtype=np.int64)
    start, points, cells = 0, [], []
    for table, of, in_cells in tables:
        if table is None or table.shape[0] == 0 or (of == "edges" and dim == 2):
            continue
        where = mesh.p if of is None else mesh.p[:, getattr(mesh, of)].mean(axis=1)
        entity[table] = start + np.arange(table.shape[1])
        points.append(where[:, : table.shape[1]])
        inside = np.arange(table.shape[1])[None] if in_cells is None else getattr(mesh, in_cells)
        cells.append(start + np.asarray(inside, dtype=np.int64))
        start += table.shape[1]
    whole = np.vstack(cells)
    return entity, np.hstack(points), whole if basis.tind is None else whole[:, basis.tind]
