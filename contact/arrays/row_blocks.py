"""The diagonal of a large sparse matrix, by several threads."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

_MOST_THREADS = 8  # more share the bandwidth of the memory
_OF_A_THREAD = 4_000_000  # entries that are worth one: SciPy looks at them in a few milliseconds


def diagonal(matrix: sparse.csr_array) -> NDArray[Any]:
    """``matrix.diagonal()``; SciPy looks at all entries, and lets other threads run meanwhile.

    Parameters
    ----------
    matrix : csr_array, shape (n, n)
    """
    n = matrix.shape[0]
    threads = min(os.cpu_count() or 1, _MOST_THREADS, matrix.nnz // _OF_A_THREAD)
    if threads < 2:
        return np.asarray(matrix.diagonal())
    bounds = np.linspace(0, n, threads + 1).astype(np.int64)

    def part(begin: int, end: int) -> NDArray[Any]:
        starts = matrix.indptr[begin : end + 1]
        some = slice(starts[0], starts[-1])
        entries = matrix.data[some], matrix.indices[some], starts - starts[0]
        rows = sparse.csr_array(entries, shape=(end - begin, n))
        return np.asarray(rows.diagonal(begin))

    with ThreadPoolExecutor(threads) as pool:
        return np.concatenate(list(pool.map(part, bounds[:-1], bounds[1:])))
