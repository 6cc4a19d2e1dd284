"""Factors of symmetric quasidefinite sparse matrices whose diagonal changes.

A matrix ``[[H, C'], [C, -E]]`` with H and E positive definite has a factorisation ``L D L'`` in
every order of elimination ([1]_), so one ordering serves all matrices of an interior-point method.
Chains, as in model predictive control, are factored row by row, see `up_looking`, others by PARDISO
if pypardiso can be imported, by SuperLU otherwise.

References
----------
.. [1] R. J. Vanderbei, "Symmetric quasidefinite matrices", SIAM J. Optim. 5 (1995) 100-113.
"""

from __future__ import annotations

import ctypes
import functools
import importlib.util
import sys
import threading
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import splu

Vector = np.ndarray


def has_pardiso() -> bool:
    """Whether pypardiso can be imported."""
    return importlib.util.find_spec("pypardiso") is not None


def quasidefinite(upper: sparse.csc_array, solver: str = "auto") -> Any:
    """Prepare to factor symmetric matrices, given what is above the diagonal; the method `factor`
    takes the diagonal. "pivoted" chooses pivots by size, for diagonals that are nearly nothing."""
    from gpu.arrays import up_looking

    found = up_looking.chain(upper) if solver == "auto" else None
    if found is not None:
        return found
    K = sparse.csc_array(upper + upper.T + sparse.eye_array(upper.shape[0]))
    if solver == "pivoted":
        return SuperLUFactor(K, threshold=0.1)
    if solver == "superlu" or (solver == "auto" and not has_pardiso()):
        return SuperLUFactor(K)
    return PardisoFactor(K)


class SuperLUFactor:
    """SuperLU in a minimum-degree order, with pivots on the diagonal where they reach `threshold`
    times the largest in their column."""

    def __init__(self, K: sparse.csc_array, threshold: float = 0.0) -> None:
        self.size, self.threshold = K.shape[0], threshold
        self._matrix = _with_sorted_indices(K)
        self._place = _diagonal_places(self._matrix)

    def factor(self, diagonal: Vector) -> None:
        """Factor the matrix with this diagonal; raises `LinAlgError`."""
        self._matrix.data[self._place] = diagonal
        if not np.isfinite(diagonal).all():
            raise np.linalg.LinAlgError("the matrix has entries that are not finite")
        try:
            self._lu = splu(
                self._matrix,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=self.threshold,
                options={"SymmetricMode": not self.threshold},
            )
        except (RuntimeError, MemoryError) as error:
            raise np.linalg.LinAlgError(str(error)) from None

    def solve(self, r: Vector) -> Vector:
        """Solve with the last factor."""
        u: Vector = self._lu.solve(r)
        return u

    def pivots(self) -> Vector:
        """Diagonal of the last factor U; -1 where the pivot was not taken from the diagonal."""
        pivots: Vector = self._lu.U.diagonal()
        return np.where(self._lu.perm_r == self._lu.perm_c, pivots, -1.0)


def structurally_regular(A: Any) -> bool:
    """Whether some choice of entries makes a host matrix of this pattern regular.

    SuperLU calls BLAS with wrong arguments where none does, and may return factors all the same.
    """
    if bool((A.diagonal() != 0.0).all()):
        return True
    pattern = sparse.csr_array(A != 0.0)
    return bool(csgraph.structural_rank(pattern) == A.shape[0])


def is_positive_definite(K: sparse.csc_array) -> bool:
    """Whether all pivots of a symmetric matrix are positive, taken from its diagonal."""
    if not bool((K.diagonal() > 0.0).all()):
        return False
    factors = SuperLUFactor(K)
    try:
        factors.factor(K.diagonal())
    except np.linalg.LinAlgError:
        return False
    return bool((factors.pivots() > 0.0).all())


def _with_sorted_indices(K: sparse.csc_array) -> sparse.csc_array:
    K = _with_full_diagonal(K)
    K.sort_indices()
    K.indices, K.indptr = K.indices.astype(np.int32), K.indptr.astype(np.int32)
    return K


def _with_full_diagonal(K: Any) -> sparse.csc_array:
    if bool((K.diagonal() != 0.0).all()):
        return sparse.csc_array(K)
    coo = sparse.coo_array(K)
    i = np.arange(K.shape[0])
    off = coo.coords[0] != coo.coords[1]
    rows = np.concatenate([coo.coords[0][off], i])
    columns = np.concatenate([coo.coords[1][off], i])
    data = np.concatenate([coo.data[off], np.ones(i.size)])
    return sparse.csc_array((data, (rows, columns)), shape=K.shape)


def _diagonal_places(K: sparse.csc_array) -> np.ndarray:
    """Indices of the diagonal entries in ``K.data``."""
    column = np.repeat(np.arange(K.shape[0]), np.diff(K.indptr))
    return np.flatnonzero(K.indices == column)


class PardisoFactor:
    """MKL's PARDISO for symmetric indefinite matrices, one analysis for all factorisations.

    Reference: Intel oneMKL developer reference, ``pardiso``, matrix type -2.
    """

    def __init__(self, K: sparse.csc_array) -> None:
        self.size = K.shape[0]
        upper = sparse.csr_array(sparse.triu(_with_full_diagonal(K), format="csr"))
        upper.sort_indices()
        self._entries = upper.data.astype(float)
        self._data = self._entries
        self._column = upper.indices.astype(np.int64)
        self._row = np.repeat(np.arange(self.size), np.diff(upper.indptr))
        self._place = upper.indptr[:-1].astype(np.int64)  # the diagonal entry is the row's first
        self._data[self._place] = 0.0
        self._largest = self._sizes()
        self._data = self._entries.copy()
        self._ia = (upper.indptr + 1).astype(np.int32)
        self._ja = (upper.indices + 1).astype(np.int32)
        self._handle = np.zeros(64, dtype=np.int64)
        self._perm = np.zeros(self.size, dtype=np.int32)
        self._iparm = np.zeros(64, dtype=np.int32)
        self._iparm[0] = 1  # use the values below instead of the defaults
        self._iparm[1] = 2  # nested dissection
        self._iparm[7] = 0  # no refinement: callers refine with the original blocks
        self._iparm[9] = 13  # pivots below 1e-13 of the norm are perturbed
        self._iparm[20] = 1  # 1x1 and 2x2 pivots
        self._nothing = np.zeros(self.size)
        self._lock = threading.Lock()
        self._call(11, self._nothing, self._nothing)

    def __reduce__(self) -> Any:
        raise TypeError("factors of PARDISO live in memory of their own: copies factor anew")

    def factor(self, diagonal: Vector) -> None:
        """Factor the matrix with this diagonal; raises `LinAlgError`."""
        with self._lock:
            self._factor(diagonal)

    def _factor(self, diagonal: Vector) -> None:
        # PARDISO perturbs pivots that are small relative to the norm of the matrix. So twice rows
        # and columns are divided by the square root of their largest entry.
        self._root = np.ones(self.size)
        self._data[:] = self._entries
        self._data[self._place] = diagonal
        for size in (np.maximum(self._largest, np.abs(diagonal)), None):
            root = 1.0 / np.sqrt(self._sizes() if size is None else size)
            self._data *= root[self._row]
            self._data *= root[self._column]
            self._root *= root
        if not np.isfinite(self._data).all():
            # PARDISO writes outside its memory if a matrix has NaN or infinities.
            raise np.linalg.LinAlgError("the matrix has entries that are not finite")
        self._call(22, self._nothing, self._nothing)

    def _sizes(self) -> Vector:
        """The largest entries of the rows of the symmetric matrix."""
        size: Vector = np.maximum.reduceat(np.abs(self._data), self._place)
        np.maximum.at(size, self._column, np.abs(self._data))
        return size

    def solve(self, r: Vector) -> Vector:
        """Solve with the last factor."""
        u = np.zeros(self.size)
        with self._lock:
            self._call(33, self._root * r, u)
            return self._root * u

    def _call(self, phase: int, b: Vector, x: Vector) -> None:
        error = ctypes.c_int32(0)
        arguments: tuple[Any, ...] = (
            self._handle,
            1,  # number of factorisations kept
            1,  # number of the one used
            -2,  # real symmetric indefinite
            phase,
            self.size,
            self._data,
            self._ia,
            self._ja,
            self._perm,
            1,  # number of right-hand sides
            self._iparm,
            0,  # print no messages
            b,
            x,
        )
        _pardiso()(
            *(
                ctypes.byref(ctypes.c_int32(value))
                if isinstance(value, int)
                else value.ctypes.data_as(ctypes.c_void_p)
                for value in arguments
            ),
            ctypes.byref(error),
        )
        if error.value == -2:
            raise MemoryError("PARDISO: not enough memory for the factorisation")
        if error.value != 0:
            raise np.linalg.LinAlgError(f"PARDISO phase {phase} failed with code {error.value}")

    def __del__(self) -> None:
        # While the interpreter shuts down, the module's names may be deleted already.
        if np is None or sys is None or sys.is_finalizing():
            return
        if getattr(self, "_handle", np.zeros(1)).any():
            self._call(-1, self._nothing, self._nothing)
            self._handle[:] = 0


@functools.cache
def _pardiso() -> Any:
    """MKL's ``pardiso``, cached because pypardiso takes a while to find the library."""
    from pypardiso.scipy_aliases import pypardiso_solver

    # A function object of our own: attribute access would return a shared one, on which other code
    # may have set argument types.
    function = pypardiso_solver.libmkl["pardiso"]
    function.argtypes, function.restype = None, None
    return function
