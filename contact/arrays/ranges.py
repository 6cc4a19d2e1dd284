"""Work on ranges of rows, cells or facets, by several threads if there are many."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from threading import current_thread
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from skfem_adini.ground.arrays import cores

Found = TypeVar("Found")


class _Limits(NamedTuple):  # of threads
    threads: int = 8  # at most: more threads only share the memory bandwidth
    entries: int = 4_000_000  # matrix entries per thread: SciPy reads them in a few ms


LIMITS = _Limits()


def in_ranges(work: Callable[[slice], Found], count: int, together: int = 2**13) -> list[Found]:
    """Results of ``work(range)`` for ranges of at most `together` that cover 0 to count, in order;
    the arrays of 2^13 cells or facets stay in the cache of a core. NumPy releases the lock for
    threads; nested calls run in their own thread, since waiting ones would block the pool."""
    ranges = [slice(at, min(at + together, count)) for at in range(0, count, together)]
    threads = min(cores(), LIMITS.threads, len(ranges))
    if threads < 2 or current_thread().name.startswith("contact-ranges"):
        return [work(some) for some in ranges]
    return list(_pool(os.getpid()).map(work, ranges))


@cache
def _pool(process: int) -> ThreadPoolExecutor:
    """The thread pool of this process; a forked process needs its own."""
    return ThreadPoolExecutor(min(cores(), LIMITS.threads), "contact-ranges")


def diagonal(matrix: sparse.csr_array) -> NDArray[Any]:
    """``matrix.diagonal()`` of a square matrix by threads, since SciPy reads all entries."""
    n = matrix.shape[0]
    threads = min(cores(), LIMITS.threads, matrix.nnz // LIMITS.entries)
    if threads < 2:
        return np.asarray(matrix.diagonal())

    def part(some: slice) -> NDArray[Any]:
        starts = matrix.indptr[some.start : some.stop + 1]
        here = slice(starts[0], starts[-1])
        entries = matrix.data[here], matrix.indices[here], starts - starts[0]
        rows = sparse.csr_array(entries, shape=(some.stop - some.start, n))
        return np.asarray(rows.diagonal(some.start))

    return np.concatenate(in_ranges(part, n, -(-n // threads)))
