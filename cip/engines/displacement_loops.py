"""Loops of the feet by displacements (`cip.engines.displacements`), and the code of the flow.

A kernel ``flow(p, q, r, at, box, sizes)`` gives the backward velocity, two numbers, at a point
whose first coordinates are those that move. Of a formula, `box` holds what does not depend on the
place; of snapshots, B-spline coefficients at one time, from ``box[at]`` on for the node's line.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy import floor

from cip.engines.cpu_loops import address
from cip.engines.path_kernel import plain
from cip.engines.snapshot_kernel import with_names
from cip.formulas.expression import (
    COORDINATES,
    Expression,
    apply,
    ordered,
    statements,
    variable,
)
from skfem_adini.ground.jit import Array, Index, Out, Real, kernel, loop, room

_BLOCK = 64
numbers = room(_BLOCK)

# Placeholder that `loop_over` replaces by a kernel.
flow: Any = None

_HEAD = (
    "def flow(p: Real, q: Real, r: Real, at: Index, box: Array, sizes: Sizes) -> tuple[Real, Real]:"
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


def formula_source(rates: Sequence[Expression], moving: Sequence[int], held: int) -> str:
    """Source of ``flow`` for backward velocities with `held` numbers from `without_place`."""
    others = [axis for axis in range(3) if axis not in moving]
    names = [COORDINATES[axis] for axis in (*moving, *others)]
    outputs = {f"o{q}": rate for q, rate in enumerate(rates)}
    return "\n".join(
        [
            _HEAD,
            *(f"    {name} = {place}" for name, place in zip(names, "pqr", strict=True)),
            *(f"    b{q} = box[{q}]" for q in range(held)),
            *statements(outputs),
            f"    return o0, {'o1' if len(rates) > 1 else '0.0'}",
            "",
        ]
    )


@cache
def spline_source(degree: int, axes: int, apart: bool = False) -> str:
    """Source of ``flow`` for uniform B-splines on lines or, with interleaved components, in planes.
    `sizes` holds for each direction the cells and whether they are periodic, and then the stride of
    the coefficients on a line, or of their rows in a plane. If `apart`, for devices, the components
    of a plane are one after the other, at a distance that `sizes` ends with."""
    terms = range(degree + 1)
    lines = [_HEAD]
    for axis, place in enumerate("pq"[:axes]):
        n, periodic = f"sizes[{2 * axis}]", f"sizes[{2 * axis + 1}]"
        lines += [
            f"    k{axis} = floor({place})",
            f"    s{axis} = {place} - k{axis}",
            f"    if k{axis} < 0 or k{axis} >= {n}:",
            f"        if {periodic} == 1:",
            f"            k{axis} = k{axis} % {n}",
            "        else:",
            f"            k{axis} = min(max(k{axis}, 0), {n} - 1)",
            f"            s{axis} = {place} - k{axis}",
            *(f"    w{axis}_{j} = {code}" for j, code in enumerate(_weights(degree, f"s{axis}"))),
        ]
    if axes == 1:
        lines.append("    first = at + k0 * sizes[2]")
        total = " + ".join(f"w0_{j} * box[first + {j} * sizes[2]]" for j in terms)
        return "\n".join([*lines, f"    return -({total}), 0.0", ""])
    if apart:
        lines.append("    first = k0 * sizes[4] + k1")
        for c, far in enumerate(("", " + sizes[6]")):
            parts = [
                " + ".join(f"w1_{j} * box[first{far} + {i} * sizes[4] + {j}]" for j in terms)
                for i in terms
            ]
            total = " + ".join(f"w0_{i} * ({part})" for i, part in enumerate(parts))
            lines.append(f"    o{c} = {total}")
        return "\n".join([*lines, "    return -o0, -o1", ""])
    rows = [" + ".join(f"w1_{j} * box[first + {2 * j + c}]" for j in terms) for c in range(2)]
    lines += [
        "    weights = numbers(box)",
        *(f"    weights[{i}] = w0_{i}" for i in terms),
        "    first = k0 * sizes[4] + 2 * k1",
        "    o0 = 0.0",
        "    o1 = 0.0",
        # A loop whose length is no constant: else nodes side by side gather their coefficients,
        # which are contiguous for one node.
        "    for i in range(sizes[5]):",
        f"        o0 = o0 + weights[i] * ({rows[0]})",
        f"        o1 = o1 + weights[i] * ({rows[1]})",
        "        first = first + sizes[4]",
        "    return -o0, -o1",
        "",
    ]
    return "\n".join(lines)


def _weights(degree: int, s: str) -> list[str]:
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


def run_substep(
    start: Index, stop: Index, row: Index, size: Index, moving: Index, step: Real, old: Array,
    new: Out, chosen: Out, p: Array, q: Array, r: Array, at: Array, bounds: Array, sizes: Array,
    box0: Array, box1: Array, box2: Array,
) -> None:  # fmt: skip
    """A classical Runge-Kutta step of the displacements of the points in rows start..stop; NaN of
    those that may leave the bounds. ``chosen[row]``: where its inner stages differ most."""
    x, y, a, b = numbers(old), numbers(old), numbers(old), numbers(old)
    sum_a, sum_b, inner, gone = numbers(old), numbers(old), numbers(old), numbers(old)
    old, new, chosen, at = address(old), address(new), address(chosen), address(at)
    p, q, r, bounds, sizes = address(p), address(q), address(r), address(bounds), address(sizes)
    box0, box1, box2 = address(box0), address(box1), address(box2)
    for line in range(start, stop):
        end, worst = min((line + 1) * row, size), -1.0
        # Stage by stage for a short block of nodes: the operations of neighbours overlap.
        for first in range(line * row, end, _BLOCK):
            count = min(_BLOCK, end - first)
            for j in range(count):
                x[j] = p[first + j] + old[first + j]
                y[j] = q[first + j]
                if moving == 2:
                    y[j] = q[first + j] + old[size + first + j]
                a[j], b[j], sum_a[j], sum_b[j], inner[j], gone[j] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for stage in range(4):
                box, shift, weight = box1, 0.5 * step, 2.0
                if stage == 0:
                    box, shift, weight = box0, 0.0, 1.0
                if stage == 3:
                    box, shift, weight = box2, step, 1.0
                for j in range(count):
                    o = first + j
                    px, py = x[j] + shift * a[j], y[j] + shift * b[j]
                    if px < bounds[0] or px > bounds[1]:
                        gone[j] = 1.0
                    if moving == 2 and (py < bounds[2] or py > bounds[3]):
                        gone[j] = 1.0
                    u, v = flow(px, py, r[o], at[o], box, sizes)
                    if stage == 2:
                        inner[j] = abs(u - a[j]) + abs(v - b[j])
                    sum_a[j] += weight * u
                    sum_b[j] += weight * v
                    a[j], b[j] = u, v
            for j in range(count):
                o = first + j
                u = step * (1.0 / 6.0) * sum_a[j]
                v = step * (1.0 / 6.0) * sum_b[j]
                inside = gone[j] == 0.0 and x[j] + u >= bounds[0] and x[j] + u <= bounds[1]
                if moving == 2:
                    inside = inside and y[j] + v >= bounds[2] and y[j] + v <= bounds[3]
                    new[size + o] = old[size + o] + v
                new[o] = old[o] + u
                if not inside:
                    new[o] = np.nan
                elif inner[j] > worst:
                    worst = inner[j]
                    chosen[line] = o


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
    start: Index, stop: Index, a: Array, b: Array, c: Array, d: Array, weights: Array, out: Out
) -> None:
    """Sum of four arrays with weights."""
    a, b, c, d, out = address(a), address(b), address(c), address(d), address(out)
    wa, wb, wc, wd = weights[0], weights[1], weights[2], weights[3]
    for o in range(start, stop):
        out[o] = wa * a[o] + wb * b[o] + wc * c[o] + wd * d[o]


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
