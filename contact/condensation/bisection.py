"""Kernels of the nested dissection, for numba: recursive bisection of cells, and counting sorts."""

from __future__ import annotations

from typing import Any

import numpy as np


def sort_steps(steps: Any, order: Any, spare: Any) -> None:
    """Write the stable order of steps (n,) from 0 to 2^28 - 1, by counting their digits."""
    bits = 14  # sorted per pass: two passes suffice below 2^28
    count = np.empty((1 << bits) + 1, dtype=np.int64)
    mask = (1 << bits) - 1
    for k in range(order.size):
        order[k] = k
    for shift in (0, bits):
        count[:] = 0
        for step in steps:
            count[((step >> shift) & mask) + 1] += 1
        for k in range(mask):
            count[k + 1] += count[k]
        for cell in order:
            digit = (steps[cell] >> shift) & mask
            spare[count[digit]] = cell
            count[digit] += 1
        order[:] = spare


def leaves_of(steps: Any, levels: int) -> Any:
    """Number of the leaf of each cell, shape (n,): its bits are the halves that it lies in.
    A set is cut between distinct coordinate values next to the median of its longest extent;
    `steps` are integer coordinates, int32 (dim, n) below 2^28, sorted once."""
    dim, n = steps.shape
    orders, spare = np.empty((dim, n), dtype=np.int32), np.empty(n, dtype=np.int32)
    for a in range(dim):
        sort_steps(steps[a], orders[a], spare)
    in_second = np.empty(n, dtype=np.bool_)
    bounds = np.array([0, n])
    for level in range(levels):
        halved = np.full(2 * (1 << level) + 1, n)
        for s in range(1 << level):
            begin, end = bounds[s], bounds[s + 1]
            cut = middle = (begin + end) // 2
            axis, longest = 0, -1
            for a in range(dim if end > begin else 0):
                extent = steps[a, orders[a, end - 1]] - steps[a, orders[a, begin]]
                if extent > longest:
                    axis, longest = a, extent
            for d in range((end - begin + 1) // 2 if longest > 0 else 0):
                left, right = middle - d, middle + d
                if left > begin and (
                    steps[axis, orders[axis, left]] != steps[axis, orders[axis, left - 1]]
                ):
                    cut = left
                    break
                if right < end and (
                    steps[axis, orders[axis, right]] != steps[axis, orders[axis, right - 1]]
                ):
                    cut = right
                    break
            for k in range(begin, end):
                in_second[orders[axis, k]] = k >= cut
            for a in range(dim):
                if a == axis:
                    continue
                kept, moved = begin, 0
                for k in range(begin, end):
                    cell = orders[a, k]
                    if in_second[cell]:
                        spare[moved] = cell
                        moved += 1
                    else:
                        orders[a, kept] = cell
                        kept += 1
                orders[a, kept:end] = spare[:moved]
            halved[2 * s], halved[2 * s + 1] = begin, cut
        bounds = halved
    leaf = np.empty(n, dtype=np.int64)
    for s in range(1 << levels):
        for k in range(bounds[s], bounds[s + 1]):
            leaf[orders[0, k]] = s
    return leaf


def spans_of(leaf: Any, cells: Any, n: int) -> Any:
    """Smallest and largest leaf of the cells of each vertex, shapes (n,); 0 for none.
    `cells`, shape (k, ncells), holds the vertices of each cell."""
    first, last = np.full(n, 1 << 62), np.full(n, -1)
    for j in range(cells.shape[0]):
        for c in range(cells.shape[1]):
            vertex, number = cells[j, c], leaf[c]
            first[vertex] = min(first[vertex], number)
            last[vertex] = max(last[vertex], number)
    for v in range(n):
        if last[v] < 0:
            first[v] = last[v] = 0
    return first, last


def order_of(keys: Any, count: int) -> Any:
    """``numpy.argsort(keys, kind="stable")`` of integers below a count, by counting."""
    begin = np.zeros(count + 1, dtype=np.int64)
    for key in keys:
        begin[key + 1] += 1
    for k in range(count):
        begin[k + 1] += begin[k]
    order = np.empty(keys.size, dtype=np.int64)
    for i in range(keys.size):
        order[begin[keys[i]]] = i
        begin[keys[i]] += 1
    return order
