"""Stages on the CPU: compiled kernels over NumPy arrays."""

from __future__ import annotations

from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from cip.kernels import Kernels
from cip.stage import Stage, StageFeet
from cip.state import State

if TYPE_CHECKING:
    from cip.solver import Solver


class HostKernels(Kernels):
    """Runs the stages with numba, rows shared among threads."""

    def __init__(self, solver: Solver) -> None:
        super().__init__(solver)
        self.widths = [width.astype(self.dtype) for width in solver.grid.widths]
        self.lines = [line.astype(self.dtype) for line in solver.grid.coordinates]
        self.lines += [np.zeros(1, self.dtype)] * (3 - solver.grid.dim)

    def place(self, state: State) -> State:
        """The state in a NumPy array of the solver's precision."""
        data = np.ascontiguousarray(state.host().data, dtype=self.dtype)
        return State(self.grid, state.profile, data, state.t)

    def feet(self, feet: StageFeet) -> StageFeet:
        """Feet in the solver's precision."""
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
        from cip import (
            conservative_kernels,
            cpu,
            line_blocks,
            line_kernels,
            plane_blocks,
            plane_kernels,
        )

        loops: Any = cpu
        grid, advect, limiter = self.grid, int(stage.advect), self.limiter
        if stage.axis is None:
            plane = (*self.widths, grid.size, *grid.nodes, *map(int, grid.periodic))

            if limiter == 0:
                blocks: Any = getattr(plane_blocks, f"run_{stage.profile}")

                def rows(start: int, stop: int) -> None:
                    near = plane_blocks.corner_room(m.size // grid.size, self.dtype, *self.widths)
                    blocks(start, stop, m, out, feet, *plane, advect, int(all(grid.uniform)), near)

            else:
                node: Any = getattr(plane_kernels, self.name(stage))

                def rows(start: int, stop: int) -> None:
                    loops.run_plane(node, start, stop, m, out, feet, *plane, advect, limiter)

            cpu.share(rows, grid.nodes[0], grid.size)
            return
        inner, line = self._line(stage)
        width = self.widths[stage.axis]
        if stage.conservative:
            node = getattr(conservative_kernels, self.name(stage))
            limits = (limiter, *self.solver.bounds, self.solver.bounds_tolerance)

            def sweep(start: int, stop: int) -> None:
                loops.run_conservative(node, start, stop, m, out, feet, width, *line, *limits)

        elif grid.dim == 1 and stage.profile == "cubic" and limiter == 0:
            lines: Any = line_blocks

            def sweep(start: int, stop: int) -> None:
                near = lines.end_room(self.dtype, width)
                lines.run_cubic(
                    start, stop, m, out, feet, width, *line[-2:], advect, int(grid.uniform[0]), near
                )

        elif grid.dim == 1:
            node = getattr(line_kernels, self.name(stage))

            def sweep(start: int, stop: int) -> None:
                loops.run_line(node, start, stop, m, out, feet, width, *line[-2:], advect, limiter)

        else:
            node = getattr(line_kernels, self.name(stage))

            def sweep(start: int, stop: int) -> None:
                loops.run_lines(node, start, stop, m, out, feet, width, *line, advect, limiter)

        cpu.share(sweep, grid.size // inner, grid.size)

    def launch_path(
        self, stage: Stage, m: Any, out: Any, t_end: float, dt: float, count: int
    ) -> bool:
        """One kernel that computes the feet too; whether any path left the box."""
        from cip import cpu, line_kernels, path_loops, plane_kernels

        loops: Any = path_loops

        key = (stage.axis, stage.blocks[0])
        if key not in self._paths:
            self._paths[key] = path_loops.compiled(self.grid, stage)
        path = self._paths[key]
        grid, advect, limiter = self.grid, int(stage.advect), self.limiter
        left = np.zeros(max(grid.nodes[0], grid.size // grid.nodes[-1]) + grid.size, np.int64)
        clock = (t_end, dt, count)
        if stage.axis is None:
            node: Any = getattr(plane_kernels, self.name(stage))
            plane = (*self.widths, grid.size, *grid.nodes, *map(int, grid.periodic))
            cpu.share(
                lambda start, stop: loops.run_plane_path(
                    node, path, start, stop, m, out, left, *self.lines[:2], *clock, *plane,
                    advect, limiter,
                ),
                grid.nodes[0],
                grid.size,
            )  # fmt: skip
            return bool(left.any())
        inner, line = self._line(stage)
        node = getattr(line_kernels, self.name(stage))
        shape = (*grid.nodes, 1, 1)[:3]
        cpu.share(
            lambda start, stop: loops.run_lines_path(
                node, path, start, stop, m, out, left, *self.lines, *shape[1:], *clock,
                self.widths[stage.axis or 0], *line, advect, limiter,
            ),
            grid.size // inner,
            grid.size,
        )  # fmt: skip
        return bool(left.any())

    def _line(self, stage: Stage) -> tuple[int, tuple[int, ...]]:
        """Number of nodes that follow each other across the sweep, and the kernels' numbers."""
        assert stage.axis is not None
        grid, axis = self.grid, stage.axis
        inner = prod(grid.nodes[axis + 1 :])
        n, periodic = grid.nodes[axis], int(grid.periodic[axis])
        return inner, (grid.size, grid.dim, axis, inner, n, periodic)
