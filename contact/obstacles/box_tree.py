"""A binary tree of boxes around simplices, searched for many lines at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Meets = Callable[[Index, Array, Array], NDArray[np.bool_]]


class BoxTree:
    """Boxes around the simplices of a surface, in pairs up to one box around all of them.

    Neighbours along a Morton curve share a box. All queries descend together, one level a step.

    Parameters
    ----------
    corners : ndarray, shape (nfacets, dim, dim)
        Corners of each segment or triangle: facet, corner, coordinate.
    """

    def __init__(self, corners: Array) -> None:
        low, high = corners.min(axis=1), corners.max(axis=1)
        margin = 1e-12 * float(np.abs(corners).max())  # rounding must not lose a facet
        order = np.argsort(_morton(0.5 * (low + high)), kind="stable")
        count = 1 << max(int(order.size - 1).bit_length(), 0)
        lows = np.full((count, low.shape[1]), np.inf)
        highs = np.full((count, low.shape[1]), -np.inf)
        lows[: order.size], highs[: order.size] = low[order] - margin, high[order] + margin
        self._order = order
        self._levels = [(lows, highs)]
        while len(lows) > 1:
            lows, highs = np.minimum(lows[::2], lows[1::2]), np.maximum(highs[::2], highs[1::2])
            self._levels.append((lows, highs))

    def near_lines(self, x: Array, n: Array) -> tuple[Index, Index]:
        """Pairs (line, facet) where the line x + d n, of shapes (npoints, dim), meets the box."""
        with np.errstate(divide="ignore"):
            inverse = 1.0 / n

        def meets(query: Index, low: Array, high: Array) -> NDArray[np.bool_]:
            with np.errstate(invalid="ignore"):  # 0 * inf on the face of a box: no bound from it
                one, other = (low - x[query]) * inverse[query], (high - x[query]) * inverse[query]
            enter = np.fmax.reduce(np.fmin(one, other), axis=1)
            leave = np.fmin.reduce(np.fmax(one, other), axis=1)
            slack = 1e-12 * np.minimum(np.abs(enter), np.abs(leave))
            # A line along an axis enters at inf and leaves at -inf beside two faces: it misses.
            slack[np.isinf(slack)] = 0.0
            return np.asarray(~(enter > leave + slack))

        return self._descend(len(x), meets)

    def _descend(self, queries: int, meets: Meets) -> tuple[Index, Index]:
        query, node = np.arange(queries), np.zeros(queries, dtype=np.int64)
        for level, (low, high) in enumerate(reversed(self._levels)):
            if level:
                query = np.repeat(query, 2)
                node = (2 * node[:, None] + np.arange(2)).ravel()
            real = low[node, 0] <= high[node, 0]
            query, node = query[real], node[real]
            kept = meets(query, low[node], high[node])
            query, node = query[kept], node[kept]
        return query, self._order[node]


def _morton(centres: Array) -> NDArray[np.uint64]:
    """Place of each centre along the curve that interleaves the bits of its coordinates."""
    low, size = centres.min(axis=0), np.ptp(centres, axis=0).max()
    cells = ((centres - low) * (2**20 - 1) / (size if size > 0 else 1.0)).astype(np.uint64)
    code = np.zeros(len(centres), dtype=np.uint64)
    dim = centres.shape[1]
    for bit in range(20):
        for axis in range(dim):
            place = (cells[:, axis] >> np.uint64(bit)) & np.uint64(1)
            code |= place << np.uint64(dim * bit + axis)
    return code
