"""The part of the interface of bodies on many processes that concerns their vectors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.cell_finder import find_cells
from contact.body.constitutive import StressLaw
from contact.body.elastic_body import ElasticBody
from contact.body.multipoint import column_lengths, picked_by
from contact.body.rigid_modes import dof_kinds, rigid_field
from contact.body.solid import Solid
from contact.body.supports import live_rows
from contact.errors import InputError
from skfem_adini.distributed import DistributedBasis, DistributedMatrix, largest, total

Array = NDArray[np.float64]
Index = NDArray[np.int64]

ROUND_OFF = 1e-12  # relative to the largest coordinate: distance that is rounding


class SpreadSolid(Solid):
    """A `Solid` of cells on many processes.
    A vector of all dofs holds, on each process, the dofs of the contact strip, the same
    everywhere, and then the other dofs that belong to the process."""

    space: DistributedBasis
    comm: Any
    local: ElasticBody  # on the cells of this process and those around them
    _strip: ElasticBody

    def _place(self, cells: Index) -> None:
        """Find the strip's dofs among the local ones, and which process has each of them."""
        space, dofs = self.space, self._strip.basis.element_dofs
        own = np.flatnonzero(space.piece.owner == self.comm.rank)
        here, there = np.intersect1d(space.piece.cells[own], cells, return_indices=True)[1:]
        told = self.comm.allgather((there, space.numbers[space.basis.element_dofs[:, own[here]]]))
        self._shared = self._strip.basis.N
        numbers = np.full(self._shared, -1, dtype=np.int64)
        for which, known in told:
            numbers[dofs[:, which]] = known
        if np.any(numbers < 0):
            raise AssertionError("a cell of the contact strip belongs to no process")
        self._strip_numbers = numbers
        order = np.argsort(space.numbers)
        found = np.searchsorted(space.numbers[order], numbers).clip(max=order.size - 1)
        local = order[found]
        known_here = space.numbers[local] == numbers
        # Local places of the strip's dofs: all that occur here, and those that are owned.
        self._seen = np.flatnonzero(known_here), local[known_here]
        is_owned = np.zeros(space.basis.N, dtype=bool)
        is_owned[space.owned] = True
        mine = known_here & is_owned[local]
        self._mine = np.flatnonzero(mine), local[mine]
        is_owned[local[mine]] = False
        self.others = np.flatnonzero(is_owned)

    def to_local(self, u: Array) -> Array:
        """A vector of this body on the dofs of the process's cells, the halo included."""
        x = np.zeros(self.space.basis.N)
        x[self._seen[1]] = u[self._seen[0]]
        x[self.others] = u[self._shared :]
        return self.space.update(x)

    def of_owned(self, x: Array) -> Array:
        """A vector of this body from local values that are right where the dofs are owned."""
        return np.concatenate((self.shared(x), x[self.others]))

    def shared(self, x: NDArray[Any]) -> NDArray[Any]:
        """Values at the strip's dofs, on every process, from local ones that are right if owned."""
        values = np.zeros((self._shared, *x.shape[1:]), dtype=x.dtype)
        for where, part in self.comm.allgather((self._mine[0], x[self._mine[1]])):
            values[where] = part
        return values

    def counted(self, u: Array) -> Array:
        """Local owned values of a vector of this body, shape (owned dofs,), without exchange."""
        x = np.zeros(self.space.basis.N)
        x[self._mine[1]] = u[self._mine[0]]
        x[self.others] = u[self._shared :]
        own: Array = x[self.space.owned]
        return own

    def places(self) -> dict[str, Index]:
        """For each owned dof a cell of the whole mesh, and its number among the dofs of the cell.

        Returns
        -------
        dict
            ``cell`` and ``slot``, shape (owned dofs,).
        """
        space = self.space
        cells = space.own_cells
        dofs = space.basis.element_dofs[:, cells]
        found = np.full((2, space.basis.N), -1, dtype=np.int64)
        found[0, dofs] = space.piece.cells[cells]
        found[1, dofs] = np.arange(dofs.shape[0])[:, None]
        return {"cell": found[0, space.owned], "slot": found[1, space.owned]}

    def from_places(
        self, parts: Iterable[dict[str, Any]], names: Sequence[str]
    ) -> dict[str, Array]:
        """Vectors of this body from values at the places of `places`, of any number of processes.

        Parameters
        ----------
        parts : iterable of dict
            ``cell`` and ``slot`` with the values of each name.
        names : sequence of str

        Raises
        ------
        InputError
            A dof has no value.
        """
        space, cells = self.space, self.space.piece.cells
        local = np.zeros((len(names), space.basis.N))
        known = np.zeros(space.basis.N, dtype=bool)
        for part in parts:
            at = np.searchsorted(cells, part["cell"]).clip(max=cells.size - 1)
            here = cells[at] == part["cell"]
            dofs = space.basis.element_dofs[part["slot"][here], at[here]]
            known[dofs] = True
            for row, name in zip(local, names, strict=True):
                row[dofs] = part[name][here]
        if not known[space.owned].all():
            raise InputError("path: the files of the processes do not hold all dofs of this body")
        return {name: self.of_owned(row) for name, row in zip(names, local, strict=True)}

    @property
    def trace(self) -> ElasticBody:
        """The cells around the contact boundary, supported as the body; its dofs come first."""
        return self._strip

    def embed(self, matrix: sparse.csr_array) -> sparse.csr_array:
        """Rows given on the dofs of the strip, extended to all dofs of this process."""
        shape = matrix.shape[0], self.f.size
        return sparse.csr_array((matrix.data, matrix.indices, matrix.indptr), shape=shape)

    def live(self, rows: sparse.csr_array) -> NDArray[np.bool_]:
        """Rows that the supports do not fix; see `contact.body.supports.live_rows`."""
        own = sparse.csr_array(rows[:, : self._shared])
        return live_rows(own, self._strip.constraint[0], self._strip.lengths)

    @cached_property
    def rows(self) -> sparse.csr_array:
        """Rows of the stiffness matrix that belong to this process, in local columns."""
        rows = sparse.csr_array(self.local.stiffness[self.space.owned])
        self.local.__dict__.pop("stiffness", None)
        return rows

    @cached_property
    def absolute_rows(self) -> sparse.csr_array:
        """``|S|`` entry by entry, against which residuals are judged."""
        rows = self.rows
        return sparse.csr_array((np.abs(rows.data), rows.indices, rows.indptr), shape=rows.shape)

    @property
    def stiffness(self) -> _Product:
        """S as ``S @ u`` for vectors of this body."""
        return _Product(self)

    @cached_property
    def unknowns(self) -> SpreadUnknowns:
        """The free unknowns z of ``u = P z + u0``, spread over the processes."""
        return SpreadUnknowns.of(self)

    @cached_property
    def constraint(self) -> tuple[sparse.csr_array, Array]:
        """P on the dofs and free unknowns of this process, and u0 of ``u = P z + u0``."""
        return self.unknowns.P, self.of_owned(self.unknowns.u0)

    @cached_property
    def lengths(self) -> tuple[Array, Array]:
        """Length of each local dof and of each own unknown, the same on all processes."""
        space, kind = self.space, dof_kinds(self.space.basis)
        own = space.own_cells
        size = total(self.comm, [self.local.basis.dx[own].sum(), own.size])
        cell = float(size[0] / size[1]) ** (1 / self.dim)
        of_dof = np.where(kind == -1, 1.0, np.where(kind == -2, cell**2, cell))
        return of_dof, column_lengths(self.unknowns.own, of_dof[space.owned])

    @cached_property
    def _values(self) -> NDArray[np.int64]:
        """Component of each owned dof that is a displacement, -1 where it is a derivative."""
        kind = dof_kinds(self.space.basis)
        return np.where(kind == -1, np.arange(kind.size) % self.dim, -1)[self.space.owned]

    @property
    def extent(self) -> float:
        """Largest extent along a coordinate axis."""
        p = self.space.mesh.p
        ends = np.array(self.comm.allgather((p.min(axis=1), p.max(axis=1))))
        return float((ends[:, 1].max(axis=0) - ends[:, 0].min(axis=0)).max())

    @cached_property
    def rigid(self) -> Array:
        """Rigid motions of all of space about the body's middle, at the local dofs."""
        p = self.space.mesh.p
        ends = np.array(self.comm.allgather((p.min(axis=1), p.max(axis=1))))
        centre = 0.5 * (ends[:, 1].max(axis=0) + ends[:, 0].min(axis=0))
        return rigid_field(self.local, centre)

    def under(self, f: Array, u0: Array, thermal: Any = None) -> Self:
        """The same body under other loads and other values of the same supports."""
        other = copy(self)
        other.f, other.constraint = f, (self.constraint[0], u0)
        return other

    def internal(self, u: Array) -> Array:
        """Internal forces S u of a displacement."""
        x = np.zeros(self.space.basis.N)
        x[self.space.owned] = self.rows @ self.to_local(u)
        return self.of_owned(x)

    def equilibrium(self, u: Array, contact: Array, load: Array) -> tuple[float, float]:
        """Largest residual force at a free dof, and the largest sum of the terms' moduli there."""
        x, P = self.to_local(u), self.unknowns.own
        _, lengths = self.lengths
        load = self.counted(load)
        force = self.rows @ x + self.counted(contact) - load
        terms = self.absolute_rows @ np.abs(x) + np.abs(load)
        return (
            self._largest(P.T @ force / lengths),
            self._largest(abs(P).T @ terms / lengths),
        )

    def give(self, forces: Array) -> float:
        """Largest displacement that one of the forces would cause if all other dofs were fixed."""
        own = DistributedMatrix(self.space, self.rows).diagonal()[self.space.owned]
        return self._largest(self.counted(forces) * self.lengths[0][self.space.owned] / own)

    def reach(self, u: Array) -> float:
        """Largest displacement at a node; if all are zero, largest derivative times its length."""
        own = self.counted(u)
        at_nodes = self._largest(own[self._values >= 0])
        return at_nodes or self._largest(self.lengths[0][self.space.owned] * own)

    def deformation(self, u: Array) -> float:
        """Largest part of a displacement that no rigid motion explains, in the units of `reach`."""
        lengths = self.lengths[0][self.space.owned]
        modes = self.rigid[self.space.owned] * lengths[:, None]
        own = lengths * self.counted(u)
        R = self.stacked(np.column_stack((modes, own)))
        motion = np.linalg.lstsq(R[:, :-1], R[:, -1], rcond=None)[0]
        return self._largest(own - modes @ motion)

    def support_error(self, u: Array) -> float:
        """Largest deviation from a prescribed displacement; derivatives are times their length."""
        z = self.unknowns
        off = self.counted(u - self.constraint[1])
        picked = picked_by(z.own, lambda: self.lengths[0][self.space.owned])
        return self._largest(self.lengths[0][self.space.owned] * (off - z.own @ (picked.T @ off)))

    def at_supports(self, forces: Array) -> Array:
        """The part of forces on all dofs that acts where a displacement is prescribed."""
        z, own = self.unknowns, self.counted(forces)
        picked = picked_by(z.own, lambda: self.lengths[0][self.space.owned])
        x = np.zeros(self.space.basis.N)
        x[self.space.owned] = own - picked @ (z.own.T @ own)
        return self.of_owned(x)

    def dot(self, a: Array, b: Array) -> float:
        """Inner product of two vectors of this body."""
        return float(total(self.comm, self.counted(a) @ self.counted(b)))

    def total(self, forces: Array) -> Array:
        """Resultant of forces on all dofs, shape (dim,)."""
        values, own = self._values, self.counted(forces)
        here = np.bincount(values[values >= 0], own[values >= 0], self.dim)
        return np.asarray(total(self.comm, here))

    def displacement(self, u: Array, points: Array) -> Array:
        """Displacement at points, by the element's own interpolation, shape (dim, npoints)."""
        x = self.to_local(u)
        return self._at(points, lambda p: self.local.displacement(x, p), (self.dim,))

    def gradient(self, u: Array, points: Array) -> Array:
        """Gradient d u_i / d x_j of the displacement at points, shape (dim, dim, npoints)."""
        x = self.to_local(u)
        return self._at(points, lambda p: self.local.gradient(x, p), (self.dim, self.dim))

    def stress_at(self, u: Array, points: Array) -> Array:
        """Cauchy stress at points, shape (dim, dim, npoints)."""
        x = self.to_local(u)
        return self._at(points, lambda p: self.local.stress_at(x, p), (self.dim, self.dim))

    def law_at(self, points: Array) -> StressLaw:
        """Stress from strain at points, shape (dim, npoints), of a uniform body.

        Raises
        ------
        InputError
            E or nu differ from cell to cell.
        """
        if np.ndim(self.local.E) or np.ndim(self.local.nu):
            raise InputError(
                "points: E or nu differ from cell to cell, so that the stress out of the plane "
                "has no one law; take result.stress(points)"
            )
        return self.local.law.at(np.zeros(points.shape[1], dtype=np.int64))

    @property
    def basis(self) -> Any:
        """Refused: each process has a piece of it."""
        raise self._in_pieces("basis")

    @property
    def mesh(self) -> Any:
        """Refused: each process has a piece of it."""
        raise self._in_pieces("mesh")

    @property
    def law(self) -> Any:
        """Refused: each process has that of its cells."""
        raise self._in_pieces("law")

    def _in_pieces(self, name: str) -> InputError:
        return InputError(
            f"body: a DistributedBody has no {name} of the whole mesh; each process has a piece, "
            f"body.local.{name}. For fields take result.stress(points) and result.sample(points), "
            "for files contact.save_pvtu(path, result), for everything on one process "
            "body.gather(result.u)"
        )

    def _at(self, points: Array, evaluate: Any, shape: tuple[int, ...]) -> Array:
        """Values at points from the first process that has a cell around each."""
        here = self._cells_here(points)
        found = evaluate(points[:, here]) if here.any() else np.zeros((*shape, 0))
        value, missing = np.zeros((*shape, points.shape[1])), np.ones(points.shape[1], dtype=bool)
        for where, part in self.comm.allgather((np.flatnonzero(here), found)):
            new = missing[where]
            value[..., where[new]] = part[..., new]
            missing[where] = False
        if missing.any():
            k = int(np.flatnonzero(missing)[0])
            raise InputError(f"points: point {k} at {points[:, k]} lies outside the body")
        return value

    def _cells_here(self, points: Array) -> NDArray[np.bool_]:
        p = self.space.mesh.p
        size = ROUND_OFF * np.abs(p).max(initial=0.0)
        near = np.all(
            (points >= p.min(axis=1)[:, None] - size) & (points <= p.max(axis=1)[:, None] + size),
            axis=0,
        )
        inside = np.zeros(points.shape[1], dtype=bool)
        for k in np.flatnonzero(near):
            with suppress(InputError):
                find_cells(self.space.mesh, points[:, [k]])
                inside[k] = True
        return inside

    def _largest(self, x: Any) -> float:
        return largest(self.comm, float(np.abs(x).max(initial=0.0)))

    def stacked(self, rows: Array) -> Array:
        """Triangular factor of the QR decomposition of rows that are spread over processes."""
        parts = self.comm.allgather(np.linalg.qr(rows, mode="r"))
        return np.asarray(np.linalg.qr(np.vstack(parts), mode="r"))


class _Product:
    """The stiffness of a body as an operator."""

    def __init__(self, body: SpreadSolid) -> None:
        self._body = body

    def __matmul__(self, u: Array) -> Array:
        return self._body.internal(u)


@dataclass(frozen=True)
class SpreadUnknowns:
    """The map ``u = P z + u0``, with the unknowns z numbered process by process."""

    own: sparse.csr_array  # P on the owned dofs, shape (owned dofs, own unknowns)
    all: sparse.csr_array  # P on all local dofs, shape (local dofs, known unknowns)
    numbers: Index  # number of each known unknown, ascending
    first: int  # number of the first own unknown
    total: int  # number of all unknowns
    strip: sparse.csr_array  # P on the contact strip, shape (its dofs, its unknowns)
    strip_numbers: Index  # number of each unknown of the strip, ascending
    P: sparse.csr_array  # on a vector of the body: the strip's dofs, then the others
    u0: Array  # shape (local dofs,)
    table: Index  # unknowns of each local dof, (local dofs, k), -1 where fewer
    space: Any

    @classmethod
    def of(cls, body: Any) -> SpreadUnknowns:
        """Number the unknowns that the supports of a `DistributedBody` leave.
        No condition may link dofs of several processes."""
        space, comm = body.space, body.comm
        P, u0 = body.local.constraint
        mine = sparse.csr_array(P[space.owned])
        mine.eliminate_zeros()
        columns = np.unique(mine.indices)
        everywhere = np.bincount(sparse.csr_array(P).indices, minlength=P.shape[1])
        here = np.bincount(mine.indices, minlength=P.shape[1])
        if any(comm.allgather(bool(np.any(everywhere[columns] != here[columns])))):
            raise InputError(
                "supports: a condition links dofs of several processes, which a DistributedBody "
                "does not offer"
            )
        own = sparse.csr_array(mine[:, columns])
        counts = np.array(comm.allgather(columns.size))
        first = int(counts[: comm.rank].sum())
        # Rows of P as tables, which can be sent: numbers of unknowns and their coefficients.
        width = max(comm.allgather(int(np.diff(own.indptr).max(initial=0))))
        number = np.full((space.basis.N, width), -1, dtype=np.int64)
        factor = np.zeros((space.basis.N, width))
        row = np.repeat(np.arange(own.shape[0]), np.diff(own.indptr))
        slot = np.arange(own.nnz) - own.indptr[row]
        number[space.owned[row], slot] = first + own.indices
        factor[space.owned[row], slot] = own.data
        number, factor = space.update(number), space.update(factor)
        whole, numbers = _rows(number, factor)
        strip, strip_numbers = _rows(body.shared(number), body.shared(factor))
        rest = _in_columns(whole[body.others], numbers, np.union1d(numbers, strip_numbers))
        first_rows = _in_columns(strip, strip_numbers, np.union1d(numbers, strip_numbers))
        return cls(
            own,
            whole,
            numbers,
            first,
            int(counts.sum()),
            strip,
            strip_numbers,
            sparse.csr_array(sparse.vstack((first_rows, rest))),
            space.update(u0),
            number,
            space,
        )

    def known(self, own: Array) -> Array:
        """Values of all unknowns that are known here, from those of the own ones."""
        mine = (self.table >= self.first) & (self.table < self.first + own.size)
        values = np.zeros(self.table.shape)
        values[mine] = own[self.table[mine] - self.first]
        # Of an own dof all unknowns are own.
        values, there = self.space.update(values), self.table >= 0
        found = np.zeros(self.numbers.size)
        found[np.searchsorted(self.numbers, self.table[there])] = values[there]
        return found

    def collected(self, numbers: Index, own: Array) -> Array:
        """Values, or rows, of some unknowns on all processes, from the own ones of each."""
        here = np.flatnonzero((numbers >= self.first) & (numbers < self.first + own.shape[0]))
        found = np.zeros((numbers.size, *own.shape[1:]))
        for place, values in self.space.comm.allgather((here, own[numbers[here] - self.first])):
            found[place] = values
        return found


def _rows(number: Index, factor: Array) -> tuple[sparse.csr_array, Index]:
    """Sparse rows from tables, and the numbers of their columns."""
    there = number >= 0
    numbers = np.unique(number[there])
    row = np.nonzero(there)[0]
    column = np.searchsorted(numbers, number[there])
    shape = number.shape[0], numbers.size
    return sparse.csr_array((factor[there], (row, column)), shape=shape), numbers


def _in_columns(rows: Any, numbers: Index, wanted: Index) -> sparse.csr_array:
    rows = sparse.csr_array(rows)
    columns = np.searchsorted(wanted, numbers)[rows.indices]
    return sparse.csr_array((rows.data, columns, rows.indptr), shape=(rows.shape[0], wanted.size))
