"""Systems whose rows change at a few unknowns from one solution to the next, by multigrid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from skfem_adini.distributed.communicator import petsc
from skfem_adini.distributed.distributed_matrix import to_petsc
from skfem_adini.distributed.distributed_solver import precondition
from skfem_adini.errors import NotConverged

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Alteration:
    """Replacement of the rows of some chosen unknowns c.

    The rows become ``of_rows @ (K x)_c + of_x @ x_c``. Fixed unknowns keep their value; the rows of
    both matrices are zero there.

    Attributes
    ----------
    held : ndarray of bool, shape (n,)
    of_rows, of_x : csr_array, shape (n, n)
    """

    held: NDArray[np.bool_]
    of_rows: sparse.csr_array
    of_x: sparse.csr_array

    @classmethod
    def none(cls, held: NDArray[np.bool_]) -> Alteration:
        """Only fixed unknowns."""
        n = held.size
        free = sparse.csr_array(sparse.diags_array((~held).astype(float)))
        return cls(held, free, sparse.csr_array((n, n)))

    @property
    def symmetric(self) -> bool:
        """Whether only the rows of fixed unknowns are altered."""
        plain = self.of_rows.nnz == np.count_nonzero(~self.held)
        return bool(
            plain and not self.of_x.nnz and np.all(self.of_rows.diagonal()[~self.held] == 1)
        )


class AlteredSystem:
    """A symmetric matrix in other unknowns x of ``z = T x``, and its altered systems.

    T differs from the identity in the rows of a few unknowns, c, only. Only K is stored, and a copy
    of it with its multigrid while a system is solved.

    Parameters
    ----------
    rows : csr_array, shape (own unknowns, k)
        Own rows of the matrix in the unknowns z.
    numbers : ndarray, shape (k,)
        Number of each column.
    first, total : int
        Number of the first own unknown, and of all.
    chosen : ndarray, shape (n,)
        Numbers of the unknowns c, on all processes.
    change : csr_array, shape (own unknowns, j)
        Own rows of T.
    columns : ndarray, shape (j,)
        Number of each of its columns.
    near_null : ndarray, shape (own unknowns, modes)
        Functions of little energy, in x.
    comm : Communicator
    method : {"gamg", "hypre"}
    block_size : int
        Number of unknowns that stand together at each node.

    Raises
    ------
    MissingDependency
        petsc4py is not installed.
    """

    def __init__(
        self,
        rows: Any,
        numbers: Index,
        first: int,
        total: int,
        chosen: Index,
        change: Any,
        columns: Index,
        near_null: Array,
        comm: Any,
        method: str = "gamg",
        block_size: int = 1,
    ) -> None:
        self._PETSc = petsc(comm)
        self.comm, self.first, self.chosen, self.method = comm, first, chosen, method
        here = (chosen >= first) & (chosen < first + rows.shape[0])
        self._here = np.flatnonzero(here)
        self._own = chosen[here] - first
        self._near_null = near_null
        K = to_petsc(rows, numbers, (total, total), comm, block_size)
        self._T = to_petsc(change, columns, (total, total), comm, block_size)
        self._K = K.ptap(self._T)
        self._K.setOption(self._PETSc.Mat.Option.SYMMETRIC, True)
        K.destroy()
        self._b, self._x = self._K.createVecs()
        self.iterations = 0
        self.reference = 0.0

    def times(self, x: Array) -> Array:
        """K x on own unknowns."""
        return self._product(self._K, x)

    def to_z(self, x: Array) -> Array:
        """Own ``z = T x``."""
        return self._product(self._T, x)

    def carried(self, force: Array) -> Array:
        """Own forces ``T^T g`` from the forces g on z."""
        self._b.setArray(force)
        self._T.multTranspose(self._b, self._x)
        return np.array(self._x.getArray())

    def _product(self, matrix: Any, own: Array) -> Array:
        self._b.setArray(own)
        matrix.mult(self._b, self._x)
        return np.array(self._x.getArray())

    def of_chosen(self, own: Array) -> Array:
        """Values of the chosen unknowns, on all processes."""
        values = np.zeros(self.chosen.size)
        for place, part in self.comm.allgather((self._here, own[self._own])):
            values[place] = part
        return values

    def put(self, own: Array, values: Array) -> Array:
        """A copy of own values in which those of chosen unknowns are replaced."""
        own = own.copy()
        own[self._own] = values[self._here]
        return own

    def altered(self, alteration: Alteration, x: Array) -> tuple[Array, Array]:
        """Altered rows times x, zero at fixed unknowns, and K x."""
        product = self.times(x)
        rows = alteration.of_rows @ self.of_chosen(product) + alteration.of_x @ self.of_chosen(x)
        return self.put(product, rows), product

    def solve(
        self, alteration: Alteration, load: Array, of_chosen: Array, start: Array, tol: float
    ) -> tuple[Array, Array]:
        """Solve an altered system.

        Parameters
        ----------
        alteration : Alteration
        load : ndarray, shape (own unknowns,)
            Right side of the rows that are not chosen.
        of_chosen : ndarray, shape (n,)
            That of the chosen ones; held ones take it as their value.
        start : ndarray
        tol : float
            Residual, relative to the largest one at the start of any solution of this system.

        Returns
        -------
        x, product : ndarray
            Own x and K x.

        Raises
        ------
        NotConverged
            The residual stays above a thousand times the tolerance.
        """
        held = alteration.held
        x = self.put(start, np.where(held, of_chosen, self.of_chosen(start)))
        right = self.put(load, np.where(held, 0.0, of_chosen))
        ksp: Any = None
        pieces: list[Any] = []
        before = np.inf
        for _ in range(5):  # four runs of the Krylov method, each from the true residual
            rows, product = self.altered(alteration, x)
            left = right - rows
            size = self._norm(left)
            self.reference = max(self.reference, size)
            if size <= tol * self.reference or size > 0.5 * before:
                break  # in the second case the residual is at rounding level
            if ksp is None:
                ksp, pieces = self._prepared(alteration)
            x, before = x + self._iterated(ksp, left, tol), size
        for piece in pieces:
            piece.destroy()
        if not size <= 1e3 * tol * self.reference:
            raise NotConverged(
                f"{self.method}: relative residual {size / self.reference:.1e} after "
                f"{self.iterations} iterations, asked for {tol:.1e}"
            )
        return x, product

    def _iterated(self, ksp: Any, left: Array, tol: float) -> Array:
        self._b.setArray(left)
        ksp.setTolerances(rtol=1e-14, atol=0.3 * tol * self.reference, max_it=500)
        ksp.solve(self._b, self._x)
        self.iterations += int(ksp.getIterationNumber())
        return np.array(self._x.getArray())

    def _prepared(self, alteration: Alteration) -> tuple[Any, list[Any]]:
        """The Krylov method with multigrid for the system with fixed unknowns."""
        PETSc = self._PETSc
        own = alteration.held[self._here]
        rows = (self.first + self._own[own]).astype(PETSc.IntType)
        P = self._K.copy()
        P.zeroRowsColumns(rows, diag=1.0)
        self._stiffen(P, alteration.of_x)
        for option in (PETSc.Mat.Option.SYMMETRIC, PETSc.Mat.Option.SPD):
            P.setOption(option, True)
        modes = self._near_null.copy()
        modes[self._own[own]] = 0.0
        pieces = [P]
        A = P
        if not alteration.symmetric:
            sizes = P.getSizes()
            A = PETSc.Mat().createPython(sizes, _Rows(self, alteration), comm=PETSc.COMM_WORLD)
            A.setUp()
            pieces.append(A)
        ksp = PETSc.KSP().create(comm=PETSc.COMM_WORLD)
        ksp.setOperators(A, P)
        ksp.setType("cg" if alteration.symmetric else "gmres")
        if not alteration.symmetric:
            ksp.setGMRESRestart(100)
            ksp.setPCSide(PETSc.PC.Side.RIGHT)
        precondition(ksp, P, modes, self.method)
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        ksp.setUp()
        return ksp, [ksp, *pieces]

    def _stiffen(self, P: Any, of_x: sparse.csr_array) -> None:
        """Add the symmetric part of the change on the chosen unknowns to the matrix of the
        multigrid."""
        PETSc = self._PETSc
        part = (0.5 * (of_x + of_x.T)).tocoo()
        row, column = part.coords
        mine = np.isin(row, self._here)
        P.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        of = self.chosen.astype(PETSc.IntType)
        for r, c, value in zip(row[mine], column[mine], part.data[mine], strict=True):
            P.setValue(of[r], of[c], value, addv=PETSc.InsertMode.ADD_VALUES)
        P.assemble()

    def _norm(self, own: Array) -> float:
        return float(np.sqrt(sum(self.comm.allgather(float(own @ own)))))


class _Rows:
    """The altered matrix as a PETSc shell matrix, on unknowns that are zero where fixed."""

    def __init__(self, system: AlteredSystem, alteration: Alteration) -> None:
        self._system, self._alteration = system, alteration
        self._matrix = system._K
        self._free = np.where(alteration.held, 0.0, 1.0)

    def mult(self, matrix: Any, x: Any, y: Any) -> None:
        system, own = self._system, np.array(x.getArray())
        at = system.of_chosen(own)
        own = system.put(own, self._free * at)
        work = x.duplicate()
        work.setArray(own)
        self._matrix.mult(work, y)
        product = np.array(y.getArray())
        alteration = self._alteration
        rows = alteration.of_rows @ system.of_chosen(product) + alteration.of_x @ (self._free * at)
        y.setArray(system.put(product, np.where(alteration.held, at, rows)))
        work.destroy()
