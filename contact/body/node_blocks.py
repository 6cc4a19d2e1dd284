"""Unknowns of a body on many processes in blocks of equal size, one for each node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class NodeBlocks:
    """A numbering in which unknowns that supports take away keep a place, with a unit row.
    Multigrid joins the unknowns of a node only where all nodes have equally many."""

    size: int  # of a block; 1 where supports turn the unknowns
    place: Index  # place of each own unknown among the own places
    count: int  # number of own places
    first: int  # number of the first own place
    total: int  # number of all places

    @classmethod
    def of(cls, body: Any) -> NodeBlocks:
        """Blocks of the vertices if all dofs are there, else of the components of a scalar dof."""
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
        """Which numbers are those of own places."""
        mine: NDArray[np.bool_] = (numbers >= self.first) & (numbers < self.first + self.count)
        return mine

    def put(self, own: Array) -> Array:
        """Values of own unknowns at their places, zero at the others."""
        values = np.zeros((self.count, *own.shape[1:]))
        values[self.place] = own
        return values

    def rows(self, S: sparse.csr_array, z: Any) -> tuple[sparse.csr_array, Index]:
        """Own rows of a matrix with one on the diagonal of empty places, and column numbers."""
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
        """Own rows, and their columns, of a matrix that is `change` (n, n) at the places `at`,
        else identity."""
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
