"""Stages on the CPU: compiled kernels over NumPy arrays."""

from __future__ import annotations

from dataclasses import replace
from math import prod
from typing import Any

import numpy as np

from cip.engines.engine import Engine
from cip.engines.setting import Setting
from cip.profiles.records import Limits, Line, Update
from cip.stages.stage import Stage, StageFeet
from cip.stages.state import State, state_of


class CpuEngine(Engine):
    """Runs the stages with numba; threads share the rows of the grid."""

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
        return state_of(self.grid, state.profile, data, state.t)

    def place_feet(self, feet: StageFeet) -> StageFeet:
        """Feet in the setting's precision."""
        return replace(feet, data=feet.data.astype(self.dtype))

    def empty(self, data: Any) -> Any:
        """Uninitialized memory for the new moments."""
        return np.empty_like(data)

    def correct(self, flat: Any, places: Any, values: Any, add: bool) -> None:
        """Write values to (or add them at) indices into the flat moments."""
        if add:
            np.add.at(flat, places, values.astype(self.dtype))
        else:
            flat[places] = values

    def launch(self, stage: Stage, m: Any, out: Any, feet: Any) -> None:
        """Run a stage's kernel over all nodes with stored feet; the arrays are flat."""
        from cip.engines import cpu_loops, line_blocks, plane_blocks
        from cip.jit import loop_over
        from cip.profiles import conservative_kernels, line_kernels, plane_kernels

        grid, limiter = self.grid, self.limiter
        lines = [self._lines[axis] for axis in stage.moving]
        update = tuple(Update(self.grid.size, self.grid.dim, stage.axis or 0, int(stage.advect)))
        if stage.axis is None:
            if limiter == 0:
                blocks: Any = getattr(plane_blocks, f"run_{stage.profile}")

                def rows(start: int, stop: int) -> None:
                    near = plane_blocks.corner_room(m.size // grid.size, self.dtype, *self.widths)
                    blocks(start, stop, m, out, feet, *lines, update, int(all(grid.uniform)), near)

            else:
                run_plane = loop_over(
                    cpu_loops.run_plane, node=getattr(plane_kernels, self.name(stage))
                )

                def rows(start: int, stop: int) -> None:
                    run_plane(start, stop, m, out, feet, *lines, update, limiter)

            cpu_loops.share(rows, grid.nodes[0], grid.size)
            return
        (line,) = lines
        if stage.conservative:
            node = getattr(conservative_kernels, self.name(stage))
            run_conservative = loop_over(cpu_loops.run_conservative, node=node)
            limits = tuple(Limits(limiter, *self.bounds(stage), self.setting.bounds_tolerance))

            def sweep(start: int, stop: int) -> None:
                run_conservative(start, stop, m, out, feet, line, update, limits)

        elif grid.dim == 1 and stage.profile == "cubic" and limiter == 0:
            run_cubic: Any = line_blocks.run_cubic

            def sweep(start: int, stop: int) -> None:
                near = line_blocks.end_room(self.dtype, self.widths[0])
                uniform = int(grid.uniform[0])
                run_cubic(start, stop, m, out, feet, line, update, uniform, near)

        elif grid.dim == 1:
            run_line = loop_over(cpu_loops.run_line, node=getattr(line_kernels, self.name(stage)))

            def sweep(start: int, stop: int) -> None:
                run_line(start, stop, m, out, feet, line, update, limiter)

        else:
            run_lines = loop_over(cpu_loops.run_lines, node=getattr(line_kernels, self.name(stage)))

            def sweep(start: int, stop: int) -> None:
                run_lines(start, stop, m, out, feet, line, update, limiter)

        cpu_loops.share(sweep, grid.size // line[2], grid.size)

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
        """Run a stage's kernel that computes the feet too, and write them to `kept` if given. The
        result is 0, `LEFT`, `COARSE` or both bits.
        """
        from cip.engines import cpu_loops, path_loops
        from cip.jit import loop_over
        from cip.profiles import line_kernels, plane_kernels

        path, box = self._path(stage)
        lines = [self._lines[axis] for axis in stage.moving]
        update = tuple(Update(self.grid.size, self.grid.dim, stage.axis or 0, int(stage.advect)))
        x, y, z = self.coordinates
        paths = tuple(path_loops.Paths(x, y, z, t_end, dt / count, count, box))
        if stage.axis is None:
            node: Any = getattr(plane_kernels, self.name(stage))
            run, rows = (
                loop_over(path_loops.run_plane_path, node=node, path=path),
                self.grid.nodes[0],
            )
        else:
            node = getattr(line_kernels, self.name(stage))
            run = loop_over(path_loops.run_lines_path, node=node, path=path)
            rows = self.grid.size // lines[0][2]
        said = np.zeros(rows, np.int64)
        components = 0 if kept is None else len(stage.jets)
        kept = np.empty(0) if kept is None else kept

        def work(start: int, stop: int) -> None:
            run(start, stop, m, out, said, kept, components, paths, *lines, update, self.limiter)

        cpu_loops.share(work, rows, self.grid.size)
        return int(np.bitwise_or.reduce(said))
