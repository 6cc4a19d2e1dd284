"""Base of the engines for the CPU and a CUDA device: computes feet and applies stages."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from cip.characteristics.feet import FEET, check_inside
from cip.engines.displacements import Displacements, Flow, TooCoarse
from cip.engines.path_kernel import PATH
from cip.errors import NotConverged
from cip.formulas.formula import Formula
from cip.formulas.snapshots import snapshots_of
from cip.grid import Grid
from cip.profiles.catalogue import LIMITER_CODES, moments
from cip.stages.stage import Stage, StageFeet
from cip.stages.state import State


class _Limits(NamedTuple):  # limits of what is computed, compiled and kept
    renewal: int = 16  # steps after which unsteady velocities get a new number of sub-steps
    compiled: int = 100_000  # nodes from which on compiling a steady velocity saves time
    feet: int = 16  # sets of feet kept for a steady velocity: of full steps and of shorter ones
    differences: int = 16_384  # nodes from which on feet of formulas are differenced


LIMITS = _Limits()


class _Memory(threading.local):
    """Results of earlier steps, separate for each thread."""

    def __init__(self) -> None:
        self.left = False  # whether paths begin on walls
        # For each part of a step: the time at which the sub-steps were last counted, and their
        # number.
        self.counts: dict[Any, tuple[float, int]] = {}
        self.spare: list[Any] = []  # arrays of moments, to be used again
        self.displaced: dict[Stage, Displacements | None] = {}
        self.flows: dict[Any, Flow] = {}


class Tally(Protocol):
    """What counts the integrals that pass the walls."""

    def enter(self, amounts: dict[tuple[int, int], float]) -> None:
        """Count what came in through walls."""

    def leave(self, axis: int, amounts: Any) -> None:
        """Count what left by both walls of a direction, at the ends of all lines."""


class Engine:
    """Runs the stages of a setting; subclasses implement memory and kernels of the CPU or device.
    The last numbers of sub-steps and the feet of steady velocities are cached."""

    xp: Any = np  # the module of the arrays

    def __init__(self, setting: Setting) -> None:
        self.setting, self.grid, self.dtype = setting, setting.grid, setting.dtype
        self.limiter = LIMITER_CODES[setting.limiter]
        # Numbers of a field in the flat moments, which hold one field after another.
        self.step = len(moments(setting.profile, setting.grid.dim)) * setting.grid.size
        self._memory = _Memory()
        self._feet: dict[Any, StageFeet] = {}
        self._lock = threading.Lock()
        self._paths: dict[Any, Any] = {}

    @property
    def _counts(self) -> dict[Any, tuple[float, int]]:
        return self._memory.counts

    @property
    def substep_counts(self) -> dict[Any, tuple[float, int]]:
        """The numbers of sub-steps of earlier steps in this thread; set them to repeat a step."""
        return dict(self._counts)

    @substep_counts.setter
    def substep_counts(self, counts: dict[Any, tuple[float, int]]) -> None:
        self._memory.counts = dict(counts)

    @property
    def paths_left(self) -> bool:
        """Whether this thread has found paths that begin on walls; set it to repeat a step."""
        return self._memory.left

    @paths_left.setter
    def paths_left(self, left: bool) -> None:
        self._memory.left = left

    def begin(self, state: State) -> State:
        """Place the first state of a run and forget sub-step counts, so runs are independent."""
        self._memory.counts, self._memory.left = {}, False
        return self.place(state)

    def place(self, state: State) -> State:
        """The state in the memory and precision in which the kernels work."""
        raise NotImplementedError

    def place_feet(self, feet: StageFeet) -> StageFeet:
        """The feet in the memory and precision in which the kernels work."""
        raise NotImplementedError

    def empty(self, data: Any) -> Any:
        """Uninitialized memory for the new moments."""
        raise NotImplementedError

    def fields(self, m: Any) -> list[slice]:
        """The parts of the flat moments that belong to each field."""
        return [slice(start, start + self.step) for start in range(0, m.size, self.step)]

    def launch(self, stage: Stage, m: Any, out: Any, feet: Any, prefix: str = "node_") -> None:
        """Run a stage's kernel over all nodes with stored feet; the arrays are flat. `prefix`
        chooses another one than the update."""
        raise NotImplementedError

    def launch_path(
        self, stage: Stage, m: Any, out: Any, t_end: float, dt: float, count: int
    ) -> int:
        """Run a stage's kernel that computes the feet too. The result is the bitwise or of the
        codes of `path`, `PATH.left` and `PATH.coarse`."""
        raise NotImplementedError

    def correct(self, flat: Any, places: Any, values: Any, add: bool) -> None:
        """Write values to (or add them at) indices into the flat moments."""
        raise NotImplementedError

    def apply(
        self,
        stage: Stage,
        data: Any,
        t: float,
        dt: float,
        homogeneous: bool = False,
        kept: list[StageFeet] | None = None,
        known: StageFeet | None = None,
        tallies: Sequence[Tally] = (),
    ) -> Any:
        """The moments after a stage of the step [t, t + dt], of one field or of several along the
        first axis. `homogeneous`: data on walls are zero, which makes it linear. Feet that are not
        cached are added to `kept` (on the CPU); `known` feet are reused, unless the kernel computes
        them. `tallies`, one for each field or none, count what passes the walls."""
        out = self.empty(data)
        m, new = data.reshape(-1), out.reshape(-1)
        if self._computes(stage, m.size // self.step):
            t_end, length = t + stage.end * dt, (stage.end - stage.begin) * dt
            room = [] if kept is None else [np.empty(len(stage.jets) * self.grid.size)]

            def attempt(count: int) -> int:
                return self.launch_path(stage, m, new, t_end, length, count, *room)

            if self._refine(stage, t, dt, attempt):
                if kept is not None:
                    count, begin = self._counts[stage.part(dt)][1], t + stage.begin * dt
                    kept.append(StageFeet(room[0], [None], begin, t_end, (count,)))
                return out
        feet = self.feet(stage, t, dt) if known is None else known
        if kept is not None and not self.setting.steady:
            kept.append(feet)
        fields = self.fields(m)
        if stage.parts and stage.conservative:  # bounds of their own
            for part, own in zip(stage.parts, fields, strict=True):
                self.launch(part, m[own], new[own], feet.data)
        else:
            self.launch(stage, m, new, feet.data)
        own_stages = stage.parts or [stage] * len(fields)
        for part, own in zip(own_stages, fields, strict=True):
            for correction in part.corrections(feet):
                if not homogeneous:
                    self.correct(new[own], correction.places, correction.values, correction.add)
                elif not correction.add:
                    self.correct(new[own], correction.places, 0.0 * correction.values, False)
            for stops in feet.stops:
                new[own][self.xp.asarray(stops.values)] = new[own][self.xp.asarray(stops.means)]
        if tallies and stage.axis is not None and not self.grid.periodic[stage.axis]:
            areas = self.xp.asarray(stage.areas)
            for tally, part, own in zip(tallies, own_stages, fields, strict=True):
                tally.enter(part.entered(feet))
                left = self.xp.empty(self.grid.size, self.dtype)
                self.launch(part, m[own], left, feet.data, "node_leaving_")
                tally.leave(stage.axis, left.reshape(self.grid.nodes) * areas)
        return out

    def feet(self, stage: Stage, t: float, dt: float) -> StageFeet:
        """Feet of a stage in the memory of the kernels; those of a steady velocity are cached."""
        if not self.setting.steady:
            return self.place_feet(self._computed_feet(stage, t, dt))
        key = (stage.axis, (stage.end - stage.begin) * dt)
        found = self._feet.get(key)
        if found is None:
            left = self._memory.left
            found = self._shared_feet(stage, t, dt, key)
            self._memory.left = left  # as in a step that finds the feet here
            with self._lock:  # threads may share an engine
                while len(self._feet) >= LIMITS.feet:
                    self._feet.pop(next(iter(self._feet)))
                self._feet[key] = found
        t_start, t_end = t + stage.begin * dt, t + stage.end * dt
        return replace(found, t_start=t_start, t_end=t_end)

    def _shared_feet(self, stage: Stage, t: float, dt: float, key: Any) -> StageFeet:
        """The feet that another solver of the same velocity keeps, or new ones."""
        shared, grid = self.setting.shared, self.grid
        if shared is None or stage.coast is not None:
            return self.place_feet(self._computed_feet(stage, t, dt))
        edges = tuple(line.tobytes() for line in grid.edges), grid.periodic
        whole = (type(self), edges, stage.jets, *stage.blocks, stage.tolerance, self.dtype, key)
        found: StageFeet | None = shared.get(whole)
        if found is None:
            found = shared[whole] = self.place_feet(self._computed_feet(stage, t, dt))
        for exits in found.exits:
            check_inside(grid, exits, set(stage.walls), t + stage.end * dt)
        return found

    def _computed_feet(self, stage: Stage, t: float, dt: float) -> StageFeet:
        """Feet of a stage: by compiled formulas where that saves time, else by NumPy."""
        moved = self._displaced(stage)
        if moved is not None:
            by_steps: StageFeet = self._refined(moved, t, dt, moved.feet)
            return by_steps
        large = self.grid.size > LIMITS.compiled or not self.setting.steady
        if large and stage.formula and (self.setting.steady or not self._memory.left):
            found = self._compiled_feet(stage, t, dt)
            if found is not None:
                return found
        return stage.feet(t, dt)

    def _displaced(self, stage: Stage) -> Displacements | None:
        """The feet of a stage by displacements, None where others serve."""
        found = self._memory.displaced
        if stage not in found:
            # At coasts derivatives are not those of displacements.
            serves = not self.setting.steady and stage.coast is None
            serves = serves and Displacements.serves(stage, LIMITS.differences)
            found[stage] = self._by_displacements(stage) if serves else None
        return found[stage]

    def _by_displacements(self, stage: Stage) -> Displacements | None:
        return Displacements(stage, self._memory.flows)

    def _refined(
        self, moved: Displacements, t: float, dt: float, attempt: Callable[..., Any]
    ) -> Any:
        """The result of attempt(t, dt, count) with the sub-steps of the last step, at intervals
        with fewer, or with more."""
        key = ("displaced", *moved.stage.part(dt))
        first, count = self._counts.get(key, (t, moved.least))
        if abs(t - first) > LIMITS.renewal * abs(dt):
            first, count = t, max(moved.least, count // 2)
        while count <= FEET.substeps:
            try:
                found = attempt(t, dt, count)
            except TooCoarse:
                count = max(1, 2 * count)
            else:
                self._counts[key] = (first, count)
                return found
        raise NotConverged(
            f"characteristics: {FEET.substeps} sub-steps over dt = {dt:.6g} from t = {t:.6g} leave "
            f"an error above foot_tolerance = {moved.stage.foot_error:.1e} cells; take a smaller "
            "dt, or a larger foot_tolerance of the solver"
        )

    def _compiled_feet(self, stage: Stage, t: float, dt: float) -> StageFeet | None:
        from cip.engines import cpu_loops

        path, box = self._path(stage)
        t_end, length = t + stage.end * dt, (stage.end - stage.begin) * dt
        feet = np.empty((len(stage.blocks), len(stage.jets) * self.grid.size))

        def attempt(count: int) -> int:
            found = 0
            for row, block in zip(feet, stage.blocks, strict=True):
                given = t_end, length / count, count, box, row
                said = cpu_loops.follow_all(path, stage, block, *given)
                found |= int(np.bitwise_or.reduce(said))
            return found

        if not self._refine(stage, t, dt, attempt) or not np.isfinite(feet.sum()):
            return None
        count = self._counts[stage.part(dt)][1]
        exits: list[Any] = [None] * len(feet)
        counts = (count,) * len(feet)
        made = StageFeet(feet.reshape(-1), exits, t + stage.begin * dt, t_end, counts)
        return stage.stopped(made)

    def _refine(self, stage: Stage, t: float, dt: float, attempt: Callable[[int], int]) -> bool:
        """Call attempt(count) with more and more sub-steps until no path is too coarse. False if
        NumPy must compute the feet, since paths begin on walls or too many sub-steps are needed."""
        count = self._count(stage, t, dt)
        while count <= FEET.substeps:
            found = attempt(count)
            if not found & PATH.coarse:
                self._counts[stage.part(dt)] = (self._counts[stage.part(dt)][0], count)
                self._memory.left = bool(found & PATH.left)
                return not self._memory.left
            count *= 2
        return False

    def _path(self, stage: Stage) -> Any:
        from cip.engines import cpu_loops

        key = (stage.axis, stage.blocks[0])
        if key not in self._paths:
            self._paths[key] = cpu_loops.compiled(self.grid, stage)
        return self._paths[key]

    def name(self, stage: Stage, prefix: str = "node_") -> str:
        """Name of the node function; profiles with and without limiter have one for each."""
        limited = self.limiter != 0 and stage.profile in ("cubic", "adini", "bicubic")
        return f"{prefix}{stage.profile}" + ("_limited" if limited else "")

    def bounds(self, stage: Stage) -> tuple[float, float]:
        """The bounds that the limiter imposes in a stage: between the sweeps of a splitting only
        the sign, as the field is compressed along one direction and not yet stretched along the
        others."""
        low, high = stage.bounds or self.setting.bounds
        if not stage.compressed:
            return low, high
        return (0.0 if low >= 0.0 else -np.inf), (0.0 if high <= 0.0 else np.inf)

    def _computes(self, stage: Stage, fields: int) -> bool:
        if self._memory.left or not stage.computable or self._displaced(stage) is not None:
            return False
        return not self.setting.stores_feet

    def _count(self, stage: Stage, t: float, dt: float) -> int:
        """First number of sub-steps to try: that of the last step, reduced at intervals to what a
        sample of the nodes needs, but at most by half."""
        key = stage.part(dt)
        found = self._counts.get(key)
        if found is None:
            found = self._counts[key] = (t, self._first_count(stage, t, dt))
        elif not self.setting.steady and abs(t - found[0]) > LIMITS.renewal * abs(dt):
            # A velocity that was steep between the nodes of the sample does not become smooth at
            # once: take at least half of the last number, and an even one.
            half = 2 * (found[1] // 4)
            found = self._counts[key] = (t, max(self._first_count(stage, t, dt), half))
        return found[1]

    def _first_count(self, stage: Stage, t: float, dt: float) -> int:
        # A sample of formulas; that of snapshots would take longer than to try.
        return 2 if snapshots_of(stage.velocity) is not None else stage.substeps(t, dt)


@dataclass(frozen=True, eq=False)
class Setting:
    """A scheme on a grid: the data that its stages need."""

    grid: Grid
    formulas: tuple[Formula, ...]  # the velocity, a component for each direction
    profile: str
    limiter: str | None
    bounds: tuple[float, float]  # (low, high) of the field, for the limiter "bounds"
    bounds_tolerance: float  # smaller violations are not limited; in the unit of the field
    dtype: np.dtype[Any]  # of the moments and the stored feet
    store_feet: bool | None  # None: if the velocity is steady
    steady: bool  # whether the velocity is the same at all times
    shared: Any = None  # feet that solvers of a steady velocity keep, which do not keep it alive

    @property
    def stores_feet(self) -> bool:
        """Whether feet are stored even if a kernel could compute them: by default, steady ones."""
        return self.steady if self.store_feet is None else self.store_feet
