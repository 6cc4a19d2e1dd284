"""Kernels that count and write the rows of a sparse matrix, block by block.

Plain Python that numba can compile; `csr_scatter` compiles each kernel with the `PARTS` that it
calls. A block of rows consists of the dofs of a vertex, edge, facet or cell and belongs to all
cells around it. A cell in which it has the place p contributes to it with the kind (class of the
cell, p). The kinds determine the local rows that are summed and, with the order of the neighbouring
blocks, all entries.
"""

from __future__ import annotations

from typing import Any

import numpy as np


def cells_of_blocks(of_cells: Any, blocks: int) -> Any:
    """Return where each block's entries begin, the cells that hold it, and its places in them.
    Those of block b are the entries first[b] to first[b + 1] - 1 of `holders` and `places`."""
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


def sum_vector(of_cells: Any, start: Any, begins: Any, labels: Any, local: Any, total: Any) -> Any:
    """Add the local vectors of all cells to `total`."""
    width, cells = of_cells.shape
    for c in range(cells):
        label = labels[c]
        for b in range(width):
            target = start[of_cells[b, c]] - begins[b]
            for i in range(begins[b], begins[b + 1]):
                total[target + i] += local[label, i]


def _largest(start: Any, begin: Any, end: Any) -> Any:
    """Return the largest number of members of a block from `begin` to `end`, at least 1."""
    most = np.int64(1)
    for block in range(begin, end):
        most = max(most, start[block + 1] - start[block])
    return most


def count_rows(
    begin: int, end: int, rows: Any, columns: Any, labels: Any, masks: Any, full: bool,
    follows: Any, counts: Any,
) -> Any:  # fmt: skip
    """Count the entries of the rows of the blocks from `begin` to `end`.
    In `follows` mark the blocks whose rows are those of the block before with shifted columns."""
    first, holders, places, row_start, row_local = rows
    of_cells, start, begins, uniform = columns
    wide = begins.size - 1
    most = _largest(first, begin, end)
    owner = np.full(start.size - 1, -1, dtype=np.int32)
    slot = np.empty(start.size - 1, dtype=np.int32)
    blocks = np.empty(most * wide, dtype=np.int64)
    found = np.empty(most * wide, dtype=np.int64)
    offset = np.empty(most * wide + 1, dtype=np.int64)
    hits = np.empty(most * wide, dtype=np.uint64)
    kinds = np.empty(most, dtype=np.int64)
    last_held = np.int64(-1)
    for row_block in range(begin, end):
        origin = first[row_block]
        held = first[row_block + 1] - origin
        top = row_start[row_block]
        height = row_start[row_block + 1] - top
        # A block follows the one before if it has the same kinds and all its column blocks are
        # those of the block before plus a constant.
        alike = uniform and held == last_held and held > 0
        step = np.int64(of_cells[0, holders[origin]]) - blocks[0] if alike else np.int64(0)
        last_held = held
        for k in range(held):
            cell = holders[origin + k]
            kind = labels[cell] * (row_local.size - 1) + places[origin + k]
            alike = alike and kind == kinds[k]
            kinds[k] = kind
            for b in range(wide):
                block = np.int64(of_cells[b, cell])
                alike = alike and block - blocks[k * wide + b] == step
                blocks[k * wide + b] = block
        follows[row_block] = alike
        if alike:
            for a in range(top, top + height):
                counts[a + 1] = counts[a + 1 - height]
            continue
        count = _sort_neighbours(row_block, held * wide, blocks, start, owner, slot, found, offset)
        for a in range(height):
            counts[top + a + 1] = offset[count]
            if not full:
                counts[top + a + 1] = _count_nonzero(
                    a, held, kinds, row_local, blocks, masks, slot, hits, count, offset
                )


def _count_nonzero(
    a: Any, held: Any, kinds: Any, row_local: Any, blocks: Any, masks: Any, slot: Any, hits: Any,
    count: Any, offset: Any,
) -> Any:  # fmt: skip
    """Return the number of entries in row `a` of a block to which some cell adds a non-zero."""
    rows_wide, wide = row_local.size - 1, masks.shape[2]
    for s in range(count):
        hits[s] = np.uint64(0)
    for k in range(held):
        label = kinds[k] // rows_wide
        i = row_local[kinds[k] % rows_wide] + a
        for b in range(wide):
            hits[slot[blocks[k * wide + b]]] |= masks[label, i, b]
    entries = 0
    for s in range(count):
        for q in range(offset[s + 1] - offset[s]):
            if (hits[s] >> np.uint64(q)) & np.uint64(1):
                entries += 1
    return entries


def fill_rows(
    begin: int, end: int, rows: Any, columns: Any, labels: Any, local: Any, masks: Any, full: bool,
    follows: Any, indptr: Any, indices: Any, data: Any,
) -> Any:  # fmt: skip
    """Write the entries of the rows of the blocks from `begin` to `end`."""
    first, holders, places, row_start, row_local = rows
    of_cells, start, begins, _ = columns
    wide = begins.size - 1
    most, highest = _largest(first, begin, end), _largest(row_start, begin, end)
    longest = most * begins[wide]
    owner = np.full(start.size - 1, -1, dtype=np.int32)
    slot = np.empty(start.size - 1, dtype=np.int32)
    blocks = np.empty(most * wide, dtype=np.int64)
    found = np.empty(most * wide, dtype=np.int64)
    offset = np.empty(most * wide + 1, dtype=np.int64)
    hits = np.zeros(most * wide, dtype=np.uint64)
    sums = np.zeros(longest, dtype=data.dtype)
    numbers = np.empty(longest, dtype=indices.dtype)
    key = np.empty(most * (wide + 1), dtype=np.int64)
    # Blocks of rows kept for reuse: of 2^15 entries, 400 kB at 12 bytes, half of an L2 cache.
    ways = max(1, min(64, 2**15 // (highest * longest)))
    keys = np.empty((ways, key.size), dtype=np.int64)
    key_sizes = np.full(ways, -1, dtype=np.int64)
    kept_places = np.empty((ways, highest * longest), dtype=np.int32)
    kept_sums = np.empty((ways, highest * longest), dtype=data.dtype)
    way = np.int64(0)
    for row_block in range(begin, end):
        origin = first[row_block]
        top = row_start[row_block]
        # Views let the compiler see that no index is negative.
        write_indices = indices[indptr[top] : indptr[row_start[row_block + 1]]]
        write_data = data[indptr[top] : indptr[row_start[row_block + 1]]]
        if follows[row_block]:
            step = of_cells[0, holders[origin]] - blocks[0]
            blocks[0] += step
            before = indices[indptr[top] - write_indices.size : indptr[top]]
            shift = indices.dtype.type(step * (start[1] - start[0]))
            for e in range(write_indices.size):
                write_indices[e] = before[e] + shift
        else:
            held = first[row_block + 1] - origin
            for k in range(held):
                cell = holders[origin + k]
                key[k * (wide + 1)] = labels[cell] * (row_local.size - 1) + places[origin + k]
                for b in range(wide):
                    blocks[k * wide + b] = of_cells[b, cell]
            count = _sort_neighbours(
                row_block, held * wide, blocks, start, owner, slot, found, offset
            )
            way = _find_way(held, wide, slot, blocks, key, ways)
            if not _is_kept(way, held * (wide + 1), key, keys, key_sizes):
                _sum_block(
                    key, held, row_start[row_block + 1] - top, count, offset, row_local, begins,
                    local, masks, full, hits, sums, way, kept_places, kept_sums,
                )  # fmt: skip
            for s in range(count):
                for q in range(offset[s + 1] - offset[s]):
                    numbers[offset[s] + q] = start[found[s]] + q
            read_places = kept_places[way]
            for e in range(write_indices.size):
                write_indices[e] = numbers[read_places[e]]
        read_sums = kept_sums[way]
        for e in range(write_data.size):
            write_data[e] = read_sums[e]


def _sort_neighbours(
    row_block: Any, size: Any, blocks: Any, start: Any, owner: Any, slot: Any, found: Any,
    offset: Any,
) -> Any:  # fmt: skip
    """Write the distinct blocks in ascending order, the slot of each, and where slots begin.
    Return the number of slots."""
    count = 0
    for k in range(size):
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
    return count


def _find_way(held: Any, wide: Any, slot: Any, blocks: Any, key: Any, ways: Any) -> Any:
    """Complete the key (kinds of cells, slots of their blocks); return its cache index."""
    for k in range(held):
        for b in range(wide):
            key[k * (wide + 1) + 1 + b] = slot[blocks[k * wide + b]]
    # The hash of Fowler, Noll and Vo: offset basis and prime of 64 bits.
    code = np.uint64(14695981039346656037)
    for k in range(held * (wide + 1)):
        code = (code ^ np.uint64(key[k])) * np.uint64(1099511628211)
    return np.int64((code >> np.uint64(20)) % np.uint64(ways))


def _is_kept(way: Any, size: Any, key: Any, keys: Any, key_sizes: Any) -> Any:
    """Return whether the cache has the rows of this key; if not, store the key for them."""
    same = key_sizes[way] == size
    if same:
        for k in range(size):
            same = same and keys[way, k] == key[k]
    if not same:
        key_sizes[way] = size
        for k in range(size):
            keys[way, k] = key[k]
    return same


def _sum_block(
    key: Any, held: Any, height: Any, count: Any, offset: Any, row_local: Any, begins: Any,
    local: Any, masks: Any, full: Any, hits: Any, sums: Any,
    way: Any, kept_places: Any, kept_sums: Any,
) -> Any:  # fmt: skip
    """Sum the rows of a block; store the positions and sums of their entries in the cache."""
    wide = begins.size - 1
    rows_wide = row_local.size - 1
    entries = 0
    for a in range(height):
        for s in range(count):
            hits[s] = np.uint64(0)
        for q in range(offset[count]):
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
                for j in range(begins[b], begins[b + 1]):
                    sums[target + j] += local[label, i, j]
        for s in range(count):
            for q in range(offset[s + 1] - offset[s]):
                if full or (hits[s] >> np.uint64(q)) & np.uint64(1):
                    kept_places[way, entries] = offset[s] + q
                    kept_sums[way, entries] = sums[offset[s] + q]
                    entries += 1


PARTS = (_largest, _sort_neighbours, _count_nonzero, _find_way, _is_kept, _sum_block)
