"""Distribution of the cells of a mesh to processes."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import integer

Indices = NDArray[np.int64]
_log = logging.getLogger(__name__)


def partition(mesh: Any, parts: int) -> Indices:
    """Divide the cells of a mesh into parts of equal size with few facets between them.

    METIS does it where pymetis is installed. Otherwise the parts are strips across the longest
    extent of the mesh.

    Parameters
    ----------
    mesh
        Any scikit-fem mesh.
    parts
        Number of parts.

    Returns
    -------
    ndarray, shape (ncells,)
        The part of each cell, from 0.

    Raises
    ------
    InputError
        No mesh, or more parts than cells.

    References
    ----------
    G. Karypis and V. Kumar, A fast and high quality multilevel scheme for partitioning irregular
    graphs, SIAM J. Sci. Comput. 20 (1998), 359-392.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> sizes = np.bincount(partition(MeshQuad().refined(3), 2))
    >>> sizes.tolist()
    [32, 32]
    """
    cells = getattr(getattr(mesh, "t", None), "shape", (0, 0))[1]
    if cells == 0:
        raise InputError(f"mesh: expected a scikit-fem mesh with cells, got {type(mesh).__name__}")
    parts = integer("parts", parts, 1)
    if parts > cells:
        raise InputError(f"parts: {parts} processes are more than the {cells} cells of the mesh")
    if parts == 1:
        return np.zeros(cells, dtype=np.int64)
    try:
        import pymetis
    except ImportError:
        _log.info("pymetis is not installed: the parts are strips")
        return _strips(mesh, parts)
    starts, neighbours = _neighbours(mesh)
    _, found = pymetis.part_graph(parts, adjacency=pymetis.CSRAdjacency(starts, neighbours))
    part = np.asarray(found, dtype=np.int64)
    # METIS may leave parts of very small meshes empty.
    return part if np.bincount(part, minlength=parts).min() > 0 else _strips(mesh, parts)


def _neighbours(mesh: Any) -> tuple[Indices, Indices]:
    """Cells that share a facet with each cell, concatenated in METIS's format."""
    inner = mesh.f2t[:, mesh.f2t[1] >= 0].astype(np.int64)
    pairs = np.hstack((inner, inner[::-1]))
    pairs = pairs[:, np.lexsort(pairs[::-1])]
    starts = np.searchsorted(pairs[0], np.arange(mesh.t.shape[1] + 1))
    return starts.astype(np.int64), pairs[1]


def _strips(mesh: Any, parts: int) -> Indices:
    middles = mesh.p[:, mesh.t].mean(axis=1)
    axis = int(np.argmax(np.ptp(middles, axis=1)))
    part = np.empty(middles.shape[1], dtype=np.int64)
    for k, own in enumerate(np.array_split(np.argsort(middles[axis], kind="stable"), parts)):
        part[own] = k
    return part
