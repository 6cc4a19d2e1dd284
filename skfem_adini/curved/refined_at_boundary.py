"""Meshes that are finer around a curved boundary."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import MeshQuad

from skfem_adini.curved.cut_domain import CutDomain
from skfem_adini.curved.quadrature.level_set import LevelSet
from skfem_adini.curved.quadrature.polygon import Polygon
from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import array_of, integer

Array = NDArray[np.float64]


def refined_at_boundary(
    mesh: MeshQuad,
    level_set: LevelSet | Polygon | Callable[[Array], Any],
    levels: int = 1,
    layers: int = 2,
    where: Callable[[Array], Any] | None = None,
) -> MeshQuad:
    r"""Divide the cells around the zero line in four, several times.

    The extrapolation of a cubic beyond a boundary of curvature :math:`\kappa` costs accuracy when
    :math:`\kappa h` is not small; finer cells are needed there and nowhere else. All cut cells and
    `layers` cells on both sides get the same size, so hanging vertices lie away from the cut cells,
    where `AdiniExtension` makes the functions continuous.

    Parameters
    ----------
    mesh
        `MeshQuad` of axis-parallel rectangles.
    level_set
        What `CutDomain` takes.
    levels
        How many times to divide.
    layers
        Neighbours on each side, at least 1.
    where
        Function of cell centres (2, cells) that returns which cells may be divided; all by default.
        At the border of that region hanging vertices lie in cut cells.

    Returns
    -------
    MeshQuad
        With hanging vertices.

    Raises
    ------
    InputError
        Numbers out of range; those of `CutDomain`.

    Examples
    --------
    >>> mesh = MeshQuad.init_tensor(*[np.linspace(-1, 1, 9)] * 2)
    >>> finer = refined_at_boundary(mesh, lambda x: x[0] ** 2 + x[1] ** 2 - 0.5, layers=1)
    >>> mesh.t.shape[1], finer.t.shape[1]
    (64, 232)
    """
    levels, layers = integer("levels", levels, 0), integer("layers", layers, 1)
    if where is not None and not callable(where):
        raise InputError(f"where: expected a function of cell centres, got {where!r}")
    for _ in range(levels):
        # Only signs are needed here, so one Gauss point is enough.
        domain = CutDomain(mesh, level_set, q=1)
        chosen = np.zeros(mesh.t.shape[1], dtype=bool)
        chosen[domain.cut] = True
        chosen[domain.quadrature.boundary_cells] = True
        for _ in range(layers):
            touched = np.zeros(mesh.p.shape[1], dtype=bool)
            touched[mesh.t[:, chosen]] = True
            chosen = touched[mesh.t].any(axis=0)
        if where is not None:
            allowed = array_of("where", where(mesh.p[:, mesh.t].mean(axis=1)))
            if allowed.shape != chosen.shape or allowed.dtype.kind != "b":
                raise InputError(
                    f"where: expected True or False for each of the {chosen.size} cells, got "
                    f"{allowed.dtype} of shape {allowed.shape}"
                )
            chosen &= allowed
        cells = np.flatnonzero(chosen)
        if cells.size == 0:
            return mesh
        mesh = _divided(mesh, cells)
    return mesh


def _divided(mesh: MeshQuad, cells: NDArray[np.integer]) -> MeshQuad:
    """Divide cells in four; vertices in the same place become one.
    Midpoints are the same numbers, bit by bit, on both sides of an edge, so coordinates can be
    compared; scikit-fem's sum of two meshes would round them to eight decimals."""
    finer = MeshQuad(mesh.p, np.ascontiguousarray(mesh.t[:, cells]), validate=False).refined()
    p = np.hstack([mesh.p, finer.p])
    t = np.hstack([np.delete(mesh.t, cells, axis=1), finer.t + mesh.p.shape[1]])
    used, t = np.unique(t, return_inverse=True)
    p, place = np.unique(p[:, used], axis=1, return_inverse=True)
    t = place.ravel()[t.ravel()].reshape(4, -1)
    return MeshQuad(np.ascontiguousarray(p), np.ascontiguousarray(t))
