"""L2 projection onto the boundary trace of the Adini space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from .boundary_edges import Array, BoundaryEdges, Value, adini_dofs, imposed_components
from .trace_directions import TraceDirections

_GAUSS_POINTS = 8


def project_trace(
    basis: Any,
    facets: Any,
    value: Value,
    components: int | Sequence[int] | None = None,
) -> Array:
    r"""Return dofs whose trace is the L2 projection of the data onto the edges.

    On an edge of length l the trace is :math:`\sum_k u_k h_k(s) + l\, (t \cdot \nabla u_k) m_k(s)`
    with the cubic Hermite functions h and m of the two ends. The unknowns are u and the part of
    the gradient that the given edges see; the projection of `skfem.FacetBasis.project` is singular
    for this element, because the functions of the normal derivative vanish on the edge.

    Parameters
    ----------
    basis
        Basis with `ElementQuadAdini` or `ElementVector(ElementQuadAdini())`.
    facets
        Edge numbers, a boundary name, a callable of edge midpoints, or a set of these.
    value
        The data, as in :func:`essential_constraints`; integrated by 8 Gauss points an edge.
    components
        Components of a vector field to project, counted from 0; all by default.

    Returns
    -------
    ndarray
        Vector (dofs,), zero away from the edges and in normal derivatives.

    Raises
    ------
    InputError
        No edges, an unknown boundary, another element, or data that are NaN or of the wrong
        shape.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> from skfem_adini import ElementQuadAdini
    >>> basis = Basis(MeshQuad().with_defaults(), ElementQuadAdini())
    >>> x = project_trace(basis, "bottom", lambda x: x[0] ** 2)
    >>> [round(float(u), 9) for u in x[basis.nodal_dofs[:, 1]]]
    [1.0, 2.0, 0.0]
    """
    dofs = adini_dofs(basis)
    chosen = imposed_components(components, dofs.shape[1])
    edges = BoundaryEdges.select(basis.mesh, facets)

    s, w = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    s, w = (s + 1) / 2, w / 2
    functions = _local_trace(edges, s)
    mass = np.einsum("ieq,jeq,q,e->ije", functions, functions, w, edges.length)
    data = edges.sample(value, s, dofs.shape[1])

    x = np.zeros(dofs.size)
    for c in chosen:
        directions = TraceDirections(dofs)
        directions.add(c, edges)
        _, seen, _ = directions.split()
        local = np.concatenate([dofs[:, c, node] for node in edges.vertices])
        rows, columns = np.broadcast_arrays(local[:, None], local[None])
        shape = (dofs.size, dofs.size)
        M = sp.csc_array((mass.ravel(), (rows.ravel(), columns.ravel())), shape=shape)
        b = np.zeros(dofs.size)
        np.add.at(b, local, np.einsum("ieq,eq,q,e->ie", functions, data[c], w, edges.length))
        x += seen @ spsolve(sp.csc_matrix(seen.T @ M @ seen), seen.T @ b)
    return x


def _local_trace(edges: BoundaryEdges, s: Array) -> Array:
    """Return the traces of u, u_x, u_y of the first, then the last vertex, (6, edges, points)."""
    value = 1 - 3 * s**2 + 2 * s**3
    slopes = np.array([s * (1 - s) ** 2, -(s**2) * (1 - s)])
    along = (edges.tangent * edges.length)[None, :, :, None] * slopes[:, None, None, :]
    values = np.broadcast_to(np.array([value, 1 - value])[:, None, None, :], along[:, :1].shape)
    return np.concatenate([values, along], axis=1).reshape(6, *along.shape[2:])
