"""Cells that a body can be made of."""

from __future__ import annotations

from typing import Any

import numpy as np
import skfem
from skfem import Mesh

from contact.errors import InputError


def check_cells(mesh: Mesh) -> None:
    """Raise unless every cell is mapped one to one: no corner folds over or is flat."""
    if not np.all(np.isfinite(mesh.doflocs)):
        raise InputError("mesh: has coordinates that are not finite")
    with np.errstate(all="ignore"):
        det = np.atleast_2d(mesh.mapping().detDF(mesh.elem.refdom.p))
    size = np.ptp(mesh.p[:, mesh.t], axis=1).max(axis=0) ** mesh.dim()
    sound = np.all(det > 1e-12 * size[:, None], axis=1) | np.all(
        det < -1e-12 * size[:, None], axis=1
    )
    if not np.all(sound):
        raise InputError(
            f"mesh: {np.sum(~sound)} cells are flat, not convex or folded (first: "
            f"{int(np.argmin(sound))}); order their vertices cyclically and untangle them"
        )


def check_rectangles(mesh: Mesh, element: Any) -> None:
    """Raise where scikit-fem's own Bogner-Fox-Schmit element meets other cells than rectangles.

    It takes any cells, but along sides that are not parallel to an axis its functions jump.
    """
    if not isinstance(element, skfem.ElementQuadBFS):
        return
    corner = mesh.p[:, mesh.t]
    side = np.abs(np.roll(corner, -1, axis=1) - corner)
    slanted = (side.min(axis=0) > 1e-10 * side.max(axis=0)).any(axis=0)
    if slanted.any():
        raise InputError(
            f"element: {slanted.sum()} of {slanted.size} cells are no rectangles with sides "
            f"parallel to the axes (first: {int(np.argmax(slanted))}), and skfem.ElementQuadBFS "
            "is not continuous between others; turn the coordinates or use ElementQuadAdini"
        )
