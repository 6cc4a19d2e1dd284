"""CUDA C of kernels over all nodes, around translated kernels of one node, and their launch."""

from __future__ import annotations

from typing import Any

from cip.engines.cuda_engine import indices_of, kernel_head
from cip.grid import Grid
from cip.sensitivities.profile_derivatives import Traced, traced
from cip.stages.stage import Stage


def update_of(stage: Stage) -> Traced:
    """The update of a node in a stage."""
    return traced(stage.profile, stage.advect, stage.grid.dim, stage.axis)


def kernel_text(
    constants: list[str], code: str, arguments: list[str], body: list[str], index: str, grid: Grid
) -> str:
    """The source of the kernel ``run``."""
    head = f'extern "C" __global__ void run({", ".join(arguments)}) {{'
    first = kernel_head("double", index, all(grid.uniform))
    return "\n".join([first, *constants, code, head, *body, "}", ""])


def widths_of(grid: Grid) -> tuple[list[str], list[str]]:
    """Code of the widths of equal cells, or the arguments that hold those of others."""
    if all(grid.uniform):
        widths = enumerate(float(width[0]) for width in grid.widths)
        return [f"    const real h{axis} = (real){width!r};" for axis, width in widths], []
    return [], [f"const real* __restrict__ h{axis}" for axis in range(grid.dim)]


def point_of(grid: Grid) -> tuple[list[str], list[str]]:
    """Code of the coordinates of node o, and the arguments for the grid's lines."""
    x = ["(real)0"] * 3
    for axis, node in enumerate(indices_of(grid)):
        x[axis] = f"line{axis}[{node}]"
    return x, [f"const real* __restrict__ line{axis}" for axis in range(grid.dim)]


def launch(kernel: Any, stage: Stage, *arguments: Any) -> None:
    """Run a kernel whose threads find their node by `cip.engines.cuda_engine.node_place`."""
    if stage.axis is None:
        nx, ny = stage.grid.nodes
        kernel((-(-ny // 64), -(-nx // 4)), (64, 4), arguments)
    else:
        kernel((-(-stage.grid.size // 256),), (256,), arguments)
