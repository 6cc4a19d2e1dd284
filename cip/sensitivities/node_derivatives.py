"""Derivatives of the update of a node as compiled kernels, and over all nodes on the CPU.

Both kernels are generated from the kernel of the step. For changes d of the components of a foot,
`push` computes the changes of the new moments at given old ones. For weights w of the new moments,
`pull` computes the derivatives of w . (new moments): those in the old moments at the corners of the
foot's cell, which are added up, and those in the components of the foot.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from cip.engines.cpu_loops import address, at_addresses, foot_room, kernel_of, share
from cip.formulas.expression import constant, gradient, statements, variable
from cip.profiles.catalogue import Line
from cip.profiles.line_profiles import around, locate
from cip.sensitivities.blocks import Block, add_whole_cells, integral_weights, mean_changes
from cip.sensitivities.profile_derivatives import Traced, traced
from skfem_adini.ground.jit import Array, Index, Out, loop_over

# Placeholder that `loop_over` replaces by a kernel.
node: Any = None


def _signature(name: str, given: str, update: Traced) -> str:
    """The first line of the kernel of a node, which takes old moments and the arguments `given`."""
    axes, places = "xy"[: update.dim], "ij"[: update.dim]
    lines = ", ".join(f"{axis}: Line" for axis in axes)
    indices = ", ".join(f"{place}: Index" for place in places)
    return (
        f"def {name}(m: Array, {given}: Array, out: Out, g: Out, feet: Array, "
        f"stride: Index, first: Index, {lines}, size: Index, o: Index, {indices}) -> None:"
    )


def _places_of(update: Traced) -> list[str]:
    """Code of the index of each of ``update.reads`` among the old moments."""
    nodes = [_corner(*sides) for sides in update.corners]
    nodes += [f"n{q}" for q in range(len(update.around))]
    return [f"{q} * size + {nodes[role]}" if q else nodes[role] for q, role in update.sources]


def _corner(*sides: int) -> str:
    """Code of the index of a corner of the cell."""
    return " + ".join(f"{'kr'[side]}{axis}" for axis, side in enumerate(sides))


def _beginning(update: Traced, used: set[str]) -> list[str]:
    """Code that locates the foot and reads its components and the old moments that are `used`. The
    widths of its cell are called h0 and h1."""
    code = []
    for axis, line in enumerate("xy"[: update.dim]):
        displacement = f"feet[{axis} * stride + first]"
        code.append(
            f"    k{axis}, r{axis}, s{axis} = "
            f"locate({'ij'[axis]}, {displacement}, {line}.n, {line}.periodic)"
        )
        code.append(f"    h{axis} = {line}.h[k{axis}]")
    ends = [f"{end}0" for end in "kr"]
    if update.around:
        ends += [f"n{q}" for q in range(4)]
        code.append(f"    {', '.join([*ends[2:], *update.around])} = around(x, k0)")
    if update.dim == 1:
        code += [f"    {end} = x.first + {end} * x.stride" for end in ends]
    else:
        code += [f"    {end} = {end} * y.n" for end in ends]
    for q, name in enumerate(update.feet):
        code.append(f"    {name} = feet[{update.dim + q} * stride + first]")
    places = zip(update.reads, _places_of(update), strict=True)
    return [*code, *(f"    {name} = m[{at}]" for name, at in places if name in used)]


def push_source(update: Traced) -> str:
    """Source of the kernel ``push(m, d, out, g, feet, stride, first, x, [y,] size, o, i[, j])``,
    which writes the changes of the new moments of node o to `out`. The changes `d` of the
    components are laid out as the feet, those of displacements as lengths; `g` is not used."""
    found = {}
    for q, output in enumerate(update.outputs):
        total = constant(0.0)
        for c, name in enumerate((*update.places, *update.feet)):
            total = total + output.derivative(name) * variable(f"e{c}")
        found[f"d{q}"] = total
    used = set().union(*(part.variables() for part in found.values()))
    code = [
        _signature("push", "d", update),
        *_beginning(update, used),
        *(f"    e{axis} = d[{axis} * stride + first] / h{axis}" for axis in range(update.dim)),
    ]
    for q in range(len(update.feet)):
        code.append(f"    e{update.dim + q} = d[{update.dim + q} * stride + first]")
    code += statements(found)
    code += [f"    out[{q} * size + o] = d{q}" for q in range(len(update.outputs))]
    return "\n".join(code) + "\n"


def pull_source(update: Traced, apart: bool = False) -> str:
    """Source of the kernel ``pull(m, w, out, g, feet, stride, first, x, [y,] size, o, i[, j])``,
    which adds to `out`, laid out as m and w, and writes derivatives in the components to `g`, for
    displacements per length. `apart`: that in ``update.reads[q]`` goes to ``out[q size + o]``."""
    dim, count = update.dim, len(update.reads)
    total = constant(0.0)
    for q, output in enumerate(update.outputs):
        total = total + variable(f"w{q}") * output
    names = [*update.reads, *update.places, *update.feet]
    found = {f"d{q}": part for q, part in enumerate(gradient(total, names))}
    used = set().union(*(part.variables() for part in found.values()))
    code = [
        _signature("pull", "w", update),
        *_beginning(update, used),
        *(f"    w{q} = w[{q} * size + o]" for q in range(len(update.outputs))),
        *statements(found),
    ]
    if apart:
        code += [f"    out[{q} * size + o] = d{q}" for q in range(count)]
    else:
        code += [f"    out[{at}] += d{q}" for q, at in enumerate(_places_of(update))]
    code += [f"    g[{axis}] = d{count + axis} / h{axis}" for axis in range(dim)]
    code += [f"    g[{dim + q}] = d{count + dim + q}" for q in range(len(update.feet))]
    return "\n".join(code) + "\n"


def run_plane(
    start: Index, stop: Index, m: Array, given: Array, out: Out, g: Out, feet: Array, size: Index,
    components: Index, x: Line, y: Line,
) -> None:  # fmt: skip
    """Process rows start..stop of a plane; adds derivatives in the components of feet to g."""
    m, given, out, g, feet = address(m), address(given), address(out), address(g), address(feet)
    x, y, here = at_addresses(x), at_addresses(y), foot_room(np.empty(1))
    for i in range(start, stop):
        for j in range(y.n):
            o = i * y.n + j
            node(m, given, out, here, feet, size, o, x, y, size, o, i, j)
            for c in range(components):
                g[c * size + o] += here[c]


def run_sweep(
    start: Index, stop: Index, m: Array, given: Array, out: Out, g: Out, feet: Array, size: Index,
    components: Index, x: Line,
) -> None:  # fmt: skip
    """The same for a line or a sweep, with the rows of `cip.engines.cpu_loops.run_lines`."""
    m, given, out, g, feet = address(m), address(given), address(out), address(g), address(feet)
    x, here = at_addresses(x), foot_room(np.empty(1))
    for row in range(start, stop):
        block = row // x.n
        i = row - block * x.n
        for q in range(x.stride):
            first = block * x.n * x.stride + q
            o = first + i * x.stride
            own = Line(x.h, first, x.stride, x.n, x.periodic)
            node(m, given, out, here, feet, size, o, own, size, o, i)
            for c in range(components):
                g[c * size + o] += here[c]


@cache
def _kernel(name: str, *scheme: Any) -> Any:
    """The compiled kernel `push` or `pull` of a profile; `scheme` as for `traced`."""
    source = (push_source if name == "push" else pull_source)(traced(*scheme))
    return kernel_of(source, Line=Line, locate=locate, around=around)


def _loop(block: Block, name: str) -> tuple[Any, list[tuple[Any, ...]], int]:
    """The loop of a kernel over all nodes of a block, the lines that are its last arguments (each a
    `Line` as a tuple), and the number of its rows."""
    stage, grid = block.stage, block.stage.grid
    strides = [grid.size // int(np.prod(grid.nodes[: axis + 1])) for axis in range(grid.dim)]
    lines = [
        tuple(Line(np.asarray(h, dtype=float), 0, stride, n, int(periodic)))
        for h, stride, n, periodic in zip(
            grid.widths, strides, grid.nodes, grid.periodic, strict=True
        )
    ]
    kernel = _kernel(name, *block.scheme)
    if stage.axis is None:
        return loop_over(run_plane, node=kernel), lines, grid.nodes[0]
    line = lines[stage.axis]
    return loop_over(run_sweep, node=kernel), [line], grid.size // line[2]


def _flat(*arrays: Array) -> list[Array]:
    return [np.ascontiguousarray(array).reshape(-1) for array in arrays]


def push_forward(blocks: list[Block], z: Array, feet: Array, changes: Array) -> Array:
    """The change of the new moments of all nodes with their feet at given old moments `z`, shape
    (moments, nodes). Feet and changes have shape (components, nodes), changes of displacements are
    lengths."""
    found = np.zeros_like(z)
    for block in blocks:
        own = block.components
        # Blocks may share means, to which each adds.
        found[block.rows] += _pushed(block, z, feet[own], changes[own])
    return found


def _pushed(block: Block, z: Array, feet: Array, changes: Array) -> Array:
    """The changes of the new moments that a block moves."""
    run, lines, rows = _loop(block, "push")
    found, grid = np.empty_like(z[block.rows]), block.stage.grid
    m, d, X = _flat(block.read(z), changes, feet)
    out, none = found.reshape(-1), np.empty(0)

    def work(start: int, stop: int) -> None:
        run(start, stop, m, d, out, none, X, grid.size, 0, *lines)

    share(work, rows, grid.size)
    if block.stage.conservative:
        found[-1] = mean_changes(grid, block.stage.axis or 0, found[-1])
    return found


def pull_back(
    blocks: list[Block], z: Array, weight: Array, feet: Array, g: Array, pairs: list[Any]
) -> Array:
    """The transposed update: weights of the old moments from those of the new, both (moments,
    nodes). Adds derivatives in the feet, (components, nodes), displacements as lengths, to `g`.
    `pairs`: for conservative blocks `mass_derivatives.whole_cells`, else None."""
    back = np.empty_like(weight)
    for block, whole in zip(blocks, pairs, strict=True):
        own = block.components
        back[block.rows] = _pulled(block, z, weight[block.rows], feet[own], g[own], whole)
    return back


def _pulled(block: Block, z: Array, weight: Array, feet: Array, g: Array, whole: Any) -> Array:
    """The weights of the old moments of a block from those of the new ones, in strips of nodes,
    each with its own sum, added in order."""
    stage, grid, read = block.stage, block.stage.grid, block.read(z)
    size, means, axis = grid.size, weight[-1], stage.axis or 0
    if stage.conservative:
        weight = np.concatenate([weight[:-1], integral_weights(grid, axis, means)[None]])
    run, lines, rows = _loop(block, "pull")
    # Strips, and so the rounding of sums, do not depend on the number of threads.
    strips = max(1, min(4, rows, size // 20_000))
    cuts = [rows * strip // strips for strip in range(strips + 1)]
    sums = np.zeros((strips, *read.shape))
    m, w, X = _flat(read, weight, feet)

    def work(first: int, last: int) -> None:
        for strip in range(first, last):
            run(
                cuts[strip], cuts[strip + 1], m, w, sums[strip].reshape(-1), g.reshape(-1), X,
                size, len(feet), *lines,
            )  # fmt: skip

    share(work, strips, size)
    back = np.asarray(sums[0] if strips == 1 else sums.sum(axis=0))
    if stage.conservative:
        add_whole_cells(grid, axis, whole, means, back[-1])
    return np.asarray(block.read_transposed(back))
