"""Kernels in plain Python for numba that number the facets of a mesh and check their sides."""

from __future__ import annotations

from typing import Any

import numpy as np


def number(t: Any, corners: Any, known: int, vertices: int, in_turn: bool) -> Any:
    """Sort the m corners of all facets of cells t (k, ncells), and count equal facets once.
    Return facets (m, nfacets), cyclic if `in_turn`; numbers (facets a cell, ncells); first and
    last cell (2, nfacets) or -1; whether facets with `known` equal corners are equal."""
    cells, (sides, m) = t.shape[1], corners.shape
    count = sides * cells
    ascending = np.empty((count, m), dtype=t.dtype)
    for side in range(sides):
        for cell in range(cells):
            i = side * cells + cell
            for j in range(m):
                vertex, k = t[corners[side, j], cell], j
                while k > 0 and ascending[i, k - 1] > vertex:
                    ascending[i, k] = ascending[i, k - 1]
                    k -= 1
                ascending[i, k] = vertex
    order, spare = np.arange(count).astype(np.int32), np.empty(count, dtype=np.int32)
    for j in range(known - 1, -1, -1):  # a stable counting sort by each corner, the lowest last
        begin = np.zeros(vertices + 1, dtype=np.int64)
        for i in range(count):
            begin[ascending[i, j] + 1] += 1
        for v in range(vertices):
            begin[v + 1] += begin[v]
        for i in order:
            vertex = ascending[i, j]
            spare[begin[vertex]] = i
            begin[vertex] += 1
        order, spare = spare, order
    numbers, sound, found, before = np.empty(count, dtype=np.int64), True, -1, 0
    first = spare  # where each facet occurs first
    for i in order:
        same = found >= 0
        for j in range(known):
            same = same and ascending[i, j] == ascending[before, j]
        if not same:
            found += 1
            first[found] = before = i
        elif ascending[i, m - 1] != ascending[before, m - 1]:
            sound = False
        numbers[i] = found
    facets, beside = (
        np.empty((m, found + 1), dtype=t.dtype),
        np.empty((2, found + 1), dtype=np.int32),
    )
    for i in order:  # the last cell of each facet remains
        beside[1, numbers[i]] = i % cells
    for f in range(found + 1):
        i = first[f]
        beside[0, f] = i % cells
        if beside[0, f] == beside[1, f]:
            beside[1, f] = -1
        for j in range(m):
            facets[j, f] = t[corners[i // cells, j], i % cells] if in_turn else ascending[i, j]
    return facets, numbers.reshape(sides, cells), beside, sound


def on_one_side(p: Any, t: Any, facets: Any, f2t: Any, some: Any) -> Any:
    """Positive where both cells of a facet lie on one side of it: the product of their signs, (n,).
    A straight cell lies on the side of the opposite vertex or facet. Differences of vertices
    come before their sums, which round by the distance from the origin."""
    (dim, _), corners, nodes = p.shape, facets.shape[0], t.shape[0]
    product = np.ones(some.size)
    x, normal = np.zeros((corners, 3)), np.zeros(3)
    for k in range(some.size):
        facet = some[k]
        origin = facets[0, facet]
        for j in range(corners):
            for d in range(dim):
                x[j, d] = p[d, facets[j, facet]] - p[d, origin]
        if dim == 2:
            normal[0], normal[1] = -x[1, 1], x[1, 0]
        else:
            # The diagonals of a bilinear facet are parallel to its middle.
            one = x[1] if corners == 3 else x[2]
            other = x[2] if corners == 3 else x[3] - x[1]
            for d in range(3):
                a, b = (d + 1) % 3, (d + 2) % 3
                normal[d] = one[a] * other[b] - one[b] * other[a]
        for side in range(2):
            cell = f2t[side, facet]
            base, along = t[0, cell], 0.0
            for d in range(dim):
                to_middle, middle = 0.0, 0.0
                for j in range(nodes):
                    to_middle += p[d, t[j, cell]] - p[d, base]
                for j in range(corners):
                    middle += x[j, d]
                way = (p[d, base] - p[d, origin]) + to_middle / nodes
                along += normal[d] * (way - middle / corners)
            product[k] *= np.sign(along)
    return product
