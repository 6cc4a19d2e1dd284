"""Stages on the CPU: compiled kernels over NumPy arrays."""

from __future__ import annotations

from dataclasses import replace
from math import prod
from sys import getrefcount
from typing import Any

import numpy as np

from cip.engines.engine import Engine, Setting
from cip.profiles.catalogue import Limits, Line, Update
from cip.stages.stage import Stage, StageFeet
from cip.stages.state import State, state_of


class CpuEngine(Engine):
    """Runs the stages with numba; the rows of the grid are shared among threads."""

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self.widths = [width.astype(self.dtype) for width in setting.grid.widths]
        grid = setting.grid
        self.coordinates: list[Any] = [line.astype(self.dtype) for line in grid.coordinates]
        self.coordinates += [np.zeros(1, self.dtype)] * (3 - grid.dim)
        strides = [prod(grid.nodes[axis + 1 :]) for axis in range(grid.dim)]
        ends = map(int, grid.periodic)
        # Records are passed to the loops as plain tuples: that takes a tenth of the time per call.
        self._lines = [
            tuple(Line(h, 0, stride, n, periodic))
            for h, stride, n, periodic in zip(self.widths, strides, grid.nodes, ends, strict=True)
        ]

    def place(self, state: State) -> State:
        """The state in a NumPy array of the setting's precision."""
        data = np.ascontiguousarray(state.host().data, dtype=self.dtype)
        return state_of(self.grid, state.profile, data, state.t, fields=state.fields)

    def place_feet(self, feet: StageFeet) -> StageFeet:
        """Feet in the setting's precision."""
        return replace(feet, data=feet.data.astype(self.dtype, copy=False))

    def empty(self, data: Any) -> Any:
        """Uninitialized memory for the new moments: that of a state which no one holds any more.
        New memory of the system costs as much as a step, as its pages come one by one."""
        spare = self._memory.spare
        for one in spare:
            # References of the list, of this loop and of the call; a view has one more.
            if getrefcount(one) == 3 and one.shape == data.shape and one.dtype == data.dtype:
                return one
        found = np.empty_like(data)
        self._memory.spare = [*spare[-2:], found]
        return found

    def correct(self, flat: Any, places: Any, values: Any, add: bool) -> None:
        """Write values to (or add them at) indices into the flat moments."""
        if add:
            np.add.at(flat, places, values.astype(self.dtype))
        else:
            flat[places] = values

    def _update(self, stage: Stage) -> tuple[list[Any], Any, int]:
        """Arguments of the loops of a stage (lines and `Update`), and the number of rows."""
        lines = [self._lines[axis] for axis in stage.moving]
        flags = int(stage.advect), int(stage.coast is not None)
        update = tuple(Update(self.grid.size, self.grid.dim, stage.axis or 0, *flags))
        rows = self.grid.nodes[0] if stage.axis is None else self.grid.size // lines[0][2]
        return lines, update, rows

    def _node(self, stage: Stage, prefix: str = "node_") -> Any:
        """The kernel that updates a node, or another one."""
        from cip.profiles import conservative_kernels, line_kernels, plane_kernels

        module: Any = conservative_kernels if stage.conservative else line_kernels
        module = plane_kernels if stage.axis is None else module
        return getattr(module, self.name(stage, prefix))

    def _limits(self, stage: Stage) -> Any:
        return tuple(Limits(self.limiter, *self.bounds(stage), self.setting.bounds_tolerance))

    def launch(self, stage: Stage, m: Any, out: Any, feet: Any, prefix: str = "node_") -> None:
        """As in the base class."""
        from cip.engines import cpu_blocks, cpu_loops, cpu_sweeps
        from skfem_adini.ground.jit import loop_over

        grid, profile, step = self.grid, stage.profile, self.step
        lines, update, rows = self._update(stage)
        if self.limiter == 0 and (stage.axis is None or (grid.dim == 1 and profile == "cubic")):
            run: Any = cpu_blocks.run_cubic
            if stage.axis is None:
                block = getattr(cpu_blocks, f"{profile}_block")
                run = loop_over(cpu_blocks.run_plane_blocks, block=block)
            uniform, moments = int(all(grid.uniform)), step // grid.size

            def work(start: int, stop: int) -> None:
                near = cpu_blocks.block_room(moments, self.dtype, self.widths)
                run(start, stop, m, out, feet, *lines, update, uniform, near, step)

        elif stage.conservative and grid.dim > 1 and stage.coast is None and prefix == "node_":
            sloped = int(profile == "csl4")
            limits = self._limits(stage)
            rows, equal = cpu_sweeps.groups(lines[0], grid.size), int(grid.uniform[update[2]])

            def work(start: int, stop: int) -> None:
                space = np.empty(3 * cpu_sweeps.WIDTH * lines[0][3], self.dtype)
                cell = np.empty(cpu_sweeps.WIDTH * lines[0][3], np.int64)
                given = (*lines, update, limits, sloped, equal, space, cell, step)
                cpu_sweeps.run_sweep(start, stop, m, out, feet, *given)

        else:
            name = "run_line" if grid.dim == 1 and not stage.conservative else "run_lines"
            name = "run_plane" if stage.axis is None else name
            run = loop_over(getattr(cpu_loops, name), node=self._node(stage, prefix))
            limits = self._limits(stage)

            def work(start: int, stop: int) -> None:
                run(start, stop, m, out, feet, *lines, update, limits, step)

        cpu_loops.share(work, rows, grid.size * (m.size // step))

    def launch_path(
        self,
        stage: Stage,
        m: Any,
        out: Any,
        t_end: float,
        dt: float,
        count: int,
        kept: Any = None,
    ) -> int:
        """As in the base class; the feet are stored in `kept` if given."""
        from cip.engines import cpu_loops
        from skfem_adini.ground.jit import loop_over

        path, box = self._path(stage)
        lines, update, rows = self._update(stage)
        x, y, z = self.coordinates
        paths = tuple(cpu_loops.Paths(x, y, z, t_end, dt / count, count, box))
        loop = cpu_loops.run_plane_path if stage.axis is None else cpu_loops.run_lines_path
        run, limits = loop_over(loop, node=self._node(stage), path=path), self._limits(stage)
        said, step = np.zeros(rows, np.int64), self.step
        components = 0 if kept is None else len(stage.jets)
        kept = np.empty(0) if kept is None else kept

        def work(start: int, stop: int) -> None:
            run(start, stop, m, out, said, kept, components, paths, *lines, update, limits, step)

        cpu_loops.share(work, rows, self.grid.size * (m.size // step))
        return int(np.bitwise_or.reduce(said))
