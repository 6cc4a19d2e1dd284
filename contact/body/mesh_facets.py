"""The facets of a mesh, numbered as scikit-fem numbers them, by counting sorts."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from skfem import Mesh
from skfem.refdom import RefHex, RefQuad, RefTet, RefTri

from contact.body import facet_kernels
from skfem_adini.jit import compiled


def number_facets(mesh: Mesh) -> None:
    """Give a mesh its ``facets``, ``t2f`` and ``f2t``, unless it has computed them.

    scikit-fem sorts records of corners to number facets, and sorts the numbers twice to find their
    cells. A facet is known by two corners in the plane and by three in space, which are sorted by
    counting.

    Parameters
    ----------
    mesh : Mesh
    """
    if hasattr(mesh, "_t2f") or mesh.refdom not in (RefTri, RefQuad, RefTet, RefHex):
        return
    t, corners = np.ascontiguousarray(mesh.t), np.array(mesh.refdom.facets)
    facets, numbers, beside, sound = facet_kernel("number")(
        t, corners, mesh.dim(), mesh.nvertices, mesh.refdom is RefHex
    )
    if sound:  # no facets that have three corners in common, and not the fourth
        found: Any = mesh
        found._facets, found._t2f, found._f2t = facets, numbers, beside


@cache
def facet_kernel(name: str) -> Callable[..., Any]:
    """A function of `facet_kernels`, compiled."""
    return compiled(getattr(facet_kernels, name))
