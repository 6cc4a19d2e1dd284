"""Dofs that a homogeneous Dirichlet condition fixes on axis-parallel edges and faces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from skfem_adini.conditions.boundary_edges import (
    Indices,
    facet_corners,
    facet_numbers,
    imposed_components,
)
from skfem_adini.elements.vertex_dofs import vertex_dofs
from skfem_adini.errors import InputError

_PARALLEL = 1e-10  # slant in lengths of an edge: above that of rounded coordinates


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
    normal_to = extent <= _PARALLEL * extent.max(axis=0) + rounding
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
