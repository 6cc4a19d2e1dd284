"""Sweeps of the conservative profiles in several dimensions on the CPU: three passes over a line.

First the cell of each foot, for all fields, then of each field the slope of each node, the value at
each foot and the integral from the left end of its cell, last the means, from differences of
neighbours' integrals and the whole cells between. Each
integral is computed once, so what leaves a cell enters the next one. Lines whose nodes are not
contiguous are taken side by side.
"""

from __future__ import annotations

from typing import Any

from cip.engines.cpu_loops import address, at_addresses, shifted
from cip.profiles.catalogue import Limits, Line, Update
from cip.profiles.conservative_kernels import cell_of, mass_of, slope_of
from cip.profiles.conservative_profiles import csl2, csl4
from skfem_adini.ground.jit import Array, Index, Out, kernel, loop

# Lines side by side: slopes and integrals of them stay in the second-level cache.
WIDTH = 32


@kernel
def slopes(
    m: Array, line: Line, value: Index, mean: Index, count: Index, uniform: Index, out: Out
) -> None:
    """The slope of each node of `count` lines, as `slope_of`."""
    n, stride = line.n, line.stride
    inverse = 1.0 / line.h[0]
    for i in range(n):
        inner = i > 0 and i < n - 1
        if uniform == 1 and (line.periodic == 1 or inner):
            before, after = i - 1, i + 1
            if before < 0:
                before = n - 1
            if after == n:
                after = 0
            for q in range(count):
                jump = m[mean + i * stride + q] - m[mean + before * stride + q]
                ends = m[value + after * stride + q] - m[value + before * stride + q]
                out[i * count + q] = inverse * (2.0 * jump - 0.5 * ends)
        else:
            for q in range(count):
                out[i * count + q] = slope_of(m, line, value + q, mean + q, i)


@kernel
def places(
    feet: Array, line: Line, first: Index, count: Index, cell: Out, inside: Out
) -> None:  # fmt: skip
    """The cells of the feet of `count` lines, not reduced modulo the period, and places in them."""
    for i in range(line.n):
        for q in range(count):
            k, s = cell_of(i, feet[first + i * line.stride + q], line.n, line.periodic)
            cell[i * count + q] = k
            inside[i * count + q] = s


@kernel
def values(
    m: Array, feet: Array, out: Out, line: Line, value: Index, mean: Index, first: Index,
    size: Index, count: Index, sloped: Index, slope: Array, cell: Array, inside: Array, left: Out,
    limits: Limits,
) -> None:  # fmt: skip
    """New values of `count` lines, and the integral from the left end of each foot's cell."""
    n, stride = line.n, line.stride
    for i in range(n):
        for q in range(count):
            o = first + i * stride + q
            k, s = cell[i * count + q], inside[i * count + q]
            if k < 0 or k >= n:
                k = k % n
            r = k + 1
            if r == n:
                r = 0
            h = line.h[k]
            va = h * slope[k * count + q]
            vb = h * slope[r * count + q]
            a, b = m[value + k * stride + q], m[value + r * stride + q]
            c = m[mean + k * stride + q]
            if sloped == 1:
                f0, _slope, mass = csl4(a, b, va, vb, c, s, limits)
            else:
                f0, _slope, mass = csl2(a, b, c, s, limits)
            out[value + i * stride + q] = feet[size + o] * f0
            left[i * count + q] = mass * h


@kernel
def new_means(
    m: Array, out: Out, line: Line, mean: Index, count: Index, cell: Array, left: Array
) -> None:
    """New means of `count` lines from the integrals of `values`."""
    n, stride = line.n, line.stride
    cells = n
    if line.periodic == 0:  # the last node has no cell after it, and no width
        cells = n - 1
        for q in range(count):
            out[mean + cells * stride + q] = 0.0
    for i in range(cells):
        after, wrapped = i + 1, 0
        if after == n:
            after, wrapped = 0, n
        inverse = 1.0 / line.h[i]
        for q in range(count):
            k1, k2 = cell[i * count + q], cell[after * count + q] + wrapped
            mass = left[after * count + q] - left[i * count + q]
            if k1 != k2:
                mass = mass + mass_of(m, line, mean + q, k1)
                for k in range(k1 + 1, k2):
                    mass = mass + mass_of(m, line, mean + q, k)
            out[mean + i * stride + q] = mass * inverse


def groups(line: tuple[Any, ...], size: int) -> int:
    """Number of groups of lines."""
    _h, _first, stride, n, _periodic = line
    return size // (n * stride) * -(-stride // WIDTH)


@loop
def run_sweep(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, line: Line, update: Update,
    limits: Limits, sloped: Index, uniform: Index, room: Out, cell: Out, step: Index,
) -> None:  # fmt: skip
    """Sweep groups start..stop of up to `WIDTH` lines; `room` holds ``3 WIDTH n`` numbers, `cell`
    ``WIDTH n`` whole ones."""
    fields, cell = m.size // step, address(cell)
    m, out, feet = address(m), address(out), address(feet)
    line, update, limits = at_addresses(line), Update(*update), Limits(*limits)
    n, stride, size = line.n, line.stride, update.size
    width = min(stride, WIDTH)
    parts = (stride + width - 1) // width
    left, inside = address(room[width * n :]), address(room[2 * width * n :])
    slope = address(room)
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
                        cell, inside, left, limits,
                    )  # fmt: skip
                    new_means(old, new, line, mean, count, cell, left)
                at += 2 * size
