"""``L D L'`` of sparse quasidefinite matrices, row by row ([1]_), where dense blocks do not pay.

What is above the diagonal of the permuted matrix is given by columns (Ap, Ai, Ax), L by columns
(Lp, Li, Lx), its pattern by rows (Rp, Ri) too. Import it inside functions only: it imports numba.

References
----------
.. [1] T. A. Davis, "Algorithm 849: a concise sparse Cholesky factorization package", ACM Trans.
   Math. Softw. 31 (2005) 587-591.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from skfem_adini.ground.jit import Array, Index, Real, loop


class _Limits(NamedTuple):
    work: int = 500  # most multiplications an unknown: beyond, dense blocks are faster
    pivot: float = 1e-14  # least one over the terms that make it


LIMITS = _Limits()


@loop
def counts(Ap: Array, Ai: Array, parent: Array, column: Array, row: Array, most: Index) -> bool:
    """Elimination tree and, added to what is given, the numbers of entries of the columns and rows
    of L; whether they are at most `most`, else they are not complete."""
    n, entries = parent.size, 0
    seen = np.full(n, -1, np.int32)
    for k in range(n):
        parent[k] = -1
        seen[k] = k
        for p in range(Ap[k], Ap[k + 1]):
            i = Ai[p]
            while seen[i] != k:
                if parent[i] < 0:
                    parent[i] = k
                column[i] += 1
                row[k] += 1
                seen[i] = k
                i = parent[i]
        entries += row[k]
        if entries > most:
            return False
    return True


@loop
def pattern(
    Ap: Array, Ai: Array, parent: Array, Lp: Array, Li: Array, Rp: Array, Ri: Array
) -> None:
    """The rows of L, each column behind those of its subtree, and the columns."""
    n = parent.size
    seen, path, end = np.full(n, -1, np.int32), np.empty(n, np.int32), Lp[:n].copy()
    for k in range(n):
        seen[k], top = k, Rp[k + 1]
        for p in range(Ap[k], Ap[k + 1]):
            i, length = Ai[p], 0
            while seen[i] != k:
                seen[i], path[length] = k, i
                length += 1
                i = parent[i]
            while length:
                length -= 1
                top -= 1
                Ri[top] = path[length]
        for s in range(Rp[k], Rp[k + 1]):
            i = Ri[s]
            Li[end[i]] = k
            end[i] += 1


@loop
def numeric(
    Ap: Array, Ai: Array, Ax: Array, diagonal: Array, Lp: Array, Li: Array, Lx: Array,
    Rp: Array, Ri: Array, D: Array, least: Real,
) -> Index:  # fmt: skip
    """L and 1 / D; a pivot keeps the sign of its diagonal entry and at least the part `least` of
    the terms that make it. Returns the row that is not finite, or -1."""
    n = D.size
    y, end = np.zeros(n), Lp[:n].copy()
    for k in range(n):
        for p in range(Ap[k], Ap[k + 1]):
            y[Ai[p]] = Ax[p]
        d = diagonal[k]
        size = abs(d)
        for s in range(Rp[k], Rp[k + 1]):
            i = Ri[s]
            v, stop = y[i], end[i]
            y[i] = 0.0
            for p in range(Lp[i], stop):
                y[Li[p]] -= Lx[p] * v
            entry = v * D[i]
            Lx[stop] = entry
            end[i] = stop + 1
            d -= entry * v
            size += abs(entry * v)
        if not 0.0 < size < np.inf:
            return k
        if diagonal[k] < 0.0:
            d = min(d, -least * size)
        else:
            d = max(d, least * size)
        D[k] = 1.0 / d
    return -1


@loop
def solution(order: Array, Lp: Array, Li: Array, Lx: Array, D: Array, b: Array, x: Array) -> None:
    """Solve ``L D L' P x = P b``."""
    n = D.size
    u = np.empty(n)
    for j in range(n):
        u[j] = b[order[j]]
    for j in range(n):
        v = u[j]
        for p in range(Lp[j], Lp[j + 1]):
            u[Li[p]] -= Lx[p] * v
    for j in range(n - 1, -1, -1):
        v = u[j] * D[j]
        for p in range(Lp[j], Lp[j + 1]):
            v -= Lx[p] * u[Li[p]]
        u[j] = v
        x[order[j]] = v


class UpLooking:
    """``L D L'`` row by row; `work` is the mean number of multiplications an unknown."""

    def __init__(self, upper: sparse.csc_array, order: np.ndarray) -> None:
        self.size, self._order = order.size, order
        indptr, indices = upper.indptr.astype(np.int64), upper.indices.astype(np.int32)
        self._upper = indptr, indices, upper.data.astype(float)
        self._parent = np.empty(self.size, np.int32)
        column, row = np.zeros((2, self.size + 1), np.int64)
        most = int(np.sqrt(LIMITS.work) * self.size)
        complete = counts(indptr, indices, self._parent, column[1:], row[1:], most)
        self.work = float(column @ column) / self.size if complete else np.inf
        self._columns, self._rows = np.cumsum(column), np.cumsum(row)

    def prepare(self) -> UpLooking:
        """Itself, with the pattern of L."""
        entries = int(self._rows[-1])
        self._Li, self._Ri = np.empty((2, entries), np.int32)
        self._Lx, self._D = np.empty(entries), np.empty(self.size)
        pattern(*self._upper[:2], self._parent, self._columns, self._Li, self._rows, self._Ri)
        return self

    def factor(self, diagonal: Array) -> None:
        """Factor the matrix with this diagonal; raises `LinAlgError`."""
        row = numeric(
            *self._upper, diagonal[self._order], self._columns, self._Li, self._Lx, self._rows,
            self._Ri, self._D, LIMITS.pivot,
        )  # fmt: skip
        if row >= 0:
            raise np.linalg.LinAlgError(f"row {row} is zero, or not finite")

    def solve(self, r: Array) -> Array:
        """Solve with the last factor."""
        x = np.empty(self.size)
        solution(self._order, self._columns, self._Li, self._Lx, self._D, r, x)
        return x


def chain(upper: sparse.csc_array) -> UpLooking | None:
    """The factors in the given order, or in one of small bandwidth, if one of these leaves so few
    multiplications that dense blocks do not pay."""
    n = upper.shape[0]
    if not n or upper.nnz**2 > LIMITS.work * n**2:  # the columns of the matrix alone are longer
        return None
    found = UpLooking(upper, np.arange(n))
    if found.work > LIMITS.work:
        rows: Any = sparse.csr_array(upper + upper.T)
        order = csgraph.reverse_cuthill_mckee(rows, symmetric_mode=True).astype(np.int64)
        found = UpLooking(sparse.csc_array(sparse.triu(rows[order][:, order], 1)), order)
    return found.prepare() if found.work <= LIMITS.work else None
