"""Quadrature rules on boxes in which every zero line is a graph over one side.

Plain Python for numba (`cut_quadrature.compiled_cut_boxes`). A leaf is one smooth level set of a
composition; a point is in leaf k where its polynomial is below -tol[k]. The state of a leaf is 1
(the box is in it), 0 (it is not) or 2 (open). Rows of the results are (box, x, y, weight) and
(box, x, y, weight, n_x, n_y, leaf). A row `geometry` begins with lower corner and sides of a
part of the box, in sides of the box; `lengths` are the sides of that part.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skfem_adini.curved.quadrature import bernstein_kernels as poly

Array = NDArray[np.float64]
State = NDArray[np.int64]
Table = NDArray[np.uint8]


class _Limits(NamedTuple):  # limits of the rules
    place: float = 1e-14  # over the sides of a box: nearer points are equal (rounding of 1)
    slope: float = 0.3  # least ratio of slopes along and across the height in a graph's direction
    slope_of_many: float = 1e-6  # for several zero lines, whose angle division does not change
    steadiness: float = 0.7  # least ratio of smallest to largest slope: Gauss points converge fast
    end: float = 1e-12  # distance from the ends, over the interval, at which graphs are compared
    roots: int = 64  # on a line, at most: eight times the degree, for rounding


LIMITS = _Limits()


def relevant(table: Table, state: State, k: int) -> bool:
    """Return whether leaf k can change the truth value, given the states of the others."""
    for index in range(table.size):
        if index >> k & 1:
            continue
        fits = True
        for l in range(state.size):
            if l != k and state[l] != 2 and (index >> l & 1) != state[l]:
                fits = False
        if fits and table[index] != table[index | 1 << k]:
            return True
    return False


def index_of(state: State) -> int:
    """Return the index in the truth table for leaves that are all in state 0 or 1."""
    index = 0
    for k in range(state.size):
        if state[k] == 1:
            index |= 1 << k
    return index


def good_direction(c: Array, state: State, d: int, lengths: Array) -> float:
    """Return how well every open polynomial can be solved for the coordinate d, from 0 (not) to 1.
    `lengths` are the sides of the box."""
    quality = 1.0
    open_count = 0
    for k in range(state.size):
        if state[k] == 2:
            open_count += 1
    for k in range(state.size):
        if state[k] != 2:
            continue
        low, high = poly.slope_range(c[k], d)
        other_low, other_high = poly.slope_range(c[k], 1 - d)
        across = max(abs(other_low), abs(other_high)) / lengths[1 - d]
        least = min(abs(low), abs(high)) / lengths[d]
        most = max(abs(low), abs(high)) / lengths[d]
        if low * high <= 0 or most <= 0 or least < LIMITS.steadiness * most:
            return 0.0
        steep = least / across if across > 0 else np.inf
        if steep < (LIMITS.slope if open_count == 1 else LIMITS.slope_of_many):
            return 0.0
        quality = min(quality, steep / (1 + steep))
    for k in range(state.size):
        for l in range(k):
            if state[k] == 2 and state[l] == 2:
                low, high = poly.jacobian_range(c[k], c[l])
                if low * high <= 0:
                    return 0.0
    return quality


def height(c: Array, d: int, tol: float, s: float) -> tuple[float, bool, bool]:
    """Return the root along d at the other coordinate s (2: none), and whether each end is
    inside."""
    along = poly.line(c, d, s)
    first, last = along[0], along[along.size - 1]
    starts, ends = first < -tol, last < -tol
    if starts == ends:
        return 2.0, starts, ends
    if starts and last <= 0:
        return 1.0, starts, ends
    if ends and first <= 0:
        return 0.0, starts, ends
    return poly.bracketed_root(along, 0.0, 1.0), starts, ends


def clamped_height(c: Array, d: int, s: float) -> float:
    """Return the root along d at s of a polynomial that has one, up to rounding.
    Near the place where a graph leaves the box rounding may move its root beyond a side; then
    that side is returned."""
    along = poly.line(c, d, s)
    first, last = along[0], along[along.size - 1]
    if (first < 0) == (last < 0):
        return 0.0 if abs(first) < abs(last) else 1.0
    return poly.bracketed_root(along, 0.0, 1.0)


def crossing(f: Array, g: Array, d: int, tol_f: float, tol_g: float, a: float, b: float) -> float:
    """Return where two graphs cross between a and b, or -1; their difference is monotone."""
    middle = 0.5 * (a + b)
    y_f, _, _ = height(f, d, tol_f, middle)
    y_g, _, _ = height(g, d, tol_g, middle)
    if max(y_f, y_g) > 1:  # a graph has no root here: graphs enter and leave the box at breaks only
        return -1.0
    # At a and b themselves rounding may hide a root that lies on a side of the box.
    a, b = a + LIMITS.end * (b - a), b - LIMITS.end * (b - a)
    rising = clamped_height(f, d, b) > clamped_height(g, d, b)
    if (clamped_height(f, d, a) > clamped_height(g, d, a)) == rising:
        return -1.0
    for _ in range(60):
        middle = 0.5 * (a + b)
        if (clamped_height(f, d, middle) > clamped_height(g, d, middle)) == rising:
            b = middle
        else:
            a = middle
    return 0.5 * (a + b)


def emit_surface(
    surface: Array,
    count: int,
    c: Array,
    k: int,
    outward: float,
    box: int,
    geometry: Array,
    lengths: Array,
    x: float,
    y: float,
    measure: tuple[int, float],
) -> tuple[Array, int]:
    """Append a quadrature point of a zero line.
    `measure` is (d, w) for a graph with heights along d, where w is the weight over the other
    coordinate, or (-1, w), where w is the weight in arc length."""
    g_x, g_y = poly.gradient(c, x, y)
    g_x, g_y = g_x / lengths[0], g_y / lengths[1]
    size = np.hypot(g_x, g_y)
    if size == 0:
        return surface, count
    if measure[0] >= 0:  # a graph over the other coordinate
        along = abs(g_x) if measure[0] == 0 else abs(g_y)
        weight = measure[1] * size / along
    else:
        weight = measure[1]
    row = np.empty(7)
    row[0] = box
    row[1], row[2] = geometry[0] + geometry[2] * x, geometry[1] + geometry[3] * y
    row[3], row[4], row[5], row[6] = weight, outward * g_x / size, outward * g_y / size, k
    return poly.append(surface, count, row), count + 1


def sorted_breaks(breaks: Array, count: int) -> None:
    """Sort the first entries of an array in place."""
    for i in range(1, count):
        moving = breaks[i]
        j = i
        while j > 0 and breaks[j - 1] > moving:
            breaks[j] = breaks[j - 1]
            j -= 1
        breaks[j] = moving


def product_rule(
    box: int, geometry: Array, nodes: Array, weights: Array, volume: Array, count: int
) -> tuple[Array, int]:
    """Append the points of a tensor Gauss rule on a box that lies inside."""
    row = np.empty(4)
    for i in range(nodes.size):
        for j in range(nodes.size):
            row[0] = box
            row[1] = geometry[0] + geometry[2] * nodes[i]
            row[2] = geometry[1] + geometry[3] * nodes[j]
            row[3] = geometry[2] * geometry[3] * weights[i] * weights[j]
            volume = poly.append(volume, count, row)
            count += 1
    return volume, count


def face_rule(
    c: Array,
    state: State,
    tol: Array,
    table: Table,
    box: int,
    geometry: Array,
    lengths: Array,
    nodes: Array,
    weights: Array,
    surface: Array,
    count: int,
) -> tuple[Array, int]:
    """Append boundary points on the sides of a box where a leaf that contains it vanishes."""
    breaks, found = np.empty(LIMITS.roots * state.size + 2), np.empty(LIMITS.roots)
    here = state.copy()
    for k in range(state.size):
        if state[k] != 1:
            continue
        for d in range(2):
            for end in range(2):
                face = poly.line(c[k], 1 - d, float(end))
                largest = 0.0
                for i in range(face.size):
                    largest = max(largest, abs(face[i]))
                if largest > tol[k]:
                    continue
                breaks[0], breaks[1], used = 0.0, 1.0, 2
                for l in range(state.size):
                    if state[l] == 2:
                        n = poly.roots(poly.line(c[l], 1 - d, float(end)), tol[l], found)
                        for i in range(n):
                            breaks[used + i] = found[i]
                        used += n
                sorted_breaks(breaks, used)
                for i in range(used - 1):
                    a, b = breaks[i], breaks[i + 1]
                    if b - a < LIMITS.place:
                        continue
                    for l in range(state.size):
                        if state[l] == 2:
                            middle = poly.value(poly.line(c[l], 1 - d, float(end)), 0.5 * (a + b))
                            here[l] = 1 if middle < -tol[l] else 0
                    here[k] = 1
                    within = table[index_of(here)]
                    here[k] = 0
                    beyond = table[index_of(here)]
                    here[k] = 1
                    if within == beyond:
                        continue
                    for p in range(nodes.size):
                        t = a + (b - a) * nodes[p]
                        x, y = (float(end), t) if d == 0 else (t, float(end))
                        measure = (-1, weights[p] * (b - a) * lengths[1 - d])
                        outward = 1.0 if within else -1.0
                        surface, count = emit_surface(
                            surface, count, c[k], k, outward, box, geometry, lengths, x, y, measure
                        )
    return surface, count


def height_breaks(c: Array, state: State, tol: Array, d: int, breaks: Array) -> int:
    """Write, sorted, where zero lines meet the sides or each other; return their number."""
    K, found = state.size, np.empty(LIMITS.roots)
    breaks[0], breaks[1], used = 0.0, 1.0, 2
    for k in range(K):
        if state[k] == 2:
            for end in range(2):
                n = poly.roots(poly.line(c[k], 1 - d, float(end)), tol[k], found)
                for i in range(n):
                    breaks[used + i] = found[i]
                used += n
    sorted_breaks(breaks, used)
    simple = used
    for i in range(simple - 1):
        for k in range(K):
            for l in range(k):
                if state[k] == 2 and state[l] == 2 and breaks[i + 1] - breaks[i] > LIMITS.place:
                    x = crossing(c[k], c[l], d, tol[k], tol[l], breaks[i], breaks[i + 1])
                    if x >= 0:
                        breaks[used] = x
                        used += 1
    sorted_breaks(breaks, used)
    return used


def height_rule(
    c: Array,
    state: State,
    tol: Array,
    table: Table,
    d: int,
    box: int,
    geometry: Array,
    lengths: Array,
    nodes: Array,
    weights: Array,
    volume: Array,
    nv: int,
    surface: Array,
    ns: int,
) -> tuple[Array, int, Array, int]:
    """Append the points of a box in which every open zero line is a graph over one side."""
    K = state.size
    simple = 2 + 2 * K * LIMITS.roots
    breaks = np.empty(simple + K * (K - 1) // 2 * simple)
    used = height_breaks(c, state, tol, d, breaks)
    heights, starts, ends = np.empty(K), np.zeros(K, np.bool_), np.zeros(K, np.bool_)
    here = state.copy()
    row, cuts = np.empty(4), np.empty(K + 2)
    for i in range(used - 1):
        a, b = breaks[i], breaks[i + 1]
        if b - a < LIMITS.place:
            continue
        for p in range(nodes.size):
            s, w = a + (b - a) * nodes[p], weights[p] * (b - a)
            cuts[0], cuts[1], n = 0.0, 1.0, 2
            for k in range(K):
                if state[k] == 2:
                    heights[k], starts[k], ends[k] = height(c[k], d, tol[k], s)
                    if heights[k] <= 1:
                        cuts[n] = heights[k]
                        n += 1
            sorted_breaks(cuts, n)
            for j in range(n - 1):
                low, high = cuts[j], cuts[j + 1]
                if high <= low:
                    continue
                for k in range(K):
                    if state[k] == 2:
                        before = heights[k] > 0.5 * (low + high)
                        here[k] = 1 if (starts[k] if before else ends[k]) else 0
                if not table[index_of(here)]:
                    continue
                for r in range(nodes.size):
                    t = low + (high - low) * nodes[r]
                    x, y = (t, s) if d == 0 else (s, t)
                    row[0] = box
                    row[1] = geometry[0] + geometry[2] * x
                    row[2] = geometry[1] + geometry[3] * y
                    row[3] = geometry[2] * geometry[3] * w * weights[r] * (high - low)
                    volume = poly.append(volume, nv, row)
                    nv += 1
            for k in range(K):
                if state[k] != 2 or heights[k] > 1:
                    continue
                for l in range(K):
                    if state[l] == 2:
                        before = heights[l] > heights[k]
                        here[l] = 1 if (starts[l] if before else ends[l]) else 0
                here[k] = 1
                within = table[index_of(here)]
                here[k] = 0
                beyond = table[index_of(here)]
                if within == beyond:
                    continue
                x, y = (heights[k], s) if d == 0 else (s, heights[k])
                outward = 1.0 if within else -1.0
                measure = (d, w * lengths[1 - d])
                surface, ns = emit_surface(
                    surface, ns, c[k], k, outward, box, geometry, lengths, x, y, measure
                )
    return volume, nv, surface, ns
