"""Kernels that sum the matrices of affine cells row by row, each from a table of its cell.

Like `row_kernels` this is plain Python, which `ground.jit` compiles. A row belongs to one
scalar function and one component. All cells around the function are visited in ascending order, so
that an entry and its mirror image are the same sums.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from skfem_adini.assembly.row_kernels import _largest, _sort_neighbours


def count_neighbours(begin: int, end: int, around: Any, counts: Any) -> Any:
    """Write into counts[f + 1] how many functions, f included, share a cell with f."""
    first, holders, _, of_cells = around
    owner = np.full(counts.size - 1, -1, dtype=np.int32)
    for row in range(begin, end):
        count = 0
        for h in range(first[row], first[row + 1]):
            for j in range(of_cells.shape[0]):
                other = of_cells[j, holders[h]]
                if owner[other] != row:
                    owner[other] = row
                    count += 1
        counts[row + 1] = count


def fill_affine(
    begin: int, end: int, around: Any, start: Any, heads: Any, geometry: Any, table: Any,
    indices: Any, data: Any,
) -> Any:  # fmt: skip
    """Write the columns and values of the rows of the functions from `begin` to `end`. Geometry is
    (cells, k, k, dim, dim), table (functions of a cell, dim, dim, functions of a cell); `heads`
    holds the number of neighbours of all functions before each one."""
    first, holders, places, of_cells = around
    wide, k = of_cells.shape[0], geometry.shape[1]
    most = _largest(first, begin, end) * wide
    owner = np.full(start.size - 1, -1, dtype=np.int32)
    slot = np.empty(start.size - 1, dtype=np.int32)
    blocks = np.empty(most, dtype=np.int32)
    found = np.empty(most, dtype=np.int32)
    offset = np.empty(most + 1, dtype=np.int64)
    local = np.empty((k, k, wide))
    sums = np.empty((most, k, k))
    for row in range(begin, end):
        size = 0
        for h in range(first[row], first[row + 1]):
            for j in range(wide):
                blocks[size] = of_cells[j, holders[h]]
                size += 1
        count = _sort_neighbours(row, size, blocks, start, owner, slot, found, offset)
        sums[:count] = 0.0
        size = 0
        for h in range(first[row], first[row + 1]):
            _rows_of_cell(geometry[holders[h]], table[places[h]], local)
            for j in range(wide):
                sum_of = sums[slot[blocks[size]]]
                size += 1
                for c in range(k):
                    for d in range(k):
                        sum_of[c, d] += local[c, d, j]
        part = slice(k * k * heads[row], k * k * heads[row + 1])
        values, numbers = data[part].reshape((k, count, k)), indices[part].reshape((k, count, k))
        for c in range(k):
            for s in range(count):
                for d in range(k):
                    values[c, s, d] = sums[s, c, d]
                    numbers[c, s, d] = k * found[s] + d


def _rows_of_cell(geometry: Any, R: Any, local: Any) -> Any:
    """Compute sum_pq G_cd,pq R_pq,j; swapping the two functions and components swaps p and q."""
    dim = R.shape[0]
    for c in range(local.shape[0]):
        for d in range(local.shape[1]):
            G, out = geometry[c, d], local[c, d]
            for j in range(out.size):
                out[j] = G[0, 0] * R[0, 0, j]
            for p in range(1, dim):
                own, R_own = G[p, p], R[p, p]
                for j in range(out.size):
                    out[j] += own * R_own[j]
            for p in range(dim):
                for q in range(p + 1, dim):
                    one, other, R_one, R_other = G[p, q], G[q, p], R[p, q], R[q, p]
                    for j in range(out.size):
                        out[j] += one * R_one[j] + other * R_other[j]


PARTS = (_largest, _sort_neighbours, _rows_of_cell)
