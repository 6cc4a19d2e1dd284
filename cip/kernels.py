"""What the kernels on the CPU and on the device have in common: the order of a stage."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cip.characteristics import MAX_SUBSTEPS
from cip.schemes import LIMITER_CODES
from cip.stage import Stage, StageFeet
from cip.state import State

if TYPE_CHECKING:
    from cip.solver import Solver

# The number of sub-steps of feet computed in the kernel is found again after so many steps, and
# when a measure of the velocity grows by this factor, to more than this many cells a step.
_RENEW = 16
_FASTER = 1.5
_SLOW = 1e-3
_STEADY = np.zeros(1)
# Feet of a steady velocity on so many nodes are worth the seconds of compiling its formula.
_COMPILE_FROM = 100_000


class Kernels:
    """Runs the stages of a solver; subclasses know where the arrays live."""

    def __init__(self, solver: Solver) -> None:
        self.solver, self.grid, self.dtype = solver, solver.grid, solver.dtype
        self.limiter = LIMITER_CODES[solver.limiter]
        self._left = False
        self._counts: dict[Any, tuple[float, Any, int]] = {}
        self._paths: dict[Any, Any] = {}

    def place(self, state: State) -> State:
        """The state where the kernels work, in the solver's precision."""
        raise NotImplementedError

    def feet(self, feet: StageFeet) -> StageFeet:
        """Feet where the kernels work, in the solver's precision."""
        raise NotImplementedError

    def empty(self, data: Any) -> Any:
        """Room for the new moments."""
        raise NotImplementedError

    def launch(self, stage: Stage, m: Any, out: Any, feet: Any) -> None:
        """One kernel over all nodes with stored feet; flat arrays."""
        raise NotImplementedError

    def launch_path(
        self, stage: Stage, m: Any, out: Any, t_end: float, dt: float, count: int
    ) -> bool:
        """One kernel that computes the feet too; whether any path left the box."""
        raise NotImplementedError

    def correct(self, flat: Any, places: Any, values: Any, add: bool) -> None:
        """Write or add values at flat places."""
        raise NotImplementedError

    def apply(self, stage: Stage, data: Any, t: float, dt: float) -> Any:
        """The moments after a stage of the step [t, t + dt]."""
        out = self.empty(data)
        m, new = data.reshape(-1), out.reshape(-1)
        if self._computes(stage):
            length = (stage.end - stage.begin) * dt
            count = self._count(stage, t, dt)
            if not self.launch_path(stage, m, new, t + stage.end * dt, length, count):
                return out
            self._left = True  # paths begin on walls: their feet must be known to the host
        feet = self.solver.feet(stage, t, dt)
        self.launch(stage, m, new, feet.data)
        for correction in stage.corrections(feet):
            self.correct(new, correction.places, correction.values, correction.add)
        return out

    def compute_feet(self, stage: Stage, t: float, dt: float) -> StageFeet:
        """Feet of a stage: compiled for formulas where that pays, else by NumPy."""
        large = self.grid.size > _COMPILE_FROM or not self.solver.steady
        if large and stage.formula and not self._left:
            found = self._compiled_feet(stage, t, dt)
            if found is not None:
                return found
        return stage.feet(t, dt)

    def _compiled_feet(self, stage: Stage, t: float, dt: float) -> StageFeet | None:
        from cip import cpu, path_loops
        from cip.jit import loop_over

        path, box = self._path(stage)
        run_feet, size = loop_over(path_loops.run_feet, path=path), self.grid.size
        t_end, length = t + stage.end * dt, (stage.end - stage.begin) * dt

        def follow(count: int) -> Any:
            feet = np.empty((len(stage.blocks), len(stage.jets) * size))
            left = np.empty(size, np.int64)
            for row, block in zip(feet, stage.blocks, strict=True):
                points = [np.ascontiguousarray(x.ravel()) for x in stage.points(block)]
                points += [np.zeros(size)] * (3 - self.grid.dim)
                clock = (t_end, length / count, count)
                arguments = (row, left, *points, box, size, len(stage.jets), *clock)

                def work(start: int, stop: int, arguments: Any = arguments) -> None:
                    run_feet(start, stop, *arguments)

                cpu.share(work, size, size)
                if left.any():
                    self._left = True  # paths begin on walls: NumPy finds where
                    return None
            return feet if np.isfinite(feet.sum()) else None  # NumPy names the node

        old = self._counts.get(stage.part(dt))
        count = self._count(stage, t, dt)
        feet = follow(count)
        if feet is not None and self._counts[stage.part(dt)] is not old:
            # It was found on a sample of the nodes; what is steep may lie between them.
            coarse = follow(max(1, count // 2))
            while not stage.agree(coarse, feet):
                count *= 2
                if count > MAX_SUBSTEPS:
                    return None  # NumPy says so
                coarse, feet = feet, follow(count)
            self._counts[stage.part(dt)] = (*self._counts[stage.part(dt)][:2], count)
        if feet is None:
            return None
        return StageFeet(feet.reshape(-1), [None] * len(feet), t + stage.begin * dt, t_end)

    def _path(self, stage: Stage) -> Any:
        from cip import path_loops

        key = (stage.axis, stage.blocks[0])
        if key not in self._paths:
            self._paths[key] = path_loops.compiled(self.grid, stage)
        return self._paths[key]

    def name(self, stage: Stage) -> str:
        """Name of the node function; those that have a limiter have a fast form without."""
        limited = self.limiter != 0 and stage.profile in ("cubic", "adini", "bicubic")
        return f"node_{stage.profile}" + ("_limited" if limited else "")

    def _computes(self, stage: Stage) -> bool:
        if self._left or not stage.computable:
            return False
        stored = self.solver.store_feet
        return not self.solver.steady if stored is None else not stored

    def _count(self, stage: Stage, t: float, dt: float) -> int:
        key, pace = stage.part(dt), _STEADY
        if not self.solver.steady:
            pace = stage.pace(t, dt)
        found = self._counts.get(key)
        if (
            found is None
            or (not self.solver.steady and abs(t - found[0]) > _RENEW * dt)
            or np.any(pace > _FASTER * np.maximum(found[1], _SLOW))
        ):
            found = self._counts[key] = (t, pace, stage.substeps(t, dt))
        return found[2]
