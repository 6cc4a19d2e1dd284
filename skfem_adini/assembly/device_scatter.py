"""Scatter of local matrices into CSR by operations on whole arrays, as a device does them."""

from __future__ import annotations

import importlib
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skfem_adini.assembly.csr_scatter import index_type
from skfem_adini.assembly.dof_blocks import DofBlocks

# Entries that are summed at a time: their places and columns take some hundred megabytes.
_ENTRIES = 2**24


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
    Each cell adds a small matrix, a tile, for each pair of its blocks. A stable sort brings equal
    pairs together in the order of the cells, in which a pair's tiles are added: the order of sums
    is that of the host.
    """
    pairs = _Pairs.of(xp, len(local), labels, rows, columns)
    starts, total, corner = _places(xp, pairs, rows, columns)
    column_start = xp.asarray(columns.start)
    heights, widths = np.diff(rows.local), np.diff(columns.local)
    tall, wide = (xp.asarray(np.diff(of.start)) for of in (rows, columns))
    size, kind = int(starts[-1]), index_type(int(starts[-1]), max(rows.size, columns.size))
    data, where = xp.empty(size, dtype=local.dtype), xp.empty(size, dtype=kind)
    hit = None if np.all(local != 0) else xp.empty(size, dtype=bool)
    for h, w in set(product(heights.tolist(), widths.tolist())):
        tiles = xp.asarray(_tiles(local, rows, columns, h, w))
        down, across = xp.arange(h), xp.arange(w)
        fits = xp.flatnonzero((tall[pairs.row] == h) & (wide[pairs.column] == w))
        for i in range(0, fits.size, step := max(1, _ENTRIES // (h * w))):
            some = fits[i : i + step]
            row, first = pairs.row[some], column_start[pairs.column[some]]
            place = (corner[some, None] + down * total[row, None])[:, :, None] + across
            data[place] = pairs.gathered(xp, some, tiles, xp.add).reshape(place.shape)
            where[place] = (first[:, None, None] + across).astype(kind)
            if hit is not None:
                found = pairs.gathered(xp, some, tiles != 0, xp.logical_or)
                hit[place] = found.reshape(place.shape)
    if hit is not None:
        keep = xp.flatnonzero(hit)
        before = xp.concatenate([xp.zeros(1, dtype=np.int64), xp.cumsum(hit, dtype=np.int64)])
        data, where, starts = data[keep], where[keep], before[starts]
        kind = index_type(int(keep.size), max(rows.size, columns.size))
    csr = importlib.import_module("scipy.sparse" if xp is np else "cupyx.scipy.sparse").csr_matrix
    parts = data, where.astype(kind, copy=False), starts.astype(kind)
    matrix = csr(parts, shape=(rows.size, columns.size))
    matrix.has_canonical_format = True
    return matrix


class _Pairs(NamedTuple):
    """The distinct pairs of blocks of all cells, in order, on the device.

    Attributes
    ----------
    row, column
        Blocks of each pair, shape (pairs,).
    begin
        Where the tiles that cells add to each pair begin, then how many there are, (pairs + 1,).
    tiles
        Their numbers, in the order of the cells: class of the cell times pairs in a cell, plus pair
        in the cell; at the end that of the tile of zeros.
    """

    row: Any
    column: Any
    begin: Any
    tiles: Any

    @classmethod
    def of(cls, xp: Any, classes: int, labels: Any, rows: DofBlocks, columns: DofBlocks) -> _Pairs:
        blocks, kind = len(columns.start) - 1, np.int64
        R, C = xp.asarray(rows.of_cells.T), xp.asarray(columns.of_cells.T)
        key = (R.astype(kind)[:, :, None] * blocks + C[:, None, :]).ravel()
        order = xp.argsort(key, kind="stable") if xp is np else xp.argsort(key)
        key, inside = key[order], R.shape[1] * C.shape[1]
        new = xp.concatenate([xp.ones(1, dtype=bool), key[1:] != key[:-1], xp.ones(1, dtype=bool)])
        begin = xp.flatnonzero(new)
        cell, pair = order // inside, order % inside
        tiles = xp.empty(order.size + 1, dtype=kind)
        tiles[:-1] = xp.asarray(labels)[cell].astype(kind) * inside + pair
        tiles[-1] = classes * inside
        key = key[begin[:-1]]
        return cls(key // blocks, key % blocks, begin, tiles)

    def gathered(self, xp: Any, some: Any, of_tiles: Any, add: Any) -> Any:
        """Return the sums, or what `add` else makes, of the tiles of some pairs, one by one."""
        begin, end = self.begin[some], self.begin[some + 1]
        total = of_tiles[self.tiles[begin]]
        for k in range(1, int((end - begin).max())):
            total = add(total, of_tiles[self.tiles[xp.where(begin + k < end, begin + k, -1)]])
        return total


def _places(xp: Any, pairs: _Pairs, rows: DofBlocks, columns: DofBlocks) -> tuple[Any, Any, Any]:
    """Return where rows begin, how long those of each row block are, and where each pair begins.

    All rows of a block have the same columns; a pair begins in the first of its rows.
    """
    row_start, width = xp.asarray(rows.start), xp.asarray(np.diff(columns.start))[pairs.column]
    past = xp.concatenate([xp.zeros(1, dtype=np.int64), xp.cumsum(width, dtype=np.int64)])
    block = past[xp.searchsorted(pairs.row, xp.arange(len(rows.start)), side="left")]
    total = block[1:] - block[:-1]
    of_row = xp.searchsorted(row_start, xp.arange(rows.size), side="right") - 1
    starts = xp.concatenate([xp.zeros(1, dtype=np.int64), xp.cumsum(total[of_row])])
    return starts, total, starts[row_start[pairs.row]] + past[:-1] - block[pairs.row]


def _tiles(
    local: NDArray[Any], rows: DofBlocks, columns: DofBlocks, h: int, w: int
) -> NDArray[Any]:
    """Return the tiles of one size of all classes, then one of zeros, shape (tiles, h w).

    Tiles of another size are zero.
    """
    tall, wide = (range(len(of.local) - 1) for of in (rows, columns))
    tiles = np.zeros((len(local) + 1, len(tall), len(wide), h * w), dtype=local.dtype)
    for i, j in product(tall, wide):
        (a, b), (c, d) = rows.local[i : i + 2], columns.local[j : j + 2]
        if (b - a, d - c) == (h, w):
            tiles[:-1, i, j] = local[:, a:b, c:d].reshape(len(local), -1)
    return tiles.reshape(-1, h * w)[: len(local) * len(tall) * len(wide) + 1]
