"""Free unknowns of a body whose cells are spread over processes."""

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
    """The map ``u = P z + u0``, with the unknowns z numbered process by process.

    Attributes
    ----------
    own : csr_array, shape (owned dofs, own unknowns)
        P on the owned dofs.
    all : csr_array, shape (local dofs, known unknowns)
        P on all local dofs.
    numbers : ndarray
        Number of each known unknown, ascending.
    first, total : int
        Number of the first own unknown, and of all of them.
    strip : csr_array, shape (dofs of the contact strip, its unknowns)
    strip_numbers : ndarray
        Number of each unknown of the strip, ascending.
    P : csr_array
        On a vector of the body: the strip's dofs, then the others.
    u0 : ndarray, shape (local dofs,)
    table : ndarray, shape (local dofs, k)
        Numbers of the unknowns of each dof, -1 where there are fewer.
    space : DistributedBasis
    """

    own: sparse.csr_array
    all: sparse.csr_array
    numbers: Index
    first: int
    total: int
    strip: sparse.csr_array
    strip_numbers: Index
    P: sparse.csr_array
    u0: Array
    table: Index
    space: Any

    @classmethod
    def of(cls, body: Any) -> SpreadUnknowns:
        """Number the unknowns that the supports of a `DistributedBody` leave.

        Raises
        ------
        InputError
            A condition links dofs of several processes.
        """
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
