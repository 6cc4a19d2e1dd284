"""A sparse matrix whose rows are spread over processes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from skfem_adini.distributed.communicator import petsc
from skfem_adini.errors import InputError

Array = NDArray[np.float64]


class DistributedMatrix:
    """The rows of a matrix that belong to each process.

    `DistributedBasis.assemble` makes it.

    Parameters
    ----------
    space : DistributedBasis
        Of rows and columns.
    rows : csr_array, shape (space.owned.size, space.basis.N)
        The owned rows, in local columns.

    Raises
    ------
    InputError
        Another shape.

    Examples
    --------
    >>> from skfem import MeshQuad, ElementQuad1
    >>> from skfem.models.poisson import laplace
    >>> from skfem_adini.distributed import DistributedBasis
    >>> space = DistributedBasis(MeshQuad().refined(2), ElementQuad1())
    >>> K = space.assemble(laplace)
    >>> bool(abs(K @ np.ones(space.basis.N)).max() < 1e-14)
    True
    """

    def __init__(self, space: Any, rows: Any) -> None:
        expected = space.owned.size, space.basis.N
        if rows.shape != expected:
            raise InputError(f"rows: expected shape {expected}, got {rows.shape}")
        self.space, self.rows = space, sparse.csr_array(rows)

    def __repr__(self) -> str:
        n, here = self.space.N, self.space.owned.size
        return f"DistributedMatrix({n} x {n}, {here} rows here)"

    @property
    def shape(self) -> tuple[int, int]:
        """Of the whole matrix."""
        return self.space.N, self.space.N

    def __matmul__(self, x: Array) -> Array:
        """The product with a local vector, as a local vector."""
        return self.space.extended(self.rows @ x)

    def __add__(self, other: DistributedMatrix) -> DistributedMatrix:
        return DistributedMatrix(self.space, self.rows + other.rows)

    def __sub__(self, other: DistributedMatrix) -> DistributedMatrix:
        return DistributedMatrix(self.space, self.rows - other.rows)

    def __rmul__(self, factor: float) -> DistributedMatrix:
        return DistributedMatrix(self.space, factor * self.rows)

    def diagonal(self) -> Array:
        """The diagonal as a local vector."""
        space = self.space
        place = np.arange(space.owned.size), space.owned
        picked = sparse.csr_array((np.ones(space.owned.size), place), shape=self.rows.shape)
        own = np.asarray(self.rows.multiply(picked).sum(axis=1), dtype=np.float64).ravel()
        return space.extended(own)

    def to_petsc(self, block_size: int = 1) -> Any:
        """The matrix as a ``petsc4py.PETSc.Mat`` of type AIJ, a copy.

        Parameters
        ----------
        block_size : int
            Number of unknowns that stand together at each node.

        Raises
        ------
        MissingDependency
            petsc4py is not installed.
        """
        space = self.space
        return to_petsc(self.rows, space.numbers, (space.N, space.N), space.comm, block_size)

    def gather(self) -> sparse.csr_array | None:
        """The whole matrix in scikit-fem's numbering, on the first process; None on the others."""
        space, here = self.space, self.rows.tocoo()
        serial = space.serial_numbers()
        row, column = here.coords
        parts = space.comm.gather((space.first + row, space.numbers[column], here.data))
        if parts is None or serial is None:
            return None
        i, j, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        return sparse.csr_array((values, (serial[i], serial[j])), shape=self.shape)


def to_petsc(
    rows: Any, numbers: NDArray[np.int64], shape: tuple[int, int], comm: Any, block_size: int = 1
) -> Any:
    """Rows of this process in local columns, numbered by `numbers` (n,), as a part of a PETSc
    matrix."""
    PETSc = petsc(comm)
    rows = sparse.csr_array(rows)
    columns = numbers[rows.indices]
    # A copy: it is sorted by the numbers of the columns.
    shape_here = rows.shape[0], shape[1]
    local = sparse.csr_array((rows.data.copy(), columns, rows.indptr), shape=shape_here)
    local.sort_indices()
    A = PETSc.Mat().create(comm=PETSc.COMM_WORLD)
    own = rows.shape[0]
    A.setSizes(((own, shape[0]), (own, shape[1])))
    A.setType("aij")
    A.setBlockSize(block_size)
    kind = PETSc.IntType
    A.setPreallocationCSR((local.indptr.astype(kind), local.indices.astype(kind), local.data))
    A.assemble()
    return A
