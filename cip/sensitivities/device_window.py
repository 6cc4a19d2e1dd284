"""The window of a run on a CUDA device: states, feet and sums stay there."""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.engines.cuda_engine import compiled, node_place
from cip.engines.cuda_source import translate
from cip.engines.path_kernel import FOOT_ROOM
from cip.profiles import line_profiles, records
from cip.sensitivities.blocks import Block
from cip.sensitivities.device_adjoint import DeviceAdjoint
from cip.sensitivities.device_kernel import kernel_text, launch, point_of, update_of, widths_of
from cip.sensitivities.mass_derivatives import mean_changes
from cip.sensitivities.node_tangent import push_source
from cip.sensitivities.path_tangent import PathTangent
from cip.sensitivities.window import Window
from cip.stages.stage import Stage, StageFeet


class DeviceWindow(Window):
    """As `Window`, with vectors of CuPy; derivatives of inflow are computed on the host."""

    def __init__(self, engine: Any, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._xp, self._engine = engine.xp, engine
        self._stages: dict[int, DeviceAdjoint] = {}
        self._pushes: dict[Stage, DevicePush] = {}
        self._orders: dict[Any, Any] = {}

    def _linear(self, tangent: Any, adjoint: Any, columns: int) -> Any:
        """An operator of CuPy."""
        from cupyx.scipy.sparse.linalg import LinearOperator

        shape = (self._start.data.size, columns)
        return LinearOperator(shape, tangent, rmatvec=adjoint, dtype=np.float64)

    def _on_device(self, n: int) -> DeviceAdjoint:
        stage = self._moves[n].stage
        if id(stage) not in self._stages:
            self._stages[id(stage)] = DeviceAdjoint(self._engine, stage)
        return self._stages[id(stage)]

    def _pull_back(self, n: int, z: Any, weight: Any, feet: Any, g: Any) -> Any:
        orders = self._orders.get(self._key(n))
        back, orders = self._on_device(n).pull_back(z, weight, feet, g, orders)
        if self._steady:
            self._orders[self._key(n)] = orders
        return back

    def _gradient(self, n: int, feet: StageFeet, g: Any) -> Any:
        return self._on_device(n).parameter_gradient(feet, g)

    def _new_tangent(self, stage: Stage) -> DevicePathTangent:
        return DevicePathTangent(self._engine, stage)

    def _push_forward(self, n: int, z: Any, feet: Any, changes: Any) -> Any:
        stage = self._moves[n].stage
        if stage not in self._pushes:
            self._pushes[stage] = DevicePush(self._engine, stage)
        return self._pushes[stage].forward(self._blocks_of(stage), z, feet, changes)


Array = Any  # arrays of CuPy


def push_all(stage: Stage, index: str) -> str:
    """CUDA C of the kernel ``run(m, d, out, feet, widths...)``: `push` of all nodes."""
    grid, update = stage.grid, update_of(stage)
    constants, place, lines = node_place(stage)
    widths, uneven = widths_of(grid)
    axes, nodes = ", ".join("xy"[: update.dim]), ", ".join("ij"[: update.dim])
    code = translate([records, line_profiles, push_source(update)], "push")
    body = [place, *widths, lines, f"    push(m, d, out, feet, size, o, {axes}, size, o, {nodes});"]
    arguments = [
        "const real* __restrict__ m", "const real* __restrict__ d", "real* __restrict__ out",
        "const real* __restrict__ feet", *uneven,
    ]  # fmt: skip
    return kernel_text(constants, code, arguments, body, index, grid)


def tangent_all(stage: Stage, source: str, index: str) -> str:
    """CUDA C of the kernel ``run(lines..., t, step, count, values, out)``: `tangent` of all nodes,
    whose `source` is that of `cip.sensitivities.path_tangent.tangent_source`.
    """
    grid = stage.grid
    x, lines = point_of(grid)
    body = [
        "    const index o = blockIdx.x * blockDim.x + threadIdx.x;",
        f"    if (o >= (index){grid.size}) return;",
        f"    real here[{FOOT_ROOM}];",
        f"    tangent(here, {', '.join(x)}, t, step, count, values);",
        *(f"    out[(index){c} * {grid.size} + o] = here[{c}];" for c in range(len(stage.jets))),
    ]
    arguments = [
        *lines, "const real t", "const real step", "const index count",
        "const real* __restrict__ values", "real* __restrict__ out",
    ]  # fmt: skip
    return kernel_text([], translate([source], "tangent"), arguments, body, index, grid)


class DevicePush:
    """The change of the new moments of a stage with its feet."""

    def __init__(self, engine: Any, stage: Stage) -> None:
        self._engine, self._stage = engine, stage
        self._push = compiled(push_all(stage, engine._index))

    def forward(self, blocks: list[Block], z: Array, feet: Array, changes: Array) -> Array:
        """As `cip.sensitivities.tangent_loops.push_forward`, of arrays on the device."""
        xp, stage = self._engine.xp, self._stage
        found = xp.zeros(z.shape)
        for block in blocks:
            own, new = block.components, xp.empty(z[block.rows].shape)
            read = xp.ascontiguousarray(block.read(z))
            launch(
                self._push, stage, read, changes[own], new, feet[own], *self._engine._widths
            )  # fmt: skip
            if stage.conservative:
                new[-1] = mean_changes(stage.grid, stage.axis or 0, new[-1], xp)
            found[block.rows] += new
        return found


class DevicePathTangent(PathTangent):
    """As `PathTangent`, with arrays on the device of an engine."""

    def __init__(self, engine: Any, stage: Stage) -> None:
        super().__init__(stage)
        self.xp, self._engine = engine.xp, engine

    def _by_kernel(self, block: Block, feet: StageFeet, values: Array, out: Array) -> None:
        stage, xp, index = self._stage, self.xp, self._engine._index
        kernel = compiled(tangent_all(stage, self.source, index))
        lines = [xp.asarray(line) for line in stage.lines(block.bits)]
        step, count = self._step(block, feet)
        arguments = [*lines, feet.t_end, step, self._engine._whole(count), xp.asarray(values), out]
        kernel((-(-stage.grid.size // 256),), (256,), tuple(arguments))
