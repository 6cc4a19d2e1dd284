"""Which cell a point lies in, and where: straight cells by scikit-fem, curved ones by Newton."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from skfem import MappingAffine, Mesh, MeshHex2, MeshQuad2, MeshTet2, MeshTri2

from contact.errors import InputError

Array = NDArray[np.float64]
CHUNK = 100  # points for which scikit-fem's finder is asked at once
CANDIDATES = 48  # cells tried for a point, in the order of their middles' distance
STEPS = 20  # of Newton's method for a place in a curved cell
INSIDE = 1e-8  # by how much a place may lie outside the reference cell
CURVED = (MeshTri2, MeshQuad2, MeshTet2, MeshHex2)
MET = 1e-10  # distance to the point, over the cell's size


def find_cells(mesh: Mesh, points: Array) -> NDArray[np.int64]:
    """Number of the cell that each point lies in, shape (npoints,).

    Parameters
    ----------
    mesh : Mesh
    points : ndarray, shape (dim, npoints)

    Raises
    ------
    InputError
        A point lies outside the mesh.
    """
    if isinstance(mesh, CURVED):
        return _find_curved(mesh, points)
    try:
        finder = mesh.element_finder()
        # It compares every point with the neighbours of all points: cost grows like a square.
        some = np.array_split(points, max(points.shape[1] // CHUNK, 1), axis=1)
        return np.concatenate([finder(*part) for part in some])
    except Exception as error:  # scikit-fem raises ValueError, or Exception from its Newton
        raise InputError(
            f"points: scikit-fem's finder places at least one outside the body ({error})"
        ) from error


def _find_curved(mesh: Mesh, points: Array) -> NDArray[np.int64]:
    middles = mesh.p[:, mesh.t].mean(axis=1)
    tried = min(CANDIDATES, mesh.nelements)
    near = scipy.spatial.KDTree(middles.T).query(points.T, k=tried)[1].reshape(-1, tried)
    found = np.full(points.shape[1], -1, dtype=np.int64)
    nodes = mesh.doflocs[:, mesh.dofs.element_dofs]
    low, high = nodes.min(axis=1), nodes.max(axis=1)
    bulge = 0.25 * (high - low)  # of a cell of second order beyond its nodes
    where = points[:, :, None]
    boxed = np.all((where >= (low - bulge)[:, near]) & (where <= (high + bulge)[:, near]), axis=0)
    turn = np.where(boxed, np.cumsum(boxed, axis=1), 0)
    for attempt in range(1, int(turn.max(initial=0)) + 1):
        i, j = np.nonzero((turn == attempt) & (found < 0)[:, None])
        X = _newton(mesh.mapping(), points[:, i], near[i, j])
        hit = ~np.isnan(X).any(axis=0) & _inside(mesh, X)
        found[i[hit]] = near[i[hit], j[hit]]
    if np.any(found < 0):
        lost = int(np.flatnonzero(found < 0)[0])
        raise InputError(f"points: point {lost} at {points[:, lost]} lies outside the body")
    return found


def places_in(mesh: Mesh, mapping: Any, points: Array, cells: NDArray[np.int64]) -> Array:
    """Reference coordinates of points in the cells that hold them, shape (dim, npoints)."""
    if not isinstance(mapping, MappingAffine):
        return _newton(mapping, points, cells)
    X: Array = mapping.invF(points[:, :, None], tind=cells)[:, :, 0]
    return X


def _newton(mapping: Any, points: Array, cells: NDArray[np.int64]) -> Array:
    """Reference coordinates of points in given cells, NaN where there are none."""
    size = np.abs(mapping.detDF(np.full((len(points), 1), 0.25), tind=cells))[:, 0]
    size = size ** (1 / len(points))
    X = np.full((*points.shape, 1), 0.25)
    for _ in range(STEPS):
        off = points[:, :, None] - mapping.F(X, tind=cells)
        if np.all(np.linalg.norm(off, axis=0)[:, 0] <= MET * size):
            break
        J = np.moveaxis(mapping.DF(X, tind=cells), (0, 1), (-2, -1))
        flat = np.abs(np.linalg.det(J)) < 1e-12 * size[:, None] ** len(points)
        J[flat] = np.eye(len(points))
        step = np.linalg.solve(J, np.moveaxis(off, 0, -1)[..., None])[..., 0]
        step[flat] = 0.0
        # Outside its cell a map of second order may fold.
        X = np.clip(X + np.moveaxis(step, -1, 0), -0.5, 1.5)
    off = points[:, :, None] - mapping.F(X, tind=cells)
    met = np.linalg.norm(off[:, :, 0], axis=0) <= MET * size
    return np.where(met, X[:, :, 0], np.nan)


def _inside(mesh: Mesh, X: Array) -> NDArray[np.bool_]:
    """Whether places lie in the reference cell."""
    inside = np.all((X >= -INSIDE) & (X <= 1 + INSIDE), axis=0)
    if isinstance(mesh, MeshTri2 | MeshTet2):
        inside &= X.sum(axis=0) <= 1 + INSIDE
    return inside
