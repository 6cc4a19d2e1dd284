"""Geometry of straight-sided quadrilateral cells, from coordinate differences alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from skfem.refdom import RefQuad

from skfem_adini.elements.straight_cells import straight_corners
from skfem_adini.errors import InputError

Array = NDArray[np.float64]

SMALLEST_SINE = 1e-12  # of the angle of two sides: below it the Jacobian has less than four digits


@dataclass(frozen=True)
class QuadCells:
    """Bilinear cells :math:`F(X, Y) = p_0 + a X + b Y + c X Y` on the unit square.
    Sides a, b and twist c are differences of coordinates: an offset of the mesh from the origin
    costs no further rounding."""

    affine_name: ClassVar[str] = "parallelogram"
    general_name: ClassVar[str] = "quadrilateral"

    a: Array  # p_1 - p_0, shape (2, cells)
    b: Array  # p_3 - p_0
    c: Array  # p_0 - p_1 + p_2 - p_3, stored as zero at rounding level
    affine: bool  # whether every cell is a parallelogram

    @property
    def count(self) -> int:
        """Number of cells."""
        return self.a.shape[1]

    @classmethod
    def from_mapping(cls, mapping: Any, tind: NDArray[np.integer] | None = None) -> QuadCells:
        """Read the cells `tind` (all by default) of the mesh behind a scikit-fem mapping."""
        mesh = mapping.mesh
        if mesh.refdom is not RefQuad:
            raise InputError(f"mesh: expected quadrilaterals (MeshQuad), got {type(mesh).__name__}")
        p0, p1, p2, p3 = straight_corners(mesh, tind)
        a, b = p1 - p0, p3 - p0
        c = (p2 - p3) - a
        # c is a difference of four rounded coordinates.
        rounding = 16 * np.finfo(float).eps * np.abs(mesh.doflocs).max()
        c[np.abs(c) <= rounding] = 0.0
        return cls(a, b, c, affine=not c.any())

    def tangents(self, X: float | Array, Y: float | Array) -> tuple[Array, Array]:
        """Return dF/dX and dF/dY at numbers X, Y, each of shape (2, number of cells)."""
        return self.a + self.c * Y, self.b + self.c * X

    def inverse_jacobian(self, X: Array) -> Array:
        """Return DF^-1 as (2, 2, cells, points), with one point when the cells are affine.
        The reference points X have the shape (2, points) or (2, cells, points)."""
        if self.affine:
            X = np.zeros((2, 1))
        u = self.c[:, :, None] * X[1]
        u += self.a[:, :, None]
        v = self.c[:, :, None] * X[0]
        v += self.b[:, :, None]
        area = u[0] * v[1]
        area -= v[0] * u[1]
        G = np.empty((2, 2, *area.shape))
        np.divide(v[1], area, out=G[0, 0])
        np.divide(u[0], area, out=G[1, 1])
        np.negative(area, out=area)
        np.divide(v[0], area, out=G[0, 1])
        np.divide(u[1], area, out=G[1, 0])
        return G

    def second_derivatives(self, X: Array) -> Iterator[tuple[tuple[int, int], Array]]:
        """Yield the one mixed second derivative of the map, shape (2, cells, 1)."""
        yield (0, 1), self.c[:, :, None]

    def check(self) -> float:
        """Raise on a cell that is not strictly convex, else return the largest relative twist.
        It is the ratio of a twist to the longest side of its cell."""
        places = ((0, 0), (1, 0), (1, 1), (0, 1))
        corners = [self.tangents(X, Y) for X, Y in (places[:1] if self.affine else places)]
        lengths = np.array([[np.hypot(*u), np.hypot(*v)] for u, v in corners])
        areas = np.array([u[0] * v[1] - v[0] * u[1] for u, v in corners])
        orientation = np.sign(areas.sum(axis=0))
        convex = (areas * orientation > SMALLEST_SINE * lengths.prod(axis=1)).all(axis=0)
        if not convex.all():
            bad = np.flatnonzero(~convex)
            raise InputError(
                f"mesh: {len(bad)} of {len(convex)} cells are not strictly convex quadrilaterals "
                f"(first: position {bad[0]}); order the vertices of a cell cyclically and move "
                f"vertices until all four corners turn the same way"
            )
        return float((np.hypot(*self.c) / lengths.max(axis=(0, 1))).max(initial=0.0))
