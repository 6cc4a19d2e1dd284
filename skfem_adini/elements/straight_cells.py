"""Corners of straight cells, on meshes of first and second order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from skfem.refdom import RefHex, RefQuad

from skfem_adini.errors import InputError

Array = NDArray[np.float64]


class _Geometry(NamedTuple):  # tolerances for straight, parallel or degenerate cells
    node: float = 1e-10  # distance from the middle over the size of a cell: above rounding in files
    slant: float = 1e-10  # over the length of a side: above the rounding of coordinates
    twist: float = 1e-3  # over the longest side: noise of coordinates in files is far below
    sine: float = 1e-12  # of the angle of two sides: smaller ones leave less than four digits


GEOMETRY = _Geometry()


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
        allowed = GEOMETRY.node * size + 16 * np.finfo(float).eps * np.abs(mesh.doflocs).max()
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
        convex = (areas * orientation > GEOMETRY.sine * lengths.prod(axis=1)).all(axis=0)
        if not convex.all():
            bad = np.flatnonzero(~convex)
            raise InputError(
                f"mesh: {len(bad)} of {len(convex)} cells are not strictly convex quadrilaterals "
                f"(first: position {bad[0]}); order the vertices of a cell cyclically and move "
                f"vertices until all four corners turn the same way"
            )
        return float((np.hypot(*self.c) / lengths.max(axis=(0, 1))).max(initial=0.0))


_OTHER_AXES = ((1, 2), (2, 0), (0, 1))


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
        valid = (volumes * sign > GEOMETRY.sine * lengths.prod(axis=1)).all(axis=0)
        if not self.affine:
            doubtful = np.flatnonzero(valid)
            for steps in (1, 8):
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


def reference_points(mesh: Any, cells: NDArray[np.integer], x: Array) -> Array:
    """Return X with F(X) = x for points x, shape (2, len(cells), points), any distance away.
    scikit-fem's `invF` iterates, and converges only near the cell."""
    origin, first, last = (mesh.p[:, mesh.t[i, cells]][:, :, None] for i in (0, 1, 3))
    a, b, d = first - origin, last - origin, x - origin
    determinant = a[0] * b[1] - a[1] * b[0]
    return np.array([d[0] * b[1] - d[1] * b[0], a[0] * d[1] - a[1] * d[0]]) / determinant
