"""A binary tree of boxes around simplices, searched for many lines or points at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Meets = Callable[[Index, Array, Array], NDArray[np.bool_]]
Batches = Iterator[tuple[Index, Index]]

_TOGETHER = 2**18  # pairs of a query and a box tested at once: bounds the memory


class BoxTree:
    """Binary tree of boxes around segments or triangles (nfacets, dim, dim).
    Neighbours along a Morton curve share a box. All queries descend together, one level per step,
    unless they meet too many boxes for the memory."""

    def __init__(self, corners: Array) -> None:
        low, high = corners.min(axis=1), corners.max(axis=1)
        margin = 1e-12 * float(np.abs(corners).max())  # safety against rounding
        order = np.argsort(_morton(0.5 * (low + high)), kind="stable")
        count = 1 << max(int(order.size - 1).bit_length(), 0)
        # Coordinates first, for contiguous access.
        lows = np.full((low.shape[1], count), np.inf)
        highs = np.full((low.shape[1], count), -np.inf)
        lows[:, : order.size], highs[:, : order.size] = (
            low[order].T - margin,
            high[order].T + margin,
        )
        self._order = order
        self._levels = [(lows, highs)]
        while lows.shape[1] > 1:
            lows = np.minimum(lows[:, ::2], lows[:, 1::2])
            highs = np.maximum(highs[:, ::2], highs[:, 1::2])
            self._levels.append((lows, highs))

    def near_lines(self, x: Array, n: Array) -> tuple[Index, Index]:
        """Pairs (line, facet) where the line x + d n, of shapes (npoints, dim), meets the box."""
        with np.errstate(divide="ignore"):
            slopes = np.ascontiguousarray(1.0 / n.T)
        places = np.ascontiguousarray(x.T)

        def meets(query: Index, low: Array, high: Array) -> NDArray[np.bool_]:
            enter, leave = np.full(query.size, -np.inf), np.full(query.size, np.inf)
            for place, slope, lowest, highest in zip(places, slopes, low, high, strict=True):
                at, per = place[query], slope[query]
                with np.errstate(invalid="ignore"):  # 0 * inf on a box's face: no bound
                    one, other = (lowest - at) * per, (highest - at) * per
                enter = np.fmax(enter, np.fmin(one, other))
                leave = np.fmin(leave, np.fmax(one, other))
            slack = 1e-12 * np.minimum(np.abs(enter), np.abs(leave))
            # A line along an axis that misses two faces enters at inf and leaves at -inf.
            slack[np.isinf(slack)] = 0.0
            return np.asarray(~(enter > leave + slack))

        line, facet = zip(*self._descend(len(x), meets), strict=True)
        return np.concatenate(line), np.concatenate(facet)

    def near_points(self, x: Array, bound: Array) -> Batches:
        """Batches of pairs (point, facet) that include the facets nearest to points (npoints, dim).
        `bound` (npoints,): squared upper bounds of the distance, which may decrease between
        batches."""
        places = np.ascontiguousarray(x.T)

        def meets(query: Index, low: Array, high: Array) -> NDArray[np.bool_]:
            square = np.zeros(query.size)
            for one, lowest, highest in zip(places, low, high, strict=True):
                place = one[query]
                away = np.maximum(np.maximum(lowest - place, place - highest), 0.0)
                square += away * away
            return np.asarray(square <= bound[query] * (1 + 1e-12))

        return self._descend(len(x), meets)

    def one_near(self, x: Array) -> Index:
        """A facet near each point (npoints, dim), found by descending to the nearer of two
        boxes."""
        node = np.zeros(len(x), dtype=np.int64)
        places = x.T[:, :, None]
        for low, high in reversed(self._levels[:-1]):
            pair = 2 * node[:, None] + np.arange(2)
            away = np.maximum(low[:, pair] - places, places - high[:, pair]).clip(0.0)
            square = np.sum(away * away, axis=0)
            # Inside both boxes take the one with the nearer middle. Empty boxes are at inf.
            with np.errstate(invalid="ignore"):
                middle = np.abs(low[:, pair] + high[:, pair] - 2 * places).sum(axis=0)
            both = (square[:, 0] == square[:, 1]) & (middle[:, 1] < middle[:, 0])
            node = 2 * node + ((square[:, 1] < square[:, 0]) | both)
        return self._order[node]

    def _descend(self, queries: int, meets: Meets) -> Batches:
        top = len(self._levels) - 1
        waiting = [(np.arange(queries), np.zeros(queries, dtype=np.int64), top)]
        while waiting:
            query, node, level = waiting.pop()
            low, high = self._levels[level]
            real = low[0, node] <= high[0, node]
            query, node = query[real], node[real]
            kept = meets(query, low[:, node], high[:, node])
            query, node = query[kept], node[kept]
            if level == 0:
                yield query, self._order[node]
                continue
            parts = -(-max(query.size, 1) // _TOGETHER)
            for some, nodes in zip(
                np.array_split(query, parts), np.array_split(node, parts), strict=True
            ):
                below = (2 * nodes[:, None] + np.arange(2)).ravel()
                waiting.append((np.repeat(some, 2), below, level - 1))


def _morton(centres: Array) -> NDArray[np.uint64]:
    """Position of each centre along the Morton curve, which interleaves coordinate bits."""
    low, size = centres.min(axis=0), np.ptp(centres, axis=0).max()
    cells = ((centres - low) * (2**20 - 1) / (size if size > 0 else 1.0)).astype(np.uint64)
    code = np.zeros(len(centres), dtype=np.uint64)
    dim = centres.shape[1]
    for bit in range(20):
        for axis in range(dim):
            place = (cells[:, axis] >> np.uint64(bit)) & np.uint64(1)
            code |= place << np.uint64(dim * bit + axis)
    return code
