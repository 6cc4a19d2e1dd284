"""Fill-reducing elimination order: nested dissection by bisection of the cells' coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Index = NDArray[np.int64]
_STEPS = 2.0**26  # coordinates this part of a body's size apart are one: rounding differs less


@dataclass(frozen=True)
class Dissection:
    """The vertices of a mesh graph as parts of a binary tree of sets of cells.

    A vertex belongs to the smallest set that holds all of its cells: to a leaf, or to the separator
    of a set that is cut between its cells.

    Attributes
    ----------
    levels : int
        Cuts from the whole mesh to a leaf.
    height : ndarray, shape (n,)
        0 for a vertex of a leaf, h for one of the separator of a set of 2**h leaves.
    part : ndarray, shape (n,)
        Number of that set among those of its height.
    """

    levels: int
    height: Index
    part: Index

    @property
    def order(self) -> Index:
        """Vertices in the order of elimination, (n,): both halves of a set, then its separator."""
        return np.lexsort((self.height, (self.part + 1) << self.height))

    def breadth_first(self, depth: int) -> tuple[Index, Index]:
        """An order of elimination that ends with the separators of the largest sets.

        Parameters
        ----------
        depth : int
            Levels of the tree that are told apart, from 1 to ``levels + 1``; smaller sets are
            parts of its leaves, with their vertices in the order of `order`.

        Returns
        -------
        order : ndarray, shape (n,)
            First all leaves, then the separators of their pairs, and so on to that of the mesh.
        block : ndarray, shape (n,)
            Number of the block of this order, of ``2**depth - 1``, to which a vertex belongs.
        """
        cut = self.levels - depth + 1  # height of the leaves that are told apart
        height = np.maximum(self.height, cut)
        part = self.part >> (height - self.height)
        before = (2 << (self.levels - cut)) - (2 << (self.levels - height))
        block = before + part
        order = self.order
        return order[counted_order(block[order], (1 << depth) - 1)], block


def counted_order(keys: NDArray[np.integer], count: int) -> Index:
    """``numpy.argsort(keys, kind="stable")`` of many whole numbers below a count, by counting."""
    places = keys, np.arange(keys.size)
    table = sparse.coo_array((np.ones(keys.size, dtype=bool), places), shape=(count, keys.size))
    return np.asarray(table.tocsr().indices, dtype=np.int64)


def nested_dissection(points: NDArray[np.float64], cells: Index, leaf_size: int = 8) -> Dissection:
    """Cut a mesh in two again and again, each set of cells across its longest coordinate.

    The cut is between different coordinates of the cells' middles, next to the median: on a grid
    the separators are whole lines or planes. All sets of a level are cut together by one sort.

    Parameters
    ----------
    points : ndarray, shape (dim, n)
        Coordinates of the vertices: nodes, edges, facets or cells that carry unknowns.
    cells : ndarray, shape (k, ncells)
        Vertices of each cell; unknowns of one cell are neighbours.
    leaf_size : int
        Sets are cut until they have about so many cells.

    Returns
    -------
    Dissection
        Of the n vertices; those without cells are in a leaf.

    References
    ----------
    A. George, Nested dissection of a regular finite element mesh, SIAM J. Numer. Anal. 10 (1973).

    Examples
    --------
    A path of seven vertices, whose cells are its edges: the middle one is eliminated last.

    >>> import numpy as np
    >>> path = nested_dissection(np.arange(7.0)[None], np.array([np.arange(6), np.arange(1, 7)]), 2)
    >>> int(path.order[-1])
    3
    """
    n = points.shape[1]
    levels = max(0, int(np.ceil(np.log2(max(cells.shape[1], 1) / leaf_size))))
    middles = np.zeros((len(points), cells.shape[1]))
    for row in cells:
        middles += points[:, row] / len(cells)
    leaf = _leaves(middles, levels)
    first, last = np.full(n, 1 << levels), np.full(n, -1)
    for row in cells:
        np.minimum.at(first, row, leaf)
        np.maximum.at(last, row, leaf)
    first[last < 0] = last[last < 0] = 0  # vertices without cells
    height = np.frexp((first ^ last).astype(np.float64))[1].astype(np.int64)
    return Dissection(levels, height, first >> height)


def _leaves(middles: NDArray[np.float64], levels: int) -> Index:
    """Number of the leaf of each cell, shape (ncells,): its bits are the halves it lies in."""
    n = middles.shape[1]
    leaf = np.zeros(n, dtype=np.int64)
    if levels == 0:
        return leaf
    low = middles.min(axis=1, keepdims=True)
    size = float((middles - low).max()) or 1.0
    steps = np.rint((middles - low) / size * _STEPS).astype(np.int32)
    # Cells by their set, and within it by each coordinate: halves of a set need no sort again.
    orders = [np.argsort(own, kind="stable").astype(np.int32) for own in steps]
    place, in_second = np.arange(n, dtype=np.int32), np.empty(n, dtype=bool)
    start, stop = np.zeros(1, dtype=np.int64), np.full(1, n)
    for _ in range(levels):
        first, last = np.minimum(start, n - 1), np.maximum(stop - 1, 0)
        pairs = list(zip(steps, orders, strict=True))
        extent = [own[order[last]] - own[order[first]] for own, order in pairs]
        axis = np.argmax(np.where(stop > start, extent, 0), axis=0).astype(np.int8)
        along = np.repeat(axis, stop - start)
        cell = _chosen(along, orders)
        where = _chosen(along, [own[cell] for own in steps])
        cuts = np.flatnonzero(where[1:] != where[:-1]) + 1
        cut = _nearest(cuts, start, stop)
        second = place >= np.repeat(cut, stop - start)
        in_second[cell], before = second, ~second
        for order in orders:
            moves = in_second[order]
            order[before], order[second] = order[~moves], order[moves]
        start, stop = np.column_stack([start, cut]).ravel(), np.column_stack([cut, stop]).ravel()
    leaf[orders[0]] = np.repeat(np.arange(start.size), stop - start)
    return leaf


def _chosen(axis: NDArray[np.int8], rows: list[NDArray[np.int32]]) -> NDArray[np.int32]:
    """From the row of its axis, each entry; `numpy.choose` is slower for so few rows."""
    found = rows[0].copy()
    for k in range(1, len(rows)):
        np.copyto(found, rows[k], where=axis == k)
    return found


def _nearest(cuts: Index, start: Index, stop: Index) -> Index:
    """The cut inside each interval that is next to its middle; the middle if there is none."""
    middle = (start + stop) // 2
    if cuts.size == 0:
        return middle
    after = np.searchsorted(cuts, middle)
    left = cuts[np.maximum(after - 1, 0)]
    right = cuts[np.minimum(after, cuts.size - 1)]
    best = np.where(np.abs(left - middle) <= np.abs(right - middle), left, right)
    return np.where((best > start) & (best < stop), best, middle)
