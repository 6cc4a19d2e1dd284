"""Scatter of local matrices and vectors into global ones, row by row, by compiled kernels."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from skfem_adini.assembly.dof_blocks import DofBlocks
from skfem_adini.jit import compiled

Array = NDArray[Any]
Integers = NDArray[np.integer]

_MOST_THREADS = 8
_WORTH_A_THREAD = 50_000

# Sets of rows kept for reuse by a thread, and their entries: about half a second cache.
_WAYS = 64
_CACHED = 2**15


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
    columns. Two blocks whose cells have the same classes, in the same order, and whose neighbours
    come in the same order, have the same rows but for the numbers of the columns: each thread
    keeps the rows that it summed lately, in the order of the cells, and copies them. Often even the
    columns are those of the block before plus a constant, which the counting notes for the writing.
    Threads share the blocks, so their number does not change the result. Indices have 32 bits until
    the matrix holds 2^31 entries.
    """
    kernel = _kernel("sum_rows")
    first, *held = _kernel("cells_of_blocks")(rows.of_cells, len(rows.start) - 1)
    masks, full = _masks(local, columns.local)
    counts = np.zeros(rows.size + 1, dtype=np.int64)
    follows = np.zeros(len(rows.start) - 1, dtype=np.bool_)
    sizes = np.diff(columns.start)
    uniform = bool((sizes == sizes[0]).all())
    none = np.empty(0, dtype=np.int32)
    arguments = (first, *held, rows.start, rows.local, columns.of_cells, columns.start)
    arguments += (columns.local, labels, local, masks, full, uniform, follows)
    shares = _shares(first, len(columns.local) - 1)

    def count(begin: int, end: int) -> None:
        kernel(begin, end, *arguments, counts, none, local[:0, 0, 0], True)

    _in_threads(count, shares)
    np.cumsum(counts, out=counts)
    index = index_type(int(counts[-1]), max(rows.size, columns.size))
    indices = np.empty(counts[-1], dtype=index)
    data = np.empty(counts[-1], dtype=local.dtype)

    def fill(begin: int, end: int) -> None:
        kernel(begin, end, *arguments, counts, indices, data, False)

    _in_threads(fill, shares)
    matrix = sparse.csr_matrix(
        (data, indices, counts.astype(index)), shape=(rows.size, columns.size)
    )
    matrix.has_canonical_format = True
    return matrix


def scatter_vector(local: Array, labels: Integers, rows: DofBlocks) -> Array:
    """Return the sum of the local vectors (classes, local rows) of all cells."""
    total = np.zeros(rows.size, dtype=local.dtype)
    _kernel("sum_vector")(rows.of_cells, rows.start, rows.local, labels, local, total)
    return total


def index_type(entries: int, size: int) -> type[np.signedinteger[Any]]:
    """Return the integers that can count the entries and number the columns."""
    return np.int32 if max(entries, size) <= np.iinfo(np.int32).max else np.int64


def _masks(local: Array, starts: Integers) -> tuple[Array, bool]:
    """Return which entries of each row are not zero: a bit for each dof of a column block."""
    nonzero = local != 0
    if nonzero.all():
        return np.empty((0, 0, 0), dtype=np.uint64), True
    masks = np.zeros((*local.shape[:2], len(starts) - 1), dtype=np.uint64)
    for block, (begin, end) in enumerate(pairwise(starts)):
        for bit in range(end - begin):
            masks[:, :, block] |= nonzero[:, :, begin + bit].astype(np.uint64) << np.uint64(bit)
    return masks, False


def _shares(first: Integers, columns: int) -> list[tuple[int, int]]:
    """Return ranges of blocks of about equal work, one for each thread."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    work = int(first[-1]) * columns
    # The work is limited by the memory: a second thread on two processors gained nothing.
    threads = max(1, min((cores or 1) // 2, _MOST_THREADS, work // _WORTH_A_THREAD))
    ends = np.searchsorted(first, first[-1] * np.arange(1, threads) / threads)
    ends = [0, *map(int, ends), len(first) - 1]
    return list(pairwise(ends))


def _in_threads(work: Callable[[int, int], None], shares: list[tuple[int, int]]) -> None:
    if len(shares) == 1:
        work(*shares[0])
        return
    with ThreadPoolExecutor(len(shares) - 1) as pool:
        others = [pool.submit(work, *share) for share in shares[1:]]
        work(*shares[0])
        for other in others:
            other.result()


@lru_cache
def _kernel(name: str) -> Callable[..., Any]:
    return compiled(_KERNELS[name])


def _cells_of_blocks(of_cells: Any, blocks: int) -> Any:
    """Return for each block the cells that hold it and its places in them, from `first` on."""
    width, cells = of_cells.shape
    first = np.zeros(blocks + 1, dtype=np.int64)
    for b in range(width):
        for c in range(cells):
            first[of_cells[b, c] + 1] += 1
    for k in range(blocks):
        first[k + 1] += first[k]
    holders = np.empty(width * cells, dtype=np.int32)
    places = np.empty(width * cells, dtype=np.int32)
    free = first[:-1].copy()
    for c in range(cells):
        for b in range(width):
            block = of_cells[b, c]
            holders[free[block]] = c
            places[free[block]] = b
            free[block] += 1
    return first, holders, places


def _sum_vector(of_cells: Any, start: Any, begins: Any, labels: Any, local: Any, total: Any) -> Any:
    width, cells = of_cells.shape
    for c in range(cells):
        label = labels[c]
        for b in range(width):
            target = start[of_cells[b, c]] - begins[b]
            for i in range(begins[b], begins[b + 1]):
                total[target + i] += local[label, i]


def _sum_rows(
    begin: int, end: int, first: Any, holders: Any, places: Any, row_start: Any, row_local: Any,
    of_cells: Any, start: Any, begins: Any, labels: Any, local: Any, masks: Any, full: bool,
    uniform: bool, follows: Any, indptr: Any, indices: Any, data: Any, counting: bool,
) -> Any:  # fmt: skip
    """Count or write the rows of the blocks from `begin` to `end`."""
    rows_wide = row_local.size - 1
    wide = begins.size - 1
    most = np.int64(1)
    highest = np.int64(1)
    for row_block in range(begin, end):
        most = max(most, first[row_block + 1] - first[row_block])
        highest = max(highest, row_start[row_block + 1] - row_start[row_block])
    longest = most * begins[wide]
    owner = np.full(start.size - 1, -1, dtype=np.int32)
    slot = np.empty(start.size - 1, dtype=np.int32)
    blocks = np.empty(most * wide, dtype=np.int64)
    found = np.empty(most * wide, dtype=np.int64)
    offset = np.empty(most * wide + 1, dtype=np.int64)
    hits = np.zeros(most * wide, dtype=np.uint64)
    sums = np.zeros(longest, dtype=data.dtype)
    columns = np.empty(longest, dtype=indices.dtype)
    key = np.empty(most * (wide + 1), dtype=np.int64)
    ways = max(1, min(_WAYS, _CACHED // (highest * longest)))
    keys = np.empty((ways, key.size), dtype=np.int64)
    key_sizes = np.full(ways, -1, dtype=np.int64)
    kept = np.empty((ways, highest), dtype=np.int64)
    kept_places = np.empty((ways, highest * longest), dtype=np.int32)
    kept_sums = np.empty((ways, highest * longest), dtype=data.dtype)
    way = np.int64(0)
    last_size = np.int64(-1)
    one = np.uint64(1)
    none = np.uint64(0)
    for row_block in range(begin, end):
        origin = first[row_block]
        held = first[row_block + 1] - origin
        size = held * (wide + 1)
        top = row_start[row_block]
        height = row_start[row_block + 1] - top
        moved = not counting and follows[row_block]
        step = np.int64(0)
        if moved:
            step = of_cells[0, holders[origin]] - blocks[0]
            blocks[0] += step
        else:
            # A block follows the one before if all its numbers are that one's plus a constant.
            moved = counting and uniform and size == last_size and size > 0
            if moved:
                step = of_cells[0, holders[origin]] - blocks[0]
            for k in range(held):
                cell = holders[origin + k]
                at = k * (wide + 1)
                kind = labels[cell] * rows_wide + places[origin + k]
                moved = moved and kind == key[at]
                key[at] = kind
                for b in range(wide):
                    block = np.int64(of_cells[b, cell])
                    moved = moved and block - blocks[k * wide + b] == step
                    blocks[k * wide + b] = block
            last_size = size
            if counting:
                follows[row_block] = moved
        if not moved:
            count = 0
            for k in range(held * wide):
                block = blocks[k]
                if owner[block] != row_block:
                    owner[block] = row_block
                    place = count
                    while place > 0 and found[place - 1] > block:
                        found[place] = found[place - 1]
                        place -= 1
                    found[place] = block
                    count += 1
            offset[0] = 0
            for s in range(count):
                slot[found[s]] = s
                offset[s + 1] = offset[s] + start[found[s] + 1] - start[found[s]]
            for k in range(held):
                for b in range(wide):
                    key[k * (wide + 1) + 1 + b] = slot[blocks[k * wide + b]]
            length = offset[count]
            code = np.uint64(14695981039346656037)
            for k in range(size):
                code = (code ^ np.uint64(key[k])) * np.uint64(1099511628211)
            way = np.int64((code >> np.uint64(20)) % np.uint64(ways))
            same = key_sizes[way] == size
            if same:
                for k in range(size):
                    same = same and keys[way, k] == key[k]
            if not same:
                key_sizes[way] = size
                for k in range(size):
                    keys[way, k] = key[k]
                entries = 0
                for a in range(height):
                    for s in range(count):
                        hits[s] = none
                    for q in range(length):
                        sums[q] = 0
                    for k in range(held):
                        at = k * (wide + 1)
                        label = key[at] // rows_wide
                        i = row_local[key[at] % rows_wide] + a
                        for b in range(wide):
                            s = key[at + 1 + b]
                            if not full:
                                hits[s] |= masks[label, i, b]
                            target = offset[s] - begins[b]
                            if not counting:
                                for j in range(begins[b], begins[b + 1]):
                                    sums[target + j] += local[label, i, j]
                    for s in range(count):
                        for q in range(offset[s + 1] - offset[s]):
                            if full or (hits[s] >> np.uint64(q)) & one:
                                kept_places[way, entries] = offset[s] + q
                                kept_sums[way, entries] = sums[offset[s] + q]
                                entries += 1
                    kept[way, a] = entries
            if not counting:
                for s in range(count):
                    for q in range(offset[s + 1] - offset[s]):
                        columns[offset[s] + q] = start[found[s]] + q
        if counting:
            entries = 0
            for a in range(height):
                indptr[top + a + 1] = kept[way, a] - entries
                entries = kept[way, a]
            continue
        # Views let the compiler see that no index is negative.
        write_indices = indices[indptr[top] : indptr[top + height]]
        write_data = data[indptr[top] : indptr[top + height]]
        read_sums = kept_sums[way]
        for e in range(write_data.size):
            write_data[e] = read_sums[e]
        if moved:
            before = indices[indptr[top] - write_indices.size : indptr[top]]
            shift = indices.dtype.type(step * (start[1] - start[0]))
            for e in range(write_indices.size):
                write_indices[e] = before[e] + shift
        else:
            read_places = kept_places[way]
            for e in range(write_indices.size):
                write_indices[e] = columns[read_places[e]]


_KERNELS: dict[str, Callable[..., Any]] = {
    "cells_of_blocks": _cells_of_blocks,
    "sum_rows": _sum_rows,
    "sum_vector": _sum_vector,
}
