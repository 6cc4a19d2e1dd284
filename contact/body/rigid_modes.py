"""Rigid motions of a body in the dofs of its element, and their names."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from skfem import Basis

from contact.body.constitutive import StressLaw
from contact.body.deferred_basis import DeferredBasis
from contact.errors import InputError

Array = NDArray[np.float64]


class Discretised(Protocol):
    """A body with a Basis of a vector element; `is_ring`: the mesh is the section of a ring."""

    basis: Basis

    @property
    def is_ring(self) -> bool: ...  # noqa: D102


class Elastic(Discretised, Protocol):
    """A body with a Basis and a material."""

    lam: Array
    law: StressLaw
    dilatation: str

    @property
    def measure(self) -> Array: ...  # noqa: D102


_VALUE = -1  # a value dof in `dof_kinds`


def rigid_modes(body: Discretised) -> Array:
    """Rigid motions of every connected piece, shape (ndofs, npieces * dim (dim + 1) / 2).
    Translations, then rotations about the piece's middle, u_a = -x_b and u_b = x_a for a < b; in a
    ring only the axial translation. Supports are ignored."""
    basis = body.basis
    entity, points, cells = dof_entities(basis)
    pieces, piece = _pieces(cells, points.shape[1])
    kind, dim = dof_kinds(basis), basis.elem.dim
    each = 1 if body.is_ring else dim * (dim + 1) // 2
    modes = np.zeros((pieces, each, basis.N))
    for k, own in enumerate(modes):
        middle = _middle(points[:, piece == k])
        for c in range(dim):  # dofs of component c
            mine = slice(c, None, dim)
            inside = piece[entity[mine]] == k
            value = inside & (kind[mine] == _VALUE)
            if body.is_ring:
                own[0, mine] = value * (c == 1.0)
                continue
            own[c, mine] = value
            for number, (a, b) in enumerate(combinations(range(dim), 2), dim):
                if c in (a, b):
                    along, sign = (b, -1.0) if c == a else (a, 1.0)
                    x = basis.doflocs[along, mine] - middle[along]
                    slope = inside & (kind[mine] == along)
                    own[number, mine] = sign * (value * x + slope)
    return np.asarray(modes.reshape(-1, basis.N).T)


def rigid_field(body: Discretised, centre: Array) -> Array:
    """One set of rigid motions for the whole body, shape (ndofs, dim (dim + 1) / 2).
    Translations, then rotations about `centre`: counter-clockwise in 2-D, about x, y, z in 3-D.
    In a ring only the axial translation is strain-free."""
    basis = body.basis
    kind, dim = dof_kinds(basis), basis.elem.dim
    component = np.arange(basis.N) % dim
    x = basis.doflocs - centre[:, None]
    columns = [((component == c) & (kind == _VALUE)) * 1.0 for c in range(dim)]
    for a, b in ((0, 1),) if dim == 2 else ((1, 2), (2, 0), (0, 1)):
        rotation = np.zeros(basis.N)
        for moving, along, sign in ((a, b, -1.0), (b, a, 1.0)):
            here = component == moving
            rotation += here * (kind == _VALUE) * sign * x[along]
            rotation += here * (kind == along) * sign
        columns.append(rotation)
    return np.array(columns).T


def _pieces(cells: NDArray[np.int64], count: int) -> tuple[int, NDArray[np.int32]]:
    """Number of connected pieces of the mesh, and the piece of each entity."""
    first = np.repeat(cells[:1], cells.shape[0] - 1, axis=0).ravel()
    ones = np.ones(first.size)
    links = sparse.coo_array((ones, (first, cells[1:].ravel())), shape=(count, count))
    found: tuple[int, NDArray[np.int32]] = connected_components(links.tocsr(), directed=False)
    return found


def _middle(points: Array) -> Array:
    middle: Array = 0.5 * (points.min(axis=1) + points.max(axis=1))
    return middle


def dof_kinds(basis: Basis) -> NDArray[np.int64]:
    """-1 for a value, i for the derivative along x_i, -2 for a mixed second derivative."""
    kind = np.full(basis.N, -2, dtype=np.int64)
    for row, of_row in _kinds_of_rows(basis):
        kind[row] = of_row
    return kind


def _kinds_of_rows(basis: Basis) -> Iterator[tuple[NDArray[np.int32], int]]:
    """Kinds of the dofs at vertices, edges, facets and cells."""
    dofs, names = basis.dofs, iter(basis.elem.dofnames)
    kinds = {"u": _VALUE, "u_x": 0, "u_y": 1, "u_z": 2, "u_xy": -2}
    for table in (dofs.nodal_dofs, dofs.facet_dofs, dofs.edge_dofs, dofs.interior_dofs):
        for row in () if table is None else table:
            name = next(names).split("^")[0]
            if name not in kinds:
                raise InputError(
                    f"element {type(basis.elem.elem).__name__}: its dof {name!r} is neither a "
                    "value, a first derivative nor u_xy, which contact needs for rigid motions"
                )
            yield row, kinds[name]


def value_dofs(body: Discretised) -> NDArray[np.bool_]:
    """Dofs that are displacements, not derivatives, shape (ndofs,)."""
    return np.asarray(dof_kinds(body.basis) == _VALUE)


def dof_lengths(body: Discretised) -> Array:
    """Factor that scales each dof to a displacement, (ndofs,): 1 for values, else a mean cell size.
    Residuals and norms over dofs of several kinds use these units."""
    basis = body.basis
    lengths = np.ones(basis.N)
    slopes = [pair for pair in _kinds_of_rows(basis) if pair[1] != _VALUE]
    if slopes:
        volume = basis.volume if isinstance(basis, DeferredBasis) else float(basis.dx.sum())
        cell = (volume / basis.mesh.nelements) ** (1 / basis.elem.dim)
        for row, kind in slopes:
            lengths[row] = cell**2 if kind == -2 else cell
    return lengths


def describe_motion(body: Discretised, u: Array) -> str:
    """Name a rigid motion, e.g. "a translation along x" or "a rotation about (0, 1)".
    From a linear program with friction satisfied to 1e-6, its rotation has that accuracy and its
    direction the square root of it."""
    if body.is_ring:
        return "a translation along the axis y"
    modes = rigid_modes(body)
    dim = body.basis.elem.dim
    per_piece = dim * (dim + 1) // 2
    coefficient = np.linalg.lstsq(modes, u, rcond=None)[0].reshape(-1, per_piece)
    k = int(np.argmax(np.abs(coefficient).max(axis=1)))
    shift, turn = coefficient[k, :dim], coefficient[k, dim:]
    entity, points, _ = dof_entities(body.basis)
    where = points[:, np.unique(entity[np.abs(modes[:, k * per_piece]) > 0])]
    reach = float(np.ptp(where, axis=1).max())
    if np.abs(turn).max() * reach < 1e-5 * np.abs(shift).max():
        axis = int(np.argmax(np.abs(shift)))
        pure = np.abs(np.delete(shift, axis)).max() < 2e-3 * abs(shift[axis])
        direction = "xyz"[axis] if pure else str(np.round(shift / np.linalg.norm(shift), 4))
        return f"a translation along {direction}"
    if dim == 2:
        centre = _middle(where) + np.array([-shift[1], shift[0]]) / turn[0]
        centre[np.abs(centre) < 1e-5 * reach] = 0.0  # six digits are printed
        return f"a rotation about ({centre[0]:.6g}, {centre[1]:.6g})"
    vector = np.array([turn[2], -turn[1], turn[0]])
    return f"a rotation about the axis {np.round(vector / np.linalg.norm(vector), 4)}"


def reduced_echelon(rows: Array) -> Array:
    """Reduced row echelon form."""
    rows, done = rows.copy(), 0
    for column in range(rows.shape[1]):
        if done == rows.shape[0]:
            break
        best = done + int(np.argmax(np.abs(rows[done:, column])))
        if np.abs(rows[best, column]) < 1e-9 * np.abs(rows).max():
            continue
        rows[[done, best]] = rows[[best, done]]
        rows[done] /= rows[done, column]
        others = np.arange(rows.shape[0]) != done
        rows[others] -= np.outer(rows[others, column], rows[done])
        done += 1
    return rows


Index = NDArray[np.int64]


def dof_entities(basis: Basis) -> tuple[Index, Array, Index]:
    """Vertex, edge, facet or cell of each dof (ndofs,), for ordering and for rigid motions.
    Also returned are the middles of all entities (dim, nentities) and those of each cell,
    (nentities a cell, ncells)."""
    dofs, mesh, dim = basis.dofs, basis.mesh, basis.elem.dim
    tables = (
        (dofs.nodal_dofs, None, "t"),
        (dofs.edge_dofs, "edges", "t2e"),  # numbered by the mesh on first access
        (dofs.facet_dofs, "facets", "t2f"),
        (dofs.interior_dofs, "t", None),
    )
    entity = np.full(basis.N, -1, dtype=np.int64)
    start, points, cells = 0, [], []
    for table, of, in_cells in tables:
        if table is None or table.shape[0] == 0 or (of == "edges" and dim == 2):
            continue
        where = mesh.p if of is None else mesh.p[:, getattr(mesh, of)].mean(axis=1)
        entity[table] = start + np.arange(table.shape[1])
        points.append(where[:, : table.shape[1]])
        inside = np.arange(table.shape[1])[None] if in_cells is None else getattr(mesh, in_cells)
        cells.append(start + np.asarray(inside, dtype=np.int64))
        start += table.shape[1]
    whole = np.vstack(cells)
    return entity, np.hstack(points), whole if basis.tind is None else whole[:, basis.tind]
