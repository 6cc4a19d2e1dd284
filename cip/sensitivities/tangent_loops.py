"""The change of all new moments with the feet, over all nodes on the CPU."""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.engines.cpu_loops import address, at_addresses, share
from cip.jit import Array, Index, Out, loop_over
from cip.profiles.records import Line
from cip.sensitivities.blocks import Block
from cip.sensitivities.grid_lines import lines_of
from cip.sensitivities.mass_derivatives import mean_changes
from cip.sensitivities.node_tangent import push_kernel

# `loop_over` replaces it by a kernel.
push: Any = None


def run_plane(
    start: Index, stop: Index, m: Array, d: Array, out: Out, feet: Array, size: Index,
    x: Line, y: Line,
) -> None:  # fmt: skip
    """Rows start..stop of a plane."""
    m, d, out, feet = address(m), address(d), address(out), address(feet)
    x, y = at_addresses(x), at_addresses(y)
    for i in range(start, stop):
        for j in range(y.n):
            o = i * y.n + j
            push(m, d, out, feet, size, o, x, y, size, o, i, j)


def run_sweep(
    start: Index, stop: Index, m: Array, d: Array, out: Out, feet: Array, size: Index, x: Line
) -> None:
    """Rows start..stop of a line or a sweep, as in `cip.engines.cpu_loops.run_lines`."""
    m, d, out, feet = address(m), address(d), address(out), address(feet)
    x = at_addresses(x)
    for row in range(start, stop):
        block = row // x.n
        i = row - block * x.n
        for q in range(x.stride):
            first = block * x.n * x.stride + q
            o = first + i * x.stride
            own = Line(x.h, first, x.stride, x.n, x.periodic)
            push(m, d, out, feet, size, o, own, size, o, i)


def push_forward(blocks: list[Block], z: Array, feet: Array, changes: Array) -> Array:
    """The change of the new moments of all nodes with their feet at given old moments `z`, shape
    (moments, nodes). Feet and changes have shape (components, nodes), changes of displacements are
    lengths."""
    found = np.zeros_like(z)
    for block in blocks:
        own = block.components
        # Blocks may share means, to which each adds.
        found[block.rows] += _of_block(block, z, feet[own], changes[own])
    return found


def _of_block(block: Block, z: Array, feet: Array, changes: Array) -> Array:
    """The changes of the new moments that a block moves."""
    stage, grid = block.stage, block.stage.grid
    push_one, lines = push_kernel(*block.scheme), lines_of(grid)
    if stage.axis is None:
        run, rows = loop_over(run_plane, push=push_one), grid.nodes[0]
    else:
        run, lines = loop_over(run_sweep, push=push_one), [lines[stage.axis]]
        rows = grid.size // lines[0][2]
    flat = [np.ascontiguousarray(array).reshape(-1) for array in (block.read(z), changes, feet)]
    found = np.empty_like(z[block.rows])
    out = found.reshape(-1)

    def work(start: int, stop: int) -> None:
        run(start, stop, flat[0], flat[1], out, flat[2], grid.size, *lines)

    share(work, rows, grid.size)
    if stage.conservative:
        found[-1] = mean_changes(grid, stage.axis or 0, found[-1])
    return found
