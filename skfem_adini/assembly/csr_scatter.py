"""Scatter of local matrices and vectors into global ones, row by row, by compiled kernels."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from skfem_adini.assembly import row_kernels
from skfem_adini.assembly.dof_blocks import DofBlocks
from skfem_adini.assembly.row_shares import in_threads, shares_of
from skfem_adini.ground.jit import compiled

Array = NDArray[Any]
Integers = NDArray[np.integer]


def scatter_matrix(local: Array, labels: Integers, rows: DofBlocks, columns: DofBlocks) -> Any:
    """Return the sum of the local matrices of all cells as a canonical CSR matrix.

    Entries to which only exact zeros contribute are left out, as scikit-fem does.

    Parameters
    ----------
    local
        Local matrices, shape (classes, local rows, local columns).
    labels
        Class of each cell.
    rows, columns
        Dofs of the test and of the trial functions.

    Notes
    -----
    A row belongs to one block of dofs, and all rows of a block have the neighbours of the block as
    columns. Two blocks have the same rows, apart from the column numbers, if their cells have the
    same classes in the same order and their neighbours come in the same order. Each thread
    therefore keeps the rows that it summed last and copies them for such blocks. Often even the
    column numbers are those of the preceding block plus a constant; the counting kernel marks these
    blocks for the writing kernel. Every block is summed by one thread, in the order of its cells,
    so the number of threads does not change the result. Indices have 32 bits as long as numbers of
    entries, rows and columns are below 2^31.
    """
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
    """Return which entries are not zero, as bit masks, and whether all are.

    The masks have the shape (classes, local rows, column blocks of a cell), with one bit for each
    dof of a column block; they are empty if no entry is zero.
    """
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
    return compiled(getattr(row_kernels, name), row_kernels.PARTS)
