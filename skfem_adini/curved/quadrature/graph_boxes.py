"""Subdivision of boxes until every zero line in them is a graph over one side.

Plain Python; `cut_quadrature.compiled_cut_boxes` compiles it and `graph_rules`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skfem_adini.curved.quadrature import bernstein_kernels as poly
from skfem_adini.curved.quadrature import graph_rules as rules
from skfem_adini.curved.quadrature.graph_rules import Array, State, Table


class _Limits(NamedTuple):  # limits of the subdivision
    halvings: int = 40  # the side, 1e-12, is then near the rounding of the coefficients
    side: float = 1e-9  # over the sides of a box: nearer points lie on a side, to avoid slivers


LIMITS = _Limits()


def classify(c: Array, tol: Array, table: Table, state: State) -> int:
    """Write the state of every leaf, see `graph_rules`; return how many are open and relevant."""
    K = state.size
    for k in range(K):
        low, high = c[k].min(), c[k].max()
        state[k] = 0 if low >= -tol[k] else (1 if high <= tol[k] else 2)
    count = 0
    for k in range(K):
        if state[k] == 2:
            if rules.relevant(table, state, k):
                count += 1
            else:
                state[k] = 0
    return count


def joined(c: Array, table: Table) -> Table:
    """Return the truth table with each leaf replaced by the first one of the same zero line."""
    table = table.copy()
    for l in range(c.shape[0]):
        for k in range(l):
            i = np.abs(c[k]).argmax()
            ratio = c[l].ravel()[i] / c[k].ravel()[i]
            if np.abs(c[l] - ratio * c[k]).max() > 1e-11 * np.abs(c[l]).max():
                continue
            for index in range(table.size):
                bit = index >> k & 1 if ratio > 0 else 1 - (index >> k & 1)
                table[index] = table[(index & ~(1 << l)) | bit << l]
            break
    return table


def meeting_point(f: Array, g: Array) -> tuple[float, float]:
    """Return the common zero that Newton's method finds from the middle, or (-1, -1)."""
    x, y = 0.5, 0.5
    for _ in range(30):
        p, q = poly.value(poly.line(f, 0, y), x), poly.value(poly.line(g, 0, y), x)
        f_x, f_y = poly.gradient(f, x, y)
        g_x, g_y = poly.gradient(g, x, y)
        determinant = f_x * g_y - f_y * g_x
        if determinant == 0:
            return -1.0, -1.0
        dx = (p * g_y - q * f_y) / determinant
        dy = (f_x * q - g_x * p) / determinant
        x, y = x - dx, y - dy
        if not (-0.5 <= x <= 1.5 and -0.5 <= y <= 1.5):
            return -1.0, -1.0
        if abs(dx) + abs(dy) < 1e-15:
            break
    inside = -LIMITS.side < x < 1 + LIMITS.side and -LIMITS.side < y < 1 + LIMITS.side
    interior = LIMITS.side < x < 1 - LIMITS.side or LIMITS.side < y < 1 - LIMITS.side
    return (x, y) if inside and interior else (-1.0, -1.0)


def dividing_point(c: Array, state: State) -> tuple[float, float]:
    """Return where to divide a box: at a common zero of two open leaves, or in the middle."""
    for k in range(state.size):
        for l in range(k):
            if state[k] == 2 and state[l] == 2:
                x, y = meeting_point(c[k], c[l])
                if x >= 0:
                    return x, y
    return 0.5, 0.5


def settle_by_middle(c: Array, state: State) -> None:
    """Set the state of every open leaf to 1 or 0, by its sign in the middle of the box."""
    for k in range(state.size):
        if state[k] == 2:
            middle = poly.value(poly.line(c[k], 0, 0.5), 0.5)
            state[k] = 1 if middle < 0 else 0


def best_direction(c: Array, state: State, lengths: Array) -> int:
    """Return the coordinate that every open polynomial can be solved for, or -1."""
    first = rules.good_direction(c, state, 0, lengths)
    last = rules.good_direction(c, state, 1, lengths)
    if first <= 0 and last <= 0:
        return -1
    return 0 if first > last else 1


def subdivide(c: Array, x: float, y: float, parts: Array, boxes: Array) -> int:
    """Write the parts left and right of x, below and above y, without those of zero width. Return
    the number of parts; `boxes` gets rows of lower corner and sides, in sides of the box."""
    K, m = c.shape[0], c.shape[1]
    sides = np.empty((2, m, m))
    quarters = np.empty((2, m, m))
    split_x, split_y = LIMITS.side < x < 1 - LIMITS.side, LIMITS.side < y < 1 - LIMITS.side
    columns, rows = 2 if split_x else 1, 2 if split_y else 1
    for k in range(K):
        if split_x:
            poly.split(c[k], 0, x, sides[0], sides[1])
        else:
            sides[0] = c[k]
        for i in range(columns):
            if split_y:
                poly.split(sides[i], 1, y, quarters[0], quarters[1])
            else:
                quarters[0] = sides[i]
            for j in range(rows):
                parts[i * rows + j, k] = quarters[j]
    for i in range(columns):
        for j in range(rows):
            box = boxes[i * rows + j]
            box[0], box[2] = (x * i, x if i == 0 else 1 - x) if split_x else (0.0, 1.0)
            box[1], box[3] = (y * j, y if j == 0 else 1 - y) if split_y else (0.0, 1.0)
    return columns * rows


def cut_boxes(
    coefficients: Array,
    tolerances: Array,
    tables: Table,
    sizes: Array,
    nodes: Array,
    weights: Array,
) -> tuple[Array, Array, NDArray[np.bool_], int]:
    """Return points of volume and boundary, which boxes are whole, and a degenerate box or -1.
    See `graph_rules`. Bernstein coefficients: (boxes, leaves, m, m), tolerances (boxes, leaves),
    tables (boxes, 2^leaves), sizes (boxes, 2); nodes, weights: Gauss rule on [0, 1]."""
    count, K, m = coefficients.shape[0], coefficients.shape[1], coefficients.shape[2]
    volume, nv = np.empty((1024, 4)), 0
    surface, ns = np.empty((256, 7)), 0
    whole = np.zeros(count, np.bool_)
    stack = np.empty((3 * LIMITS.halvings + 8, K, m, m))
    places = np.empty((3 * LIMITS.halvings + 8, 5))
    parts, boxes = np.empty((4, K, m, m)), np.empty((4, 4))
    state, lengths = np.empty(K, np.int64), np.empty(2)
    middle, one = np.full(1, 0.5), np.ones(1)
    for b in range(count):
        table = joined(coefficients[b], tables[b])
        stack[0] = coefficients[b]
        places[0] = np.array([0.0, 0.0, 1.0, 1.0, 0.0])
        top, visited = 1, 0
        while top > 0:
            top -= 1
            visited += 1
            if visited > 20_000:  # parts: more are needed only if a zero line is degenerate
                return volume[:nv], surface[:ns], whole, b
            c, place = stack[top].copy(), places[top].copy()
            lengths[0], lengths[1] = place[2] * sizes[b, 0], place[3] * sizes[b, 1]
            tol = tolerances[b]
            open_leaves = classify(c, tol, table, state)
            if open_leaves == 0:
                if not table[rules.index_of(state)]:
                    continue
                volume, nv = rules.product_rule(b, place, nodes, weights, volume, nv)
                whole[b] = visited == 1
                surface, ns = rules.face_rule(
                    c, state, tol, table, b, place, lengths, nodes, weights, surface, ns
                )
                continue
            d = best_direction(c, state, lengths)
            if d >= 0:
                volume, nv, surface, ns = rules.height_rule(
                    c, state, tol, table, d, b, place, lengths, nodes, weights,
                    volume, nv, surface, ns,
                )  # fmt: skip
                surface, ns = rules.face_rule(
                    c, state, tol, table, b, place, lengths, nodes, weights, surface, ns
                )
                continue
            if place[4] >= LIMITS.halvings:
                # The box is as narrow as rounding: use the sign in its middle.
                settle_by_middle(c, state)
                if table[rules.index_of(state)]:
                    volume, nv = rules.product_rule(b, place, middle, one, volume, nv)
                continue
            x, y = dividing_point(c, state)
            pieces = subdivide(c, x, y, parts, boxes)
            for i in range(pieces):
                stack[top] = parts[i]
                places[top, 0] = place[0] + place[2] * boxes[i, 0]
                places[top, 1] = place[1] + place[3] * boxes[i, 1]
                places[top, 2] = place[2] * boxes[i, 2]
                places[top, 3] = place[3] * boxes[i, 3]
                places[top, 4] = place[4] + 1
                top += 1
    return volume[:nv], surface[:ns], whole, -1
