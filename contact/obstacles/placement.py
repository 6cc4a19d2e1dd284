"""Checks that an obstacle lies in front of the contact boundary, not behind or around it."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from skfem import Mesh

from contact.errors import InputError, warn
from contact.facet_basis import facet_basis
from contact.obstacles.shapes import ClosestPoint, Cylinder, Moved, Plane, Sphere
from contact.obstacles.surface_mesh import SurfaceMesh

Array = NDArray[np.float64]


def check_placement(obstacle: Any, gap: Array, x: Array, n: Array, size: float) -> None:
    """Raise or warn if the position of an obstacle is almost certainly a mistake. Warn if no ray
    meets it, if most of the boundary lies inside it with its nearest surface ahead (the body
    would be pushed out on the other side), or if they overlap by more than the body's `size`."""
    if obstacle is None:
        return
    plain = obstacle.obstacle if isinstance(obstacle, ClosestPoint) else obstacle
    x, n = x.reshape(x.shape[0], -1), n.reshape(n.shape[0], -1)
    if isinstance(plain, Moved):
        (x, n), plain = plain.at_home(x, n), plain.obstacle
    if isinstance(plain, Plane):
        _check_facing(plain, n)
    share = float(np.mean(_within(plain, x, n, size)))
    if share > 0.5:
        remedy = "turn its normal round" if isinstance(plain, Plane) else "change its place or sign"
        if isinstance(plain, Cylinder | Sphere | SurfaceMesh):
            remedy = f"for a hole that the body lies in, {type(plain).__name__}(..., hollow=True)"
            remedy = "hollow=False, for a body around it" if plain.hollow else remedy
        warn(
            f"obstacle: {share:.0%} of the contact boundary lie inside the "
            f"{_name(plain)} and face its surface from within, so that the body is pushed through "
            f"it to the other side; {remedy}"
        )
    elif gap.size and np.all(np.isposinf(gap)):
        if callable(plain):
            warn(
                f"obstacle: no normal of the contact boundary meets the {_name(plain)}, so that "
                "nothing can touch; check its place, or name the part of the boundary that faces "
                "it (ClosestPoint(obstacle) looks beside the normals, too)"
            )
    elif np.median(-gap[np.isfinite(gap)]) > size:
        warn(
            f"obstacle: most of the contact boundary overlaps it by more than {size:.4g}, the "
            "size of the body; a gap is positive where there is one, and a Plane's normal points "
            "towards the body"
        )


def outward_normals(mesh: Mesh, x: Array) -> Array:
    """Outward normals of the boundary facets nearest to places x, (dim, ...)."""
    basis = facet_basis(mesh, mesh.elem(), mesh.boundary_facets(), intorder=1)
    middle = np.asarray(basis.global_coordinates()).mean(axis=2)
    near = scipy.spatial.KDTree(middle.T).query(x.reshape(x.shape[0], -1).T)[1]
    normals: Array = np.asarray(basis.normals).mean(axis=2)[:, near].reshape(x.shape)
    return normals


def _check_facing(plane: Plane, n: Array) -> None:
    normal = np.asarray(plane.normal, dtype=float)
    if np.all(normal @ n >= -1e-12 * np.linalg.norm(normal)):
        turned = tuple(float(0.0 - c) for c in normal)
        raise InputError(
            f"obstacle: no part of the contact boundary faces the plane with normal={plane.normal}"
            f"; a normal points out of the obstacle towards the body: normal={turned}, or another "
            "boundary"
        )


def _within(obstacle: Any, x: Array, n: Array, size: float) -> NDArray[np.bool_]:
    """Where the boundary lies inside the obstacle and the nearest way out is ahead of it."""
    if not hasattr(obstacle, "distance"):
        return np.zeros(1, dtype=bool)
    try:
        distance, gradient = obstacle.distance(x)
    except InputError:  # the centre, or where a function is flat: no direction to judge by
        return np.zeros(1, dtype=bool)
    inside: NDArray[np.bool_] = distance < -1e-9 * size
    return inside & (np.sum(gradient * n, axis=0) > 0)


def _name(obstacle: Any) -> str:
    return type(obstacle).__name__ if hasattr(obstacle, "distance") else "obstacle"
