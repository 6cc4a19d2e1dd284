"""Scatter of local matrices and vectors into global ones, row by row, by compiled kernels."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from skfem_adini.assembly import row_kernels
from skfem_adini.assembly.dof_blocks import DofBlocks
from skfem_adini.ground.arrays import cores
from skfem_adini.ground.jit import compiled_later

Array = NDArray[Any]
Integers = NDArray[np.integer]


def scatter_matrix(local: Array, labels: Integers, rows: DofBlocks, columns: DofBlocks) -> Any:
    """Return the sum of the local matrices (classes, rows, columns) of cells, in canonical CSR.

    Entries to which only exact zeros contribute are left out, as scikit-fem does. A block of
    dofs whose cells have the same classes, and whose neighbours the same order, as those of the
    rows that a thread summed last gets a copy of these rows, often with all columns shifted by a
    constant. One thread sums a block in the order of its cells: results do not depend on the
    number of threads. Indices have 32 bits as long as numbers of entries, rows and columns are
    below 2^31."""
    count_rows, fill_rows = row_kernel("count_rows"), row_kernel("fill_rows")
    first, *held = row_kernel("cells_of_blocks")(rows.of_cells, len(rows.start) - 1)
    masks, full = _masks(local, columns.local)
    counts = np.zeros(rows.size + 1, dtype=np.int64)
    follows = np.zeros(len(rows.start) - 1, dtype=np.bool_)
    sizes = np.diff(columns.start)
    uniform = bool((sizes == sizes[0]).all())
    row_blocks = (first, *held, rows.start, rows.local)
    column_blocks = (columns.of_cells, columns.start, columns.local, uniform)
    both = row_blocks, column_blocks, labels
    shares = shares_of(first, len(columns.local) - 1)

    def count(begin: int, end: int) -> None:
        count_rows(begin, end, *both, masks, full, follows, counts)

    in_threads(count, shares)
    np.cumsum(counts, out=counts)
    index = index_type(int(counts[-1]), max(rows.size, columns.size))
    indices = np.empty(counts[-1], dtype=index)
    data = np.empty(counts[-1], dtype=local.dtype)

    def fill(begin: int, end: int) -> None:
        fill_rows(begin, end, *both, local, masks, full, follows, counts, indices, data)

    in_threads(fill, shares)
    matrix = sparse.csr_matrix(
        (data, indices, counts.astype(index)), shape=(rows.size, columns.size)
    )
    matrix.has_canonical_format = True
    return matrix


def scatter_vector(local: Array, labels: Integers, rows: DofBlocks) -> Array:
    """Return the sum of the local vectors (classes, local rows) of all cells."""
    total = np.zeros(rows.size, dtype=local.dtype)
    row_kernel("sum_vector")(rows.of_cells, rows.start, rows.local, labels, local, total)
    return total


def index_type(entries: int, size: int) -> type[np.signedinteger[Any]]:
    """Return the integer type that can count the entries and number the columns."""
    return np.int32 if max(entries, size) <= np.iinfo(np.int32).max else np.int64


def _masks(local: Array, starts: Integers) -> tuple[Array, bool]:
    """Return bit masks of the entries that are not zero, and whether all are (then without masks).
    Shape (classes, local rows, column blocks of a cell), one bit for each dof of a column block."""
    nonzero = local != 0
    if nonzero.all():
        return np.empty((0, 0, 0), dtype=np.uint64), True
    masks = np.zeros((*local.shape[:2], len(starts) - 1), dtype=np.uint64)
    for block, (begin, end) in enumerate(pairwise(starts)):
        for bit in range(end - begin):
            masks[:, :, block] |= nonzero[:, :, begin + bit].astype(np.uint64) << np.uint64(bit)
    return masks, False


@lru_cache
def row_kernel(name: str) -> Callable[..., Any]:
    """Return a function of `row_kernels`, compiled."""
    return compiled_later(getattr(row_kernels, name), row_kernels.PARTS)


class _Limits(NamedTuple):  # limits of the threads that add local matrices
    threads: int = 8  # more threads gain nothing: they share the memory bandwidth
    pairs: int = 50_000  # least number of (row block, column block) pairs of a thread: .4 to 2 ms


LIMITS = _Limits()


def shares_of(first: Integers, columns: int) -> list[tuple[int, int]]:
    """Return ranges of row blocks of about equal work, one for each thread.
    `first` (blocks + 1,) counts the cells of the blocks before each one, `columns` blocks of a
    cell."""
    work = int(first[-1]) * columns
    # The kernels are limited by memory: on two processors a second thread gained nothing.
    threads = max(1, min(cores() // 2, LIMITS.threads, work // LIMITS.pairs))
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
