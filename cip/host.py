"""Stages on the CPU: compiled kernels over NumPy arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cip.schemes import LIMITER_CODES
from cip.stage import Stage, StageFeet
from cip.state import State

if TYPE_CHECKING:
    from cip.solver import Solver


class HostKernels:
    """Runs the stages of a solver with numba, rows shared among threads."""

    def __init__(self, solver: Solver) -> None:
        self.solver = solver
        self.grid, self.dtype = solver.grid, solver.dtype
        self.limiter = LIMITER_CODES[solver.limiter]
        self.widths = [width.astype(self.dtype) for width in solver.grid.widths]

    def place(self, state: State) -> State:
        """The state in a NumPy array of the solver's precision."""
        data = np.ascontiguousarray(state.host().data, dtype=self.dtype)
        return State(self.grid, state.profile, data, state.t)

    def feet(self, feet: StageFeet) -> StageFeet:
        """Feet in the solver's precision."""
        return StageFeet(feet.data.astype(self.dtype), feet.exits, feet.t_start, feet.t_end)

    def apply(self, stage: Stage, place: int, data: Any, t: float, dt: float) -> Any:
        """The moments after a stage."""
        feet = self.solver.feet(place, stage, t, dt)
        out = np.empty_like(data)
        self.launch(stage, data.reshape(-1), out.reshape(-1), feet.data)
        stage.finish(out, feet)
        return out

    def name(self, stage: Stage) -> str:
        """Name of the node function; those that have a limiter have a fast form without."""
        limited = self.limiter != 0 and stage.profile in ("cubic", "adini", "bicubic")
        return f"node_{stage.profile}" + ("_limited" if limited else "")

    def launch(self, stage: Stage, m: Any, out: Any, feet: Any) -> None:
        """One kernel over all nodes; flat arrays."""
        from cip import cpu

        grid = self.grid
        if stage.axis is None:
            from cip import plane_kernels

            node: Any = getattr(plane_kernels, self.name(stage))
            (nx, ny), (px, py) = grid.nodes, (int(p) for p in grid.periodic)

            def plane(start: int, stop: int) -> None:
                cpu.run_plane(
                    node, start, stop, m, out, feet, self.widths[0], self.widths[1], grid.size,
                    nx, ny, px, py, int(stage.advect), self.limiter,
                )  # fmt: skip

            cpu.share(plane, nx, grid.size)
            return
        axis, n = stage.axis, grid.nodes[stage.axis]
        inner = int(np.prod(grid.nodes[axis + 1 :]))
        line = (grid.size, grid.dim, axis, inner, n, int(grid.periodic[axis]))
        width = self.widths[axis]
        if stage.conservative:
            from cip import conservative_kernels

            node = getattr(conservative_kernels, f"node_{stage.profile}")
            limits = (self.limiter, *self.solver.bounds, self.solver.bounds_tolerance)

            def sweep(start: int, stop: int) -> None:
                cpu.run_conservative(node, start, stop, m, out, feet, width, *line, *limits)

        else:
            from cip import line_kernels

            node = getattr(line_kernels, self.name(stage))
            advect = int(stage.advect)

            def sweep(start: int, stop: int) -> None:
                if grid.dim == 1:
                    cpu.run_line(
                        node, start, stop, m, out, feet, width, n, line[5], advect, self.limiter
                    )
                    return
                cpu.run_lines(node, start, stop, m, out, feet, width, *line, advect, self.limiter)

        cpu.share(sweep, grid.size // inner, grid.size)
