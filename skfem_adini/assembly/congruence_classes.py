"""Cells that are translates of each other, found from the bits of their coordinates."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skfem_adini.jit import compiled

Array = NDArray[np.float64]
Integers = NDArray[np.integer]
Words = NDArray[np.uint64]


class Classes(NamedTuple):
    """A partition of cells.

    Attributes
    ----------
    labels
        Class of each cell, shape (cells,), counted in the order of appearance.
    representatives
        The first cell of each class.
    """

    labels: Integers
    representatives: Integers


def congruence_classes(points: Array, nodes: Integers, words: Words) -> Classes:
    """Put cells whose nodes differ by a translation and whose words agree into one class.

    Two cells are congruent here when the differences of their coordinates are the same numbers in
    double precision, bit by bit. That is all of the geometry that enters a local matrix, so the
    matrix of a representative is the one that would be computed for every cell of its class, and no
    tolerance is needed. A tolerance would have to be below 1e-14 h for the matrix to be accurate to
    1e-14, but rounded coordinates x make equal cells of width h differ by eps x / h, relatively:
    such a tolerance would be too small to merge them. On uniform tensor grids the differences take
    few values, one if the spacing is a power of two and otherwise at most about ten in each
    direction.

    Parameters
    ----------
    points
        Coordinates of the nodes, shape (dim, points).
    nodes
        Nodes of the cells, shape (nodes of a cell, cells).
    words
        Further bits that must agree in a class, as those of orientations and coefficients, shape
        (cells, words).
    """
    labels, representatives = _compiled()(points, nodes, words)
    return Classes(labels, representatives)


@lru_cache
def _compiled() -> Callable[..., Any]:
    return compiled(_label, [_power_of_two])


def _power_of_two(least: Any) -> Any:
    size = 4
    while size < least:
        size *= 2
    return size


def _label(points: Any, nodes: Any, words: Any) -> Any:
    """Label the cells by a hash table with open addressing; keys are compared word by word.

    The hash is that of Fowler, Noll and Vo, with their offset basis and prime of 64 bits. Its high
    bits are folded into the low ones, which alone choose the slot.
    """
    dim = points.shape[0]
    corners, cells = nodes.shape
    more = words.shape[1]
    width = dim * (corners - 1) + more
    slots = _power_of_two(2 * cells)
    mask = np.uint64(slots - 1)
    table = np.full(slots, -1, dtype=np.int32)
    keys = np.empty((cells, width), dtype=np.uint64)  # rows never written take no memory
    labels = np.empty(cells, dtype=np.int32)
    representatives = np.empty(cells, dtype=np.int64)
    key = np.empty(width, dtype=np.uint64)
    differences = key.view(np.float64)
    count = 0
    last = -1
    for c in range(cells):
        origin = nodes[0, c]
        at = 0
        for k in range(1, corners):
            node = nodes[k, c]
            for d in range(dim):
                differences[at] = points[d, node] - points[d, origin] + 0.0  # no negative zero
                at += 1
        for k in range(more):
            key[at + k] = words[c, k]
        if last >= 0:
            same = True
            for k in range(width):
                if keys[last, k] != key[k]:
                    same = False
                    break
            if same:
                labels[c] = last
                continue
        value = np.uint64(14695981039346656037)
        for k in range(width):
            value = (value ^ key[k]) * np.uint64(1099511628211)
            value ^= value >> np.uint64(29)
        slot = value & mask
        while True:
            last = table[slot]
            if last < 0:
                break
            same = True
            for k in range(width):
                if keys[last, k] != key[k]:
                    same = False
                    break
            if same:
                break
            slot = (slot + np.uint64(1)) & mask
        if last < 0:
            last = count
            table[slot] = last
            representatives[count] = c
            for k in range(width):
                keys[count, k] = key[k]
            count += 1
        labels[c] = last
    return labels, representatives[:count].copy()
