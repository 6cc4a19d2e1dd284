"""Bases on facets of a mesh, with reference coordinates that are computed in closed form.

scikit-fem inverts the mapping by Newton's method with a tolerance in reference coordinates. In
cells with an aspect ratio of about 1e4 the rounding of coordinates exceeds it, and a bare Exception
is raised. No inversion is needed: the corners of a facet determine its position in the reference
cell.
"""

from __future__ import annotations

from copy import copy
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import Element, FacetBasis, Mesh
from skfem.quadrature import get_quadrature

Array = NDArray[np.float64]


def facet_basis(
    mesh: Mesh,
    element: Element,
    facets: NDArray[np.int64],
    *,
    quadrature: tuple[Array, Array] | None = None,
    intorder: int | None = None,
    dofs: Any = None,
) -> FacetBasis:
    """A `skfem.FacetBasis` on the first cell of each facet, for cells of any shape, at `quadrature`
    (points (dim - 1, n), weights), or exact for `intorder`, by default twice the element's degree.
    `dofs` is the element's numbering, where it is known."""
    order = 2 * element.maxdeg if intorder is None else intorder
    points, weights = quadrature or get_quadrature(mesh.brefdom, order)
    mapping = copy(mesh.mapping())
    mapping.invF = partial(_known, places_on_facets(mesh, facets, points))
    return FacetBasis(
        mesh,
        element,
        mapping=mapping,
        facets=facets,
        dofs=dofs,
        quadrature=(points, weights),
        disable_doflocs=True,
    )


def places_on_facets(mesh: Mesh, facets: NDArray[np.int64], points: Array, side: int = 0) -> Array:
    """Reference coordinates of points (dim - 1, n) of the reference facet in the first or second
    cell (`side`) of each facet, shape (dim, nfacets, n)."""
    corners, cells = mesh.facets[:, facets], mesh.t[:, mesh.f2t[side, facets]]
    first, *others = (
        mesh.elem.refdom.p[:, np.argmax(cells == corner, axis=0)]
        for corner in corners[[0, 1, -1][: mesh.dim()]]
    )
    # The last corner of a ring of three or four is the other neighbour of the first.
    along = np.stack([other - first for other in others], axis=-1)
    found: Array = first[..., None] + along @ points
    return found


def _known(places: Array, x: Array, tind: NDArray[np.int64] | None = None) -> Array:
    return places
