"""Geometry of eight-node hexahedral cells, from coordinate differences alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from skfem.refdom import RefHex

from skfem_adini.elements.quad_cells import SMALLEST_SINE
from skfem_adini.elements.straight_cells import straight_corners
from skfem_adini.errors import InputError

Array = NDArray[np.float64]

_OTHER_AXES = ((1, 2), (2, 0), (0, 1))
_FINE_STEPS = 8  # parts of a cell in each direction for a second bound of its Jacobian


@dataclass(frozen=True)
class HexCells:
    r"""Trilinear cells on the unit cube, from differences of coordinates; with (i, j, k) cyclic
    :math:`F(X) = p_{000} + \sum_i a_i X_i + \sum_i c_i X_j X_k + d X_1 X_2 X_3`. An offset of
    the mesh from the origin costs no further rounding."""

    affine_name: ClassVar[str] = "parallelepiped"
    general_name: ClassVar[str] = "hexahedral"

    a: Array  # sides at the corner (0, 0, 0), shape (3, components, cells)
    c: Array  # twists of the pairs of faces, shape as a; zero at rounding level
    d: Array  # triple twist, shape (components, cells); zero at rounding level
    affine: bool  # whether every cell is a parallelepiped

    @property
    def count(self) -> int:
        """Number of cells."""
        return self.d.shape[1]

    @classmethod
    def from_mapping(cls, mapping: Any, tind: NDArray[np.integer] | None = None) -> HexCells:
        """Read the cells `tind` (all by default) of the mesh behind a scikit-fem mapping."""
        mesh = mapping.mesh
        if mesh.refdom is not RefHex:
            raise InputError(f"mesh: expected hexahedra (MeshHex), got {type(mesh).__name__}")
        p111, p110, p101, p011, p100, p010, p001, p000 = straight_corners(mesh, tind)
        a = np.array([p100 - p000, p010 - p000, p001 - p000])
        c = np.array([(p011 - p010) - a[2], (p101 - p100) - a[2], (p110 - p100) - a[1]])
        d = (p111 - p110) - (p101 - p100) - c[0]
        # c and d are differences of four and of eight rounded coordinates.
        rounding = 16 * np.finfo(float).eps * np.abs(mesh.doflocs).max()
        c[np.abs(c) <= rounding] = 0.0
        d[np.abs(d) <= rounding] = 0.0
        return cls(a, c, d, affine=not (c.any() or d.any()))

    def tangents(self, *X: Any) -> Array:
        """Return the derivatives of F as (3, components, cells).
        With three arrays X of points, (points,) or (cells, points), a last axis of points
        follows."""
        a, c, d = self.a, self.c, self.d
        if np.ndim(X[0]):
            a, c, d = a[..., None], c[..., None], d[..., None]
        return np.array(
            [
                a[i] + c[k] * X[j] + c[j] * X[k] + d * (X[j] * X[k])
                for i, (j, k) in enumerate(_OTHER_AXES)
            ]
        )

    def inverse_jacobian(self, X: Array) -> Array:
        """Return DF^-1 as (3, 3, cells, points), with one point when the cells are affine.
        The reference points X have the shape (3, points) or (3, cells, points)."""
        t = self.a[..., None] if self.affine else self.tangents(*X)
        G = np.array([_cross(t[j], t[k]) for j, k in _OTHER_AXES])
        G /= _dot(t[0], G[0])
        return G

    def second_derivatives(self, X: Array) -> Iterator[tuple[tuple[int, int], Array]]:
        """Yield the mixed second derivatives of the map, shapes (3, cells, 1 or points)."""
        for i, (j, k) in enumerate(_OTHER_AXES):
            yield (j, k), self.c[i][..., None] + self.d[..., None] * X[i]

    def check(self) -> float:
        """Raise on a degenerate or folded cell, else return the largest ratio of twist to side.
        The determinant has degree 2 in each coordinate; its Bernstein coefficients on the cell,
        or on 8^3 parts of it, have one sign in every cell that is accepted."""
        corners = [self.tangents(*corner) for corner in np.ndindex(2, 2, 2)]
        lengths = np.array([[np.sqrt(_dot(t, t)) for t in corner] for corner in corners])
        volumes = np.array([_dot(t[0], _cross(t[1], t[2])) for t in corners])
        sign = np.sign(volumes.sum(axis=0))
        valid = (volumes * sign > SMALLEST_SINE * lengths.prod(axis=1)).all(axis=0)
        if not self.affine:
            doubtful = np.flatnonzero(valid)
            for steps in (1, _FINE_STEPS):
                least = self._least_volume(doubtful, sign[doubtful], steps)
                valid[doubtful] = least > 0
                doubtful = doubtful[least <= 0]
        if not valid.all():
            bad = np.flatnonzero(~valid)
            raise InputError(
                f"mesh: {len(bad)} of {len(valid)} cells are not hexahedra with a Jacobian of one "
                f"sign (first: position {bad[0]}); order the vertices of a cell as MeshHex does "
                f"and move vertices until no corner is flat or turned inside out"
            )
        longest = lengths.max(axis=(0, 1))
        twists = np.sqrt([_dot(t, t) for t in (*self.c, self.d)])
        return float((twists / longest).max(initial=0.0))

    def _least_volume(self, tind: NDArray[np.integer], sign: Array, steps: int) -> Array:
        """Return the least Bernstein coefficient of sign times det DF on steps^3 parts."""
        cells = HexCells(self.a[..., tind], self.c[..., tind], self.d[:, tind], self.affine)
        s = np.linspace(0, 1, 2 * steps + 1)
        t = cells.tangents(*np.array(np.meshgrid(s, s, s, indexing="ij")).reshape(3, -1))
        volume = (
            _dot(t[0], _cross(t[1], t[2])).reshape(-1, *3 * s.shape) * sign[:, None, None, None]
        )
        for axis in (1, 2, 3):
            v = np.moveaxis(volume, axis, 0)
            low, middle, high = v[:-1:2], v[1::2], v[2::2]
            parts = np.concatenate([low, 2 * middle - (low + high) / 2, high])
            volume = np.moveaxis(parts, 0, axis)
        return volume.min(axis=(1, 2, 3), initial=np.inf)


def _cross(u: Array, v: Array) -> Array:
    """Return the vector product along the first axis."""
    return np.array([u[j] * v[k] - u[k] * v[j] for j, k in _OTHER_AXES])


def _dot(u: Array, v: Array) -> Array:
    """Return the scalar product along the first axis."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
