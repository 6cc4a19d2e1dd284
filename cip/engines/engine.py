"""What the engines of the CPU and of a CUDA device share: feet, and the order of a stage."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from cip.characteristics.feet import MAX_SUBSTEPS
from cip.engines.path_kernel import COARSE, LEFT
from cip.engines.setting import Setting
from cip.profiles.catalogue import LIMITER_CODES
from cip.stages.stage import Stage, StageFeet
from cip.stages.state import State

# The number of sub-steps of an unsteady velocity is sought anew after so many steps: it may fall.
_RENEW = 16
# Feet of a steady velocity on so many nodes are worth the seconds of compiling its formula.
_COMPILE_FROM = 100_000
# Sets of feet of a steady velocity that are kept: the full step's and those of partial steps, which
# many snapshots ask for.
_KEPT_FEET = 16


class _Memory(threading.local):
    """What the steps of one thread have found; runs in other threads do not change it."""

    def __init__(self) -> None:
        self.left = False  # whether paths begin on walls
        self.counts: dict[Any, tuple[float, int]] = {}  # when it was sought, and how many


class Engine:
    """Runs the stages of a setting; subclasses know where the arrays live."""

    def __init__(self, setting: Setting) -> None:
        self.setting, self.grid, self.dtype = setting, setting.grid, setting.dtype
        self.limiter = LIMITER_CODES[setting.limiter]
        self._memory = _Memory()
        self._feet: dict[Any, StageFeet] = {}
        self._lock = threading.Lock()
        self._paths: dict[Any, Any] = {}

    @property
    def _counts(self) -> dict[Any, tuple[float, int]]:
        return self._memory.counts

    def begin(self, state: State) -> State:
        """Place the first state of a run, whose result does not depend on runs before it."""
        self._memory.counts, self._memory.left = {}, False
        return self.place(state)

    def place(self, state: State) -> State:
        """The state where the kernels work, in the precision of the setting."""
        raise NotImplementedError

    def place_feet(self, feet: StageFeet) -> StageFeet:
        """Feet where the kernels work, in the precision of the setting."""
        raise NotImplementedError

    def empty(self, data: Any) -> Any:
        """Room for the new moments."""
        raise NotImplementedError

    def launch(self, stage: Stage, m: Any, out: Any, feet: Any) -> None:
        """One kernel over all nodes with stored feet; flat arrays."""
        raise NotImplementedError

    def launch_path(
        self, stage: Stage, m: Any, out: Any, t_end: float, dt: float, count: int
    ) -> int:
        """One kernel that computes the feet too; `LEFT`, `COARSE` or both if any path says so."""
        raise NotImplementedError

    def correct(self, flat: Any, places: Any, values: Any, add: bool) -> None:
        """Write or add values at flat places."""
        raise NotImplementedError

    def apply(self, stage: Stage, data: Any, t: float, dt: float) -> Any:
        """The moments after a stage of the step [t, t + dt]."""
        out = self.empty(data)
        m, new = data.reshape(-1), out.reshape(-1)
        if self._computes(stage):
            t_end, length = t + stage.end * dt, (stage.end - stage.begin) * dt

            def attempt(count: int) -> int:
                return self.launch_path(stage, m, new, t_end, length, count)

            if self._refine(stage, t, dt, attempt):
                return out
        feet = self.feet(stage, t, dt)
        self.launch(stage, m, new, feet.data)
        for correction in stage.corrections(feet):
            self.correct(new, correction.places, correction.values, correction.add)
        return out

    def feet(self, stage: Stage, t: float, dt: float) -> StageFeet:
        """Feet of a stage where the kernels work, kept for a steady velocity."""
        if not self.setting.steady:
            return self.place_feet(self._computed_feet(stage, t, dt))
        key = (stage.axis, (stage.end - stage.begin) * dt)
        found = self._feet.get(key)
        if found is None:
            found = self.place_feet(self._computed_feet(stage, t, dt))
            with self._lock:  # threads may share an engine
                while len(self._feet) >= _KEPT_FEET:
                    self._feet.pop(next(iter(self._feet)))
                self._feet[key] = found
        t_start, t_end = t + stage.begin * dt, t + stage.end * dt
        return StageFeet(found.data, found.exits, t_start, t_end)

    def _computed_feet(self, stage: Stage, t: float, dt: float) -> StageFeet:
        """Feet of a stage: compiled for formulas where that pays, else by NumPy."""
        large = self.grid.size > _COMPILE_FROM or not self.setting.steady
        if large and stage.formula and not self._memory.left:
            found = self._compiled_feet(stage, t, dt)
            if found is not None:
                return found
        return stage.feet(t, dt)

    def _compiled_feet(self, stage: Stage, t: float, dt: float) -> StageFeet | None:
        from cip.engines import cpu_loops, path_loops
        from cip.jit import loop_over

        path, box = self._path(stage)
        run_feet, size = loop_over(path_loops.run_feet, path=path), self.grid.size
        t_end, length = t + stage.end * dt, (stage.end - stage.begin) * dt

        feet = np.empty((len(stage.blocks), len(stage.jets) * size))
        said = np.empty(size, np.int64)

        def attempt(count: int) -> int:
            found = 0
            for row, block in zip(feet, stage.blocks, strict=True):
                points: list[Any] = [np.ascontiguousarray(x.ravel()) for x in stage.points(block)]
                points += [np.zeros(size)] * (3 - self.grid.dim)
                x, y, z = points
                paths = tuple(path_loops.Paths(x, y, z, t_end, length / count, count, box))
                arguments = (row, said, paths, size, len(stage.jets))

                def work(start: int, stop: int, arguments: Any = arguments) -> None:
                    run_feet(start, stop, *arguments)

                cpu_loops.share(work, size, size)
                found |= int(np.bitwise_or.reduce(said))
            return found

        if not self._refine(stage, t, dt, attempt) or not np.isfinite(feet.sum()):
            return None
        return StageFeet(feet.reshape(-1), [None] * len(feet), t + stage.begin * dt, t_end)

    def _refine(self, stage: Stage, t: float, dt: float, attempt: Callable[[int], int]) -> bool:
        """Call attempt(count) with more sub-steps until no path is coarse.

        False where NumPy must find the feet, or say which node has none: paths begin on walls, or
        there would be too many sub-steps.
        """
        count = self._count(stage, t, dt)
        while count <= MAX_SUBSTEPS:
            found = attempt(count)
            if not found & COARSE:
                self._counts[stage.part(dt)] = (self._counts[stage.part(dt)][0], count)
                self._memory.left = bool(found & LEFT)
                return not self._memory.left
            count *= 2
        return False

    def _path(self, stage: Stage) -> Any:
        from cip.engines import path_loops

        key = (stage.axis, stage.blocks[0])
        if key not in self._paths:
            self._paths[key] = path_loops.compiled(self.grid, stage)
        return self._paths[key]

    def name(self, stage: Stage) -> str:
        """Name of the node function; those that have a limiter have a fast form without."""
        limited = self.limiter != 0 and stage.profile in ("cubic", "adini", "bicubic")
        return f"node_{stage.profile}" + ("_limited" if limited else "")

    def bounds(self, stage: Stage) -> tuple[float, float]:
        """The bounds that hold before a stage, for the limiter of its profile.

        Between the sweeps of a splitting the field is compressed along one direction and not yet
        stretched along the others: there only the sign is bounded.
        """
        low, high = self.setting.bounds
        if not stage.compressed:
            return low, high
        return (0.0 if low >= 0.0 else -np.inf), (0.0 if high <= 0.0 else np.inf)

    def _computes(self, stage: Stage) -> bool:
        if self._memory.left or not stage.computable:
            return False
        return not self.setting.stores_feet

    def _count(self, stage: Stage, t: float, dt: float) -> int:
        """Sub-steps to begin with: the last, or at times as few as a sample of the nodes needs."""
        key = stage.part(dt)
        found = self._counts.get(key)
        if found is None:
            found = self._counts[key] = (t, stage.substeps(t, dt))
        elif not self.setting.steady and abs(t - found[0]) > _RENEW * dt:
            # What was steep between the nodes of the sample hardly ends at once.
            found = self._counts[key] = (t, max(stage.substeps(t, dt), 2 * (found[1] // 4)))
        return found[1]
