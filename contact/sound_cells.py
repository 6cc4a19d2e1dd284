"""Cells that a body can be made of."""

from __future__ import annotations

import numpy as np
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
