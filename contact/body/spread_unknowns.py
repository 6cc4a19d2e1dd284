"""Unknowns of a distributed body: their numbering, and blocks of equal size per node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.errors import InputError

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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
        """Number the free unknowns of a `DistributedBody`.
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
        # Rows of P as tables, for communication: numbers of unknowns and their coefficients.
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
        """Values of all unknowns known to this process, from the owned values of all processes."""
        mine = (self.table >= self.first) & (self.table < self.first + own.size)
        values = np.zeros(self.table.shape)
        values[mine] = own[self.table[mine] - self.first]
        # All unknowns of an owned dof are owned.
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


@dataclass(frozen=True)
class NodeBlocks:
    """A numbering in which eliminated unknowns keep a place, with a unit row.
    Multigrid groups unknowns by node only if all nodes have equally many."""

    size: int  # unknowns per block; 1 if supports rotate the unknowns
    place: Index  # place of each own unknown among the own places
    count: int  # number of own places
    first: int  # number of the first own place
    total: int  # number of all places

    @classmethod
    def of(cls, body: Any) -> NodeBlocks:
        """Blocks per vertex if all dofs are at vertices, else per scalar dof."""
        z, comm = body.unknowns, body.comm
        dofs = body.local.basis.dofs
        own = sparse.csc_array(z.own)
        size = body.dim
        if dofs.nodal_dofs.size == body.space.basis.N:
            size = dofs.nodal_dofs.shape[0]
        if not all(comm.allgather(bool(np.all(np.diff(own.indptr) == 1)))):
            size = 1
        if size == 1:
            place, count = np.arange(own.shape[1]), own.shape[1]
        else:
            dof = body.space.owned[own.indices]
            group, rank = np.unique(dof // size, return_inverse=True)
            place, count = rank * size + dof % size, group.size * size
        counts = comm.allgather(count)
        return cls(size, place, count, sum(counts[: comm.rank]), sum(counts))

    @property
    def numbers(self) -> Array:
        """Number of the place of each own unknown."""
        return (self.first + self.place).astype(np.float64)

    def own(self, numbers: Index) -> NDArray[np.bool_]:
        """Mask of the numbers that are own places."""
        mine: NDArray[np.bool_] = (numbers >= self.first) & (numbers < self.first + self.count)
        return mine

    def put(self, own: Array) -> Array:
        """Own unknowns at their places, with zero at the others."""
        values = np.zeros((self.count, *own.shape[1:]))
        values[self.place] = own
        return values

    def rows(self, S: sparse.csr_array, z: Any) -> tuple[sparse.csr_array, Index]:
        """Own rows of a matrix, with a unit diagonal at empty places, and column numbers."""
        numbers = np.rint(z.known(self.numbers)).astype(np.int64)
        empty = np.setdiff1d(np.arange(self.count), self.place)
        here = S.tocoo()
        row, column = here.coords
        shape = self.count, numbers.size + empty.size
        rows = sparse.csr_array(
            (
                np.concatenate((here.data, np.ones(empty.size))),
                (
                    np.concatenate((self.place[row], empty)),
                    np.concatenate((column, numbers.size + np.arange(empty.size))),
                ),
            ),
            shape=shape,
        )
        return rows, np.concatenate((numbers, self.first + empty))

    def change(self, change: sparse.csr_array, at: Index) -> tuple[sparse.csr_array, Index]:
        """Own rows and columns of the matrix with `change` (n, n) at places `at`, else identity."""
        own = self.first + np.arange(self.count)
        numbers = np.union1d(own, at)
        block = change.tocoo()
        row, column = block.coords
        here = self.own(at[row])
        rest = np.setdiff1d(own, at)
        rows = np.concatenate((rest, at[row[here]])) - self.first
        columns = np.searchsorted(numbers, np.concatenate((rest, at[column[here]])))
        data = np.concatenate((np.ones(rest.size), block.data[here]))
        return sparse.csr_array((data, (rows, columns)), (own.size, numbers.size)), numbers
