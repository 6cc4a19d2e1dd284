"""Dofs of a Basis, grouped by the entity of the mesh that carries them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from skfem import Basis

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def dof_entities(basis: Basis) -> tuple[Index, Array, Index]:
    """Entities of all dofs, for ordering and for rigid motions.

    Parameters
    ----------
    basis : Basis
        Of a vector element.

    Returns
    -------
    entity : ndarray, shape (ndofs,)
        Number of the vertex, edge, facet or cell of each dof.
    points : ndarray, shape (dim, nentities)
    cells : ndarray, shape (nentities a cell, ncells)
        Entities of each cell.
    """
    dofs, mesh, dim = basis.dofs, basis.mesh, basis.elem.dim
    tables = (
        (dofs.nodal_dofs, None),
        (dofs.edge_dofs, "edges"),  # which a mesh numbers when they are asked for
        (dofs.facet_dofs, "facets"),
        (dofs.interior_dofs, "t"),
    )
    entity = np.full(basis.N, -1, dtype=np.int64)
    start, points = 0, []
    for table, of in tables:
        if table is None or table.shape[0] == 0 or (of == "edges" and dim == 2):
            continue
        where = mesh.p if of is None else mesh.p[:, getattr(mesh, of)].mean(axis=1)
        entity[table] = start + np.arange(table.shape[1])
        points.append(where[:, : table.shape[1]])
        start += table.shape[1]
    cells = entity[basis.element_dofs[::dim]]
    first = np.flatnonzero(np.r_[True, np.any(cells[1:] != cells[:-1], axis=1)])
    return entity, np.hstack(points), cells[first]
