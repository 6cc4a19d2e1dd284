"""The derivative of a run: its steps are repeated and passed to `cip.sensitivities`."""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.errors import InputError, NotSupported
from cip.output.trajectory import Trajectory
from cip.sensitivities.window import Move, Window, check_differentiable, checkpoint_distance
from cip.solver.time_loop import run as repeat
from cip.sources.reaction import HalfStep, halves
from cip.stages.stage import StageFeet
from cip.stages.state import State, one_field, state_of

# Limit of the bytes of feet of unsteady velocities that are stored in addition to the states.
KEPT = 2**28


def derivative(solver: Any, run: Trajectory, checkpoints: int | None = None) -> Window:
    """The derivative of a run; its `operator` is that of `Solver.tangent`."""
    if not isinstance(run, Trajectory):
        raise InputError(f"run: expected what solver.run returned, got {type(run).__name__}")
    check_differentiable(solver.profile, solver.limiter)
    if solver._coast is not None and solver.profile == "csl4" and solver.grid.dim > 1:
        raise NotSupported(
            "land: derivatives of 'csl4' beside land and closed walls are on lines; take 'csl2'"
        )
    if solver.dtype != np.float64:
        raise InputError("dtype: derivatives need a solver with dtype=float64")
    start, times = run[0], [float(t) for t in run.times[1:]]
    one_field(start, "derivatives")
    solver._accept(start)
    if not times:
        raise InputError("run: it has no steps")
    if run.dt < 0.0:
        raise NotSupported("run: it leads back in time; differentiate a run forward in time")
    replay = Replay(solver, steps_to(start, times, run.dt))
    every = checkpoint_distance(len(replay.moves), checkpoints, start.data.nbytes)
    if solver.backend == "cpu":
        replay.keep_feet(every)
    kernels = solver._kernels
    arguments = (
        replay.moves, solver._begin(start), replay.advance, replay.feet,
        tuple(solver.parameters), every, solver.steady,
    )  # fmt: skip
    window = _device_window(kernels, *arguments) if solver.backend == "cupy" else Window(*arguments)
    if not bool((window.follow().data == kernels.place(run.final).data).all()):
        raise InputError(
            "run: it is not a run of this solver, whose steps end elsewhere, or its callback has "
            "changed states; differentiate the runs between these changes one by one"
        )
    return window


def _device_window(*arguments: Any) -> Window:
    from cip.sensitivities.device_window import DeviceWindow

    return DeviceWindow(*arguments)


def steps_to(start: State, times: list[float], dt: float) -> list[tuple[float, float]]:
    """Beginning and length of all steps of a run with outputs at these times."""
    plan: list[tuple[float, float]] = []

    def advance(state: State, length: float) -> State:
        plan.append((state.t, length))
        return state

    def same(state: Any, *_: Any) -> Any:
        return state

    repeat(start, times, dt, None, False, advance, same, same)
    return plan


def around(stages: list[Move], solver: Any, t: float, dt: float) -> list[Move | HalfStep]:
    """The moves of the step [t, t + dt]: its stages between the halves of reactions."""
    before, after = halves(solver._reactions, t, dt, solver._sea)
    return [*before, *stages, *after]


class Replay:
    """Repeats the stages of a run's steps `plan`, a list of (t, dt), with the original sub-steps;
    `moves` are the stages of all steps in order, between the halves of sources and decay."""

    def __init__(self, solver: Any, plan: list[tuple[float, float]]) -> None:
        self.solver = solver
        self.moves: list[Move | HalfStep] = []
        for t, dt in plan:
            self.moves += around([Move(stage, t, dt) for stage in solver._stages], solver, t, dt)
        self._feet: dict[int, StageFeet] = {}
        self._last: tuple[int, StageFeet] | None = None  # recomputed, requested several times
        self._kept = 0
        # For each move whether paths had left the grid before, and the sub-steps known after it.
        self._memory: list[tuple[bool, dict[Any, tuple[float, int]]]] = []

    def keep_feet(self, least: int) -> None:
        """Store the feet of the last moves that were advanced, as they cost as much as a run: as
        many as take at most `KEPT` bytes, and at least those of `least` moves."""
        components = max(len(stage.blocks) * len(stage.jets) for stage in self.solver._stages)
        size = components * self.solver.grid.size * 8
        self._kept = max(least, KEPT // size)

    def advance(self, n: int, state: State, homogeneous: bool = False) -> State:
        """The state after move n; `homogeneous` as for the engine's `apply`."""
        kernels, move = self.solver._kernels, self.moves[n]
        left, new = kernels.paths_left, n == len(self._memory)
        if isinstance(move, HalfStep):
            if new:
                self._memory.append((left, kernels.substep_counts))
            data = move.linear(state.data) if homogeneous else move.applied(state.data)
            return state_of(state.grid, state.profile, data, state.t)
        if not new:
            self._recall(n)
        known = self._feet.get(n)
        kept: list[StageFeet] | None = None if known is not None or not self._kept else []
        data = kernels.apply(move.stage, state.data, move.t, move.dt, homogeneous, kept, known)
        if kept:
            while len(self._feet) >= self._kept:
                self._feet.pop(next(iter(self._feet)))
            self._feet[n] = kept[0]
        if new:
            self._memory.append((left, kernels.substep_counts))
        return state_of(state.grid, state.profile, data, move.t + move.stage.end * move.dt)

    def feet(self, n: int) -> StageFeet:
        """The feet of move n, which was taken before."""
        if n in self._feet:
            return self._feet[n]
        if self._last is None or self._last[0] != n:
            self._recall(n)
            move = self.moves[n]
            assert isinstance(move, Move)
            self._last = n, self.solver.feet(move.stage, move.t, move.dt)
        return self._last[1]

    def _recall(self, n: int) -> None:
        kernels = self.solver._kernels
        kernels.paths_left, kernels.substep_counts = self._memory[n]
