"""The cubic profile on one line on the CPU without limiter, a short block of nodes at a time.

As in `cip.engines.plane_blocks`, and for the same reason, a block is done in three loops: the cells
of the feet, the moments at the ends of these cells, the profile. If all feet of a block are the
same number of whole cells from their nodes, as for smooth velocities nearly everywhere, the cells
are contiguous and the profile reads the moments directly, without copying them.
"""

from __future__ import annotations

from math import floor
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from cip.engines.cpu_loops import address, at_addresses
from cip.jit import Array, Index, Out, Real, kernel, loop, room
from cip.profiles.line_kernels import move_cubic
from cip.profiles.line_profiles import cubic, locate
from cip.profiles.records import Foot, Line, Update

# Nodes of a block: its arrays, 7 numbers a node, take 7 kB of the first-level cache.
_LINE_BLOCK = 128

numbers = room(_LINE_BLOCK)


@kernel
def offsets(feet: Array, o: Index, count: Index, at: Out, inside: Out) -> tuple[Index, Index]:
    """Split the displacements of nodes o, .., o + count - 1 into whole cells (`at`) and fractions
    (`inside`); return the least and the largest number of whole cells.
    """
    low = floor(feet[o])
    high = low
    for q in range(count):
        f = floor(feet[o + q])
        at[q] = f
        inside[q] = feet[o + q] - f
        low = min(low, f)
        high = max(high, f)
    return low, high


@kernel
def places(
    feet: Array, o: Index, count: Index, n: Index, periodic: Index, at: Out, inside: Out
) -> None:
    """Write the cells of the feet of `count` nodes (`at`) and the places in them (`inside`)."""
    for q in range(count):
        k, _right, s = locate(o + q, feet[o + q], n, periodic)
        at[q] = k
        inside[q] = s


@kernel
def ends(m: Array, n: Index, h: Array, uniform: Index, count: Index, at: Array, near: Out) -> None:
    """Copy values and slopes at both ends of the cells, then their widths, to `near`."""
    for q in range(count):
        k = at[q]
        r = k + 1
        if r == n:
            r = 0
        near[q] = m[k]
        near[_LINE_BLOCK + q] = m[r]
        near[2 * _LINE_BLOCK + q] = m[n + k]
        near[3 * _LINE_BLOCK + q] = m[n + r]
        if uniform == 0:
            near[4 * _LINE_BLOCK + q] = h[k]


@kernel
def near_ends(
    m: Array, n: Index, h: Array, uniform: Index, count: Index, first: Index, at: Array, near: Out
) -> None:
    """As `ends`; node q's cell is ``first + q + at[q]``, and none wraps around the period."""
    for q in range(count):
        k = first + q + at[q]
        near[q] = m[k]
        near[_LINE_BLOCK + q] = m[k + 1]
        near[2 * _LINE_BLOCK + q] = m[n + k]
        near[3 * _LINE_BLOCK + q] = m[n + k + 1]
        if uniform == 0:
            near[4 * _LINE_BLOCK + q] = h[k]


@kernel
def cubic_block(
    near: Array, inside: Array, feet: Array, n: Index, o: Index, count: Index, advect: Index,
    out: Out,
) -> None:  # fmt: skip
    """Write the new values and slopes of a block."""
    for q in range(count):
        width = near[4 * _LINE_BLOCK + q]
        va = width * near[2 * _LINE_BLOCK + q]
        vb = width * near[3 * _LINE_BLOCK + q]
        value, slope = cubic(near[q], near[_LINE_BLOCK + q], va, vb, inside[q])
        move_cubic(value, slope / width, Foot(feet, n, o + q), advect, out, n, o + q)


@kernel
def cubic_row(
    m: Array, k: Index, width: Real, inside: Array, feet: Array, n: Index, o: Index, count: Index,
    advect: Index, out: Out,
) -> None:  # fmt: skip
    """As `cubic_block` for contiguous cells k, k + 1, .. of equal width, read from `m` directly."""
    cells = 1.0 / width
    for q in range(count):
        va = width * m[n + k + q]
        vb = width * m[n + k + q + 1]
        value, slope = cubic(m[k + q], m[k + q + 1], va, vb, inside[q])
        move_cubic(value, cells * slope, Foot(feet, n, o + q), advect, out, n, o + q)


def end_room(dtype: DTypeLike, h: Array) -> Any:
    """Memory for the moments at the ends of a block of cells; widths preset to the first one."""
    near = np.empty(5 * _LINE_BLOCK, dtype)
    near[4 * _LINE_BLOCK :] = h[0]
    return near


@loop
def run_cubic(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, line: Line, update: Update,
    uniform: Index, near: Out,
) -> None:  # fmt: skip
    """The new moments of nodes start..stop of the line."""
    at, inside = numbers(np.empty(1, np.int64)), numbers(m)
    m, out, feet, near = address(m), address(out), address(feet), address(near)
    line, advect = at_addresses(line), Update(*update).advect
    h, n, periodic = line.h, line.n, line.periodic
    for o in range(start, stop, _LINE_BLOCK):
        count = min(_LINE_BLOCK, stop - o)
        low, high = offsets(feet, o, count, at, inside)
        first = o
        if periodic == 1:
            first = o - (o + low) // n * n
        if first + low < 0 or first + high + count >= n:
            places(feet, o, count, n, periodic, at, inside)
            ends(m, n, h, uniform, count, at, near)
            cubic_block(near, inside, feet, n, o, count, advect, out)
        elif low == high and uniform == 1:
            cubic_row(m, first + low, h[0], inside, feet, n, o, count, advect, out)
        else:
            near_ends(m, n, h, uniform, count, first, at, near)
            cubic_block(near, inside, feet, n, o, count, advect, out)
