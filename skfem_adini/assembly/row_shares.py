"""Ranges of rows that are written at the same time, each by one thread."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.integer]

_MOST_THREADS = 8  # more gain nothing: threads share the bandwidth of the memory
_WORTH_A_THREAD = 50_000  # pairs of a row block and a column block of a cell: .4 to 2 ms


def shares_of(first: Integers, columns: int) -> list[tuple[int, int]]:
    """Return ranges of row blocks of about equal work, one for each thread.
    `first` (blocks + 1,) counts the cells of the blocks before each one, `columns` blocks of a
    cell."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    work = int(first[-1]) * columns
    # The kernels are limited by the memory: on two processors a second thread gained nothing.
    threads = max(1, min((cores or 1) // 2, _MOST_THREADS, work // _WORTH_A_THREAD))
    ends = np.searchsorted(first, first[-1] * np.arange(1, threads) / threads)
    ends = [0, *map(int, ends), len(first) - 1]
    return list(pairwise(ends))


def in_threads(work: Callable[[int, int], None], shares: list[tuple[int, int]]) -> None:
    """Call ``work(begin, end)`` for each range."""
    if len(shares) == 1:
        work(*shares[0])
        return
    with ThreadPoolExecutor(len(shares) - 1) as pool:
        others = [pool.submit(work, *share) for share in shares[1:]]
        work(*shares[0])
        for other in others:
            other.result()
