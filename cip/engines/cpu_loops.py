"""The kernels over all nodes on the CPU: rows of nodes, shared among threads.

The loops are plain Python: `loop_over` compiles one for each kernel `node`. Loops with a `path`
also compute the feet, for velocities given by formulas. They take the records of
`cip.profiles.catalogue` as plain tuples: numba unpacks these ten times faster. `m` and `out` are
those of all fields one after another, `step` numbers each: these share the feet.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from cip.engines.path_kernel import PATH, box_of, numbers_as_parameters, path_source
from cip.formulas.expression import RULES
from cip.formulas.snapshots import snapshots_of
from cip.grid import Grid
from cip.profiles.catalogue import Foot, Limits, Line, Update
from cip.stages.stage import Stage
from skfem_adini.ground.arrays import cores
from skfem_adini.ground.jit import (
    Array,
    Index,
    Out,
    Real,
    generated,
    kernel,
    loop_over,
    pointer,
    room,
    shift,
)

address, shifted = pointer(), shift()


@kernel
def at_addresses(line: Line) -> Line:
    """A `Line` with the address of its widths, as the kernels need it, from a record or tuple."""
    h, first, stride, n, periodic = line
    return Line(address(h), first, stride, n, periodic)


# On the stack: numba would free an array after its last use, which is taking its address.
foot_room = room(PATH.spline_room)

# Placeholders that `loop_over` replaces by kernels.
node: Any = None
path: Any = None


def run_line(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, line: Line, update: Update,
    limits: Limits, step: Index,
) -> None:  # fmt: skip
    """Update nodes start..stop of the line of a grid in one dimension."""
    fields = m.size // step
    m, out, feet = address(m), address(out), address(feet)
    line, advect, limits = at_addresses(line), Update(*update).advect, Limits(*limits)
    # Constants, so that the compiler removes the code for other dimensions.
    n, own = line.n, Line(line.h, 0, 1, line.n, line.periodic)
    known = Update(n, 1, 0, advect)
    for f in range(fields):
        old, new = shifted(m, f * step), shifted(out, f * step)
        for i in range(start, stop):
            node(old, new, Foot(feet, n, i), own, known, i, i, limits)


def run_lines(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, line: Line, update: Update,
    limits: Limits, step: Index,
) -> None:  # fmt: skip
    """Update rows start..stop of a sweep; `line` is the first line of the grid in its direction.
    Row ``block line.n + i`` holds node i of ``line.stride`` adjacent lines."""
    fields = m.size // step
    m, out, feet = address(m), address(out), address(feet)
    line, update, limits = at_addresses(line), Update(*update), Limits(*limits)
    inner, n = line.stride, line.n
    block = start // n
    i = start - block * n
    for _ in range(start, stop):
        base = block * n * inner
        for f in range(fields):
            old, new = shifted(m, f * step), shifted(out, f * step)
            for q in range(inner):
                o = base + i * inner + q
                own = Line(line.h, base + q, inner, n, line.periodic)
                node(old, new, Foot(feet, update.size, o), own, update, o, i, limits)
        i += 1
        if i == n:
            i = 0
            block += 1


def run_plane(
    start: Index, stop: Index, m: Array, out: Out, feet: Array, x: Line, y: Line, update: Update,
    limits: Limits, step: Index,
) -> None:  # fmt: skip
    """Update rows start..stop of a plane; x and y are the lines through its first node."""
    fields = m.size // step
    m, out, feet = address(m), address(out), address(feet)
    x, y, update, limits = at_addresses(x), at_addresses(y), Update(*update), Limits(*limits)
    for i in range(start, stop):
        for f in range(fields):
            old, new = shifted(m, f * step), shifted(out, f * step)
            for j in range(y.n):
                o = i * y.n + j
                node(old, new, Foot(feet, update.size, o), x, y, update, o, i, j, limits)


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="cip")


if hasattr(os, "register_at_fork"):
    # After a fork the child has the pool but not its threads, and would wait for them forever.
    os.register_at_fork(after_in_child=_pool.cache_clear)


def threads() -> int:
    """Number of threads: `NUMBA_NUM_THREADS` where set, else the cores of this process."""
    given = os.environ.get("NUMBA_NUM_THREADS", "")
    if given.isdigit() and int(given) > 0:
        return int(given)
    return cores()


def share(work: Callable[[int, int], Any], rows: int, size: int) -> None:
    """Call work(start, stop) on parts of the rows, one per thread; `size` counts the nodes."""
    # With fewer nodes a thread takes longer to start than it saves.
    parts = min(threads(), rows, max(1, size // 40_000))
    if parts == 1:
        work(0, rows)
        return
    cuts = [rows * part // parts for part in range(parts + 1)]
    tasks = [_pool(threads()).submit(work, *cut) for cut in pairwise(cuts)]
    for task in tasks:
        task.result()


class Paths(NamedTuple):
    """End points of paths and the time steps in which they are followed back."""

    x: Array  # coordinates along the grid's lines (`run_feet`: of the points)
    y: Array  # likewise; 0 in a direction that the grid lacks
    z: Array
    t: Real  # at the end of the path
    step: Real  # length of a sub-step
    substeps: Index
    box: Array  # of `box_of`, then the values of parameters


def follow_all(
    path: Any, stage: Stage, block: int, t: float, step: float, count: int, box: Any, out: Any
) -> Any:
    """Write what the kernel `path` finds for all points of a block of feet to `out`, components one
    after the other; its codes, one for each point."""
    size = stage.grid.size
    run, said = loop_over(run_feet, path=path), np.empty(size, np.int64)
    points: list[Any] = [np.ascontiguousarray(x.ravel()) for x in stage.points(block)]
    points += [np.zeros(size)] * (3 - stage.grid.dim)
    x, y, z = points
    paths = tuple(Paths(x, y, z, t, step, count, box))

    def work(start: int, stop: int) -> None:
        run(start, stop, out, said, paths, size, out.size // size)

    share(work, size, size)
    return said


def compiled(grid: Grid, stage: Stage) -> tuple[Any, Any]:
    """The compiled kernel `path` of a stage, and the array for its argument `box`."""
    box = box_of(grid, stage.system, stage.limit, float(np.finfo(float).eps))
    field = snapshots_of(stage.velocity)
    system, numbers = numbers_as_parameters(stage.system)
    path = kernel_of(path_source(system, stage.jets, box, constant=False, field=field))
    table = np.empty(0) if field is None else field.table
    return path, np.concatenate([box, stage.parameters, numbers, table])


@cache
def kernel_of(source: str, **more: Any) -> Any:
    """Compile the last function of a source; `more` are additional names that it uses."""
    namespace: dict[str, Any] = {name: getattr(np, name) for name in RULES} | more
    namespace.update(Real=Real, Index=Index, Array=Array, Out=Out)
    namespace.update(nan=math.nan, inf=math.inf, abs=abs, floor=math.floor)
    names = re.findall(r"^def (\w+)", source, re.MULTILINE)
    return generated(source, names, namespace, __name__)


def run_plane_path(
    start: Index, stop: Index, m: Array, out: Out, said: Out, kept: Out, components: Index,
    paths: Paths, x: Line, y: Line, update: Update, limits: Limits, step: Index,
) -> None:  # fmt: skip
    """Update rows start..stop of a plane; ``said[row]`` is the bitwise or of the codes of `path`.
    The first components of the feet are written to `kept`, laid out as by `run_feet`."""
    fields = m.size // step
    m, out, said, kept = address(m), address(out), address(said), address(kept)
    x, y, update, paths = at_addresses(x), at_addresses(y), Update(*update), Paths(*paths)
    limits = Limits(*limits)
    x1, x2 = address(paths.x), address(paths.y)
    feet, box = foot_room(np.empty(1)), address(paths.box)
    t, dt, count = paths.t, paths.step, paths.substeps
    for i in range(start, stop):
        found = 0
        for j in range(y.n):
            found |= path(feet, x1[i], x2[j], 0.0, t, dt, count, box)
            for f in range(fields):
                old, new = shifted(m, f * step), shifted(out, f * step)
                node(old, new, Foot(feet, 1, 0), x, y, update, i * y.n + j, i, j, limits)
            for f in range(components):
                kept[f * update.size + i * y.n + j] = feet[f]
        said[i] = found


def run_lines_path(
    start: Index, stop: Index, m: Array, out: Out, said: Out, kept: Out, components: Index,
    paths: Paths, line: Line, update: Update, limits: Limits, step: Index,
) -> None:  # fmt: skip
    """As `run_plane_path`, for rows start..stop of a sweep, counted as in `run_lines`."""
    fields = m.size // step
    m, out, said, kept = address(m), address(out), address(said), address(kept)
    line, update, paths = at_addresses(line), Update(*update), Paths(*paths)
    limits = Limits(*limits)
    feet, box = foot_room(np.empty(1)), address(paths.box)
    x, y, z = address(paths.x), address(paths.y), address(paths.z)
    t, dt, count = paths.t, paths.step, paths.substeps
    ny, nz, inner, n = paths.y.size, paths.z.size, line.stride, line.n
    block = start // n
    i = start - block * n
    for row in range(start, stop):
        found = 0
        base = block * n * inner
        for q in range(inner):
            o = base + i * inner + q
            found |= path(feet, x[o // (ny * nz)], y[o // nz % ny], z[o % nz], t, dt, count, box)
            own = Line(line.h, base + q, inner, n, line.periodic)
            for f in range(fields):
                old, new = shifted(m, f * step), shifted(out, f * step)
                node(old, new, Foot(feet, 1, 0), own, update, o, i, limits)
            for f in range(components):
                kept[f * update.size + o] = feet[f]
        said[row] = found
        i += 1
        if i == n:
            i = 0
            block += 1


def run_feet(
    start: Index, stop: Index, feet: Out, said: Out, paths: Paths, size: Index, components: Index
) -> None:
    """Compute the feet of points start..stop; component f of point o is at ``feet[f size + o]``."""
    paths = Paths(*paths)
    foot, box = foot_room(np.empty(1)), address(paths.box)
    feet, said = address(feet), address(said)
    x, y, z = address(paths.x), address(paths.y), address(paths.z)
    t, step, count = paths.t, paths.step, paths.substeps
    for o in range(start, stop):
        said[o] = path(foot, x[o], y[o], z[o], t, step, count, box)
        for f in range(components):
            feet[f * size + o] = foot[f]
