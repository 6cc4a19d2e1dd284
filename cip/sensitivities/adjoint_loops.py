"""The transposed update over all nodes: strips of nodes, each with its own sum, added in order."""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.engines.cpu_loops import address, at_addresses, share
from cip.engines.path_loops import foot_room
from cip.jit import Array, Index, Out, loop_over
from cip.profiles.records import Line
from cip.sensitivities.blocks import Block
from cip.sensitivities.grid_lines import lines_of
from cip.sensitivities.mass_derivatives import add_whole_cells, integral_weights
from cip.sensitivities.node_adjoint import pull_kernel

# Strips do not depend on the number of threads, so that neither does the rounding of sums.
_STRIPS = 4
_NODES_A_STRIP = 20_000

# `loop_over` replaces it by a kernel.
pull: Any = None


def run_plane(
    start: Index, stop: Index, m: Array, w: Array, back: Out, g: Out, feet: Array, size: Index,
    components: Index, x: Line, y: Line,
) -> None:  # fmt: skip
    """Rows start..stop of a plane; the derivatives with respect to feet are added to g."""
    m, w, back, g, feet = address(m), address(w), address(back), address(g), address(feet)
    x, y, here = at_addresses(x), at_addresses(y), foot_room(np.empty(1))
    for i in range(start, stop):
        for j in range(y.n):
            o = i * y.n + j
            pull(m, w, back, here, feet, size, o, x, y, size, o, i, j)
            for c in range(components):
                g[c * size + o] += here[c]


def run_sweep(
    start: Index, stop: Index, m: Array, w: Array, back: Out, g: Out, feet: Array, size: Index,
    components: Index, x: Line,
) -> None:  # fmt: skip
    """Rows start..stop of a line or a sweep, as in `cip.engines.cpu_loops.run_lines`; adds the
    derivatives with respect to feet to g.
    """
    m, w, back, g, feet = address(m), address(w), address(back), address(g), address(feet)
    x, here = at_addresses(x), foot_room(np.empty(1))
    for row in range(start, stop):
        block = row // x.n
        i = row - block * x.n
        for q in range(x.stride):
            first = block * x.n * x.stride + q
            o = first + i * x.stride
            own = Line(x.h, first, x.stride, x.n, x.periodic)
            pull(m, w, back, here, feet, size, o, own, size, o, i)
            for c in range(components):
                g[c * size + o] += here[c]


def pull_back(
    blocks: list[Block], z: Array, weight: Array, feet: Array, g: Array, pairs: list[Any]
) -> Array:
    """The transposed update: weights of the old moments from those of the new, both (moments,
    nodes). Adds derivatives in the feet, (components, nodes), displacements as lengths, to `g`.
    `pairs`: for conservative blocks `mass_derivatives.whole_cells`, else None."""
    back = np.empty_like(weight)
    for block, whole in zip(blocks, pairs, strict=True):
        own = block.components
        back[block.rows] = _of_block(block, z, weight[block.rows], feet[own], g[own], whole)
    return back


def _of_block(block: Block, z: Array, weight: Array, feet: Array, g: Array, whole: Any) -> Array:
    """The weights of the old moments of a block from those of the new ones."""
    stage, grid, read = block.stage, block.stage.grid, block.read(z)
    size, means, axis = grid.size, weight[-1], stage.axis or 0
    if stage.conservative:
        weight = np.concatenate([weight[:-1], integral_weights(grid, axis, means)[None]])
    pull_one = pull_kernel(*block.scheme)
    lines = lines_of(grid)
    if stage.axis is None:
        run, rows = loop_over(run_plane, pull=pull_one), grid.nodes[0]
    else:
        run, lines = loop_over(run_sweep, pull=pull_one), [lines[axis]]
        rows = size // lines[0][2]
    strips = max(1, min(_STRIPS, rows, size // _NODES_A_STRIP))
    cuts = [rows * strip // strips for strip in range(strips + 1)]
    sums = np.zeros((strips, *read.shape))
    flat = [np.ascontiguousarray(array).reshape(-1) for array in (read, weight, feet)]

    def work(first: int, last: int) -> None:
        for strip in range(first, last):
            run(
                cuts[strip], cuts[strip + 1], flat[0], flat[1], sums[strip].reshape(-1),
                g.reshape(-1), flat[2], size, len(feet), *lines,
            )  # fmt: skip

    share(work, strips, size)
    back = np.asarray(sums[0] if strips == 1 else sums.sum(axis=0))
    if stage.conservative:
        add_whole_cells(grid, axis, whole, means, back[-1])
    return np.asarray(block.read_transposed(back))
