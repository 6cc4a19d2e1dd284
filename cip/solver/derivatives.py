"""The derivative of a run: its steps, taken once more, handed to `cip.sensitivities`."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator

from cip.errors import InputError
from cip.output.trajectory import Trajectory
from cip.sensitivities.window import Window, check_differentiable, checkpoint_distance
from cip.solver.time_loop import run as repeat
from cip.stages.stage import StageFeet
from cip.stages.state import State


def derivative(solver: Any, run: Trajectory, checkpoints: int | None) -> LinearOperator:
    """The derivative of a run as an operator.

    Parameters
    ----------
    solver, run, checkpoints
        As for `Solver.tangent`.
    """
    if not isinstance(run, Trajectory):
        raise InputError(f"run: expected what solver.run returned, got {type(run).__name__}")
    check_differentiable(solver.profile, solver.limiter, solver.grid.dim, solver.backend)
    if solver.dtype != np.float64:
        raise InputError("dtype: derivatives need a solver with dtype=float64")
    start, times = run[0], [float(t) for t in run.times[1:]]
    solver._accept(start)
    if not times:
        raise InputError("run: it has no steps")
    (stage,) = solver._stages
    replay = Replay(solver, steps_to(start, times, run.dt))
    every = checkpoint_distance(len(replay.plan), checkpoints, start.data.nbytes)
    window = Window(
        stage, replay.plan, solver._kernels.begin(start), replay.advance, replay.feet,
        tuple(solver.velocity.parameters), every, solver.steady,
    )  # fmt: skip
    if not np.array_equal(window.follow().data, run.final.data):
        raise InputError("run: it is not a run of this solver, whose steps end elsewhere")
    return window.operator()


def steps_to(start: State, times: list[float], dt: float) -> list[tuple[float, float]]:
    """Beginning and length of all steps of a run with outputs at these times."""
    plan: list[tuple[float, float]] = []

    def advance(state: State, length: float) -> State:
        plan.append((state.t, length))
        return state

    repeat(
        start, times[-1], dt, times, None, False, advance, lambda state: state,
        lambda states, interrupted: states,
    )  # fmt: skip
    return plan


class Replay:
    """The steps of a run, repeated with the numbers of sub-steps that were taken at first.

    Parameters
    ----------
    solver : Solver
    plan : list of (t, dt)
    """

    def __init__(self, solver: Any, plan: list[tuple[float, float]]) -> None:
        self.solver, self.plan = solver, plan
        self._counts: list[dict[Any, tuple[float, int]]] = []

    def advance(self, n: int, state: State) -> State:
        """The state after step n."""
        kernels, (t, dt) = self.solver._kernels, self.plan[n]
        if n < len(self._counts):
            kernels.substep_counts = self._counts[n]
        new: State = self.solver._advance(State(state.grid, state.profile, state.data, t), dt)
        if n == len(self._counts):
            self._counts.append(kernels.substep_counts)
        return new

    def feet(self, n: int) -> StageFeet:
        """The feet of step n, which was taken before."""
        self.solver._kernels.substep_counts = self._counts[n]
        found: StageFeet = self.solver.feet(self.solver._stages[0], *self.plan[n])
        return found
