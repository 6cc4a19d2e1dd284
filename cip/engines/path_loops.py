"""Loops over nodes that compute the feet themselves, for velocities that are formulas."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from cip.engines.cpu_loops import address, at_addresses
from cip.engines.path_kernel import SPLINE_ROOM, box_of, path_source
from cip.formulas.expression import RULES
from cip.formulas.snapshots import snapshots_of
from cip.grid import Grid
from cip.jit import Array, Index, Out, Real, generated, room
from cip.profiles.records import Foot, Line, Update
from cip.stages.stage import Stage

# On the stack: numba would free an array after its last use, the taking of its address.
foot_room = room(SPLINE_ROOM)
# `loop_over` replaces these two by kernels.
node: Any = None
path: Any = None


class Paths(NamedTuple):
    """End points of paths and how they are followed back."""

    x: Array  # coordinates along the grid's lines (`run_feet`: of the points)
    y: Array  # likewise; 0 in a direction that the grid lacks
    z: Array
    t: Real  # at the end of the path
    step: Real  # length of a sub-step
    substeps: Index
    box: Array  # of `box_of`, then the values of parameters


def compiled(grid: Grid, stage: Stage) -> tuple[Any, Any]:
    """The compiled kernel `path` of a stage, and the array for its last argument `box`."""
    box = box_of(grid, stage.system, stage.limit, float(np.finfo(float).eps))
    field = snapshots_of(stage.velocity)
    path = kernel_of(path_source(stage.system, stage.jets, box, constant=False, field=field))
    table = np.empty(0) if field is None else field.table
    return path, np.concatenate([box, stage.parameters, table])


@cache
def kernel_of(source: str) -> Any:
    """The last function of a source, compiled."""
    namespace: dict[str, Any] = {name: getattr(np, name) for name in RULES}
    namespace.update(Real=Real, Index=Index, Array=Array, Out=Out)
    namespace.update(nan=math.nan, inf=math.inf, abs=abs, floor=math.floor)
    names = re.findall(r"^def (\w+)", source, re.MULTILINE)
    return generated(source, names, namespace, __file__)


def run_plane_path(
    start: Index, stop: Index, m: Array, out: Out, said: Out, kept: Out, components: Index,
    paths: Paths, x: Line, y: Line, update: Update, limiter: Index,
) -> None:  # fmt: skip
    """Rows start..stop of a plane; ``said[row]`` is the bitwise or of the codes of `path`. The
    first components of the feet are written to `kept`, laid out as by `run_feet`.
    """
    m, out, said, kept = address(m), address(out), address(said), address(kept)
    x, y, update, paths = at_addresses(x), at_addresses(y), Update(*update), Paths(*paths)
    x1, x2 = address(paths.x), address(paths.y)
    feet, box = foot_room(np.empty(1)), address(paths.box)
    t, step, count = paths.t, paths.step, paths.substeps
    for i in range(start, stop):
        found = 0
        for j in range(y.n):
            found |= path(feet, x1[i], x2[j], 0.0, t, step, count, box)
            node(m, out, Foot(feet, 1, 0), x, y, update, i * y.n + j, i, j, limiter)
            for f in range(components):
                kept[f * update.size + i * y.n + j] = feet[f]
        said[i] = found


def run_lines_path(
    start: Index, stop: Index, m: Array, out: Out, said: Out, kept: Out, components: Index,
    paths: Paths, line: Line, update: Update, limiter: Index,
) -> None:  # fmt: skip
    """As `run_plane_path` for rows start..stop of a sweep, counted as in `cpu_loops.run_lines`."""
    m, out, said, kept = address(m), address(out), address(said), address(kept)
    line, update, paths = at_addresses(line), Update(*update), Paths(*paths)
    feet, box = foot_room(np.empty(1)), address(paths.box)
    x, y, z = address(paths.x), address(paths.y), address(paths.z)
    t, step, count = paths.t, paths.step, paths.substeps
    ny, nz, inner, n = paths.y.size, paths.z.size, line.stride, line.n
    block = start // n
    i = start - block * n
    for row in range(start, stop):
        found = 0
        base = block * n * inner
        for q in range(inner):
            o = base + i * inner + q
            found |= path(feet, x[o // (ny * nz)], y[o // nz % ny], z[o % nz], t, step, count, box)
            own = Line(line.h, base + q, inner, n, line.periodic)
            node(m, out, Foot(feet, 1, 0), own, update, o, i, limiter)
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
    """Feet of the points start..stop; component f of point o is at ``feet[f size + o]``."""
    paths = Paths(*paths)
    foot, box = foot_room(np.empty(1)), address(paths.box)
    feet, said = address(feet), address(said)
    x, y, z = address(paths.x), address(paths.y), address(paths.z)
    t, step, count = paths.t, paths.step, paths.substeps
    for o in range(start, stop):
        said[o] = path(foot, x[o], y[o], z[o], t, step, count, box)
        for f in range(components):
            feet[f * size + o] = foot[f]
