"""Velocities from solutions of scikit-fem, read at the nodes of a grid.

A mesh is found by what it has (``p``, ``t``, ``to_meshtri``), so scikit-fem is never imported.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cip.errors import DivergenceWarning, InputError
from cip.formulas.expression import raised
from cip.formulas.formula import Formula, spline
from cip.formulas.snapshots import Snapshots
from cip.grid import Array, Grid, check_grid
from skfem_adini.ground.arguments import flag, real_array
from skfem_adini.ground.errors import warn


class _Limits(NamedTuple):
    rim: float = 1e-9  # by which a point may lie outside a cell of the mesh, in sizes of the cell
    divergence: float = 1e-2  # beyond the solution's, over the largest rate, that is warned of
    pairs: int = 1 << 22  # points and cells that are compared at once


LIMITS = _Limits()


class MeshField:
    """A solution at the nodes of a grid, and between them its quintic spline; arguments and
    attributes are those of `Velocity.from_basis`."""

    def __init__(
        self, basis: Any, u: Any, grid: Grid, times: Any, stream: bool, outside: str | None
    ) -> None:
        check_basis(basis, grid, flag("stream", stream))
        if outside not in (None, "land"):
            raise InputError(f"outside: expected None or 'land', got {outside!r}")
        if stream and times is not None:
            raise InputError("times: a stream function is of one time; leave stream or times out")
        rows = coefficients(basis, u, times is not None)
        nodes = _Places(basis, grid.coordinates)
        if outside is None and not nodes.inside.all():
            at = np.argwhere(~nodes.inside)[0]
            place = ", ".join(f"{x[i]:.6g}" for x, i in zip(grid.coordinates, at, strict=True))
            raise InputError(
                f"grid: {int((~nodes.inside).sum())} of its nodes lie outside the mesh, the first "
                f"at ({place}); take a smaller grid, or pass outside='land' and give the solver "
                "land=velocity.land"
            )
        sampled = np.stack([nodes.extended(nodes.read(row)[0], grid) for row in rows])
        self.grid, self._values, self._stream = grid, sampled[0], stream
        self.snapshots = None if times is None else Snapshots(times, sampled, grid, 5)
        middles = _Places(basis, [0.5 * (x[:-1] + x[1:]) for x in grid.edges])
        self.land = None if middles.inside.all() else ~middles.inside
        self._measure(middles, rows, stream)

    def _measure(self, middles: _Places, rows: Array, stream: bool) -> None:
        """Compare with the solution at the middles of cells; warn of divergence."""
        steps = (*self.grid.spacing, *([1.0] * (4 - self.grid.dim)))
        points = [*middles.points, *np.zeros((3 - self.grid.dim, middles.points.shape[1]))]
        formulas, dim = self.on(self.grid), self.grid.dim
        clocks = [0.0] if self.snapshots is None else self.snapshots.times
        worst, rate, given, error = 0.0, 0.0, 0.0, 0.0
        for row, t in zip(rows, clocks, strict=True):
            value, gradient, div = middles.read(row)
            if stream:
                value, div = np.stack([gradient[1], -gradient[0]]), np.zeros(1)
            found = np.stack([c.derivative((0, 0, 0, 0), steps)(*points, t) for c in formulas])
            slopes = [
                c.derivative(raised((0, 0, 0, 0), axis), steps)(*points, t)
                for axis, c in enumerate(formulas)
            ]
            worst = max(worst, float(np.abs(sum(slopes)).max(initial=0.0)))
            given = max(given, float(np.abs(div).max(initial=0.0)))
            error = max(error, float(np.abs(found - value).max(initial=0.0)))
            turn = np.abs(value).max(initial=0.0) / max(b - a for a, b in self.grid.bounds)
            rate = max(rate, float(np.abs(slopes).max(initial=0.0)), float(turn))
        self.divergence, self.divergence_of_solution, self.error = worst, given, error
        if worst > given + LIMITS.divergence * rate:
            other = ", or in the plane give its stream function (stream=True)" if dim == 2 else ""
            other += "; at coasts it is that of the values beyond" if self.land is not None else ""
            warn(
                f"velocity: on the grid its divergence reaches {worst:.3g}, that of the solution "
                f"{given:.3g}; a uniform field changes at that rate. Take a finer grid, or a "
                f"solution without jumps between the cells of its mesh{other}",
                DivergenceWarning,
            )

    def on(self, grid: Grid) -> tuple[Formula, ...]:
        """One `Formula` for each component; the grid must be that of the samples."""
        if self.snapshots is not None:
            return self.snapshots.on(grid)
        same = grid.nodes == self.grid.nodes and grid.periodic == self.grid.periodic
        if not (same and all(map(np.allclose, grid.edges, self.grid.edges))):
            raise InputError(
                f"velocity: it was sampled on {self.grid}, the solver has {grid}; make it with "
                "Velocity.from_basis on this grid"
            )
        if not self._stream:
            return tuple(spline(one, grid, f"c{q + 1}") for q, one in enumerate(self._values))
        # A stream function psi has the velocity (psi_y, -psi_x).
        parts = ("c1", (0, 1, 0), 1.0), ("c2", (1, 0, 0), -1.0)
        return tuple(spline(self._values, grid, name, at, sign) for name, at, sign in parts)


class _Places:
    """The points of a tensor grid, and the cells of a mesh in which they lie: `points` of shape
    (dim, n) are those inside."""

    def __init__(self, basis: Any, lines: Sequence[Array]) -> None:
        self.basis = basis
        cells = cells_of(basis.mesh, lines)
        self.inside = cells >= 0
        self.cells = cells[self.inside]
        self.points = np.stack([x[self.inside] for x in np.meshgrid(*lines, indexing="ij")])

    def read(self, row: Array) -> tuple[Any, Any, Any]:
        """The solution there, its gradient (None in H(div)), its divergence (None of scalars)."""
        basis, cells, found = self.basis, self.cells, [None, None, None]
        local = basis.mapping.invF(self.points[:, :, None], tind=cells)
        for k, dofs in enumerate(basis.element_dofs):
            part = basis.elem.gbasis(basis.mapping, local, k, tind=cells)[0]
            weight = row[dofs[cells]]
            for q, one in enumerate((np.asarray(part), part.grad, part.div)):
                if one is not None:
                    term = np.asarray(one)[..., 0] * weight
                    found[q] = term if found[q] is None else found[q] + term
        value, gradient, div = found
        if div is None and gradient is not None and gradient.ndim == 3:
            div = np.einsum("iin->n", gradient)
        return value, gradient, div

    def extended(self, values: Array, grid: Grid) -> Array:
        """Values (components, n) on the whole grid: outside those of the nearest node inside."""
        from scipy.ndimage import distance_transform_edt

        found = np.zeros((*values.shape[:-1], *self.inside.shape))
        found[..., self.inside] = values
        if self.inside.all():
            return found
        if not self.inside.any():
            raise InputError("grid: none of its nodes lies in the mesh")
        nearest = distance_transform_edt(
            ~self.inside, sampling=grid.spacing, return_distances=False, return_indices=True
        )
        return np.asarray(found[(..., *nearest)])


def cells_of(mesh: Any, lines: Sequence[Array]) -> NDArray[np.int64]:
    """For each point of a tensor grid the cell of a mesh that holds it, or -1: for each straight
    simplex the points in its bounding box are tested by their barycentric coordinates."""
    split = mesh
    if len(mesh.t) > len(lines) + 1:  # simplices of a cell are numbered after all first ones
        split = mesh.to_meshtri() if len(lines) == 2 else mesh.to_meshtet()
    corners = split.p[:, split.t]  # direction, corner, simplex
    low, high = corners.min(axis=1), corners.max(axis=1)
    rim = LIMITS.rim * (high - low).max(axis=0)
    first = np.stack([np.searchsorted(x, a - rim) for x, a in zip(lines, low, strict=True)])
    last = np.stack(
        [np.searchsorted(x, b + rim, "right") for x, b in zip(lines, high, strict=True)]
    )
    counts = last - first
    edges = corners[:, 1:] - corners[:, :1]
    inverse = np.linalg.inv(edges.transpose(2, 0, 1))
    found = np.full([x.size for x in lines], -1)
    sizes = counts.prod(axis=0)
    parts = np.append(np.flatnonzero(np.diff(np.cumsum(sizes) // LIMITS.pairs)) + 1, sizes.size)
    for begin, end in zip([0, *parts[:-1]], parts, strict=True):
        own = np.repeat(np.arange(begin, end), sizes[begin:end])
        rest = np.arange(own.size) - np.repeat(
            np.cumsum(sizes[begin:end]) - sizes[begin:end], sizes[begin:end]
        )
        index = []
        for axis in reversed(range(len(lines))):
            index.append(first[axis, own] + rest % counts[axis, own])
            rest = rest // counts[axis, own]
        index.reverse()
        away = np.stack([x[i] for x, i in zip(lines, index, strict=True)]) - corners[:, 0, own]
        parts_of = np.einsum("nij,jn->in", inverse[own], away)
        hold = (parts_of >= -LIMITS.rim).all(axis=0) & (parts_of.sum(axis=0) <= 1.0 + LIMITS.rim)
        found[tuple(i[hold] for i in index)] = own[hold] % mesh.t.shape[1]
    return found


def coefficients(basis: Any, u: Any, several: bool) -> Array:
    """The argument `u` as rows, one for each time."""
    rows = real_array("u", u).astype(float)
    if rows.ndim != 1 + several or rows.shape[-1] != basis.N:
        shape = f"(times, {basis.N})" if several else f"({basis.N},)"
        raise InputError(
            f"u: expected the coefficients of the basis, shape {shape}, got {rows.shape}"
        )
    if not np.isfinite(rows).all():
        raise InputError("u: expected finite coefficients; was the linear system singular?")
    return np.atleast_2d(rows)


def check_basis(basis: Any, grid: Any, stream: bool) -> None:
    """Raise `InputError` for a basis or a grid that does not fit."""
    check_grid(grid)
    if not all(hasattr(basis, name) for name in ("probes", "mesh", "elem", "mapping")):
        raise InputError(f"basis: expected a skfem.Basis of cells, got {type(basis).__name__}")
    if basis.tind is not None:
        raise InputError("basis: expected one of the whole mesh, not of some of its elements")
    dim = basis.mesh.p.shape[0]
    if dim != grid.dim or dim == 1:
        raise InputError(f"grid: it has {grid.dim} directions, the mesh {dim}; 2 or 3 are known")
    if stream and (dim != 2 or min(grid.cells) < 6):
        raise InputError("stream: expected a grid in the plane with 6 cells in each direction")
    point = basis.mapping.invF(
        basis.mesh.p[:, basis.mesh.t[:1, 0]][..., None], tind=np.zeros(1, int)
    )
    shape = np.shape(basis.elem.gbasis(basis.mapping, point, 0, tind=np.zeros(1, int))[0])[:-2]
    if shape != (() if stream else (dim,)):
        kind = "a scalar, the stream function" if stream else f"a vector of {dim} components"
        raise InputError(
            f"basis: expected the values of its element to be {kind}, they have the shape {shape}"
            + ("" if stream or shape else "; a stream function is given with stream=True")
        )
