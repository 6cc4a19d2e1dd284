"""Loops of the feet by displacements (`cip.engines.displacements`), and the code of the flow.

A kernel ``flow(count, p, q, r, at, box, sizes, u, v)`` writes the backward velocity, two numbers,
at points whose first coordinates are those that move. Of a formula, `box` holds what does not
depend on the place. Of snapshots it holds how many arrays of B-spline coefficients are summed, for
each where it begins and its weight, and the arrays; in these the line of a point begins at `at`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy import floor

from cip.engines.cpu_loops import address, shifted
from cip.engines.path_kernel import plain
from cip.formulas.expression import (
    COORDINATES,
    Expression,
    apply,
    ordered,
    statements,
    variable,
    with_names,
)
from skfem_adini.ground.jit import Array, Index, Out, Real, kernel, loop, room

# Nodes of a block, and of the parts of it whose cells are compared.
_BLOCK, _PART = 64, 16
HEAD = 16  # numbers before the coefficients in a box
numbers, weight_numbers = room(_BLOCK), room(12 * _BLOCK)

# Placeholder that `loop_over` replaces by a kernel.
flow: Any = None

_HEAD = (
    "def flow(count: Index, p: Array, q: Array, r: Array, at: Array, box: Array, sizes: Array, "
    "u: Out, v: Out) -> None:"
)


def of_half_angles(rates: Sequence[Expression]) -> list[Expression]:
    """Rates with sines and cosines of a in place of those of 2 a, where both occur: a sine and a
    cosine of the same angle cost as much as one of them."""
    found = [node for node in ordered(list(rates)) if node.op in ("sin", "cos")]
    angles = {node.args[0] for node in found}
    names: dict[Expression, Expression] = {}
    for node in found:
        half = 0.5 * node.args[0]
        if half in angles:
            s, c = apply("sin", half), apply("cos", half)
            names[node] = 2.0 * (s * c) if node.op == "sin" else 1.0 - 2.0 * (s * s)
    return with_names(rates, names)


def without_place(rates: Sequence[Expression]) -> tuple[list[Expression], list[Expression]]:
    """Rates with variables b0, b1, .. for their largest parts that depend on no coordinate, among
    them numbers; and these parts. Code of the first does not depend on the numbers."""
    held: dict[Expression, Expression] = {}
    moving: set[Expression] = set()
    nodes = ordered(list(rates))
    for node in nodes:
        own = node.op == "variable" and node.value in COORDINATES[:3]
        if own or any(argument in moving for argument in node.args):
            moving.add(node)
    roots = {*rates} | {argument for node in moving for argument in node.args}
    for node in nodes:
        if node in roots and node not in moving and not plain(node):
            held[node] = variable(f"b{len(held)}")
    return with_names(rates, held), list(held)


def coordinates(moving: Sequence[int]) -> list[str]:
    """Names of the coordinates, those that move first."""
    return [COORDINATES[axis] for axis in (*moving, *(a for a in range(3) if a not in moving))]


def formula_source(rates: Sequence[Expression], moving: Sequence[int], held: int) -> str:
    """Source of ``flow`` for backward velocities with `held` numbers from `without_place`."""
    outputs = {f"o{q}": rate for q, rate in enumerate(rates)}
    inner = [
        *(f"{x} = {place}[j]" for x, place in zip(coordinates(moving), "pqr", strict=True)),
        *statements(outputs, ""),
        "u[j] = o0",
        f"v[j] = {'o1' if len(rates) > 1 else '0.0'}",
    ]
    held_numbers = [f"    b{q} = box[{q}]" for q in range(held)]
    return _looped([*held_numbers, "    for j in range(count):"], inner)


def _looped(lines: Sequence[str], inner: Sequence[str]) -> str:
    return "\n".join([_HEAD, *lines, *(f"        {line}" for line in inner), ""])


@cache
def spline_source(degree: int, axes: int) -> str:
    """Source of ``flow`` for uniform B-splines on lines or, with interleaved components, in planes.
    `sizes` holds for each direction the cells and whether they are periodic, then the stride of
    the coefficients on a line, or of their rows in a plane, and the number of terms. Where nodes
    side by side lie in cells side by side, coefficients are read side by side, as vectors."""
    terms, wide = range(degree + 1), ("p", "q")[:axes]
    cell = "at[j] + c0 * row" + " + 2 * c1" * (axes - 1)
    inner = []
    for axis, place in enumerate(wide):
        n, wrap = f"sizes[{2 * axis}]", f"sizes[{2 * axis}] * sizes[{2 * axis + 1}]"
        inner += [
            f"k{axis} = down({place}[j])",
            f"i{axis} = floor(k{axis} - {wrap} * down(k{axis} / {n}))",
            f"c{axis} = min(max(i{axis}, 0), {n} - 1)",
            f"s{axis} = {place}[j] - k{axis} + (i{axis} - c{axis})",
            *(
                f"w[{(axis * len(terms) + m) * _BLOCK} + j] = {code}"
                for m, code in enumerate(weights_of(degree, f"s{axis}"))
            ),
        ]
    inner += [f"cell[j] = {cell}", "u[j] = 0.0", "v[j] = 0.0"]
    head = [
        "    cell, w = numbers(sizes), weight_numbers(box)",
        f"    row, terms = sizes[{2 * axes}], sizes[{2 * axes + 1}]",
        "    for j in range(count):",
    ]

    def sums(component: int, node: str, at: str) -> str:
        """What a row of coefficients adds to the velocity; a line has rows of one."""
        parts = [f"box[{at} + {axes * m + component}]" for m in (terms if axes == 2 else (0,))]
        if axes == 2:
            parts = [f"w[{(m + len(terms)) * _BLOCK} + {node}] * {p}" for m, p in enumerate(parts)]
        return f"w[i * {_BLOCK} + {node}] * ({' + '.join(parts)})"

    outs = list(zip(("u", "v"), range(axes), strict=False))
    alone = [f"a{c} = a{c} + {sums(c, 'j', 'o')}" for _, c in outs]
    write = [f"{name}[j] = {name}[j] - g * a{c}" for name, c in outs]
    near = [
        f"{name}[b + j] = {name}[b + j] - g * ({sums(c, 'b + j', f'o + {axes} * j')})"
        for name, c in outs
    ]
    # Of a single node the number of terms is no constant: nodes side by side would gather their
    # coefficients, which are contiguous for one node.
    tail = f"""    for part in range(floor(box[0])):
        start, g = floor(box[1 + 2 * part]), box[2 + 2 * part]
        for b in range(0, count, {_PART}):
            o = cell[b] + start
            apart = floor(count - b < {_PART})
            for j in range(b, min(b + {_PART}, count)):
                apart = apart | (cell[j] + start - o - {axes} * (j - b))
            if apart != 0:
                for j in range(b, min(b + {_PART}, count)):
                    o = cell[j] + start
                    a0, a1 = 0.0, 0.0
                    for i in range(terms):
                        {"; ".join(alone)}
                        o = o + row
                    {"; ".join(write)}
            else:
                for i in range(terms):
                    for j in range({_PART}):
                        {"; ".join(near)}
                    o = o + row
"""
    return _looped(head, inner) + tail


def weights_of(degree: int, s: str) -> list[str]:
    """Code of the uniform B-splines that are not zero in a cell, at s in [0, 1]."""
    from scipy.interpolate import BSpline, PPoly

    one: Any = BSpline.basis_element(np.arange(degree + 2.0))
    pieces = PPoly.from_spline(one)
    found = []
    for j in range(degree + 1):
        piece = int(np.flatnonzero((pieces.x == degree - j) & (np.diff(pieces.x, append=0) > 0))[0])
        code, *rest = (repr(float(number)) for number in pieces.c[:, piece])
        for number in rest:
            code = f"({number} + {s} * {code})"
        found.append(code)
    return found


@kernel
def spread(a: Array, first: Index, along: Index, count: Index, out: Out) -> None:
    """Copy entries that belong to nodes of a row, or the one that belongs to all of them."""
    if along == 0:
        for j in range(count):
            out[j] = a[first]
    else:
        for j in range(count):
            out[j] = a[first + j]


@kernel
def points_of(
    p: Array, q: Array, r: Array, at: Array, places: Array, line: Index, head: Index, count: Index,
    x: Out, y: Out, z: Out, begin: Out,
) -> None:  # fmt: skip
    """Coordinates of a block of nodes of a row, and where their lines begin."""
    spread(p, line * places[0] + head * places[1], places[1], count, x)
    spread(q, line * places[2] + head * places[3], places[3], count, y)
    spread(r, line * places[4] + head * places[5], places[5], count, z)
    spread(at, line * places[6] + head * places[7], places[7], count, begin)
    for j in range(count):
        begin[j] += (head + j) * places[8]


@kernel
def carry(old: Array, count: Index, d: Out, x: Out) -> None:
    """Begin at displacements."""
    for j in range(count):
        d[j] = old[j]
        x[j] += d[j]


@kernel
def move(
    x: Array, u: Array, a: Out, shift: Real, back: Real, low: Real, high: Real, count: Index,
    to: Out, gone: Out,
) -> None:  # fmt: skip
    """The places of a stage from the velocities u of the last one, kept in `a`, and of that before
    it; 1 where they are outside."""
    for j in range(count):
        to[j] = x[j] + shift * u[j] + back * a[j]
        a[j] = u[j]
        gone[j] = 1.0 if to[j] < low or to[j] > high else gone[j]


@kernel
def differ(
    u: Array, total: Array, a: Array, more: Real, less: Real, count: Index, inner: Out
) -> None:
    """Add what tells the size of the error."""
    for j in range(count):
        inner[j] += abs(u[j] + more * total[j] - less * a[j])


@kernel
def finish(
    x: Array, d: Array, total: Array, scale: Real, low: Real, high: Real, count: Index, to: Out,
    gone: Out, new: Out,
) -> None:  # fmt: skip
    """The places at the end of the step, and the displacements."""
    for j in range(count):
        more = scale * total[j]
        new[j] = d[j] + more
        to[j] = x[j] + more
        gone[j] = 1.0 if to[j] < low or to[j] > high else gone[j]


@kernel
def worst_of(
    px: Array, py: Array, gone: Array, worst: Real, count: Index, inner: Out, new: Out
) -> tuple[Real, Index]:
    """NaN for nodes that have left; the largest error and, if it is above `worst`, its node."""
    above, found = 0, -1
    for j in range(count):
        lost = gone[j] != 0.0 or px[j] != px[j] or py[j] != py[j]
        new[j] = np.nan if lost else new[j]
        inner[j] = -1.0 if lost else inner[j]
        above = above | (inner[j] > worst)
    if above:
        for j in range(count):
            if inner[j] > worst:
                worst = inner[j]
                found = j
    return worst, found


def run_substep(
    start: Index, stop: Index, stages: Index, row: Index, size: Index, moving: Index, step: Real,
    old: Array, new: Out, chosen: Out, p: Array, q: Array, r: Array, at: Array, places: Array,
    bounds: Array, sizes: Array, box0: Array, box1: Array, box2: Array,
) -> None:  # fmt: skip
    """A classical Runge-Kutta step of four stages, or Kutta's of three, of the displacements of the
    points in rows start..stop, from 0 if `old` is empty; NaN of those that may leave the bounds.
    ``chosen[row]``: where its stages say that the error is largest. Node j of a row has entry
    ``row places[2 q] + j places[2 q + 1]`` of array q of four, and its line begins
    ``j places[8]`` further."""
    x, y, z, px, py = numbers(new), numbers(new), numbers(new), numbers(new), numbers(new)
    dx, dy, u, v = numbers(new), numbers(new), numbers(new), numbers(new)
    a, b, begin = numbers(new), numbers(new), numbers(sizes)
    sum_a, sum_b, inner, gone = numbers(new), numbers(new), numbers(new), numbers(new)
    begun = old.size
    old, new, chosen = address(old), address(new), address(chosen)
    p, q, r, bounds, sizes = address(p), address(q), address(r), address(bounds), address(sizes)
    at, places = address(at), address(places)
    box0, box1, box2 = address(box0), address(box1), address(box2)
    for line in range(start, stop):
        worst = -1.0
        # Stage by stage for a short block of nodes: the operations of neighbours overlap.
        for head in range(0, row, _BLOCK):
            first = line * row + head
            count = min(_BLOCK, row - head)
            points_of(p, q, r, at, places, line, head, count, x, y, z, begin)
            for j in range(count):
                dx[j], dy[j], u[j], v[j], py[j] = 0.0, 0.0, 0.0, 0.0, y[j]
                a[j], b[j] = 0.0, 0.0
                sum_a[j], sum_b[j], inner[j], gone[j] = 0.0, 0.0, 0.0, 0.0
            if begun > 0:
                carry(shifted(old, first), count, dx, x)
                if moving == 2:
                    carry(shifted(old, size + first), count, dy, y)
            for stage in range(stages):
                box, shift, back, weight = box1, 0.5 * step, 0.0, 2.0
                if stage == 0:
                    box, shift, weight = box0, 0.0, 1.0
                if stage == stages - 1:
                    box, shift, weight = box2, step, 1.0
                if stages == 3 and stage == 1:
                    weight = 4.0
                if stages == 3 and stage == 2:
                    shift, back = 2.0 * step, -step
                move(x, u, a, shift, back, bounds[0], bounds[1], count, px, gone)
                if moving == 2:
                    move(y, v, b, shift, back, bounds[2], bounds[3], count, py, gone)
                flow(count, px, py, z, begin, box, sizes, u, v)
                if stage == 2:  # the difference of inner stages, or the second one in time
                    more, less = (1.0, 6.0) if stages == 3 else (0.0, 1.0)
                    differ(u, sum_a, a, more, less, count, inner)
                    if moving == 2:
                        differ(v, sum_b, b, more, less, count, inner)
                for j in range(count):
                    sum_a[j] += weight * u[j]
                if moving == 2:
                    for j in range(count):
                        sum_b[j] += weight * v[j]
            scale = step * (1.0 / 6.0)
            finish(x, dx, sum_a, scale, bounds[0], bounds[1], count, px, gone, shifted(new, first))
            if moving == 2:
                to = shifted(new, size + first)
                finish(y, dy, sum_b, scale, bounds[2], bounds[3], count, py, gone, to)
            worst, found = worst_of(px, py, gone, worst, count, inner, shifted(new, first))
            if found >= 0:
                chosen[line] = first + found


@kernel
def quarter(x: Real) -> tuple[Real, Real, Real, Real]:
    """Sine and cosine of x less k quarter turns, and the parity and half of k modulo 4. Reduction
    in three parts and polynomials are those of fdlibm; without branches, so loops of nodes become
    vector code. The error is below 2 units in the last place for abs(x) < 1e6, and of the size of
    x epsilon beyond."""
    k = floor(x * 0.6366197723675814 + 0.5)
    y = x - k * 1.5707963267341256 - k * 6.077100506303966e-11 - k * 2.0222662487959506e-21
    z = y * y
    s = -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10
    s = -1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 + z * s)
    s = y + y * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * s))
    c = 2.08757232129817482790e-09 - z * 1.13596475577881948265e-11
    c = 2.48015872894767294178e-05 + z * (-2.75573143513906633035e-07 + z * c)
    c = 4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * c)
    c = 1.0 - 0.5 * z + z * z * c
    half = floor(0.5 * k)
    return s, c, k - 2.0 * half, half - 2.0 * floor(0.5 * half)


@kernel
def fast_sin(x: Real) -> Real:
    """The sine, as vector code."""
    s, c, odd, turned = quarter(x)
    return (s + odd * (c - s)) * (1.0 - 2.0 * turned)


@kernel
def fast_cos(x: Real) -> Real:
    """The cosine, as vector code."""
    s, c, odd, turned = quarter(x)
    return (c - odd * (c + s)) * (1.0 - 2.0 * turned)


@loop
def run_combine(
    start: Index, stop: Index, a: Array, b: Array, c: Array, d: Array, weights: Array, out: Out,
    more: Out,
) -> None:  # fmt: skip
    """Sums of four arrays with weights, and with four others to `more` unless that is empty; by the
    same code, so with the same bits."""
    sums = 1 + min(more.size, 1)
    a, b, c, d, weights = address(a), address(b), address(c), address(d), address(weights)
    out, more = address(out), address(more)
    near = numbers(a)
    for first in range(start, stop, _BLOCK):
        count = min(_BLOCK, stop - first)
        for q in range(sums):
            wa, wb = weights[4 * q], weights[4 * q + 1]
            wc, wd = weights[4 * q + 2], weights[4 * q + 3]
            to = out
            if q == 1:
                to = more
            for j in range(count):
                o = first + j
                near[j] = wa * a[o] + wb * b[o] + wc * c[o] + wd * d[o]
            for j in range(count):
                to[first + j] = near[j]


@kernel
def slope(one: Real, two: Real, three: Real, four: Real) -> tuple[Real, Real]:
    """Eighth-order difference from those of the neighbours at 1 to 4 cells on both sides, and its
    change from the sixth-order one."""
    more = 0.05 * (one - two) + (6.0 / 280.0) * three - (1.0 / 280.0) * four
    return more + 0.75 * one - 0.15 * two + (1.0 / 60.0) * three, more


@loop
def run_difference(
    start: Index, stop: Index, a: Array, out: Out, said: Out, n: Index, stride: Index,
    periodic: Index, factor: Real, plus: Real, limit: Real,
) -> None:  # fmt: skip
    """Write ``plus + factor`` times the difference along lines for rows start..stop, counted as in
    `cip.engines.cpu_loops.run_lines`; NaN beside walls and where its error may exceed the limit.
    ``said[row]`` is not zero if that occurs."""
    a, out, said = address(a), address(out), address(said)
    i, most = start % n, limit / abs(factor)
    for line in range(start, stop):
        first = line * stride
        worst = 0.0
        if i >= 4 and i < n - 4:
            for o in range(first, first + stride):
                value, more = slope(
                    a[o + stride] - a[o - stride],
                    a[o + 2 * stride] - a[o - 2 * stride],
                    a[o + 3 * stride] - a[o - 3 * stride],
                    a[o + 4 * stride] - a[o - 4 * stride],
                )
                worst = max(worst, abs(more))
                out[o] = plus + factor * value if abs(more) <= most else np.nan
        elif periodic == 1:
            base = first - i * stride
            for o in range(stride):
                value, more = slope(
                    a[base + (i + 1) % n * stride + o] - a[base + (i - 1) % n * stride + o],
                    a[base + (i + 2) % n * stride + o] - a[base + (i - 2) % n * stride + o],
                    a[base + (i + 3) % n * stride + o] - a[base + (i - 3) % n * stride + o],
                    a[base + (i + 4) % n * stride + o] - a[base + (i - 4) % n * stride + o],
                )
                worst = max(worst, abs(more))
                out[first + o] = plus + factor * value if abs(more) <= most else np.nan
        else:
            for o in range(first, first + stride):
                out[o] = np.nan
            worst = np.inf
        said[line] = 0.0
        if worst > most:
            said[line] = 1.0
        i += 1
        if i == n:
            i = 0
