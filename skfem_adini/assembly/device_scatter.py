"""Scatter of local matrices into CSR by operations on whole arrays, as a device does them."""

from __future__ import annotations

import importlib
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skfem_adini.assembly.csr_scatter import index_type
from skfem_adini.assembly.dof_blocks import DofBlocks

# Pairs of blocks that are added at a time, so that their index arrays stay below a gigabyte.
_PAIRS = 2**21


def scatter_on(
    xp: Any, local: NDArray[Any], labels: NDArray[Any], rows: DofBlocks, columns: DofBlocks
) -> Any:
    """Return what `scatter_matrix` returns, bit by bit, computed by NumPy or CuPy.

    Parameters
    ----------
    xp
        NumPy or CuPy.
    local, labels, rows, columns
        As for `skfem_adini.assembly.csr_scatter.scatter_matrix`.

    Notes
    -----
    Each cell adds a small matrix for each pair of its blocks. A stable sort brings equal pairs
    together in the order of the cells. The first of each pair are added at once, then the second,
    and so on: no two additions of one step meet, and the order of sums is that of the host.
    """
    data, hit, starts, where = _summed(xp, local, labels, rows, columns)
    keep = xp.flatnonzero(hit)
    kind = index_type(int(keep.size), max(rows.size, columns.size))
    before = xp.concatenate([xp.zeros(1, dtype=np.int64), xp.cumsum(hit, dtype=np.int64)])
    csr = importlib.import_module("scipy.sparse" if xp is np else "cupyx.scipy.sparse").csr_matrix
    matrix = csr(
        (data[keep], where[keep].astype(kind), before[starts].astype(kind)),
        shape=(rows.size, columns.size),
    )
    matrix.has_canonical_format = True
    return matrix


def _summed(xp: Any, local: Any, labels: Any, rows: DofBlocks, columns: DofBlocks) -> Any:
    """Return values, whether a non-zero came in, row starts, and columns, zeros included."""
    heights, widths = np.diff(rows.local), np.diff(columns.local)
    row_start, column_start = xp.asarray(rows.start), xp.asarray(columns.start)
    order, begins, rank = _sorted_pairs(xp, rows, columns)
    pairs = len(heights) * len(widths)
    # Row block and column block of each distinct pair, and where its part of a row begins.
    first = order[begins]
    R = _block(xp, rows, first // pairs, first % pairs // len(widths))
    C = _block(xp, columns, first // pairs, first % len(widths))
    width = column_start[C + 1] - column_start[C]
    past = xp.concatenate([xp.zeros(1, dtype=np.int64), xp.cumsum(width)])
    block = xp.searchsorted(R, xp.arange(len(rows.start)), side="left")
    total = past[block[1:]] - past[block[:-1]]  # length of the rows of each row block
    of_row = xp.searchsorted(row_start, xp.arange(rows.size), side="right") - 1
    starts = xp.concatenate([xp.zeros(1, dtype=np.int64), xp.cumsum(total[of_row])])
    corner = starts[row_start[R]] + past[:-1] - past[block[R]]
    size = int(starts[-1])
    data, hit = xp.zeros(size, dtype=local.dtype), xp.zeros(size, dtype=bool)
    where = xp.zeros(size, dtype=np.int64)
    pair_of = xp.searchsorted(begins, xp.arange(order.size), side="right") - 1
    flat, labels = xp.asarray(local).ravel(), xp.asarray(labels)
    full, wide = int(local.shape[1] * local.shape[2]), int(local.shape[2])
    local_rows, local_columns = xp.asarray(rows.local), xp.asarray(columns.local)
    for h, w in set(product(heights.tolist(), widths.tolist())):
        a, c = (
            part.ravel()[None] for part in xp.meshgrid(xp.arange(h), xp.arange(w), indexing="ij")
        )
        kinds = (heights[:, None] == h) & (widths[None] == w)
        fits = xp.asarray(kinds.ravel())[order % pairs]
        for k in range(int(rank.max()) + 1):
            chosen = xp.flatnonzero((rank == k) & fits)
            for i in range(0, chosen.size, _PAIRS):
                some = chosen[i : i + _PAIRS]
                p, entry = pair_of[some], order[some]
                cell, at = entry // pairs, entry % pairs
                place = (corner[p][:, None] + a * total[R[p]][:, None]) + c
                source = (
                    (labels[cell].astype(np.int64) * full)[:, None]
                    + (local_rows[at // len(widths)][:, None] + a) * wide
                    + (local_columns[at % len(widths)][:, None] + c)
                )
                value = flat[source]
                data[place] += value
                hit[place] |= value != 0
                if k == 0:
                    where[place] = column_start[C[p]][:, None] + c + 0 * a
    return data, hit, starts, where


def _sorted_pairs(xp: Any, rows: DofBlocks, columns: DofBlocks) -> tuple[Any, Any, Any]:
    """Return the pairs of blocks of all cells in order, where distinct ones begin, and ranks."""
    blocks = len(columns.start) - 1
    R, C = xp.asarray(rows.of_cells.T).astype(np.int64), xp.asarray(columns.of_cells.T)
    key = (R[:, :, None] * blocks + C[:, None, :]).ravel()
    order = xp.argsort(key, kind="stable") if xp is np else xp.argsort(key)
    key = key[order]
    begins = xp.flatnonzero(xp.concatenate([xp.ones(1, dtype=bool), key[1:] != key[:-1]]))
    rank = (
        xp.arange(order.size)
        - begins[xp.searchsorted(begins, xp.arange(order.size), side="right") - 1]
    )
    return order, begins, rank.astype(np.int16)


def _block(xp: Any, blocks: DofBlocks, cell: Any, place: Any) -> Any:
    return xp.asarray(blocks.of_cells)[place, cell].astype(np.int64)
