"""Which functionals of the displacement the supports fix, and which stay free."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]


def unconstrained_rows(
    rows: sparse.csr_array, P: sparse.csr_array, lengths: tuple[Array, Array]
) -> NDArray[np.bool_]:
    """Rows that the prescribed displacements do not fix: those with ``rows @ P`` not zero.
    P is that of ``u = P z + u0``; the lengths scale dofs and unknowns to displacements."""
    of_dof, of_free = lengths
    left, given = few_times(rows, P), rows.copy()
    left.data /= of_free[left.indices]
    given.data /= of_dof[given.indices]
    return norms(left) > 1e-9 * norms(given)


def scaled_columns(matrix: sparse.csr_array, by: Array) -> sparse.csr_array:
    """The matrix times a diagonal matrix, sharing the sparsity pattern."""
    parts = matrix.data * by[matrix.indices], matrix.indices, matrix.indptr
    return sparse.csr_array(parts, shape=matrix.shape)


def few_times(rows: sparse.csr_array, P: sparse.csr_array) -> sparse.csr_array:
    """``rows @ P`` for few sparse rows, at a cost independent of the columns of P."""
    touched, at = np.unique(rows.indices, return_inverse=True)
    part = sparse.csr_array(P[touched])
    seen, to = np.unique(part.indices, return_inverse=True)
    few = sparse.csr_array((rows.data, at, rows.indptr), shape=(rows.shape[0], touched.size))
    small = few @ sparse.csr_array((part.data, to, part.indptr), shape=(touched.size, seen.size))
    parts = small.data, seen[small.indices], small.indptr
    product = sparse.csr_array(parts, shape=(rows.shape[0], P.shape[1]))
    product.sort_indices()
    return product


def selected(P: sparse.csr_array) -> NDArray[np.integer] | None:
    """The dof of each free unknown, shape (nfree,); None unless every unknown is a dof."""
    if P.nnz != P.shape[1] or not np.all(P.data == 1.0):
        return None
    dofs = np.empty(P.nnz, dtype=P.indices.dtype)
    dofs[P.indices] = np.flatnonzero(P.indptr[1:] != P.indptr[:-1])
    return dofs


def transposed(P: sparse.csr_array, chosen: NDArray[np.integer] | None) -> Any:
    """``P^T`` in CSR format, without sorting if unknowns are the chosen dofs."""
    if chosen is None:
        return P.T
    parts = np.ones(chosen.size), chosen, np.arange(chosen.size + 1, dtype=P.indptr.dtype)
    return sparse.csr_array(parts, shape=P.shape[::-1])


def norms(rows: sparse.csr_array) -> Array:
    """Euclidean norms of the rows."""
    owner = np.repeat(np.arange(rows.shape[0]), np.diff(rows.indptr))
    return np.sqrt(np.bincount(owner, np.square(rows.data), rows.shape[0]))


def single(P: sparse.csr_array) -> bool:
    """Whether each free unknown is a multiple of one dof."""
    if P.nnz != P.shape[1]:
        return False
    filled = np.zeros(P.shape[1], dtype=bool)
    filled[P.indices] = True
    return bool(filled.all())


def in_order(P: sparse.csr_array) -> sparse.csr_array:
    """The same free unknowns in the order of the dofs, where each is one dof; else P itself.
    Free rows and columns of a matrix then stay sorted."""
    if not single(P) or np.any(np.diff(P.indptr) > 1):
        return P
    return sparse.csr_array((P.data, np.arange(P.nnz, dtype=P.indices.dtype), P.indptr), P.shape)
