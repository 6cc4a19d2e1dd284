"""Dirichlet conditions on edges and faces of any direction, as an affine parametrisation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from skfem_adini.conditions.boundary_edges import (
    Array,
    BoundaryEdges,
    Indices,
    Value,
    facet_corners,
    facet_numbers,
    imposed_components,
    refuse_periodic,
    sample,
)
from skfem_adini.conditions.trace_directions import CORNER, NOISE, TraceDirections, vertex_normals
from skfem_adini.elements.straight_cells import GEOMETRY
from skfem_adini.elements.vertex_dofs import vertex_dofs
from skfem_adini.errors import InputError


def essential_constraints(
    basis: Any,
    facets: Any = None,
    value: Value = 0.0,
    components: int | Sequence[int] | None = None,
    smooth: bool | Sequence[bool] = False,
    clamp_normal: bool = False,
) -> tuple[sp.csc_array, Array]:
    r"""Return T and x0 such that u = value on the facets for every x = T z + x0.

    At a vertex p of the given edges (in 3-D of the edges of the given faces), with unit tangents
    :math:`t_k`, the conditions are
    :math:`u(p) = g(p)` and :math:`t_k \cdot \nabla u(p) = \partial g / \partial t_k` on each edge
    that meets there. The gradient is their least-squares solution

    .. math::
        \Big(\sum_k t_k t_k^T\Big) \nabla u(p) = \sum_k t_k \, \partial g / \partial t_k .

    - Edges in one line (turning by less than 1e-3 radians, as by noise on coordinates) fix the
      derivative along it, as the mean of the derivatives from both sides, and leave the normal
      derivative free: one column of T with the entries of the unit normal. On the edges u then
      varies with that derivative, in proportion to the turn; the relative error of a uniform stress
      is up to some 1e-5.
    - Edges in one plane in 3-D fix the gradient in that plane and leave the normal derivative.
    - Edges that turn further fix the whole gradient, each its own component: no conflict arises.

    So u = value holds on every facet, and polynomial solutions on polygons and polyhedra are exact.
    Where facets approximate a curve these are too many conditions, unless the data have the right
    normal derivative: a field that is zero on the facets has gradient zero at their vertices, the
    solution has not. With ``smooth=True`` facets that turn by less than .9 radians follow a smooth
    boundary. There the :math:`t_k` are the edges projected along its normal, and the data are
    sampled on the cubics with these tangents; on the facets the error of u is of the order of
    their distance from the curve.

    Relative errors of a ring (radii 1 and 2, twisted and stretched, Adini), with n facets on a
    quarter of its inner side. There the displacement is zero, or has exact data that are not zero:

    ====================  =======  =======  =======  =======  ===========
    u in L2               n = 4    n = 8    n = 16   n = 32   order
    ====================  =======  =======  =======  =======  ===========
    zero, facets          .125     .0635    .0322    .0163    1.0
    zero, smooth          .0228    .00644   .00170   .000438  2.0
    data, facets          7.6e-4   6.3e-5   4.6e-6   3.2e-7   3.9
    data, smooth          .0179    .00506   .00134   .000344  2.0
    ====================  =======  =======  =======  =======  ===========

    The tangential derivative is that of the polynomial through g at 10 Chebyshev-Lobatto points
    of the edge: exact for polynomials of degree 9 along the edge, else of order :math:`h^9`.

    Parameters
    ----------
    basis
        Basis with an element of this package that has u and its gradient at the vertices, or
        `ElementVector` of one.
    facets
        Facet numbers, a boundary name, a callable of facet midpoints, or a set of these; or a
        mapping from boundary names to values, or a list of pairs (facets, value), which replace
        `value`; the whole boundary by default.
    value
        The data g: a number, or a callable of points (dim, edges, points) returning (edges,
        points) ((components, edges, points) for vector fields). For a vector field also a
        sequence of one number or scalar callable for each component; None leaves it free.
    components
        Components of a vector field on which to impose the data, counted from 0; all by default.
    smooth
        Whether facets that turn by less than .9 radians follow a smooth boundary; a sequence has
        one entry for each condition.
    clamp_normal
        Set the normal derivative at the vertices to zero too (for BFS also u_xy), for clamped
        plates, as `essential_dofs` does.

    Returns
    -------
    T
        Sparse matrix (dofs, free parameters) with orthonormal columns.
    x0
        Vector (dofs,) that satisfies the conditions, orthogonal to the columns of T.

    Raises
    ------
    InputError
        No facets, an unknown boundary, another element, data that are NaN or of the wrong shape,
        two boundaries with different values at a common vertex, or a periodic mesh.

    Examples
    --------
    >>> import numpy as np
    >>> from skfem import Basis, MeshQuad
    >>> from skfem_adini import ElementQuadAdini
    >>> mesh = MeshQuad(np.array([[0.0, 2, 1, -1], [0, 1, 3, 2]]), np.array([[0, 1, 2, 3]]).T)
    >>> basis = Basis(mesh, ElementQuadAdini())
    >>> T, x0 = essential_constraints(basis, mesh.boundary_facets()[:1], lambda x: x[0] ** 2)
    >>> T.shape
    (12, 8)

    The condensed problem is `A = T.T @ K @ T`, `b = T.T @ (f - K @ x0)`.
    """
    dofs = vertex_dofs(basis)
    refuse_periodic(basis.mesh)
    count, vertices = dofs.shape[1:]
    conditions = _conditions(facets, value)
    if not conditions:
        raise InputError("facets: the mapping is empty; name at least one boundary")

    each = list(smooth) if isinstance(smooth, list | tuple) else [smooth] * len(conditions)
    if len(each) != len(conditions) or not all(isinstance(one, bool) for one in each):
        raise InputError(
            f"smooth={smooth!r}: expected True or False, or one of them for each of the "
            f"{len(conditions)} conditions"
        )

    parts = []
    for (where, g), turn in zip(
        conditions, (CORNER if one else NOISE for one in each), strict=True
    ):
        chosen = imposed_components(components, count)
        if isinstance(g, list | tuple):
            chosen = [c for c in chosen if c >= len(g) or g[c] is not None]
            g = [0.0 if part is None else part for part in g]
        parts.append((where, facet_numbers(basis.mesh, where), g, chosen, turn))

    s, derivative = _differentiation()
    sampled = []
    for c in range(count):
        mine = [part for part in parts if c in part[3]]
        normals = _normals(basis.mesh, [(facets, turn) for _, facets, _, _, turn in mine])
        for where, facets, g, _, _ in mine:
            edges = BoundaryEdges.of(basis.mesh, basis.mesh.facets[:, facets])
            ends = edges.along(normals)
            sampled.append((where, edges, c, ends, sample(g, edges.curve(s, ends), count)[c]))
    # Values at a vertex that differ by less, relative to the largest one, agree.
    tolerance = 1e-10 * max((np.abs(data).max() for *_, data in sampled), default=0.0)

    dim = basis.mesh.dim()
    directions = TraceDirections(dofs, dim)
    nodal = np.full((count, vertices), np.nan)
    right = np.zeros(dofs.size)
    for where, edges, c, ends, data in sampled:
        directions.add(c, edges, ends)
        for end, (node, tangent) in enumerate(zip(edges.vertices, ends, strict=True)):
            _set_nodal(nodal[c], node, data[:, -end], where, tolerance)
            slope = tangent * (data @ derivative[end]) / edges.length
            np.add.at(right, dofs[1 : 1 + dim, c, node], slope)
    right[dofs[0]] = np.nan_to_num(nodal)
    T, seen, weights = directions.split()
    if clamp_normal:
        T = _without(T, [dofs[:, c, edges.vertices] for _, edges, c, *_ in sampled])
    return T, seen @ ((seen.T @ right) / weights)


def _without(T: sp.csc_array, clamped: list[Indices]) -> sp.csc_array:
    """Return the columns without entries in any of the dofs."""
    held = np.zeros(T.shape[0], dtype=bool)
    for dofs in clamped:
        held[dofs] = True
    return sp.csc_array(T[:, np.asarray(held @ abs(T)) == 0])


def _conditions(facets: Any, value: Value) -> list[tuple[Any, Any]]:
    """Return the conditions as pairs of boundary and data."""
    if isinstance(facets, Mapping):
        return list(facets.items())
    pairs = isinstance(facets, list) and all(isinstance(item, tuple) for item in facets)
    return facets if pairs else [(facets, value)]


def _normals(mesh: Any, parts: list[tuple[Indices, float]]) -> Array:
    """Return the normals at vertices of the facets of all conditions on a component."""
    facets, turn = np.zeros(0, dtype=int), np.zeros(0)
    if parts:
        every = np.concatenate([here for here, _ in parts])
        facets, place = np.unique(every, return_inverse=True)
        turn = np.full(facets.size, np.inf)
        np.minimum.at(turn, place, np.concatenate([np.full(h.size, t) for h, t in parts]))
    return vertex_normals(mesh, facets, turn)


def _differentiation() -> tuple[Array, Array]:
    """Return Lobatto points on [0, 1] and the weights of the derivatives at 0 and at 1."""
    powers = np.arange(10)  # exact for cubic data on a cubic curve: degree nine along it
    s = (1 - np.cos(np.pi * powers / 9)) / 2
    vandermonde = (2 * s[:, None] - 1) ** powers
    ends = 2 * powers * np.array([(-1.0) ** (powers + 1), np.ones(10)])
    return s, np.linalg.solve(vandermonde.T, ends.T).T


def _set_nodal(nodal: Array, node: Indices, data: Array, where: Any, tolerance: float) -> None:
    """Write nodal values, and check them against values that are already set."""
    clash = np.flatnonzero(np.abs(nodal[node] - data) > tolerance)
    if clash.size:
        k = clash[0]
        raise InputError(
            f"value: vertex {node[k]} gets {nodal[node[k]]:.6g} and {data[k]:.6g} (the latter from "
            f"{where!r}); the data must agree where boundaries meet"
        )
    nodal[node] = data


def essential_dofs(
    basis: Any,
    facets: Any = None,
    clamp_normal: bool = False,
    components: int | Sequence[int] | None = None,
) -> Indices:
    """Return the dofs of u and of its tangential derivatives on axis-parallel edges or faces.

    Along an edge u is the cubic of its values and tangential derivatives at the two ends (on a
    face, the Adini function of its values and two tangential derivatives at the corners), so
    these dofs fix the trace; the normal derivative stays free. Where edges or faces of several
    directions meet, the derivatives along all of them belong to the trace.

    Use it instead of ``basis.get_dofs(facets)``, the usual choice for Lagrange elements. With the
    elements of this package `get_dofs` also returns the normal derivative; fixing that
    over-constrains a second-order problem and reduces its order in L2 from 4 to 1.

    Parameters
    ----------
    basis
        Basis with an element of this package that has u and its gradient at the vertices, or
        `ElementVector` of one.
    facets
        Facet numbers, a boundary name, a callable of facet midpoints, or a set of these; the whole
        boundary by default.
    clamp_normal
        Add the normal derivative (for BFS also u_xy), for clamped plates. Facets may then have
        any direction.
    components
        Components of a vector field, counted from 0; all by default.

    Returns
    -------
    ndarray
        Sorted dof numbers, ready for `skfem.condense(K, f, D=...)`.

    Raises
    ------
    InputError
        No facets, an unknown boundary, another element, or a slanted facet without
        `clamp_normal`.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> from skfem_adini import ElementQuadAdini
    >>> basis = Basis(MeshQuad().with_defaults(), ElementQuadAdini())
    >>> essential_dofs(basis, "bottom").tolist()
    [0, 1, 3, 4]
    >>> essential_dofs(basis, "bottom", clamp_normal=True).tolist()
    [0, 1, 2, 3, 4, 5]

    Poisson's equation with u = 0, and with u = x^2 y on the boundary:

    >>> from skfem import condense, solve
    >>> from skfem.models.poisson import laplace, unit_load
    >>> K, f, D = laplace.assemble(basis), unit_load.assemble(basis), essential_dofs(basis)
    >>> u = solve(*condense(K, f, D=D))
    >>> u = solve(*condense(K, f, x=basis.project(lambda x: x[0] ** 2 * x[1]), D=D))
    """
    dofs = vertex_dofs(basis)
    chosen = imposed_components(components, dofs.shape[1])
    mesh = basis.mesh
    numbers = facet_numbers(mesh, facets)
    vertices = mesh.facets[:, numbers]
    if clamp_normal:
        return np.unique(dofs[:, chosen][:, :, vertices])

    rounding = 4 * np.finfo(float).eps * np.abs(mesh.p).max()
    extent = np.ptp(facet_corners(mesh, numbers), axis=1)
    normal_to = extent <= GEOMETRY.slant * extent.max(axis=0) + rounding
    if not normal_to.any(axis=0).all():
        raise InputError(
            f"facets: {np.sum(~normal_to.any(axis=0))} facets are parallel to no axis (in 3-D: to "
            "no two axes), where no set of dofs fixes the trace; use T, x0 = "
            "essential_constraints(basis, facets, value), solve (T.T @ K @ T) z = T.T @ (f - K @ "
            "x0) and take x = T @ z + x0. clamp_normal=True is for clamped plates"
        )
    fixed = [dofs[0, chosen][:, vertices]]
    for along, slopes in zip(~normal_to, dofs[1:], strict=False):
        fixed.append(slopes[chosen][:, vertices[:, along]])
    return np.unique(np.concatenate([part.ravel() for part in fixed]))
