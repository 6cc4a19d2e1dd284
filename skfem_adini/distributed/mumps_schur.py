"""MUMPS's factorisation with the dense Schur complement of chosen unknowns, on many processes."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from skfem_adini.distributed.communicator import petsc
from skfem_adini.distributed.distributed_matrix import to_petsc
from skfem_adini.errors import AdiniError, InputError

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class MumpsSchur:
    """One parallel factorisation; the Schur complement is computed with it.

    petsc4py does not wrap these functions of PETSc, so they are called through ctypes.

    Parameters
    ----------
    rows : csr_array, shape (own unknowns, k)
        Own rows of a symmetric matrix whose part without the chosen unknowns is positive definite.
    numbers : ndarray, shape (k,)
        Number of each column in the whole matrix.
    first, total : int
        Number of the first own unknown, and of all.
    chosen : ndarray, shape (n,)
        Ascending numbers of the unknowns to be kept, the same on all processes.
    comm : Communicator

    Attributes
    ----------
    schur : ndarray, shape (n, n)
        The complement, on all processes.

    Raises
    ------
    InputError
        The part without the chosen unknowns is not positive definite.
    MissingDependency
        petsc4py is not installed.

    References
    ----------
    P. R. Amestoy, I. S. Duff, J. Koster and J.-Y. L'Excellent, A fully asynchronous multifrontal
    solver using distributed dynamic scheduling, SIAM J. Matrix Anal. Appl. 23 (2001), 15-41.
    """

    def __init__(
        self, rows: Any, numbers: Index, first: int, total: int, chosen: Index, comm: Any
    ) -> None:
        PETSc = petsc(comm)
        self._comm, self._first, self._chosen = comm, first, chosen
        here = (chosen >= first) & (chosen < first + rows.shape[0])
        self._here = np.flatnonzero(here)  # indices of own unknowns among the chosen ones
        self._own = chosen[here] - first
        # The matrix may be singular, for a body without supports. A shift of the chosen unknowns
        # makes it definite; it enters the complement unchanged and is subtracted again.
        order = np.argsort(numbers)
        column = order[np.searchsorted(numbers[order], chosen[here])]
        picked = sparse.csr_array((np.ones(column.size), (self._own, column)), shape=rows.shape)
        added = abs(sparse.csr_array(rows.multiply(picked)))
        shift = np.asarray(added.sum(axis=1), dtype=np.float64).ravel()[self._own]
        self._matrix = to_petsc(sparse.csr_array(rows + added), numbers, (total, total), comm)
        for option in (PETSc.Mat.Option.SYMMETRIC, PETSc.Mat.Option.SPD):
            self._matrix.setOption(option, True)
        self._b, self._x = self._matrix.createVecs()
        self._ksp = PETSc.KSP().create(comm=PETSc.COMM_WORLD)
        self._ksp.setOperators(self._matrix)
        self._ksp.setType("preonly")
        pc = self._ksp.getPC()
        pc.setType("cholesky")
        pc.setFactorSolverType("mumps")
        pc.setFactorSetUpSolverType()
        factor = pc.getFactorMatrix()
        library = ctypes.CDLL(PETSc.__file__)
        # MUMPS requires all of them on the first process.
        kept = chosen if comm.rank == 0 else chosen[:0]
        which = PETSc.IS().createGeneral(kept.astype(PETSc.IntType), comm=PETSc.COMM_WORLD)
        _call(library.MatFactorSetSchurIS, ctypes.c_void_p(factor.handle), _handle(which))
        try:
            self._ksp.setUp()
        except PETSc.Error as error:
            raise _refused(error) from error
        if factor.getMumpsInfog(1) < 0:
            raise _refused(f"MUMPS reports {factor.getMumpsInfog(1)}")
        factor.setMumpsIcntl(26, 0)  # from here on, solutions are those of the inner block
        triangle = _dense(library, factor, chosen.size) if comm.rank == 0 else None
        shifts = np.zeros(chosen.size)
        for place, values in comm.allgather((self._here, shift)):
            shifts[place] = values
        self.schur = self._whole(triangle) - np.diag(shifts)

    def _whole(self, block: Array | None) -> Array:
        """Both triangles from the one that MUMPS computed, recognised by a product with S."""
        z = np.random.default_rng(0).standard_normal(self._chosen.size)
        exact = self._product(z)
        found: Array | str = "the product with the Schur complement of MUMPS is wrong"
        if block is not None:
            lower = np.tril(block)
            upper = np.triu(block)
            for part in (lower + np.tril(block, -1).T, upper + np.triu(block, 1).T):
                if np.abs(part @ z - exact).max() <= 1e-6 * np.abs(exact).max():
                    found = np.ascontiguousarray(part)
                    break
        found = self._comm.bcast(found)
        if isinstance(found, str):
            raise AdiniError(found)
        return found

    def _product(self, z: Array) -> Array:
        """S z with the shift, by one inner solve."""
        carried = self._times(self._spread(np.zeros(self._b.getLocalSize()), z))
        inner = self._solve(carried)
        return self._collect(carried - self._times(inner))

    def _spread(self, own: Array, z: Array) -> Array:
        """Own values in which those of the chosen unknowns are replaced."""
        own = own.copy()
        own[self._own] = z[self._here]
        return own

    def _collect(self, own: Array) -> Array:
        """Values of the chosen unknowns, on all processes."""
        z = np.zeros(self._chosen.size)
        for place, values in self._comm.allgather((self._here, own[self._own])):
            z[place] = values
        return z

    def _times(self, own: Array) -> Array:
        self._b.setArray(own)
        self._matrix.mult(self._b, self._x)
        return np.array(self._x.getArray())

    def _solve(self, load: Array) -> Array:
        """Inner unknowns for a load on them, with the chosen ones zero."""
        load = load.copy()
        load[self._own] = 0.0
        self._b.setArray(load)
        self._ksp.solve(self._b, self._x)
        x = np.array(self._x.getArray())
        x[self._own] = 0.0
        return x

    def reduce(self, load: Array) -> Array:
        """Carry an own load to the chosen unknowns, shape (n,), on all processes."""
        return self._collect(load - self._times(self._solve(load)))

    def expand(self, load: Array, z: Array) -> Array:
        """All own unknowns from the chosen ones."""
        given = self._spread(np.zeros_like(load), z)
        inner = self._solve(load - self._times(given))
        return inner + given


def _handle(thing: Any) -> Any:
    return ctypes.c_void_p(thing.handle)


def _call(function: Any, *arguments: Any) -> None:
    code = function(*arguments)
    if code:
        raise AdiniError(f"PETSc: {function.__name__} failed with code {code}")


def _dense(library: Any, factor: Any, size: int) -> Array:
    """A copy of the factor's Schur complement, in MUMPS's storage."""
    block, status = ctypes.c_void_p(), ctypes.c_int()
    _call(
        library.MatFactorGetSchurComplement,
        _handle(factor), ctypes.byref(block), ctypes.byref(status),
    )  # fmt: skip
    data = ctypes.POINTER(ctypes.c_double)()
    _call(library.MatDenseGetArray, block, ctypes.byref(data))
    copied = np.array(np.ctypeslib.as_array(data, shape=(size * size,)))
    _call(library.MatDenseRestoreArray, block, ctypes.byref(data))
    _call(library.MatFactorRestoreSchurComplement, _handle(factor), ctypes.byref(block), 0)
    return copied.reshape(size, size)


def _refused(reason: Any) -> InputError:
    return InputError(
        "stiffness: the part inside the contact boundary is not positive definite; parts of the "
        f"mesh hang together by a hinge alone, or a piece is not held ({str(reason).strip()})"
    )
