"""Planes on the CPU without limiter, a short block of nodes at a time.

The arithmetic of a node can be vectorized, its scattered reads cannot (processors read one number
at a time there, and gather instructions are slower still). Each block of a row is therefore done in
three loops: the cells of the feet, copying the moments at the corners of these cells side by side,
the profile. The arrays of a block stay in the first-level cache. A single loop takes about twice as
long.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from cip.engines.cpu_loops import address, at_addresses
from cip.jit import Array, Index, Out, kernel, loop, room
from cip.profiles.line_profiles import locate
from cip.profiles.plane_kernels import adini_profile, bicubic_profile, move_adini, move_bicubic
from cip.profiles.records import Corners, Foot, Line, Update

# Nodes of a block: its arrays, up to 30 numbers a node, take 15 kB of the first-level cache.
_PLANE_BLOCK = 64

numbers = room(4 * _PLANE_BLOCK)


@kernel
def places(
    feet: Array, size: Index, o: Index, count: Index, i: Index, j: Index, x: Line, y: Line,
    at: Out, inside: Out,
) -> None:  # fmt: skip
    """Write the cells of the feet of `count` nodes in a row (`at`), places in them (`inside`)."""
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
    """Copy moment after moment at the four corners of the cells, then the widths, to `near`. The
    widths of a uniform grid are there already, from `corner_room`.
    """
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
def beside(near: Array, moment: Index, q: Index) -> Corners:
    """A moment at the corners of the cell of node q of the block."""
    row = 4 * moment * _PLANE_BLOCK + q
    return Corners(
        near[row],
        near[row + _PLANE_BLOCK],
        near[row + 2 * _PLANE_BLOCK],
        near[row + 3 * _PLANE_BLOCK],
    )


@kernel
def adini_block(
    near: Array, inside: Array, feet: Array, size: Index, o: Index, count: Index, advect: Index,
    new: Out,
) -> None:  # fmt: skip
    """Write the new moments of a block, Adini's profile."""
    B = _PLANE_BLOCK
    for q in range(count):
        u, ux, uy = beside(near, 0, q), beside(near, 1, q), beside(near, 2, q)
        a, b = near[12 * B + q], near[13 * B + q]
        value, fx, fy = adini_profile(u, ux, uy, a, b, inside[q], inside[B + q])
        move_adini(value, fx, fy, Foot(feet, size, o + q), advect, new, B, q)


@kernel
def bicubic_block(
    near: Array, inside: Array, feet: Array, size: Index, o: Index, count: Index, advect: Index,
    new: Out,
) -> None:  # fmt: skip
    """Write the new moments of a block, bicubic profile."""
    B = _PLANE_BLOCK
    for q in range(count):
        u, ux = beside(near, 0, q), beside(near, 1, q)
        uy, uxy = beside(near, 2, q), beside(near, 3, q)
        a, b = near[16 * B + q], near[17 * B + q]
        value, fx, fy, fxx, fxy, fyy = bicubic_profile(
            u, ux, uy, uxy, a, b, inside[q], inside[B + q]
        )
        foot = Foot(feet, size, o + q)
        move_bicubic(value, fx, fy, fxx, fxy, fyy, foot, advect, new, B, q)


@kernel
def keep(new: Array, moments: Index, size: Index, count: Index, out: Out, o: Index) -> None:
    """Copy the new moments of a block to the array of all new moments."""
    for moment in range(moments):
        for q in range(count):
            out[moment * size + o + q] = new[moment * _PLANE_BLOCK + q]


def corner_room(moments: int, dtype: DTypeLike, *widths: Array) -> Any:
    """Memory for the moments at the corners of a block; widths preset to those of the first cell.
    Allocated outside the compiled loop on purpose: as it may overlap the moments, the compiler
    avoids gather instructions, which are slower, for the scattered reads."""
    near = np.empty((4 * moments + len(widths), _PLANE_BLOCK), dtype)
    for row, width in zip(near[4 * moments :], widths, strict=True):
        row[:] = width[0]
    return near.reshape(-1)


@loop
def run_adini(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, x: Line, y: Line, update: Update,
    uniform: Index, near: Out,
) -> None:  # fmt: skip
    """Rows start..stop of a plane, Adini's profile."""
    at, inside, new = numbers(np.empty(1, np.int64)), numbers(m), numbers(m)
    m, out, feet, near = address(m), address(out), address(feet), address(near)
    x, y, update = at_addresses(x), at_addresses(y), Update(*update)
    size, ny = update.size, y.n
    for i in range(start, stop):
        for j in range(0, ny, _PLANE_BLOCK):
            count = min(_PLANE_BLOCK, ny - j)
            o = i * ny + j
            places(feet, size, o, count, i, j, x, y, at, inside)
            corners(m, size, 3, x, y, uniform, count, at, near)
            adini_block(near, inside, feet, size, o, count, update.advect, new)
            keep(new, 3, size, count, out, o)


@loop
def run_bicubic(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, x: Line, y: Line, update: Update,
    uniform: Index, near: Out,
) -> None:  # fmt: skip
    """Rows start..stop of a plane, bicubic profile."""
    at, inside, new = numbers(np.empty(1, np.int64)), numbers(m), numbers(m)
    m, out, feet, near = address(m), address(out), address(feet), address(near)
    x, y, update = at_addresses(x), at_addresses(y), Update(*update)
    size, ny = update.size, y.n
    for i in range(start, stop):
        for j in range(0, ny, _PLANE_BLOCK):
            count = min(_PLANE_BLOCK, ny - j)
            o = i * ny + j
            places(feet, size, o, count, i, j, x, y, at, inside)
            corners(m, size, 4, x, y, uniform, count, at, near)
            bicubic_block(near, inside, feet, size, o, count, update.advect, new)
            keep(new, 4, size, count, out, o)
