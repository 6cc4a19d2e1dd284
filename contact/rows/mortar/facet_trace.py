"""Values of a body's scalar element at places on its facets, one place a row."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.facet_basis import places_on_facets
from contact.rows.outline import Outline

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def facet_trace(outline: Outline, facet: Index, X: Array) -> sparse.csr_array:
    """Trace of all scalar functions at X (dim - 1, n) on reference facets, (n, scalar dofs).
    `facet` counts positions in ``outline.facets``. Functions not connected to the facet vanish
    there and are left out, so that no rounding of theirs remains."""
    body, mesh = outline.body, outline.body.mesh
    corners = np.hstack((np.zeros((len(X), 1)), np.eye(len(X))))
    first, *ends = np.moveaxis(places_on_facets(mesh, outline.facets, corners), 2, 0)
    places = first[:, facet] + sum(
        (end - first)[:, facet] * s for end, s in zip(ends, X, strict=True)
    )
    cells = mesh.f2t[0, outline.facets[facet]]
    rows, columns, values = [], [], []
    for i, of_cells in enumerate(body.scalar_dofs.element_dofs):
        dof = of_cells[cells]
        on = np.flatnonzero((outline.scalar_dofs[facet] == dof[:, None]).any(axis=1))
        if on.size:
            at = places[:, on, None]
            field = body.element.gbasis(body.basis.mapping, at, i, tind=cells[on])[0]
            rows.append(on)
            columns.append(dof[on])
            values.append(np.broadcast_to(np.asarray(field), (on.size, 1))[:, 0])
    place = np.concatenate(rows), np.concatenate(columns)
    shape = facet.size, int(body.scalar_dofs.N)
    return sparse.csr_array(sparse.coo_array((np.concatenate(values), place), shape=shape))
