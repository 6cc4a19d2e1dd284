"""The cell and the reference coordinates of points: curved cells by Newton's method."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from skfem import MappingAffine, Mesh, MeshHex2, MeshQuad2, MeshTet2, MeshTri2

from contact.errors import InputError

Array = NDArray[np.float64]
INSIDE = 1e-8  # distance from the reference cell, in its coordinates, that counts as inside
CURVED_MESHES = (MeshTri2, MeshQuad2, MeshTet2, MeshHex2)
ROUNDINGS = 16  # rounding units of the largest coordinate by which a point may miss its cell


def find_cells(mesh: Mesh, points: Array) -> NDArray[np.int64]:
    """Number of the cell that each point (dim, npoints) lies in, shape (npoints,)."""
    found = (_find_curved if isinstance(mesh, CURVED_MESHES) else _find_straight)(mesh, points)
    for lost in np.flatnonzero(found < 0):
        found[lost] = _nearest(mesh, points[:, lost])
        if found[lost] < 0:
            raise InputError(f"points: point {lost} at {points[:, lost]} lies outside the body")
    return found


def _find_straight(mesh: Mesh, points: Array) -> NDArray[np.int64]:
    """Cells of points by scikit-fem's finder, which has no tolerance; -1 where it finds none."""
    if not points.size:
        return np.zeros(0, dtype=np.int64)
    finder = mesh.element_finder()

    def find(part: Array) -> NDArray[np.int64]:
        try:
            return np.asarray(finder(*part), dtype=np.int64)
        except ValueError:  # a point lies outside
            if part.shape[1] == 1:
                return np.array([-1])
            return np.concatenate([find(half) for half in np.array_split(part, 2, axis=1)])

    # The finder's cost grows like the square of the number of points: pass about a hundred.
    some = np.array_split(points, max(points.shape[1] // 100, 1), axis=1)
    return np.concatenate([find(part) for part in some])


def _nearest(mesh: Mesh, point: Array) -> int:
    """The cell that holds or is nearest to a point; -1 if it is farther than rounding."""
    rounding = ROUNDINGS * np.finfo(float).eps * float(np.abs(mesh.p).max())
    nodes = mesh.doflocs[:, mesh.dofs.element_dofs]
    low, high = nodes.min(axis=1), nodes.max(axis=1)
    room = rounding + (0.25 * (high - low) if isinstance(mesh, CURVED_MESHES) else 0.0)
    where = point[:, None]
    cells = np.flatnonzero(np.all((where >= low - room) & (where <= high + room), axis=0))
    if not cells.size:
        return -1
    mapping, there = mesh.mapping(), np.repeat(where, cells.size, axis=1)
    X = places_in(mesh, mapping, there, cells)
    outside = np.maximum(-X, X - 1.0).max(axis=0)
    if len(mesh.t) == len(X) + 1:  # simplices
        outside = np.maximum(outside, X.sum(axis=0) - 1.0)
    if np.isnan(outside).all():
        return -1
    best = int(np.nanargmin(outside))
    J = mapping.DF(np.clip(X[:, best : best + 1, None], 0.0, 1.0), tind=cells[[best]])
    # Rounding of the point in reference coordinates, larger in thinner cells.
    thickness = np.linalg.svd(J[:, :, 0, 0], compute_uv=False)[-1]
    return int(cells[best]) if outside[best] <= INSIDE + rounding / thickness else -1


def _find_curved(mesh: Mesh, points: Array) -> NDArray[np.int64]:
    middles = mesh.p[:, mesh.t].mean(axis=1)
    tried = min(48, mesh.nelements)  # number of cells tried, nearest middles first
    near = scipy.spatial.KDTree(middles.T).query(points.T, k=tried)[1].reshape(-1, tried)
    found = np.full(points.shape[1], -1, dtype=np.int64)
    nodes = mesh.doflocs[:, mesh.dofs.element_dofs]
    low, high = nodes.min(axis=1), nodes.max(axis=1)
    bulge = 0.25 * (high - low)  # how far a curved cell may extend beyond its nodes
    where = points[:, :, None]
    boxed = np.all((where >= (low - bulge)[:, near]) & (where <= (high + bulge)[:, near]), axis=0)
    turn = np.where(boxed, np.cumsum(boxed, axis=1), 0)
    for attempt in range(1, int(turn.max(initial=0)) + 1):
        i, j = np.nonzero((turn == attempt) & (found < 0)[:, None])
        X = _newton(mesh.mapping(), points[:, i], near[i, j])
        hit = ~np.isnan(X).any(axis=0) & _inside(mesh, X)
        found[i[hit]] = near[i[hit], j[hit]]
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
    rounding = ROUNDINGS * np.finfo(float).eps * np.abs(points).max(axis=0, initial=0.0)
    near = np.maximum(1e-10 * size, rounding)  # distance at which Newton's method has converged
    X = np.full((*points.shape, 1), 0.25)
    for _ in range(20):
        off = points[:, :, None] - mapping.F(X, tind=cells)
        if np.all(np.linalg.norm(off, axis=0)[:, 0] <= near):
            break
        J = np.moveaxis(mapping.DF(X, tind=cells), (0, 1), (-2, -1))
        flat = np.abs(np.linalg.det(J)) < 1e-12 * size[:, None] ** len(points)
        J[flat] = np.eye(len(points))
        step = np.linalg.solve(J, np.moveaxis(off, 0, -1)[..., None])[..., 0]
        step[flat] = 0.0
        # Outside its cell a mapping of second order need not be injective.
        X = np.clip(X + np.moveaxis(step, -1, 0), -0.5, 1.5)
    off = points[:, :, None] - mapping.F(X, tind=cells)
    met = np.linalg.norm(off[:, :, 0], axis=0) <= near
    return np.where(met, X[:, :, 0], np.nan)


def _inside(mesh: Mesh, X: Array) -> NDArray[np.bool_]:
    """Whether places lie in the reference cell."""
    inside = np.all((X >= -INSIDE) & (X <= 1 + INSIDE), axis=0)
    if isinstance(mesh, MeshTri2 | MeshTet2):
        inside &= X.sum(axis=0) <= 1 + INSIDE
    return inside
