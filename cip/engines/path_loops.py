"""Loops over nodes that compute the feet themselves, for velocities that are formulas."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from cip.engines.cpu_loops import address
from cip.engines.path_kernel import box_of, path_source
from cip.formulas.expression import RULES
from cip.grid import Grid
from cip.jit import Array, Index, Out, Real, generated, room
from cip.stages.stage import Stage

# No stage reads more components of the feet.
_COMPONENTS = 16

# On the stack: an array would be freed after its last use, which is where its address is taken.
foot_room = room(_COMPONENTS)
# In their place `loop_over` puts kernels.
node: Any = None
path: Any = None


def compiled(grid: Grid, stage: Stage) -> tuple[Any, Any]:
    """The kernel `path` of a stage, and its last argument."""
    box = box_of(grid, stage.system, stage.limit, float(np.finfo(float).eps))
    return _path(path_source(stage.system, stage.jets, box, constant=False)), np.array(box)


@cache
def _path(source: str) -> Any:
    namespace: dict[str, Any] = {name: getattr(np, name) for name in RULES}
    namespace.update(Real=Real, Index=Index, Array=Array, Out=Out)
    namespace.update(nan=math.nan, inf=math.inf, abs=abs)
    return generated(source, ["rates", "velocity", "path"], namespace, __file__)


def run_plane_path(
    start: Index, stop: Index, m: Array, out: Out, said: Out,
    x: Array, y: Array, box: Array, t: Real, step: Real, count: Index, hx: Array, hy: Array,
    size: Index, nx: Index, ny: Index, px: Index, py: Index, advect: Index, limiter: Index,
) -> None:  # fmt: skip
    """Rows start..stop of a plane; said[row] gathers what `path` says."""
    m, out, said, hx, hy = address(m), address(out), address(said), address(hx), address(hy)
    foot, box = foot_room(np.empty(1)), address(box)
    for i in range(start, stop):
        found = 0
        for j in range(ny):
            found |= path(foot, x[i], y[j], 0.0, t, step, count, box)
            node(
                m, out, foot, 1, 0, hx, hy, size, i * ny + j, i, j, nx, ny, px, py, advect, limiter
            )
        said[i] = found


def run_lines_path(
    start: Index, stop: Index, m: Array, out: Out, said: Out,
    x: Array, y: Array, z: Array, box: Array, ny: Index, nz: Index, t: Real, step: Real,
    count: Index, h: Array, size: Index, dim: Index, axis: Index, inner: Index, n: Index,
    periodic: Index, advect: Index, limiter: Index,
) -> None:  # fmt: skip
    """Rows start..stop of a sweep."""
    m, out, said, h = address(m), address(out), address(said), address(h)
    foot, box = foot_room(np.empty(1)), address(box)
    block = start // n
    i = start - block * n
    for row in range(start, stop):
        found = 0
        base = block * n * inner
        for q in range(inner):
            o = base + i * inner + q
            found |= path(foot, x[o // (ny * nz)], y[o // nz % ny], z[o % nz], t, step, count, box)
            node(
                m, out, foot, 1, 0, h, size, dim, axis, o, base + q, inner, n, periodic, i,
                advect, limiter,
            )  # fmt: skip
        said[row] = found
        i += 1
        if i == n:
            i = 0
            block += 1


def run_feet(
    start: Index, stop: Index, feet: Out, said: Out, x: Array, y: Array, z: Array,
    box: Array, size: Index, components: Index, t: Real, step: Real, count: Index,
) -> None:  # fmt: skip
    """Feet of the points start..stop, component after component."""
    foot, box = foot_room(np.empty(1)), address(box)
    feet, said = address(feet), address(said)
    for o in range(start, stop):
        said[o] = path(foot, x[o], y[o], z[o], t, step, count, box)
        for f in range(components):
            feet[f * size + o] = foot[f]
