"""Sweeps of the conservative profiles in several dimensions on the CPU: three passes over a line.

First the cell of each foot, for all fields, then of each field the slope of each node, the value at
each foot and the integral from the left end of its cell, last the means, from differences of
neighbours' integrals and the whole cells between. Each
integral is computed once, so what leaves a cell enters the next one. Lines whose nodes are not
contiguous are taken side by side. Nodes that are neighbours in memory form runs: of one line, or
one node each of lines side by side. Where the feet of a run lie in cells that are neighbours too,
as for smooth velocities nearly everywhere, all of it is vector code.
"""

from __future__ import annotations

from typing import Any

from cip.engines.cpu_loops import address, at_addresses, shifted
from cip.profiles.catalogue import Limits, Line, Update
from cip.profiles.conservative_kernels import cell_of, mass_of, slope_of
from cip.profiles.conservative_profiles import csl2, csl4
from skfem_adini.ground.jit import Array, Index, Out, Real, kernel, loop, room

# Lines side by side: slopes and integrals of them stay in the second-level cache; and nodes of a
# run of one line.
WIDTH, _RUN = 32, 64
numbers = room(_RUN)


@kernel
def run_of(number: Index, line: Line, count: Index, end: Index) -> tuple[Index, Index, Index]:
    """The first node of a run, the number of its nodes, and by how many cells they follow each
    other, among nodes before `end`."""
    if line.stride > 1:
        return number, count, 0
    return number * _RUN, min(_RUN, end - number * _RUN), 1


@kernel
def cells_of_run(
    cell: Array, at: Index, length: Index, n: Index, along: Index, uniform: Index
) -> tuple[Index, Index]:
    """The cell of the first foot of a run, reduced modulo the period, and 1 if those of the others
    are its neighbours and of equal width."""
    k, apart = cell[at], 0
    for q in range(length):
        apart = apart | (cell[at + q] - k - along * q)
    k = k % n
    if apart != 0 or (along == 1 and (uniform == 0 or k + length >= n)):
        return k, 0
    return k, 1


@kernel
def slope_run(
    m: Array, value: Index, mean: Index, o: Index, before: Index, after: Index, length: Index,
    inverse: Real, out: Out,
) -> None:  # fmt: skip
    """Slopes of nodes that are neighbours in memory, on a uniform grid."""
    for q in range(length):
        jump = m[mean + o + q] - m[mean + before + q]
        ends = m[value + after + q] - m[value + before + q]
        out[q] = inverse * (2.0 * jump - 0.5 * ends)


@kernel
def slopes(
    m: Array, line: Line, value: Index, mean: Index, count: Index, uniform: Index, out: Out
) -> None:
    """The slope of each node of `count` lines, as `slope_of`."""
    n, stride, i = line.n, line.stride, 0
    inverse = 1.0 / line.h[0]
    while i < n:
        rows = 1
        if uniform == 1 and (line.periodic == 1 or (i > 0 and i < n - 1)):
            if stride == 1 and i > 0 and i < n - 1:
                rows = n - 1 - i
            before, after = (i - 1 + n) % n * stride, (i + 1) % n * stride
            to = shifted(out, i * count)
            slope_run(m, value, mean, i * stride, before, after, rows * count, inverse, to)
        else:
            for q in range(count):
                out[i * count + q] = slope_of(m, line, value + q, mean + q, i)
        i += rows


@kernel
def places(
    feet: Array, line: Line, first: Index, count: Index, cell: Out, inside: Out
) -> None:  # fmt: skip
    """The cells of the feet of `count` lines, not reduced modulo the period, and places in them."""
    for number in range(line.n if line.stride > 1 else (line.n - 1) // _RUN + 1):
        i, length, along = run_of(number, line, count, line.n)
        for q in range(length):
            d = feet[first + i * line.stride + q]
            k, s = cell_of(i + along * q, d, line.n, line.periodic)
            cell[i * count + q] = k
            inside[i * count + q] = s


@kernel
def values(
    m: Array, feet: Array, out: Out, line: Line, value: Index, mean: Index, first: Index,
    size: Index, count: Index, sloped: Index, slope: Array, cell: Array, inside: Array, left: Out,
    limits: Limits, uniform: Index,
) -> None:  # fmt: skip
    """New values of `count` lines, and the integral from the left end of each foot's cell."""
    n, stride = line.n, line.stride
    found, mass_found = numbers(inside), numbers(inside)
    # With a constant the compiler removes the code of limiters.
    free = Limits(0, limits.low, limits.high, limits.slack)
    for number in range(n if stride > 1 else (n - 1) // _RUN + 1):
        i, length, along = run_of(number, line, count, n)
        at, o = i * count, i * stride
        k, near = cells_of_run(cell, at, length, n, along, uniform)
        if near == 1 and limits.limiter == 0:
            r = (k + 1) % n
            h, ka, ra = line.h[k], k * stride, r * stride
            if sloped == 1:
                for q in range(length):
                    a, b, c = m[value + ka + q], m[value + ra + q], m[mean + ka + q]
                    va, vb = h * slope[k * count + q], h * slope[r * count + q]
                    f0, _slope, mass = csl4(a, b, va, vb, c, inside[at + q], free)
                    found[q], mass_found[q] = f0, mass * h
            else:
                for q in range(length):
                    a, b, c = m[value + ka + q], m[value + ra + q], m[mean + ka + q]
                    f0, _slope, mass = csl2(a, b, c, inside[at + q], free)
                    found[q], mass_found[q] = f0, mass * h
        else:
            for q in range(length):
                k = cell[at + q] % n
                r = (k + 1) % n
                h, side = line.h[k], q * (1 - along)
                a, b = m[value + k * stride + side], m[value + r * stride + side]
                c = m[mean + k * stride + side]
                va, vb = h * slope[k * count + side], h * slope[r * count + side]
                if sloped == 1:
                    f0, _slope, mass = csl4(a, b, va, vb, c, inside[at + q], limits)
                else:
                    f0, _slope, mass = csl2(a, b, c, inside[at + q], limits)
                found[q], mass_found[q] = f0, mass * h
        for q in range(length):
            out[value + o + q] = feet[size + first + o + q] * found[q]
            left[at + q] = mass_found[q]


@kernel
def new_means(
    m: Array, out: Out, line: Line, mean: Index, count: Index, cell: Array, left: Array,
    uniform: Index,
) -> None:  # fmt: skip
    """New means of `count` lines from the integrals of `values`."""
    n, stride = line.n, line.stride
    found = numbers(left)
    cells = n
    if line.periodic == 0:  # the last node has no cell after it, and no width
        cells = n - 1
        for q in range(count):
            out[mean + cells * stride + q] = 0.0
    # On one line the last cell, whose right end is the first node, is a run of its own.
    last = cells if stride > 1 else n - 1
    runs = last if stride > 1 else (last - 1) // _RUN + 1
    for number in range(runs + (cells - last)):
        i, length, along = run_of(number, line, count, last)
        if number == runs:
            i, length = last, 1
        after, wrapped = i + 1, 0
        if after == n:
            after, wrapped = 0, n
        at, to, o = i * count, after * count, i * stride
        k, near = cells_of_run(cell, at, length, n, along, uniform)
        whole, uneven = cell[to] + wrapped - cell[at], 0
        for q in range(length):
            found[q] = left[to + q] - left[at + q]
            uneven = uneven | (cell[to + q] + wrapped - cell[at + q] - whole)
        if near == 1 and uneven == 0 and (along == 0 or k + whole + length <= n):
            for more in range(whole):
                c = (k + more) % n
                for q in range(length):
                    found[q] += m[mean + c * stride + q] * line.h[c]
        else:
            for q in range(length):
                side = mean + q * (1 - along)
                for c in range(cell[at + q], cell[to + q] + wrapped):
                    found[q] += mass_of(m, line, side, c)
        for q in range(length):
            out[mean + o + q] = found[q] * (1.0 / line.h[i + along * q])


def groups(line: tuple[Any, ...], size: int) -> int:
    """Number of groups of lines."""
    _h, _first, stride, n, _periodic = line
    return size // (n * stride) * -(-stride // WIDTH)


@loop
def run_sweep(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, line: Line, update: Update,
    limits: Limits, sloped: Index, uniform: Index, space: Out, cell: Out, step: Index,
) -> None:  # fmt: skip
    """Sweep groups start..stop of up to `WIDTH` lines; `space` holds ``3 WIDTH n`` numbers, `cell`
    ``WIDTH n`` whole ones."""
    fields, cell = m.size // step, address(cell)
    m, out, feet = address(m), address(out), address(feet)
    line, update, limits = at_addresses(line), Update(*update), Limits(*limits)
    n, stride, size = line.n, line.stride, update.size
    width = min(stride, WIDTH)
    parts = (stride + width - 1) // width
    left, inside = address(space[width * n :]), address(space[2 * width * n :])
    slope = address(space)
    bit = 1 << update.axis
    for group in range(start, stop):
        q = group % parts * width
        count = min(width, stride - q)
        first = group // parts * n * stride + q
        at = 0
        for pair in range(1 << update.dim):
            if pair & bit == 0:
                value = pair * size + first
                mean = (pair + bit) * size + first
                places(feet, line, at + first, count, cell, inside)
                for f in range(fields):
                    old, new = shifted(m, f * step), shifted(out, f * step)
                    if sloped == 1:
                        slopes(old, line, value, mean, count, uniform, slope)
                    values(
                        old, feet, new, line, value, mean, at + first, size, count, sloped, slope,
                        cell, inside, left, limits, uniform,
                    )  # fmt: skip
                    new_means(old, new, line, mean, count, cell, left, uniform)
                at += 2 * size
