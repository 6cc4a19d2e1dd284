"""Vectors and matrices on the free unknowns of all bodies, by gathers where these are dofs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.condensation.device_schur import Rows
from skfem_adini.ground.arrays import host, namespace

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Csr = sparse.csr_array
Matrix = Any  # of SciPy by rows; or `Rows`, with its values on a device
NOTHING = 1e-150  # in place of zeros, which sparse products drop, so that the pattern stays


class FreeUnknowns:
    """The unknowns z of displacements u = P z + u0; the places of a tangent's entries are kept."""

    def __init__(self, P: Csr) -> None:
        self.P = P
        columns = P.tocsc()
        alone = P.nnz == P.shape[1] and bool(np.all(np.diff(columns.indptr) == 1))
        self._dofs: Index | None = None  # of the unknowns; None if supports couple dofs
        if alone and np.all(P.data == 1):
            self._dofs = np.asarray(columns.indices, dtype=np.int64)
            self._number = np.full(P.shape[0], -1)
            self._number[self._dofs] = np.arange(self._dofs.size)
        self._known: tuple[Any, ...] | None = None  # the last pattern, and where entries go

    def forces(self, f: Array) -> Array:
        """P^T f."""
        return np.asarray(self.P.T @ f if self._dofs is None else f[self._dofs])

    def displacement(self, z: Array) -> Array:
        """P z."""
        if self._dofs is None:
            return np.asarray(self.P @ z)
        u = np.zeros(self.P.shape[0])
        u[self._dofs] = z
        return u

    def rows(self, R: Csr) -> Csr:
        """R P, of rows R (m, ndofs)."""
        if self._dofs is None:
            return Csr(R @ self.P)
        column = self._number[R.indices]
        free = column >= 0
        ends = np.concatenate(([0], np.cumsum(free)))[R.indptr]
        return Csr((R.data[free], column[free], ends), shape=(R.shape[0], self.P.shape[1]))

    def matrix(self, K: Matrix) -> tuple[Matrix, Array]:
        """D P^T K P D with the scales D (n,) that make its diagonal one, which is complete, and
        columns in order; matrices of one pattern share its arrays."""
        if self._dofs is None:
            K_host = on_host(K)
            data = np.where(K_host.data == 0.0, NOTHING, K_host.data)
            full = Csr((data, K_host.indices, K_host.indptr), shape=K.shape)
            A = _complete(Csr(self.P.T @ full @ self.P))
            A = with_values(K, A, namespace(K.data).asarray(A.data))
            scaled = self._scaling(A)
        else:
            pattern, known = (K.indptr, K.indices), self._known
            if known is None or not all(map(np.array_equal, known[0], pattern)):
                numbers = np.arange(1.0, K.nnz + 1)  # of entries; below 2^53 they are exact
                own = Csr((numbers, K.indices, K.indptr), shape=K.shape)[self._dofs][:, self._dofs]
                like = _complete(Csr(own))
                place = namespace(K.data).asarray(like.data.astype(np.int64) - 1)
                like = with_values(K, like, K.data[place])
                self._known = known = pattern, like, place, place < 0, self._scaling(like)
            _, like, place, new, scaled = known
            A = with_values(K, like, K.data[place])
            A.data[new] = 0.0
        diagonal, row, column = scaled
        size = np.sqrt(np.abs(A.data[diagonal]))
        unit = 1.0 / np.where(size > 0, size, 1.0)
        A.data[:] *= unit[row]
        A.data[:] *= unit[column]
        return A, host(unit)

    def _scaling(self, A: Matrix) -> tuple[Any, Any, Any]:
        """Numbers of the entries on the diagonal, rows and columns of all, where the values are."""
        put, row = namespace(A.data).asarray, np.repeat(np.arange(A.shape[0]), np.diff(A.indptr))
        return put(np.flatnonzero(A.indices == row)), put(row), put(A.indices)


def on_host(K: Matrix) -> Csr:
    """The matrix of SciPy."""
    return K.on_host() if isinstance(K, Rows) else K


def with_values(K: Matrix, like: Matrix, data: Any) -> Matrix:
    """A matrix of the kind of K with the pattern of another one."""
    if isinstance(K, Rows):
        return Rows(like.indptr, like.indices, data)
    return Csr((data, like.indices, like.indptr), shape=like.shape)


def added(K: Matrix, other: Csr) -> Matrix:
    """K + other; with the pattern of K where that contains the other one."""
    if not other.nnz:
        return K
    if not other.has_canonical_format:
        other = other.copy()
        other.sum_duplicates()
    rows = np.flatnonzero(np.diff(other.indptr))
    at, keys = entries(K, rows)
    _, wanted = entries(other, rows)
    place = np.minimum(np.searchsorted(keys, wanted), keys.size - 1)
    if not (keys.size and np.array_equal(keys[place], wanted)):
        total = Csr(on_host(K) + other)
        return with_values(K, total, namespace(K.data).asarray(total.data))
    put, data = namespace(K.data).asarray, K.data.copy()
    data[put(at[place])] += put(other.data)
    return with_values(K, K, data)


def stacked(parts: list[Matrix]) -> Matrix:
    """The block diagonal matrix of several."""
    if len(parts) == 1:
        return parts[0]
    shapes = np.array([part.shape for part in parts])
    columns = np.cumsum(shapes[:, 1]) - shapes[:, 1]
    starts = np.cumsum([0, *(part.nnz for part in parts)])
    indices = [part.indices + first for part, first in zip(parts, columns, strict=True)]
    ends = [part.indptr[1:] + first for part, first in zip(parts, starts[:-1], strict=True)]
    pattern = np.concatenate(indices), np.concatenate([[0], *ends])
    on_device = next((part for part in parts if isinstance(part, Rows)), None)
    if on_device is not None:
        xp = namespace(on_device.data)
        return Rows(pattern[1], pattern[0], xp.concatenate([xp.asarray(p.data) for p in parts]))
    data = np.concatenate([part.data for part in parts])
    return Csr((data, *pattern), shape=tuple(shapes.sum(axis=0)))


def entries(A: Matrix, rows: Index) -> tuple[Index, Index]:
    """Numbers of the entries of some rows, and keys that ascend with row and column."""
    count = np.diff(A.indptr)[rows]
    first = np.cumsum(count) - count
    at = np.repeat(A.indptr[rows] - first, count) + np.arange(count.sum())
    return at, np.repeat(rows, count) * A.shape[1] + A.indices[at]


def _complete(A: Csr) -> Csr:
    """A with ascending columns and zeros where the diagonal had no entries."""
    own, n = A.tocoo(), np.arange(A.shape[0])
    place: Any = np.concatenate((own.row, n)), np.concatenate((own.col, n))
    return Csr(sparse.coo_array((np.concatenate((own.data, np.zeros(n.size))), place), A.shape))
