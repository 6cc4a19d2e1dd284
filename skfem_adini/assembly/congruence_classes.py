"""Cells that are translates of each other, up to the rounding of their coordinates."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skfem_adini.ground.jit import compiled_later

Array = NDArray[np.float64]
Integers = NDArray[np.integer]
Words = NDArray[np.uint64]


class _Limits(NamedTuple):  # limits of the search for congruent cells
    # Relative to the coordinates: equal cells differ by 2 eps, and by more after refinement.
    rounding: float = 8 * np.finfo(float).eps
    farthest: int = 1024  # bound of coordinates over the height of a cell, which limits the error
    few: int = 32  # cells of which all pairs are compared at once; more are sorted


LIMITS = _Limits()


class Classes(NamedTuple):
    """A partition of cells."""

    labels: Integers  # class of each cell, in order of appearance, shape (cells,)
    representatives: Integers  # the first cell of each class


def any_alike(points: Array, nodes: Integers, words: Words) -> bool:
    """Whether any two cells are congruent."""
    if len(_compiled()(points, nodes, words)[1]) < nodes.shape[1]:
        return True  # bit by bit
    return len(congruence_classes(points, nodes, words).representatives) < nodes.shape[1]


def congruence_classes(points: Array, nodes: Integers, words: Words) -> Classes:
    r"""Put cells whose nodes differ by a translation and whose words agree into one class.

    Differences of the nodes' coordinates may differ by :math:`8 \epsilon \min(\max |x|, 1024
    a)`, with a the height of a cell (volume over longest sides): rounding makes equal cells of a
    grid differ by up to :math:`2 \epsilon \max |x|`. So the local matrix of a class, that of its
    first cell, has a relative error of a small multiple of :math:`8 \epsilon \min(\max |x| / a,
    1024)`. Words (cells, words) are bits of orientations and coefficients."""
    # Compare bits first: few classes remain to be compared with a tolerance.
    labels, first = _compiled()(points, nodes, words)
    if len(first) > 1 and len(nodes) > len(points):
        merged, members = _merged(points, nodes[:, first], words[first])
        if len(members) < len(first):
            labels, first = merged[labels], first[members]
    return Classes(labels, first)


def _merged(points: Array, nodes: Integers, words: Words) -> tuple[Integers, Integers]:
    """Label cells equal up to rounding, in order of appearance; also return the first of each
    label. They are sorted by one difference after the other. A class ends at a gap, and after a
    stretch as long as the tolerance: no chain of small steps joins unlike cells."""
    dim, cells = len(points), nodes.shape[1]
    sides = points[:, nodes[1:]] - points[:, nodes[:1]]
    longest = np.maximum(np.abs(sides).max(axis=(0, 1)), np.finfo(float).tiny)
    height = _volumes(sides[:, :dim] / longest) * longest
    tolerance = LIMITS.rounding * np.minimum(np.abs(points).max(), LIMITS.farthest * height)
    if cells <= LIMITS.few:
        apart = np.abs(sides[..., None] - sides[:, :, None]) > tolerance
        near = ~apart.any(axis=(0, 1)) & (words[:, None] == words).all(axis=2)
        first_of = near.argmax(axis=1)
        if (near == near[first_of]).all():  # tolerance is transitive here
            leads = first_of == np.arange(cells)
            return (np.cumsum(leads, dtype=np.int32) - 1)[first_of], np.flatnonzero(leads)
    labels, count = np.zeros(cells, dtype=np.int64), 1
    several = np.arange(cells)  # those that are not yet alone in their class
    exact = np.zeros(cells)
    columns = [*((word, exact) for word in words.T)]
    columns += [(side, tolerance) for side in sides.reshape(-1, cells)]
    for values, within in columns:
        several = several[np.lexsort((values[several], labels[several]))]
        value, own, most = values[several], labels[several], within[several]
        begins = np.append(True, (own[1:] != own[:-1]) | (value[1:] - value[:-1] > most[1:]))
        start = np.maximum.accumulate(np.where(begins, np.arange(len(several)), 0))
        stretch = (value - value[start]) // np.maximum(most[start], np.finfo(float).tiny)
        begins[1:] |= stretch[1:] != stretch[:-1]
        group = np.cumsum(begins) - 1
        labels[several] = count + group
        count += int(group[-1]) + 1
        several = several[np.bincount(group)[group] > 1]
        if not several.size:
            break
    _, first, labels = np.unique(labels, return_index=True, return_inverse=True)
    order = np.argsort(first)
    return np.argsort(order)[labels].astype(np.int32), first[order]


def _volumes(a: Array) -> Array:
    """Return the volumes of parallelepipeds, from coordinates of their sides: (dim, dim, cells)."""
    if len(a) == 1:
        return np.abs(a[0, 0])
    x, y, z = a if len(a) == 3 else (*a, np.zeros_like(a[0]))
    normal = y[0] * z[1] - z[0] * y[1], z[0] * x[1] - x[0] * z[1], x[0] * y[1] - y[0] * x[1]
    third = (x[2], y[2], z[2]) if len(a) == 3 else (0.0, 0.0, 1.0)
    return np.abs(sum(n * t for n, t in zip(normal, third, strict=True)))


@lru_cache
def _compiled() -> Callable[..., Any]:
    return compiled_later(_label, [_power_of_two])


def _power_of_two(least: Any) -> Any:
    size = 4
    while size < least:
        size *= 2
    return size


def _label(points: Any, nodes: Any, words: Any) -> Any:
    """Label the cells by a hash table with open addressing; keys are compared word by word.
    The hash is that of Fowler, Noll and Vo with 64 bits; its high bits are folded into the low
    ones, which alone choose the slot."""
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
