"""The window of a run on a CUDA device: states, feet and sums stay on the device."""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.engines.cuda_kernels import compiled, kernel_text, launch, node_place, point_of, widths_of
from cip.engines.cuda_source import translate
from cip.engines.path_kernel import PATH
from cip.formulas.snapshots import snapshots_of
from cip.profiles import catalogue, line_profiles
from cip.sensitivities.blocks import (
    Block,
    blocks_of,
    integral_weights,
    mean_changes,
    per_width,
    whole_cells,
)
from cip.sensitivities.node_derivatives import pull_source, push_source
from cip.sensitivities.path_adjoint import parameter_gradient, trail_length, unwind_source
from cip.sensitivities.path_tangent import PathTangent
from cip.sensitivities.profile_derivatives import Traced, traced
from cip.sensitivities.window import Window
from cip.stages.stage import Stage, StageFeet


class DeviceWindow(Window):
    """As `Window`, with CuPy vectors; derivatives of inflow are computed on the host."""

    def __init__(self, engine: Any, *arguments: Any) -> None:
        from cupyx.scipy.sparse.linalg import LinearOperator

        super().__init__(*arguments)
        self._xp, self._engine, self._kind = engine.xp, engine, LinearOperator
        self._stages: dict[int, DeviceAdjoint] = {}
        self._pushes: dict[Stage, DevicePush] = {}
        self._orders: dict[Any, Any] = {}

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
    code = translate([catalogue, line_profiles, push_source(update)], "push")
    body = [
        place,
        *widths,
        lines,
        f"    push(m, d, out, out, feet, size, o, {axes}, size, o, {nodes});",
    ]
    arguments = [
        "const real* __restrict__ m", "const real* __restrict__ d", "real* __restrict__ out",
        "const real* __restrict__ feet", *uneven,
    ]  # fmt: skip
    return kernel_text(constants, code, arguments, body, grid, index)


def tangent_all(stage: Stage, source: str, index: str) -> str:
    """CUDA C of the kernel ``run(lines..., t, step, count, values, out)``: `tangent` of all nodes,
    whose `source` is that of `cip.sensitivities.path_tangent.tangent_source`."""
    grid = stage.grid
    x, lines = point_of(grid)
    body = [
        "    const index o = blockIdx.x * blockDim.x + threadIdx.x;",
        f"    if (o >= (index){grid.size}) return;",
        f"    real here[{PATH.foot_room}];",
        f"    tangent(here, {', '.join(x)}, t, step, count, values);",
        *(f"    out[(index){c} * {grid.size} + o] = here[{c}];" for c in range(len(stage.jets))),
    ]
    arguments = [
        *lines, "const real t", "const real step", "const index count",
        "const real* __restrict__ values", "real* __restrict__ out",
    ]  # fmt: skip
    return kernel_text([], translate([source], "tangent"), arguments, body, grid, index)


class DevicePush:
    """The change of a stage's new moments for a change of its feet."""

    def __init__(self, engine: Any, stage: Stage) -> None:
        self._engine, self._stage = engine, stage
        self._push = compiled(push_all(stage, engine.index))

    def forward(self, blocks: list[Block], z: Array, feet: Array, changes: Array) -> Array:
        """As `cip.sensitivities.node_derivatives.push_forward`, with arrays on the device."""
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
        stage, xp, index = self._stage, self.xp, self._engine.index
        kernel = compiled(tangent_all(stage, self.source, index))
        lines = [xp.asarray(line) for line in stage.lines(block.bits)]
        step, count = self._step(block, feet)
        arguments = [*lines, feet.t_end, step, self._engine.whole(count), xp.asarray(values), out]
        kernel((-(-stage.grid.size // 256),), (256,), tuple(arguments))


def pull_all(stage: Stage, index: str) -> str:
    """CUDA C of ``run(m, w, parts, g, feet, cells, widths...)``, which writes the contributions of
    all nodes, adds derivatives in the components of feet to `g`, and writes the lower corner of the
    cell of each foot."""
    grid, update = stage.grid, update_of(stage)
    constants, place, lines = node_place(stage)
    code = translate([catalogue, line_profiles, pull_source(update, apart=True)], "pull")
    widths, uneven = widths_of(grid)
    axes, nodes = "xy"[: update.dim], "ij"[: update.dim]
    locate = [
        f"    index k{a}, r{a}; real s{a}; locate({i}, feet[{a} * size + o], {x}.n, {x}.periodic, "
        f"&k{a}, &r{a}, &s{a});"
        for a, (x, i) in enumerate(zip(axes, nodes, strict=True))
    ]
    count = update.dim + len(update.feet)
    body = [
        place, *widths, lines, *locate,
        f"    cells[o] = {'k0 * y.n + k1' if update.dim == 2 else 'base + k0 * inner'};",
        f"    real here[{PATH.foot_room}];",
        f"    pull(m, w, parts, here, feet, size, o, {', '.join(axes)}, size, o, "
        f"{', '.join(nodes)});",
        *(f"    g[{c} * size + o] += here[{c}];" for c in range(count)),
    ]  # fmt: skip
    arguments = [
        "const real* __restrict__ m", "const real* __restrict__ w", "real* __restrict__ parts",
        "real* __restrict__ g", "const real* __restrict__ feet", "index* cells", *uneven,
    ]  # fmt: skip
    return kernel_text(constants, code, arguments, body, grid, index)


def gather_all(stage: Stage, index: str) -> str:
    """CUDA C of ``run(parts, order, starts, out)``, which adds up the contributions. Further
    arguments: for conservative profiles ``shares, owners, wholes`` (contributions of new cells to
    the old ones that they contain), then for sweeps the widths of cells."""
    grid, update = stage.grid, update_of(stage)
    moments = update.moments
    constants, place, lines = node_place(stage)
    widths, uneven = widths_of(grid)
    axis = stage.axis or 0
    arguments = [
        "const real* __restrict__ parts", "const index* __restrict__ order",
        "const index* __restrict__ starts", "real* __restrict__ out",
    ]  # fmt: skip
    code, body = "", [place, *(f"    real sum{q} = 0;" for q in range(moments))]
    if update.around:
        code = translate([catalogue, line_profiles], "around")
        body += [*widths, lines, *_sums_of_a_sweep(stage, update)]
        arguments += uneven
    else:
        body += _sums_at_corners(stage, update)
    if stage.conservative:
        arguments += [
            "const real* __restrict__ shares", "const index* __restrict__ owners",
            "const index* __restrict__ wholes", *uneven,
        ]  # fmt: skip
        body += [
            *widths,
            "    for (index p = wholes[o]; p < wholes[o + 1]; p++)",
            f"        sum{moments - 1} += shares[owners[p]] * WIDTH(h{axis}, i);",
        ]
    body += [f"    out[(index){q} * size + o] = sum{q};" for q in range(moments)]
    return kernel_text(constants, code, arguments, body, grid, index)


def _sums_at_corners(stage: Stage, update: Traced) -> list[str]:
    """Code that sums the contributions of feet in the cells around a node to it as a corner."""
    grid, body = stage.grid, []
    for corner, sides in enumerate(update.corners):
        inside, names = [], []
        for q, (axis, side) in enumerate(zip(stage.moving, sides, strict=True)):
            node, length = "ij"[q], f"(index){grid.nodes[axis]}"
            lower = f"c{corner}_{q}"
            names.append(lower)
            body.append(f"    index {lower} = {node} - {side};")
            if side and grid.periodic[axis]:
                body.append(f"    if ({lower} < 0) {lower} += {length};")
            elif side:
                inside.append(f"{lower} >= 0")
        cell = f"base + {names[0]} * inner"
        if stage.axis is None:
            cell = f"{names[0]} * ny + {names[1]}"
        body += [
            f"    if ({' && '.join(inside) or '1'}) {{",
            *_sums_of_a_cell(cell, [("1", corner)], update),
            "    }",
        ]
    return body


def _sums_of_a_sweep(stage: Stage, update: Traced) -> list[str]:
    """The same where feet also contribute to nodes around their cell, up to three cells away."""
    assert stage.axis is not None
    ends = ["k", "r", *(f"n{q}" for q in range(len(update.around)))]
    inside = "k >= 0 && k < n - 1"
    wrap = []
    if stage.grid.periodic[stage.axis]:
        inside, wrap = "1", ["        if (k < 0) k += n;", "        if (k >= n) k -= n;"]
    return [
        f"    index {', '.join(ends[2:])};",
        f"    real {', '.join(update.around)};",
        # Short lines wrap around before that, and no cell may count twice.
        "    for (index away = -3; away < 3 && away < n - 3; away++) {",
        "        index k = i + away;",
        *wrap,
        f"        if ({inside}) {{",
        "        const index r = k + 1 < n ? k + 1 : 0;",
        f"        around(x, k, {', '.join(f'&{name}' for name in (*ends[2:], *update.around))});",
        *_sums_of_a_cell(
            "base + k * inner", [(f"{end} == i", role) for role, end in enumerate(ends)], update
        ),
        "        }",
        "    }",
    ]


def _sums_of_a_cell(cell: str, roles: list[tuple[str, int]], update: Traced) -> list[str]:
    """Code that adds the contributions of feet in a cell to a node, for each role and condition."""
    lines = [
        f"        const index cell = {cell}, stop = starts[cell + 1];",
        "        for (index p = starts[cell]; p < stop; p++) {",
        "            const index from = order[p];",
    ]
    for condition, own in roles:
        lines += [
            f"            if ({condition}) sum{q} += parts[(index){part} * size + from];"
            for part, (q, role) in enumerate(update.sources)
            if role == own
        ]
    return [*lines, "        }"]


def unwind_all(stage: Stage, count: int, index: str) -> str:
    """CUDA C of ``run(g, lines..., t, step, count, values, gradients, threads)``, which
    differentiates all characteristics in reverse, with at most `count` sub-steps each, and writes a
    gradient for each thread."""
    grid, system = stage.grid, stage.system
    code = translate([unwind_source(system, tuple(stage.jets))], "unwind")
    x, lines = point_of(grid)
    parameters = len(system.parameters)
    # Paths that begin on walls have no weight, and no velocity beyond these.
    weighs = " || ".join(f"g[(index){q} * {grid.size} + o] != 0" for q in range(len(stage.jets)))
    body = [
        "    const index thread = blockIdx.x * blockDim.x + threadIdx.x;",
        "    if (thread >= threads) return;",
        f"    real trail[{trail_length(system, count)}], grad[{parameters}];",
        f"    for (int q = 0; q < {parameters}; q++) grad[q] = 0;",
        f"    for (index o = thread; o < (index){grid.size}; o += threads)",
        f"        if ({weighs})",
        f"        unwind(g, (index){grid.size}, o, {', '.join(x)}, t, step, count, values, trail, "
        "grad);",
        f"    for (int q = 0; q < {parameters}; q++) gradients[q * threads + thread] = grad[q];",
    ]
    arguments = [
        "const real* __restrict__ g",
        *lines,
        "const real t", "const real step", "const index count",
        "const real* __restrict__ values", "real* __restrict__ gradients", "const index threads",
    ]  # fmt: skip
    return kernel_text([], code, arguments, body, grid, index)


class DeviceAdjoint:
    """The transposed steps of a stage on the device of an engine. Each node writes what it gives to
    the moments at the corners of its foot's cell; then each node sums what the feet in the cells
    around it give, sorted by their cells and nodes. No two threads add to the same number, so the
    result does not depend on their schedule."""

    def __init__(self, engine: Any, stage: Stage) -> None:
        import cupy

        self._xp, self._engine, self._stage = cupy, engine, stage
        grid, index = stage.grid, engine.index
        self._size, self.whole = grid.size, engine.whole
        self._parts, self._blocks = len(update_of(stage).reads), blocks_of(stage, cupy)
        self._pull = compiled(pull_all(stage, index))
        self._gather = compiled(gather_all(stage, index))
        self._unwind: dict[int, Any] = {}

    def pull_back(
        self, z: Array, weight: Array, feet: Array, g: Array, orders: Any = None
    ) -> tuple[Array, Any]:
        """As `cip.sensitivities.node_derivatives.pull_back`, on the device; also returns, for each
        block, the nodes sorted by the cells of their feet, `orders` for a later call with these
        feet."""
        out, found = self._xp.empty_like(weight), []
        for block, order in zip(self._blocks, orders or [None] * len(self._blocks), strict=True):
            own = block.components
            back, order = self._of_block(block, z, weight[block.rows], feet[own], g[own], order)
            if len(self._blocks) == 1:
                return back, [order]
            out[block.rows] = back
            found.append(order)
        return out, found

    def _of_block(
        self, block: Block, z: Array, weight: Array, feet: Array, g: Array, order: Any
    ) -> tuple[Array, Any]:
        """The weights of the old moments of a block, and the order of its nodes."""
        xp, size, stage = self._xp, self._size, self._stage
        read, axis = xp.ascontiguousarray(block.read(z)), stage.axis or 0
        parts = xp.empty(self._parts * size)
        cells = xp.empty(size, self.whole)
        out, weights, shares = xp.empty_like(read), weight, []
        if stage.conservative:
            shares = [per_width(stage.grid, axis, weight[-1], xp)]
            integrals = integral_weights(stage.grid, axis, weight[-1], xp)
            weights = xp.concatenate([weight[:-1], integrals[None]])
        widths = self._engine._widths
        launch(self._pull, stage, read, weights, parts, g, feet, cells, *widths)
        if order is None:
            order = self._order(cells, feet)
        more = widths if shares or update_of(stage).around else []
        launch(self._gather, stage, parts, *order[:2], out, *shares, *order[2:], *more)
        return block.read_transposed(out), order

    def _order(self, cells: Array, feet: Array) -> tuple[Array, ...]:
        """Nodes sorted by the cells of their feet and where each cell begins among them; for
        conservative profiles also the new cells sorted by the whole old ones in them."""
        xp, size = self._xp, self._size
        keys = xp.sort(cells.astype(np.int64) * size + xp.arange(size))
        starts = xp.searchsorted(keys, xp.arange(size + 1, dtype=np.int64) * size)
        found = (keys % size).astype(self.whole), starts.astype(self.whole)
        if not self._stage.conservative:
            return found
        owner, whole = whole_cells(self._stage.grid, self._stage.axis or 0, feet[0], xp)
        pairs = xp.sort(whole * size + owner)
        wholes = xp.searchsorted(pairs, xp.arange(size + 1, dtype=np.int64) * size)
        return *found, (pairs % size).astype(self.whole), wholes.astype(self.whole)

    def parameter_gradient(self, feet: StageFeet, g: Array) -> Any:
        """As `cip.sensitivities.path_adjoint.parameter_gradient`, of `g` on the device."""
        stage = self._stage
        if not all(c.exact for c in stage.velocity) or snapshots_of(stage.velocity) is not None:
            return parameter_gradient(stage, feet, g.get())
        found = np.zeros(len(stage.system.parameters))
        for block in self._blocks:
            found += self._gradient(block, feet, g[block.components])
        return found

    def _gradient(self, block: Block, feet: StageFeet, g: Array) -> Any:
        """The gradient in the parameters from derivatives in the feet of a block."""
        stage, xp, engine = self._stage, self._xp, self._engine
        inside, count = feet.interior(self._size, block.number), feet.substeps[block.number]
        if not inside.all():
            g = xp.where(xp.asarray(inside), g, 0.0)
        most = 1 << (count - 1).bit_length()  # one kernel serves all counts up to this
        if most not in self._unwind:
            self._unwind[most] = compiled(unwind_all(stage, most, engine.index))
        values = xp.asarray(np.array(stage.parameters, dtype=float))
        # Threads that differentiate characteristics: all gradients have at most 2^28 numbers.
        threads = max(1, min(self._size, 2**17, 2**28 // len(values)))
        gradients = xp.empty((len(values), threads))
        lines = [xp.asarray(line) for line in stage.lines(block.bits)]
        step = (feet.t_end - feet.t_start) / count
        arguments = [g, *lines, feet.t_end, step, self.whole(count)]
        arguments += [values, gradients, self.whole(threads)]
        self._unwind[most]((-(-threads // 128),), (128,), tuple(arguments))
        return gradients.sum(axis=1).get()


def update_of(stage: Stage) -> Traced:
    """The update of a node in a stage."""
    return traced(stage.profile, stage.advect, stage.grid.dim, stage.axis)
