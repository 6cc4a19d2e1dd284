"""Work on ranges of rows, cells or facets, by several threads where there is much of it."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from threading import current_thread
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Found = TypeVar("Found")
_MOST_THREADS = 8  # more threads only share the memory's bandwidth
_OF_A_THREAD = 4_000_000  # entries worth a thread: SciPy reads them in a few ms
_NAME = "contact-ranges"
_TOGETHER = 2**13  # cells or facets whose arrays stay in the cache of a core


def cores() -> int:
    """Cores that this process may use."""
    known = getattr(os, "sched_getaffinity", None)
    return len(known(0)) if known else os.cpu_count() or 1


def in_ranges(work: Callable[[slice], Found], count: int, together: int = _TOGETHER) -> list[Found]:
    """Results of ``work(range)`` for ranges of at most `together` that cover 0 to count, in order.
    Threads run while NumPy works; nested calls stay in their thread, because waiting ones would
    keep threads from the others."""
    ranges = [slice(at, min(at + together, count)) for at in range(0, count, together)]
    threads = min(cores(), _MOST_THREADS, len(ranges))
    if threads < 2 or current_thread().name.startswith(_NAME):
        return [work(some) for some in ranges]
    return list(_pool(os.getpid()).map(work, ranges))


@cache
def _pool(process: int) -> ThreadPoolExecutor:
    """Threads of this process, which a forked one would not have; they wait for the next ranges."""
    return ThreadPoolExecutor(min(cores(), _MOST_THREADS), _NAME)


def diagonal(matrix: sparse.csr_array) -> NDArray[Any]:
    """``matrix.diagonal()`` of a square matrix by threads: SciPy looks at all entries."""
    n = matrix.shape[0]
    threads = min(cores(), _MOST_THREADS, matrix.nnz // _OF_A_THREAD)
    if threads < 2:
        return np.asarray(matrix.diagonal())

    def part(some: slice) -> NDArray[Any]:
        starts = matrix.indptr[some.start : some.stop + 1]
        here = slice(starts[0], starts[-1])
        entries = matrix.data[here], matrix.indices[here], starts - starts[0]
        rows = sparse.csr_array(entries, shape=(some.stop - some.start, n))
        return np.asarray(rows.diagonal(some.start))

    return np.concatenate(in_ranges(part, n, -(-n // threads)))
