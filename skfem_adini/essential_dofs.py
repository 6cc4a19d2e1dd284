"""Dofs that a homogeneous Dirichlet condition fixes on axis-parallel edges."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .boundary_edges import BoundaryEdges, Indices, adini_dofs, imposed_components
from .errors import InputError

_PARALLEL = 1e-10


def essential_dofs(
    basis: Any,
    facets: Any,
    clamp_normal: bool = False,
    components: int | Sequence[int] | None = None,
) -> Indices:
    """Return the dofs of u and of its tangential derivative on axis-parallel edges.

    Along an edge u is the cubic of its values and tangential derivatives at the two ends, so
    these dofs fix the trace; the normal derivative stays free, and fixing it as well
    (`basis.get_dofs(facets).all()`) over-constrains a second-order problem. Where a horizontal
    and a vertical edge meet, both derivatives belong to the trace.

    Parameters
    ----------
    basis
        Basis with `ElementQuadAdini` or `ElementVector(ElementQuadAdini())`.
    facets
        Edge numbers, a boundary name, a callable of edge midpoints, or a set of these.
    clamp_normal
        Add the normal derivative, for clamped plates. Edges may then have any direction.
    components
        Components of a vector field, counted from 0; all by default.

    Returns
    -------
    ndarray
        Sorted dof numbers, ready for `skfem.condense(K, f, D=...)`.

    Raises
    ------
    InputError
        No edges, an unknown boundary, another element, or a slanted edge without `clamp_normal`.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> from skfem_adini import ElementQuadAdini
    >>> basis = Basis(MeshQuad().with_defaults(), ElementQuadAdini())
    >>> essential_dofs(basis, "bottom").tolist()
    [0, 1, 3, 4]
    >>> essential_dofs(basis, "bottom", clamp_normal=True).tolist()
    [0, 1, 2, 3, 4, 5]
    """
    dofs = adini_dofs(basis)
    chosen = imposed_components(components, dofs.shape[1])
    edges = BoundaryEdges.select(basis.mesh, facets)
    if clamp_normal:
        return np.unique(dofs[:, chosen][:, :, edges.vertices])

    rounding = 4 * np.finfo(float).eps * np.abs(basis.mesh.p).max()
    rise = np.abs(edges.last - edges.first)[::-1]
    horizontal, vertical = rise <= _PARALLEL * edges.length + rounding
    if not (horizontal | vertical).all():
        raise InputError(
            f"facets: {np.sum(~(horizontal | vertical))} edges are parallel to no axis, so u_x and "
            "u_y do not separate there; use essential_constraints(basis, facets)"
        )
    u, u_x, u_y = dofs[:, chosen]
    fixed = (
        u[:, edges.vertices],
        u_x[:, edges.vertices[:, horizontal]],
        u_y[:, edges.vertices[:, vertical]],
    )
    return np.unique(np.concatenate([part.ravel() for part in fixed]))
