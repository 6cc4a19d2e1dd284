"""Sweeps of the conservative profiles in several dimensions on the CPU: three passes over a line.

First the slope of each node, then the value at each foot and the integral from the left end of its
cell, last the means, from differences of neighbours' integrals and the whole cells between. Each
integral is computed once, so what leaves a cell enters the next one. Lines whose nodes are not
contiguous are taken side by side.
"""

from __future__ import annotations

from typing import Any

from cip.engines.cpu_loops import address, at_addresses
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
def values(
    m: Array, feet: Array, out: Out, line: Line, value: Index, mean: Index, first: Index,
    size: Index, count: Index, sloped: Index, slope: Array, left: Out, limits: Limits,
) -> None:  # fmt: skip
    """New values of `count` lines, and the integral from the left end of each foot's cell."""
    n, stride = line.n, line.stride
    for i in range(n):
        for q in range(count):
            o = first + i * stride + q
            k, s = cell_of(i, feet[o], n, line.periodic)
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
    m: Array, feet: Array, out: Out, line: Line, mean: Index, first: Index, count: Index,
    left: Array,
) -> None:  # fmt: skip
    """New means of `count` lines from the integrals of `values`."""
    n, stride, periodic = line.n, line.stride, line.periodic
    for i in range(n):
        after = i + 1
        if after == n:
            after = 0
        inverse = 0.0
        if periodic == 1 or i < n - 1:
            inverse = 1.0 / line.h[i]
        for q in range(count):
            k1, _s = cell_of(i, feet[first + i * stride + q], n, periodic)
            k2, _s = cell_of(i + 1, feet[first + after * stride + q], n, periodic)
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
    limits: Limits, sloped: Index, uniform: Index, room: Out,
) -> None:  # fmt: skip
    """Sweep groups start..stop of up to `WIDTH` lines; `room` holds ``2 WIDTH n`` numbers."""
    m, out, feet = address(m), address(out), address(feet)
    line, update, limits = at_addresses(line), Update(*update), Limits(*limits)
    n, stride, size = line.n, line.stride, update.size
    width = min(stride, WIDTH)
    parts = (stride + width - 1) // width
    left = address(room[width * n :])
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
                if sloped == 1:
                    slopes(m, line, value, mean, count, uniform, slope)
                values(
                    m, feet, out, line, value, mean, at + first, size, count, sloped, slope, left,
                    limits,
                )  # fmt: skip
                new_means(m, feet, out, line, mean, at + first, count, left)
                at += 2 * size
