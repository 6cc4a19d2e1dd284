"""L2 projection onto the boundary trace of the Adini space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from skfem_adini.conditions.boundary_edges import (
    Array,
    BoundaryEdges,
    Indices,
    Value,
    facet_numbers,
    imposed_components,
    refuse_periodic,
    sample,
)
from skfem_adini.conditions.trace_directions import NOISE, TraceDirections, vertex_normals
from skfem_adini.elements.hermite_factors import (
    HERMITE,
    SLOPE,
    Function,
    adini_functions,
    derivatives,
)
from skfem_adini.elements.vertex_dofs import vertex_dofs
from skfem_adini.solvers.factorize import factorize


def project_trace(
    basis: Any,
    facets: Any,
    value: Value,
    components: int | Sequence[int] | None = None,
) -> Array:
    r"""Return dofs whose trace is the L2 projection of the data onto edges or faces.

    On an edge of length l the trace is :math:`\sum_k u_k h_k(s) + l\, (t \cdot \nabla u_k) m_k(s)`
    with the cubic Hermite functions h and m of the two ends; on a face it is the function of
    :class:`ElementQuadAdini` with the derivatives along the face. The unknowns are u and the part
    of the gradient that the trace depends on; the projection of `skfem.FacetBasis.project` is
    singular for these elements, because the functions of the normal derivative vanish on the facet.

    Parameters
    ----------
    basis
        Basis with an element of this package that has u and its gradient at the vertices, or
        `ElementVector` of one.
    facets
        Facet numbers, a boundary name, a callable of facet midpoints, or a set of these.
    value
        The data, as in :func:`essential_constraints`; integrated with 8 Gauss points on an edge,
        8 x 8 on a face.
    components
        Components of a vector field to project, counted from 0; all by default.

    Returns
    -------
    ndarray
        Vector (dofs,), zero away from the facets and in normal derivatives.

    Raises
    ------
    InputError
        No facets, an unknown boundary, another element, or data that are NaN or of the wrong
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
    dofs = vertex_dofs(basis)
    chosen = imposed_components(components, dofs.shape[1])
    mesh = basis.mesh
    refuse_periodic(mesh)
    chosen_facets = facet_numbers(mesh, facets)
    vertices = mesh.facets[:, chosen_facets]
    edges = BoundaryEdges.of(mesh, vertices)
    noise = np.full(chosen_facets.size, NOISE)
    tangents = edges.along(vertex_normals(mesh, chosen_facets, noise))

    trace = BoundaryTrace.of(mesh, vertices)
    functions, dx = trace.functions, trace.dx
    mass = np.einsum("ieq,jeq,eq->ije", functions, functions, dx, optimize=True)
    data = sample(value, trace.points, dofs.shape[1])

    x = np.zeros(dofs.size)
    for c in chosen:
        directions = TraceDirections(dofs, mesh.dim())
        directions.add(c, edges, tangents)
        _, seen, _ = directions.split()
        local = np.concatenate([dofs[: 1 + mesh.dim(), c, node] for node in vertices])
        rows, columns = np.broadcast_arrays(local[:, None], local[None])
        shape = (dofs.size, dofs.size)
        M = sp.csc_array((mass.ravel(), (rows.ravel(), columns.ravel())), shape=shape)
        b = np.zeros(dofs.size)
        np.add.at(b, local, np.einsum("ieq,eq,eq->ie", functions, data[c], dx))
        x += seen @ factorize(seen.T @ M @ seen).solve(seen.T @ b)
    return x


@dataclass(frozen=True)
class BoundaryTrace:
    r"""Trace :math:`\sum_k u_k N_k+ \sum_{jk} (\partial_j F(k) \cdot \nabla u_k) H_{jk}` of facets.
    The map :math:`F` takes the unit interval or square to the facet, k are its vertices: cubic
    Hermite on edges, Adini's rectangle on faces."""

    points: Array  # Gauss points, shape (dim, facets, points)
    dx: Array  # weights times surface element, shape (facets, points)
    functions: Array  # of u, u_x, u_y (, u_z), vertex by vertex, (functions, facets, points)

    @classmethod
    def of(cls, mesh: Any, vertices: Indices) -> BoundaryTrace:
        """Return the traces on facets with vertices (2 or 4, facets)."""
        # Exact to degree 15: products of traces have degree 6, data may have more.
        s, w = np.polynomial.legendre.leggauss(8)
        s, w = (s + 1) / 2, w / 2
        p = mesh.p[:, vertices]
        if len(vertices) == 2:
            edges = BoundaryEdges.of(mesh, vertices)
            side = (edges.last - edges.first)[:, :, None]
            corners = np.array([[0.0], [1.0]])
            cubics = (((HERMITE,),), ((SLOPE,),))
            functions = _functions(cubics, corners, s[None], [[side], [side]])
            return cls(edges.points(s), edges.length[:, None] * w, functions)
        X = np.array(np.meshgrid(s, s)).reshape(2, -1)
        weights = np.outer(w, w).ravel()
        corners = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
        a, b = ((p[:, k] - p[:, 0])[:, :, None] for k in (1, 3))
        c = (p[:, 2] - p[:, 3])[:, :, None] - a
        tangents = [[a + c * y, b + c * x] for x, y in corners]
        area = np.linalg.norm(np.cross(a + c * X[1], b + c * X[0], axis=0), axis=0)
        points = p[:, 0, :, None] + a * X[0] + b * X[1] + c * (X[0] * X[1])
        return cls(points, area * weights, _functions(adini_functions(2), corners, X, tangents))


def _functions(
    reference: tuple[Function, ...], corners: Array, X: Array, tangents: list[list[Array]]
) -> Array:
    """Return N and, for each physical derivative, the sum of tangent times H."""
    rows = []
    for corner, along in zip(corners, tangents, strict=True):
        value, *slopes = derivatives(reference, corner, X, 0)
        rows.append(np.broadcast_to(value, (along[0].shape[1], len(value))))
        rows += list(sum(t * slope for t, slope in zip(along, slopes, strict=True)))
    return np.array(rows)
