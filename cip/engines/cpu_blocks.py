"""The cubic on a line, and planes, on the CPU without limiter: a short block of nodes at a time.

The arithmetic of a node can be vectorized, its scattered reads cannot (processors read one number
at a time there, and gather instructions are slower still). Each block of a row is therefore done in
three loops: the cells of the feet, copying the moments at the corners of these cells side by side,
the profile. The arrays of a block stay in the first-level cache. A single loop takes about twice as
long. If all feet of a block on a line are the same number of whole cells from their nodes, as for
smooth velocities nearly everywhere, the cells are contiguous and the profile reads the moments
directly, without copying them.
"""

from __future__ import annotations

from math import floor
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from cip.engines.cpu_loops import address, at_addresses, shifted
from cip.profiles.catalogue import Corners, Foot, Line, Update
from cip.profiles.line_kernels import move_cubic
from cip.profiles.line_profiles import cubic, locate
from cip.profiles.plane_kernels import adini_profile, bicubic_profile, move_adini, move_bicubic
from skfem_adini.ground.jit import Array, Index, Out, Real, kernel, loop, room

# Nodes of a block: its arrays, 7 numbers a node on lines and up to 30 in planes, take 7 and 15 kB
# of the first-level cache.
_LINE_BLOCK, _PLANE_BLOCK = 128, 64
# Rows in which one field follows another: their feet stay in the second-level cache. A block of all
# fields at once would read more streams than a cache has places for.
_TILE = 16

line_numbers = room(_LINE_BLOCK)
plane_numbers = room(4 * _PLANE_BLOCK)
# Placeholder that `loop_over` replaces by a kernel.
block: Any = None


def block_room(moments: int, dtype: DTypeLike, widths: list[Any]) -> Any:
    """Memory for the moments at the corners of a block; widths preset to those of the first cell.
    It is allocated outside the compiled loop because the compiler must then assume that it overlaps
    the moments, and avoids gather instructions, which are slower for the scattered reads."""
    dim, nodes = len(widths), (_LINE_BLOCK, _PLANE_BLOCK)[len(widths) - 1]
    near = np.empty((2**dim * moments + dim, nodes), dtype)
    near[2**dim * moments :] = np.array([width[0] for width in widths])[:, None]
    return near.reshape(-1)


@kernel
def offsets(feet: Array, o: Index, count: Index, at: Out, inside: Out) -> tuple[Index, Index]:
    """Split the displacements of nodes o, .., o + count - 1 into whole cells (`at`) and fractions
    (`inside`); return the least and the largest number of whole cells."""
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
def line_places(
    feet: Array, o: Index, count: Index, n: Index, periodic: Index, at: Out, inside: Out
) -> None:
    """Compute the cells of the feet of `count` nodes (`at`) and places in them (`inside`)."""
    for q in range(count):
        k, _right, s = locate(o + q, feet[o + q], n, periodic)
        at[q] = k
        inside[q] = s


@kernel
def ends(m: Array, n: Index, h: Array, uniform: Index, count: Index, at: Array, near: Out) -> None:
    """Copy values and slopes at both ends of the cells, then the cell widths, to `near`."""
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
    """As `ends`, for cells ``first + q + at[q]`` of nodes q that do not wrap around the period."""
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


@loop
def run_cubic(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, line: Line, update: Update,
    uniform: Index, near: Out, step: Index,
) -> None:  # fmt: skip
    """The new moments of nodes start..stop of the line, of all fields."""
    fields = m.size // step
    at, inside = line_numbers(np.empty(1, np.int64)), line_numbers(m)
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
            line_places(feet, o, count, n, periodic, at, inside)
            for f in range(fields):
                ends(shifted(m, f * step), n, h, uniform, count, at, near)
                cubic_block(near, inside, feet, n, o, count, advect, shifted(out, f * step))
        elif low == high and uniform == 1:
            for f in range(fields):
                old, new = shifted(m, f * step), shifted(out, f * step)
                cubic_row(old, first + low, h[0], inside, feet, n, o, count, advect, new)
        else:
            for f in range(fields):
                near_ends(shifted(m, f * step), n, h, uniform, count, first, at, near)
                cubic_block(near, inside, feet, n, o, count, advect, shifted(out, f * step))


@kernel
def plane_places(
    feet: Array, size: Index, o: Index, count: Index, i: Index, j: Index, x: Line, y: Line,
    at: Out, inside: Out,
) -> None:  # fmt: skip
    """Compute the cells of the feet of `count` nodes of a row (`at`), places in them (`inside`)."""
    for q in range(count):
        k, _right, s = locate(i, feet[o + q], x.n, x.periodic)
        l, _right, t = locate(j + q, feet[size + o + q], y.n, y.periodic)
        at[q] = k
        at[_PLANE_BLOCK + q] = l
        inside[q] = s
        inside[_PLANE_BLOCK + q] = t


@kernel
def corners(
    m: Array, size: Index, moments: Index, x: Line, y: Line, uniform: Index, count: Index,
    at: Array, near: Out,
) -> None:  # fmt: skip
    """Copy each moment at the four corners of the cells, then the widths, to `near`. On a uniform
    grid `block_room` has already set the widths."""
    for q in range(count):
        k = at[q]
        l = at[_PLANE_BLOCK + q]
        kr = k + 1
        if kr == x.n:
            kr = 0
        lr = l + 1
        if lr == y.n:
            lr = 0
        low = k * y.n
        high = kr * y.n
        for moment in range(moments):
            row = 4 * moment * _PLANE_BLOCK + q
            near[row] = m[low + l]
            near[row + _PLANE_BLOCK] = m[high + l]
            near[row + 2 * _PLANE_BLOCK] = m[low + lr]
            near[row + 3 * _PLANE_BLOCK] = m[high + lr]
            low += size
            high += size
        if uniform == 0:
            row = 4 * moments * _PLANE_BLOCK + q
            near[row] = x.h[k]
            near[row + _PLANE_BLOCK] = y.h[l]


@kernel
def corner_values(near: Array, moment: Index, q: Index) -> Corners:
    """A moment at the corners of the cell of node q of the block."""
    row = 4 * moment * _PLANE_BLOCK + q
    return Corners(
        near[row],
        near[row + _PLANE_BLOCK],
        near[row + 2 * _PLANE_BLOCK],
        near[row + 3 * _PLANE_BLOCK],
    )


@kernel
def keep(new: Array, moments: Index, size: Index, count: Index, out: Out, o: Index) -> None:
    """Copy the new moments of a block to the array of all nodes."""
    for moment in range(moments):
        for q in range(count):
            out[moment * size + o + q] = new[moment * _PLANE_BLOCK + q]


@kernel
def adini_block(
    m: Array, out: Out, feet: Array, x: Line, y: Line, update: Update, uniform: Index, o: Index,
    count: Index, at: Array, inside: Array, near: Out, new: Out,
) -> None:  # fmt: skip
    """Write the new moments of a block, Adini's profile."""
    B, size, advect = _PLANE_BLOCK, update.size, update.advect
    corners(m, size, 3, x, y, uniform, count, at, near)
    for q in range(count):
        u, ux, uy = corner_values(near, 0, q), corner_values(near, 1, q), corner_values(near, 2, q)
        a, b = near[12 * B + q], near[13 * B + q]
        value, fx, fy = adini_profile(u, ux, uy, a, b, inside[q], inside[B + q])
        move_adini(value, fx, fy, Foot(feet, size, o + q), advect, new, B, q)
    keep(new, 3, size, count, out, o)


@kernel
def bicubic_block(
    m: Array, out: Out, feet: Array, x: Line, y: Line, update: Update, uniform: Index, o: Index,
    count: Index, at: Array, inside: Array, near: Out, new: Out,
) -> None:  # fmt: skip
    """Write the new moments of a block, bicubic profile."""
    B, size, advect = _PLANE_BLOCK, update.size, update.advect
    corners(m, size, 4, x, y, uniform, count, at, near)
    for q in range(count):
        u, ux = corner_values(near, 0, q), corner_values(near, 1, q)
        uy, uxy = corner_values(near, 2, q), corner_values(near, 3, q)
        a, b = near[16 * B + q], near[17 * B + q]
        value, fx, fy, fxx, fxy, fyy = bicubic_profile(
            u, ux, uy, uxy, a, b, inside[q], inside[B + q]
        )
        foot = Foot(feet, size, o + q)
        move_bicubic(value, fx, fy, fxx, fxy, fyy, foot, advect, new, B, q)
    keep(new, 4, size, count, out, o)


def run_plane_blocks(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, x: Line, y: Line, update: Update,
    uniform: Index, near: Out, step: Index,
) -> None:  # fmt: skip
    """Update rows start..stop of a plane, of all fields."""
    fields = m.size // step
    at, inside, new = plane_numbers(np.empty(1, np.int64)), plane_numbers(m), plane_numbers(m)
    m, out, feet, near = address(m), address(out), address(feet), address(near)
    x, y, update = at_addresses(x), at_addresses(y), Update(*update)
    for first in range(start, stop, _TILE):
        for f in range(fields):
            old, to = shifted(m, f * step), shifted(out, f * step)
            for i in range(first, min(first + _TILE, stop)):
                for j in range(0, y.n, _PLANE_BLOCK):
                    count = min(_PLANE_BLOCK, y.n - j)
                    o = i * y.n + j
                    plane_places(feet, update.size, o, count, i, j, x, y, at, inside)
                    block(old, to, feet, x, y, update, uniform, o, count, at, inside, near, new)
