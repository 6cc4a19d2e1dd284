"""Stages on the CPU: compiled kernels over NumPy arrays."""

from __future__ import annotations

from math import prod
from typing import Any

import numpy as np

from cip.engines.engine import Engine
from cip.engines.setting import Setting
from cip.stages.stage import Stage, StageFeet
from cip.stages.state import State


class CpuEngine(Engine):
    """Runs the stages with numba, rows shared among threads."""

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self.widths = [width.astype(self.dtype) for width in setting.grid.widths]
        self.lines = [line.astype(self.dtype) for line in setting.grid.coordinates]
        self.lines += [np.zeros(1, self.dtype)] * (3 - setting.grid.dim)

    def place(self, state: State) -> State:
        """The state in a NumPy array of the setting's precision."""
        data = np.ascontiguousarray(state.host().data, dtype=self.dtype)
        return State(self.grid, state.profile, data, state.t)

    def place_feet(self, feet: StageFeet) -> StageFeet:
        """Feet in the setting's precision."""
        return StageFeet(feet.data.astype(self.dtype), feet.exits, feet.t_start, feet.t_end)

    def empty(self, data: Any) -> Any:
        """Room for the new moments."""
        return np.empty_like(data)

    def correct(self, flat: Any, places: Any, values: Any, add: bool) -> None:
        """Write or add values at flat places."""
        if add:
            np.add.at(flat, places, values.astype(self.dtype))
        else:
            flat[places] = values

    def launch(self, stage: Stage, m: Any, out: Any, feet: Any) -> None:
        """One kernel over all nodes with stored feet; flat arrays."""
        from cip.engines import cpu_loops, line_blocks, plane_blocks
        from cip.jit import loop_over
        from cip.profiles import conservative_kernels, line_kernels, plane_kernels

        grid, advect, limiter = self.grid, int(stage.advect), self.limiter
        if stage.axis is None:
            plane = (*self.widths, grid.size, *grid.nodes, *map(int, grid.periodic))

            if limiter == 0:
                blocks: Any = getattr(plane_blocks, f"run_{stage.profile}")

                def rows(start: int, stop: int) -> None:
                    near = plane_blocks.corner_room(m.size // grid.size, self.dtype, *self.widths)
                    blocks(start, stop, m, out, feet, *plane, advect, int(all(grid.uniform)), near)

            else:
                run_plane = loop_over(
                    cpu_loops.run_plane, node=getattr(plane_kernels, self.name(stage))
                )

                def rows(start: int, stop: int) -> None:
                    run_plane(start, stop, m, out, feet, *plane, advect, limiter)

            cpu_loops.share(rows, grid.nodes[0], grid.size)
            return
        inner, line = self._line(stage)
        width = self.widths[stage.axis]
        if stage.conservative:
            node = getattr(conservative_kernels, self.name(stage))
            run_conservative = loop_over(cpu_loops.run_conservative, node=node)
            limits = (limiter, *self.bounds(stage), self.setting.bounds_tolerance)

            def sweep(start: int, stop: int) -> None:
                run_conservative(start, stop, m, out, feet, width, *line, *limits)

        elif grid.dim == 1 and stage.profile == "cubic" and limiter == 0:
            lines: Any = line_blocks

            def sweep(start: int, stop: int) -> None:
                near = lines.end_room(self.dtype, width)
                lines.run_cubic(
                    start, stop, m, out, feet, width, *line[-2:], advect, int(grid.uniform[0]), near
                )

        elif grid.dim == 1:
            run_line = loop_over(cpu_loops.run_line, node=getattr(line_kernels, self.name(stage)))

            def sweep(start: int, stop: int) -> None:
                run_line(start, stop, m, out, feet, width, *line[-2:], advect, limiter)

        else:
            run_lines = loop_over(cpu_loops.run_lines, node=getattr(line_kernels, self.name(stage)))

            def sweep(start: int, stop: int) -> None:
                run_lines(start, stop, m, out, feet, width, *line, advect, limiter)

        cpu_loops.share(sweep, grid.size // inner, grid.size)

    def launch_path(
        self, stage: Stage, m: Any, out: Any, t_end: float, dt: float, count: int
    ) -> int:
        """One kernel that computes the feet too; what its paths say."""
        from cip.engines import cpu_loops, path_loops
        from cip.jit import loop_over
        from cip.profiles import line_kernels, plane_kernels

        path, box = self._path(stage)
        grid, advect, limiter = self.grid, int(stage.advect), self.limiter
        inner, line = (grid.nodes[1], ()) if stage.axis is None else self._line(stage)
        said = np.zeros(grid.size // inner, np.int64)  # a row
        clock = (t_end, dt / count, count)
        if stage.axis is None:
            node: Any = getattr(plane_kernels, self.name(stage))
            run_plane = loop_over(path_loops.run_plane_path, node=node, path=path)
            plane = (*self.widths, grid.size, *grid.nodes, *map(int, grid.periodic))
            cpu_loops.share(
                lambda start, stop: run_plane(
                    start, stop, m, out, said, *self.lines[:2], box, *clock, *plane, advect, limiter
                ),
                grid.nodes[0],
                grid.size,
            )  # fmt: skip
            return int(np.bitwise_or.reduce(said))
        node = getattr(line_kernels, self.name(stage))
        run_lines = loop_over(path_loops.run_lines_path, node=node, path=path)
        shape = (*grid.nodes, 1, 1)[:3]
        cpu_loops.share(
            lambda start, stop: run_lines(
                start, stop, m, out, said, *self.lines, box, *shape[1:], *clock,
                self.widths[stage.axis or 0], *line, advect, limiter,
            ),
            grid.size // inner,
            grid.size,
        )  # fmt: skip
        return int(np.bitwise_or.reduce(said))

    def _line(self, stage: Stage) -> tuple[int, tuple[int, ...]]:
        """Number of nodes that follow each other across the sweep, and the kernels' numbers."""
        assert stage.axis is not None
        grid, axis = self.grid, stage.axis
        inner = prod(grid.nodes[axis + 1 :])
        n, periodic = grid.nodes[axis], int(grid.periodic[axis])
        return inner, (grid.size, grid.dim, axis, inner, n, periodic)
