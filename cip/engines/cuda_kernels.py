"""Source of the kernels of stages for a CUDA device, and their launch."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from cip.engines.cuda_source import prelude, translate
from cip.engines.path_kernel import PATH, box_of, path_source
from cip.formulas.snapshots import snapshots_of
from cip.grid import Grid
from cip.profiles.catalogue import moments
from cip.stages.stage import Stage

# Options for NVRTC.
OPTIONS = ("--std=c++14",)


def device_source(
    stage: Stage, name: str, limiter: int, computed: bool, real: str, index: str, fields: int = 1
) -> str:
    """CUDA C of the kernel ``run`` of a stage around the node function `name`, for `fields` fields,
    with its numbers as constants; `limiter` from `LIMITER_CODES`, `computed`: whether the kernel
    computes the feet.
    """
    modules = modules_of(stage)
    entries = [name]
    grid, field = stage.grid, snapshots_of(stage.velocity)
    if computed:
        rounding = float(np.finfo(np.float64 if real == "double" else np.float32).eps)
        box = box_of(grid, stage.system, stage.limit, rounding)
        modules.append(path_source(stage.system, stage.jets, box, field=field))
        entries.append("path")
    parameters = ["const real* __restrict__ m", "real* __restrict__ out"]
    if computed:
        parameters += point_of(grid)[1]
        parameters += ["const real t", "const real step", "const index count", "int* said"]
        if field is not None:
            parameters.append("const real* __restrict__ box")
        parameters += [f"const real {name}" for name in stage.system.parameters]
    else:
        parameters.append("const real* __restrict__ feet")
    constants, place, lines = node_place(stage)
    widths, uneven = widths_of(grid)
    parameters += uneven
    body = [place, *widths, lines]
    axis, advect = stage.axis or 0, int(stage.advect)
    numbers = f"{grid.dim}, {axis}, {advect}, {int(stage.coast is not None)}"
    body.append(f"    const Update update = {{size, {numbers}}};")
    foot = "feet, size, o"
    if computed:
        foot = "room, 1, 0"
        body += _path_call(stage, field is not None)
    limits = "0, 0, 0"
    if stage.conservative:
        limits = "low, high, slack"
        parameters += ["const real low", "const real high", "const real slack"]
    along = "x, y, update, o, i, j" if stage.axis is None else "x, update, o, i"
    body.append(f"    const Limits limits = {{{limiter}, {limits}}};")
    body.append(f"    const Foot foot = {{{foot}}};")
    step = len(moments(stage.profile, grid.dim))
    body += for_fields(f"{name}(m, out, foot, {along}, limits);", step, fields)
    code = translate(modules, *entries)
    bounds = ""
    if computed and stage.axis is None and field is None:
        # Of planes: without, the bicubic profile takes registers for two blocks at a time.
        bounds = f"__launch_bounds__(256, {3 if stage.profile == 'bicubic' else 4}) "
    return kernel_text(constants, code, parameters, body, grid, index, real, bounds)


def for_fields(call: str, step: int, fields: int) -> list[str]:
    """Code that calls for each field, whose moments are `step` arrays of all nodes; without a loop
    for one, as that takes a quarter longer."""
    if fields == 1:
        return [f"    {call}"]
    call = call.replace("(m, out,", "(m + far, out + far,")
    return [
        "    #pragma unroll 1",
        f"    for (int f = 0; f < {fields}; f++) {{",
        f"        const long long far = f * ({step}ll * size);",
        f"        {call}",
        "    }",
    ]


def feet_source(stage: Stage, real: str, index: str) -> str:
    """CUDA C of the kernel ``run`` that computes the feet of all nodes and stores them, for a stage
    whose formula is not from snapshots.
    """
    grid, count = stage.grid, len(stage.jets)
    rounding = float(np.finfo(np.float64 if real == "double" else np.float32).eps)
    box = box_of(grid, stage.system, stage.limit, rounding)
    parameters = ["real* __restrict__ feet"]
    parameters += point_of(grid)[1]
    parameters += ["const real t", "const real step", "const index count", "int* said"]
    parameters += [f"const real {name}" for name in stage.system.parameters]
    body = [
        "    const index o = blockIdx.x * blockDim.x + threadIdx.x;",
        "    if (o >= size_) return;",
        *_path_call(stage, False),
        f"    for (int f = 0; f < {count}; f++) feet[(index)f * size_ + o] = room[f];",
    ]
    code = translate([path_source(stage.system, stage.jets, box)], "path")
    return kernel_text(constants_of(size=grid.size), code, parameters, body, grid, index, real)


def _path_call(stage: Stage, splines: bool) -> list[str]:
    """Code that computes the foot of node o in the array `room` and records the code of `path`."""
    x, _ = point_of(stage.grid)
    lines = [f"    real room[{PATH.spline_room if splines else PATH.foot_room}];"]
    more = ", box" if splines else ""
    if stage.system.parameters:
        lines.append(f"    const real box[] = {{{', '.join(stage.system.parameters)}}};")
        more = ", box"
    lines.append(f"    const index found = path(room, {', '.join(x)}, t, step, count{more});")
    # A byte for each code of `path`: threads only ever write the same 1, so need no atomics.
    return [*lines, "    if (found != 0) ((unsigned char*)said)[found - 1] = 1;"]


def kernel_text(
    constants: list[str], code: str, arguments: list[str], body: list[str], grid: Grid, index: str,
    real: str = "double", bounds: str = "",
) -> str:  # fmt: skip
    """The source of the kernel ``run``; `index` and `real` are the types of `prelude`, `bounds` of
    threads and blocks limit its registers."""
    device = "#define DEVICE static __device__ __forceinline__\n"
    first = device + prelude(real, index, all(grid.uniform))
    head = f'extern "C" __global__ {bounds}void run({", ".join(arguments)}) {{'
    return "\n".join([first, *constants, code, head, *body, "}", ""])


def widths_of(grid: Grid) -> tuple[list[str], list[str]]:
    """Code of the cell widths: constants on uniform grids, else arguments."""
    if all(grid.uniform):
        widths = enumerate(float(width[0]) for width in grid.widths)
        return [f"    const real h{axis} = (real){width!r};" for axis, width in widths], []
    return [], [f"const real* __restrict__ h{axis}" for axis in range(grid.dim)]


def point_of(grid: Grid) -> tuple[list[str], list[str]]:
    """Code of the coordinates of node o, and the arguments for the grid's lines."""
    x = ["(real)0"] * 3
    for axis in range(grid.dim):
        after = int(np.prod(grid.nodes[axis + 1 :]))
        x[axis] = f"line{axis}[o / (index){after} % (index){grid.nodes[axis]}]"
    return x, [f"const real* __restrict__ line{axis}" for axis in range(grid.dim)]


def launch(kernel: Any, stage: Stage, *arguments: Any) -> None:
    """Run a kernel whose threads find their node by `node_place`."""
    if stage.axis is None:
        nx, ny = stage.grid.nodes
        kernel((-(-ny // 64), -(-nx // 4)), (64, 4), arguments)
    else:
        kernel((-(-stage.grid.size // 256),), (256,), arguments)


def node_place(stage: Stage) -> tuple[list[str], str, str]:
    """Code that finds a thread's node: constants, the indices of the node, and its lines."""
    return _plane(stage.grid) if stage.axis is None else _line(stage)


def modules_of(stage: Stage) -> list[Any]:
    """The modules of the kernels of a stage."""
    # Here only their source text is used.
    from cip.profiles import (
        catalogue,
        conservative_kernels,
        conservative_profiles,
        line_kernels,
        line_profiles,
        plane_kernels,
    )

    if stage.conservative:
        return [catalogue, line_profiles, conservative_profiles, conservative_kernels]
    return [catalogue, line_profiles, plane_kernels, line_kernels]


def _plane(grid: Grid) -> tuple[list[str], str, str]:
    (nx, ny), (px, py) = grid.nodes, map(int, grid.periodic)
    constants = constants_of(size=grid.size, nx_=nx, ny_=ny)
    place = """    const index size = size_, nx = nx_, ny = ny_;
    const index j = blockIdx.x * blockDim.x + threadIdx.x;
    const index i = blockIdx.y * blockDim.y + threadIdx.y;
    if (i >= nx || j >= ny) return;
    const index o = i * ny + j;
"""
    lines = f"    const Line x = {{h0, 0, ny, nx, {px}}}, y = {{h1, 0, 1, ny, {py}}};"
    return constants, place, lines


def _line(stage: Stage) -> tuple[list[str], str, str]:
    grid, axis = stage.grid, stage.axis
    assert axis is not None
    inner = int(np.prod(grid.nodes[axis + 1 :]))
    constants = constants_of(size=grid.size, inner_=inner, n_=grid.nodes[axis])
    place = """    const index size = size_, inner = inner_, n = n_;
    const index o = blockIdx.x * blockDim.x + threadIdx.x;
    if (o >= size) return;
    const index q = o % inner, row = o / inner, i = row % n, base = row / n * (n * inner) + q;
"""
    lines = f"    const Line x = {{h{axis}, base, inner, n, {int(grid.periodic[axis])}}};"
    return constants, place, lines


def constants_of(size: int, **others: int) -> list[str]:
    """Definitions of whole numbers in code."""
    named = {"size_": size, **others}
    return [f"#define {name} ((index){value})" for name, value in named.items()]


@cache
def compiled(source: str) -> Any:
    """The kernel ``run`` of a source."""
    import cupy

    return cupy.RawModule(code=source, options=OPTIONS).get_function("run")
