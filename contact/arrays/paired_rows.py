"""Products of a sparse matrix, or of many small ones, and a vector, in pairs of numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.pairs import Pairs, dot
from contact.arrays.ranges import in_ranges

Array = NDArray[np.float64]
Index = NDArray[np.int64]
_TOGETHER = 2**15  # entries of A per range: their products fit the cache of a core


def rows_times(matrix: Any, x: Any) -> Pairs:
    """``A x``, shape (n,), every row to twice the working precision of its products.
    Rows with equal numbers of entries are computed together."""
    A, x = sparse.csr_array(matrix), Pairs.of(x)
    counts, result, plain = np.diff(A.indptr), Pairs.zeros(A.shape[0]), not np.any(x.low)
    for count in np.unique(counts[counts > 0]).tolist():
        rows, entries = np.flatnonzero(counts == count), np.arange(count)[:, None]

        def work(some: slice, rows: Index = rows, entries: Index = entries) -> None:
            at = entries + A.indptr[rows[some]]
            columns = A.indices[at]
            low = np.zeros(()) if plain else x.low[columns]
            result[rows[some]] = dot(A.data[at], Pairs(x.high[columns], low))

        in_ranges(work, rows.size, max(1, _TOGETHER // count))
    return result


def blocks_times(A: Array, x: Pairs) -> Pairs:
    """``A_c x_c`` of every cell c, (ncells, k), to twice the working precision of the products.
    A of shape (ncells, k, n), x of (ncells, n)."""
    result = Pairs.zeros(A.shape[:2])

    def work(some: slice) -> None:
        high, low = (part[some].T[:, :, None] for part in (x.high, x.low))
        result[some] = dot(A[some].transpose(2, 0, 1), Pairs(high, low))

    in_ranges(work, len(A), max(1, _TOGETHER // A[0].size))
    return result
