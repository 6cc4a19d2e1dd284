"""Stages on a CUDA device: kernels are translated to C and compiled by NVRTC through CuPy."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from cip.engines.cuda_source import prelude, translate
from cip.engines.displacements import Displacements
from cip.engines.engine import Engine, Setting
from cip.engines.path_kernel import PATH, box_of, path_source
from cip.errors import InputError
from cip.formulas.snapshots import snapshots_of
from cip.grid import Grid
from cip.stages.stage import Stage, StageFeet
from cip.stages.state import State, state_of
from skfem_adini.ground.errors import optional

# Options for NVRTC.
OPTIONS = ("--std=c++14",)


def device_source(
    stage: Stage, name: str, limiter: int, computed: bool, real: str, index: str
) -> str:
    """CUDA C of the kernel ``run`` of a stage around the node function `name`, with its numbers as
    constants; `limiter` from `LIMITER_CODES`, `computed`: whether the kernel computes the feet.
    """
    modules = _modules(stage)
    entries = [name]
    grid = stage.grid
    if computed:
        rounding = float(np.finfo(np.float64 if real == "double" else np.float32).eps)
        box = box_of(grid, stage.system, stage.limit, rounding)
        field = snapshots_of(stage.velocity)
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
    body.append(f"    {name}(m, out, foot, {along}, limits);")
    code = translate(modules, *entries)
    return kernel_text(constants, code, parameters, body, grid, index, real)


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
    return kernel_text(_constants(size=grid.size), code, parameters, body, grid, index, real)


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
    real: str = "double",
) -> str:  # fmt: skip
    """The source of the kernel ``run``; `index` and `real` are the types of `prelude`."""
    device = "#define DEVICE static __device__ __forceinline__\n"
    first = device + prelude(real, index, all(grid.uniform))
    head = f'extern "C" __global__ void run({", ".join(arguments)}) {{'
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


def _modules(stage: Stage) -> list[Any]:
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
    constants = _constants(size=grid.size, nx_=nx, ny_=ny)
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
    constants = _constants(size=grid.size, inner_=inner, n_=grid.nodes[axis])
    place = """    const index size = size_, inner = inner_, n = n_;
    const index o = blockIdx.x * blockDim.x + threadIdx.x;
    if (o >= size) return;
    const index q = o % inner, row = o / inner, i = row % n, base = row / n * (n * inner) + q;
"""
    lines = f"    const Line x = {{h{axis}, base, inner, n, {int(grid.periodic[axis])}}};"
    return constants, place, lines


def _constants(size: int, **others: int) -> list[str]:
    named = {"size_": size, **others}
    return [f"#define {name} ((index){value})" for name, value in named.items()]


@cache
def compiled(source: str) -> Any:
    """The kernel ``run`` of a source."""
    import cupy

    return cupy.RawModule(code=source, options=OPTIONS).get_function("run")


class CudaEngine(Engine):
    """Runs the stages with CuPy; states stay on the device."""

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        cupy = optional(
            "cupy",
            "backend='cupy' needs CuPy: pip install 'skfem-adini[cuda13]' (or [cuda12]), by the "
            "CUDA version of the driver",
        )
        try:
            cupy.cuda.runtime.getDeviceCount()
        except cupy.cuda.runtime.CUDARuntimeError as error:
            raise InputError(
                f"backend='cupy': no CUDA device answers ({error}); take backend='cpu' here"
            ) from error
        self.xp = self._cupy = cupy
        self._compiled: dict[Any, Any] = {}
        self._certain: set[Any] = set()
        self._splines: Any = None
        grid = setting.grid
        widths = [] if all(grid.uniform) else grid.widths  # equal widths: constants in the kernels
        self._widths = [cupy.asarray(width.astype(self.dtype)) for width in widths]
        self._lines = [cupy.asarray(line.astype(self.dtype)) for line in grid.coordinates]
        self._real = "double" if self.dtype == np.float64 else "float"
        self._index = "int" if 16 * grid.size < 2**31 else "long long"
        self._whole = np.int32 if self._index == "int" else np.int64

    def place(self, state: State) -> State:
        """The state in a CuPy array of the setting's precision."""
        data = self._cupy.ascontiguousarray(self._cupy.asarray(state.data, dtype=self.dtype))
        return state_of(self.grid, state.profile, data, state.t, fields=state.fields)

    def place_feet(self, feet: StageFeet) -> StageFeet:
        """Feet on the device, in the setting's precision."""
        return replace(feet, data=self._cupy.asarray(feet.data.astype(self.dtype, copy=False)))

    def empty(self, data: Any) -> Any:
        """Uninitialized memory for the new moments."""
        return self._cupy.empty_like(data)

    def correct(self, flat: Any, places: Any, values: Any, add: bool) -> None:
        """Write values to (or add them at) indices into the flat moments."""
        where = self._cupy.asarray(places)
        what = self._cupy.asarray(values.astype(self.dtype))
        if add:
            self._cupy.add.at(flat, where, what)
        else:
            flat[where] = what

    def _displaced(self, stage: Stage) -> Displacements | None:
        """Means only: feet of planes are computed on the device."""
        return super()._displaced(stage) if stage.conservative else None

    def launch(self, stage: Stage, m: Any, out: Any, feet: Any, prefix: str = "node_") -> None:
        """Run a stage's kernel over all nodes with stored feet; the arrays are flat. `prefix`
        chooses another one than the update."""
        arguments = [feet, *self._widths]
        if stage.conservative:
            limits = (*self.bounds(stage), self.setting.bounds_tolerance)
            arguments += [self.dtype.type(value) for value in limits]
        for own in self.fields(m):
            self._start(stage, False, [m[own], out[own], *arguments], prefix)

    def launch_path(
        self, stage: Stage, m: Any, out: Any, t_end: float, dt: float, count: int
    ) -> int:
        """Run a stage's kernel that computes the feet too; return the bits that `path` returned."""
        said = self._cupy.zeros(1, np.int32)
        real = self.dtype.type
        clock = [real(t_end), real(dt / count), self._whole(count), said]
        clock += [*self._table(stage), *(real(value) for value in stage.parameters)]
        for own in self.fields(m):
            self._start(stage, True, [m[own], out[own], *self._lines, *clock, *self._widths])
        part = (stage.axis, dt, count)
        if part in self._certain:
            return 0
        left, coarse = (int(byte != 0) for byte in said.get().view(np.uint8)[:2])
        found = PATH.left * left | PATH.coarse * coarse
        if self.setting.steady and not found:
            # Every later step has the same feet, so the host need not wait for their codes.
            self._certain.add(part)
        return found

    def _computes(self, stage: Stage, fields: int) -> bool:
        """As in the base class; several fields share feet that a kernel of their own computes."""
        several = fields > 1 and snapshots_of(stage.velocity) is None
        return not several and super()._computes(stage, fields)

    def _compiled_feet(self, stage: Stage, t: float, dt: float) -> StageFeet | None:
        """As in the base class, on the device except for means and velocities from snapshots."""
        if stage.conservative or snapshots_of(stage.velocity) is not None:
            return super()._compiled_feet(stage, t, dt)
        cupy, real, size = self._cupy, self.dtype.type, self.grid.size
        t_end, length = t + stage.end * dt, (stage.end - stage.begin) * dt
        feet = cupy.empty(len(stage.jets) * size, self.dtype)
        kernel = compiled(feet_source(stage, self._real, self._index))
        values = [real(value) for value in stage.parameters]

        def attempt(count: int) -> int:
            said = cupy.zeros(1, np.int32)
            clock = [real(t_end), real(length / count), self._whole(count), said]
            kernel((-(-size // 128),), (128,), (feet, *self._lines, *clock, *values))
            left, coarse = (int(byte != 0) for byte in said.get().view(np.uint8)[:2])
            return PATH.left * left | PATH.coarse * coarse

        if not self._refine(stage, t, dt, attempt):
            return None
        count = self._counts[stage.part(dt)][1]
        return StageFeet(feet, [None], t + stage.begin * dt, t_end, (count,))

    def _table(self, stage: Stage) -> list[Any]:
        """The table of a velocity from snapshots on the device, as a list; empty for others."""
        field = snapshots_of(stage.velocity)
        if field is None:
            return []
        if self._splines is None:
            self._splines = self._cupy.asarray(field.table.astype(self.dtype))
        return [self._splines]

    def _start(
        self, stage: Stage, computed: bool, arguments: list[Any], prefix: str = "node_"
    ) -> None:
        key = (stage.axis, computed, prefix)
        kernel = self._compiled.get(key)
        if kernel is None:
            name = self.name(stage, prefix)
            source = device_source(stage, name, self.limiter, computed, self._real, self._index)
            kernel = self._compiled[key] = compiled(source)
        launch(kernel, stage, *arguments)
