"""Corners of straight cells, on meshes of first and second order."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skfem_adini.errors import InputError

Array = NDArray[np.float64]

_STRAIGHT = 1e-10  # distance of a node from the middle, in sizes of a cell: above rounding in files


def straight_corners(mesh: Any, tind: NDArray[np.integer] | None) -> Array:
    """Return the corners of the cells `tind`, shape (corners, dim, cells).
    On meshes of second order every other node must lie at the mean of the corners of its edge,
    face or cell: their map is then that of the first-order mesh."""
    nodes = mesh.dofs.element_dofs
    nodes = nodes if tind is None else nodes[:, tind]
    count = mesh.refdom.nnodes
    p = np.moveaxis(mesh.doflocs[:, nodes], 1, 0)
    corners = p[:count]
    if len(nodes) > count:
        size = np.ptp(corners, axis=0).max(axis=0)
        allowed = _STRAIGHT * size + 16 * np.finfo(float).eps * np.abs(mesh.doflocs).max()
        places = np.asarray(mesh.elem().doflocs)
        middle = np.einsum("nk,kdc->ndc", _corner_weights(places[count:], places[:count]), corners)
        off = np.abs(p[count:] - middle).max(axis=(0, 1))
        curved = ~(off <= allowed)  # true for NaN
        if curved.any():
            first = curved.argmax()
            raise InputError(
                f"mesh: {curved.sum()} of {len(off)} cells of the {type(mesh).__name__} "
                f"are curved (first: position {first}, a node is {off[first]:.3g} off the middle); "
                "these elements need straight-sided cells: move the nodes to the middle of their "
                "edges and faces, or cut the curve out of a grid with CutDomain"
            )
    return corners


def _corner_weights(places: Array, corners: Array) -> Array:
    """Return the (multi)linear functions of the corners at reference points, (points, corners)."""
    near = 1 - np.abs(places[:, None] - corners[None])
    return np.asarray(near.prod(axis=2))
