"""Conformity at hanging vertices, as a linear parametrisation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np
import scipy
import scipy.sparse as sp

from skfem_adini.conditions.boundary_edges import Array, BoundaryEdges, Indices, refuse_periodic
from skfem_adini.elements.element_quad_adini import ElementQuadAdini
from skfem_adini.elements.hermite_factors import HERMITE, SLOPE, derivatives
from skfem_adini.elements.vertex_dofs import full_name, scalar_element, vertex_dofs
from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import finite_numbers


def hanging_constraints(
    basis: Any, essential: tuple[Any, Array] | None = None
) -> tuple[sp.csc_array, Array]:
    r"""Return T and x0 such that x = T z + x0 is continuous across edges with hanging vertices.

    A vertex hangs when it lies inside an edge of a cell that does not have it as a corner. There u
    and the tangential derivative follow from the two ends of the edge, and the normal derivative
    stays free. In the middle of an edge of length h with end values :math:`u_0, u_1` and
    tangential derivatives :math:`t_0, t_1`,

    .. math::
        u_m = \frac{u_0 + u_1}{2} + \frac{h}{8} (t_0 - t_1), \quad
        t_m = \frac{3 (u_1 - u_0)}{2 h} - \frac{t_0 + t_1}{4} .

    Elsewhere they are value and slope of the same cubic, so an edge may carry any number of
    hanging vertices, at any places and in any direction. An end of the edge may hang on another.

    Parameters
    ----------
    basis
        Basis with `ElementQuadAdini` or `ElementVector(ElementQuadAdini())` on a `MeshQuad` whose
        parts share vertices but not all edges, such as the sum of a mesh and a refined one
        (`mesh + other` merges equal vertices).
    essential
        What :func:`essential_constraints` returned for the same basis. The result then meets both
        sets of conditions. Facets with a cell on one side only include the edges that hanging
        vertices divide, so name the boundary by its coordinates or by `mesh.boundaries`, not by
        `mesh.boundary_facets()`.

    Returns
    -------
    T
        Sparse matrix (dofs, free parameters); without slanted edges a column belongs to one free
        dof, with the dofs that depend on it.
    x0
        Vector (dofs,), zero without `essential`.

    Raises
    ------
    InputError
        Another element, a vertex inside two edges at once, or conditions of `essential` at a
        hanging vertex.

    Notes
    -----
    Every vertex inside an edge that has a cell on one side only counts as hanging, so the two sides
    of a crack are joined where their vertices differ.

    Examples
    --------
    One cell beside two, on the rectangle [0, 2] x [0, 1]:

    >>> import numpy as np
    >>> from skfem import Basis, MeshQuad
    >>> from skfem_adini import ElementQuadAdini, essential_constraints
    >>> mesh = MeshQuad() + MeshQuad.init_tensor(np.array([1.0, 2]), np.array([0, 0.5, 1]))
    >>> basis = Basis(mesh, ElementQuadAdini())
    >>> T, x0 = hanging_constraints(basis)
    >>> T.shape
    (24, 22)
    >>> m = np.flatnonzero((mesh.p.T == (1, 0.5)).all(axis=1))[0]
    >>> T[[basis.nodal_dofs[0, m]]].data.tolist()
    [0.5, 0.125, 0.5, -0.125]

    With u = 0 on the left as well:

    >>> T, x0 = hanging_constraints(basis, essential_constraints(basis, lambda x: x[0] == 0))
    >>> T.shape
    (24, 18)

    The condensed problem is `A = T.T @ K @ T`, `b = T.T @ (f - K @ x0)`.
    """
    elem = scalar_element(basis)
    if not isinstance(elem, ElementQuadAdini):
        raise InputError(
            f"basis: expected ElementQuadAdini or ElementVector(ElementQuadAdini()), "
            f"got {full_name(elem)}"
        )
    refuse_periodic(basis.mesh)
    dofs = vertex_dofs(basis, weighted=True)
    hanging = _HangingVertices.find(basis.mesh)
    follow = _resolved(_one_step(dofs, hanging))
    T, x0 = _checked_conditions(essential, dofs.size)

    slaves = dofs[:, :, hanging.vertex].ravel()
    others = np.setdiff1d(dofs, slaves)
    own = np.asarray(abs(T[slaves]).sum(axis=0)).ravel() > 0
    if np.asarray(abs(T[others][:, own]).sum()) or own.sum() != len(slaves) or x0[slaves].any():
        raise InputError(
            "essential: it has conditions at hanging vertices, as mesh.boundary_facets() gives, "
            "which includes the edges they divide; name the boundary by its coordinates"
        )
    columns = sp.hstack([T[:, ~own], _normals(dofs, hanging)])
    return sp.csc_array(follow @ columns), follow @ x0


def _checked_conditions(essential: Any, rows: int) -> tuple[sp.csc_array, Array]:
    """Return T and x0 of the essential conditions, or the identity and zeros without conditions."""
    if essential is None:
        return sp.eye_array(rows, format="csc"), np.zeros(rows)
    pair = isinstance(essential, tuple | list) and len(essential) == 2
    if not pair or not sp.issparse(essential[0]):
        raise InputError(
            "essential: expected (T, x0) as essential_constraints returns, T sparse, got "
            f"{type(essential).__name__}"
        )
    T = sp.csc_array(cast(Any, essential[0]))
    shapes = T.shape, np.shape(essential[1]) if isinstance(essential[1], np.ndarray) else None
    if T.shape[0] != rows or shapes[1] != (rows,):
        raise InputError(f"essential: expected T and x0 with {rows} rows, got {shapes}")
    finite_numbers("essential: T", T.data, T.data.shape)
    return T, finite_numbers("essential: x0", essential[1], (rows,))


@dataclass(frozen=True)
class _HangingVertices:
    """Vertices inside edges."""

    vertex: Indices  # the vertices, shape (hanging,)
    edges: BoundaryEdges  # the edge that each lies on
    s: Array  # fraction of the edge, from 0 at its first vertex to 1 at its last

    @classmethod
    def find(cls, mesh: Any) -> _HangingVertices:
        single = mesh.facets[:, mesh.boundary_facets()]
        edges = BoundaryEdges.of(mesh, single)
        nodes = np.unique(single)
        middle = (edges.first + edges.last) / 2
        near = scipy.spatial.KDTree(mesh.p[:, nodes].T).query_ball_point(middle.T, edges.length / 2)
        edge = np.repeat(np.arange(len(near)), [len(found) for found in near])
        vertex = nodes[np.concatenate([np.array(found, dtype=int) for found in near])]

        tangent, length = edges.tangent[:, edge], edges.length[edge]
        offset = mesh.p[:, vertex] - edges.first[:, edge]
        s = (tangent * offset).sum(axis=0) / length
        height = np.abs(tangent[0] * offset[1] - tangent[1] * offset[0])
        rounding = 4 * np.finfo(float).eps * np.abs(mesh.p).max()
        close = 1e-9  # relative to the length of an edge: a nearer vertex lies on it or its end
        inside = (height <= close * length + rounding) & (np.minimum(s, 1 - s) > close)
        vertex, edge = vertex[inside], edge[inside]
        if len(np.unique(vertex)) < len(vertex):
            twice = np.flatnonzero(np.bincount(vertex) > 1)[0]
            raise InputError(f"mesh: vertex {twice} lies inside two edges; do the cells overlap?")
        return cls(vertex, BoundaryEdges.of(mesh, single[:, edge]), s[inside])

    @cached_property
    def tangent(self) -> Array:
        """Unit tangents of the edges, shape (2, hanging).
        Rounding of coordinates must not mix the two slopes at a vertex on an axis-parallel edge."""
        tangent = self.edges.tangent
        return np.where(np.abs(tangent) < 1e-12, 0.0, tangent)


def _one_step(dofs: Indices, hanging: _HangingVertices) -> sp.csr_array:
    """Return the matrix that computes dofs at hanging vertices from those at edges' ends."""
    edges, count = hanging.edges, dofs.shape[1]
    t, h = hanging.tangent, edges.length
    n = np.array([-t[1], t[0]])
    rows, columns, entries = [], [], []

    def add(row: Indices, column: Indices, entry: Array) -> None:
        rows.append(row)
        columns.append(column)
        entries.append(entry)

    for c in range(count):
        u, *slopes = dofs[:, c]
        m = hanging.vertex
        others = np.setdiff1d(dofs[:, c], dofs[:, c, m])
        add(others, others, np.ones(len(others)))
        for end, node in enumerate(edges.vertices):
            corner, s = np.array([float(end)]), hanging.s[None]
            (value, slope), (value_s, slope_s) = (
                derivatives((((HERMITE,),), ((SLOPE,),)), corner, s, order) for order in (0, 1)
            )
            add(u[m], u[node], value)
            for i, u_i in enumerate(slopes):
                add(u[m], u_i[node], h * slope * t[i])
                add(u_i[m], u[node], t[i] * value_s / h)
                for j, u_j in enumerate(slopes):
                    add(u_i[m], u_j[node], t[i] * slope_s * t[j])
        for i, j in np.ndindex(2, 2):
            add(slopes[i][m], slopes[j][m], n[i] * n[j])
    place = (np.concatenate(rows), np.concatenate(columns))
    matrix = sp.csr_array((np.concatenate(entries), place), shape=(dofs.size, dofs.size))
    matrix.eliminate_zeros()
    return matrix


def _resolved(step: sp.csr_array) -> sp.csr_array:
    """Repeat the step until the ends of the edges no longer hang."""
    for _ in range(60):  # squaring doubles the levels of hanging edges that are resolved
        twice = step @ step
        if abs(twice - step).max() <= 1e-13 * abs(step).max():  # hundreds of rounding errors
            return step
        step = twice
    raise InputError("mesh: the hanging vertices depend on each other; refine one of the sides")


def _normals(dofs: Indices, hanging: _HangingVertices) -> sp.csc_array:
    """Return unit columns of the normal derivatives at hanging vertices."""
    t = hanging.tangent
    n = np.array([-t[1], t[0]])
    n = n * np.sign(np.take_along_axis(n, np.abs(n).argmax(axis=0)[None], axis=0))
    rows = dofs[1:3][:, :, hanging.vertex]
    entries = np.broadcast_to(n[:, None], rows.shape)
    columns = np.broadcast_to(np.arange(rows[0].size).reshape(rows[0].shape), rows.shape)
    shape = (dofs.size, rows[0].size)
    matrix = sp.csc_array((entries.ravel(), (rows.ravel(), columns.ravel())), shape=shape)
    matrix.eliminate_zeros()
    return matrix
