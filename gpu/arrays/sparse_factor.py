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

from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import splu

from skfem_adini.ground.errors import SolverError
from skfem_adini.ground.pardiso import INDEFINITE, Pardiso, has_pardiso, upper_triangle

Vector = np.ndarray


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
    """SuperLU in a minimum-degree order, found once, with pivots on the diagonal where they reach
    `threshold` times the largest in their column."""

    def __init__(self, K: sparse.csc_array, threshold: float = 0.0) -> None:
        self.size, self.threshold = K.shape[0], threshold
        self._order: Vector | None = None
        self._lu: Any = None
        self._take(K)

    def _take(self, K: sparse.csc_array) -> None:
        self._matrix = _with_sorted_indices(K)
        self._place = _diagonal_places(self._matrix)

    def factor(self, diagonal: Vector) -> None:
        """Factor the matrix with this diagonal; raises `LinAlgError`."""
        if not np.isfinite(diagonal).all():
            raise np.linalg.LinAlgError("the matrix has entries that are not finite")
        if self._lu is not None and self._order is None:
            self._order = np.argsort(self._lu.perm_c)
            self._take(self._matrix[self._order][:, self._order])
        self._matrix.data[self._place] = diagonal if self._order is None else diagonal[self._order]
        try:
            self._lu = splu(
                self._matrix,
                permc_spec="MMD_AT_PLUS_A" if self._order is None else "NATURAL",
                diag_pivot_thresh=self.threshold,
                options={"SymmetricMode": not self.threshold},
            )
        except (RuntimeError, MemoryError) as error:
            raise np.linalg.LinAlgError(str(error)) from None
        self._own = self._order  # of the factors at hand

    def solve(self, r: Vector) -> Vector:
        """Solve with the last factor."""
        found: Vector = self._lu.solve(r if self._own is None else r[self._own])
        if self._own is None:
            return found
        u = np.empty_like(found)
        u[self._own] = found
        return u

    def pivots(self) -> Vector:
        """Diagonal of the last factor U; -1 where the pivot was not taken from the diagonal."""
        pivots: Vector = self._lu.U.diagonal()
        return np.where(self._lu.perm_r == self._lu.perm_c, pivots, -1.0)


def structurally_regular(A: Any) -> bool:
    """Whether some choice of entries makes a host matrix of this pattern regular. Where none does,
    SuperLU calls BLAS with wrong arguments, and may return factors all the same."""
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
    """MKL's PARDISO for symmetric indefinite matrices, one analysis for all factorisations."""

    def __init__(self, K: sparse.csc_array) -> None:
        upper = upper_triangle(K)
        self.size = K.shape[0]
        self._column = upper.indices
        self._row = np.repeat(np.arange(self.size), np.diff(upper.indptr))
        self._place = upper.indptr[:-1].astype(np.int64)  # the diagonal entry is the row's first
        self._entries = upper.data.astype(float)
        self._entries[self._place] = 0.0
        self._largest = self._sizes(self._entries)
        # Nested dissection, pivots of one and two rows, perturbed below 1e-13 of the norm.
        self._pardiso = Pardiso(upper, INDEFINITE, {1: 2, 9: 13, 20: 1})
        self._pardiso(11)

    def factor(self, diagonal: Vector) -> None:
        """Factor the matrix with this diagonal; raises `LinAlgError`."""
        # PARDISO perturbs pivots that are small relative to the norm of the matrix. So twice rows
        # and columns are divided by the square root of their largest entry.
        values, self._root = self._pardiso.values, np.ones(self.size)
        values[:] = self._entries
        values[self._place] = diagonal
        for size in (np.maximum(self._largest, np.abs(diagonal)), None):
            root = 1.0 / np.sqrt(self._sizes(values) if size is None else size)
            values *= root[self._row]
            values *= root[self._column]
            self._root *= root
        if not np.isfinite(values).all():
            # PARDISO writes outside its memory if a matrix has NaN or infinities.
            raise np.linalg.LinAlgError("the matrix has entries that are not finite")
        try:
            self._pardiso(22)
        except SolverError as error:
            raise np.linalg.LinAlgError(str(error)) from None

    def _sizes(self, values: Vector) -> Vector:
        """The largest entries of the rows of the symmetric matrix."""
        size: Vector = np.maximum.reduceat(np.abs(values), self._place)
        np.maximum.at(size, self._column, np.abs(values))
        return size

    def solve(self, r: Vector) -> Vector:
        """Solve with the last factor."""
        u = np.zeros(self.size)
        self._pardiso(33, self._root * r, u)
        return self._root * u
