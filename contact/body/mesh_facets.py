"""The facets of a mesh, numbered as scikit-fem numbers them, by one sort of whole numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import Mesh
from skfem.refdom import RefHex, RefQuad, RefTet, RefTri

_LARGEST = 2**63 - 1
# Which corners of a facet to bring into order, pair after pair, until they ascend.
_PAIRS = {
    2: ((0, 1),),
    3: ((0, 1), (1, 2), (0, 1)),
    4: ((0, 1), (2, 3), (0, 2), (1, 3), (1, 2)),
}


def number_facets(mesh: Mesh) -> None:
    """Give a mesh its ``facets``, ``t2f`` and ``f2t``, unless it has computed them.

    scikit-fem sorts records of corners to number facets, and sorts the numbers twice to find their
    cells. A facet is known by two corners in the plane and by three in space: they are put into one
    number, whose order is that of the records.

    Parameters
    ----------
    mesh : Mesh
    """
    if hasattr(mesh, "_t2f") or mesh.refdom not in (RefTri, RefQuad, RefTet, RefHex):
        return
    every = np.hstack([mesh.t[corners] for corners in mesh.refdom.facets])
    corners = _ascending(every)
    known = corners[: mesh.dim()]
    if mesh.nvertices ** len(known) > _LARGEST:
        return
    key = known[0].astype(np.int64)
    for row in known[1:]:
        key = key * mesh.nvertices + row
    order = np.argsort(key)
    begins = np.diff(key[order], prepend=-1) != 0
    start = np.flatnonzero(begins)
    first, last = np.minimum.reduceat(order, start), np.maximum.reduceat(order, start)
    number = np.empty(key.size, dtype=np.int64)
    number[order] = np.cumsum(begins) - 1
    if len(corners) > len(known) and np.any(corners[-1] != corners[-1, first][number]):
        return  # facets with three corners in common
    cells = mesh.t.shape[1]
    f2t = np.array([first % cells, last % cells], dtype=np.int32)
    f2t[1, f2t[0] == f2t[1]] = -1
    found: Any = mesh
    found._facets = np.ascontiguousarray((every if mesh.refdom is RefHex else corners)[:, first])
    found._t2f, found._f2t = number.reshape(-1, cells), f2t


def _ascending(corners: NDArray[np.int32]) -> NDArray[np.int32]:
    """The corners of each facet, a column, in ascending order."""
    rows = list(corners)
    for i, j in _PAIRS[len(rows)]:
        rows[i], rows[j] = np.minimum(rows[i], rows[j]), np.maximum(rows[i], rows[j])
    return np.array(rows)
