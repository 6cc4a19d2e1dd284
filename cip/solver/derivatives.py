"""The derivative of a run: its steps, taken once more, handed to `cip.sensitivities`."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator

from cip.errors import InputError
from cip.output.trajectory import Trajectory
from cip.sensitivities.window import Window, check_differentiable, checkpoint_distance
from cip.solver.time_loop import run as repeat
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
    plan: list[tuple[float, float]] = []

    def advance(state: State, dt: float) -> State:
        plan.append((state.t, dt))
        return solver._advance(state, dt)

    again = repeat(
        start, times[-1], run.dt, times, None, False, advance, solver._kernels.begin,
        lambda states, interrupted: list(states),
    )[-1]  # fmt: skip
    if not np.array_equal(again.data, run.final.data):
        raise InputError("run: it is not a run of this solver, whose steps end elsewhere")
    (stage,) = solver._stages
    parameters = tuple(solver.velocity.parameters)
    every = checkpoint_distance(len(plan), checkpoints)
    window = Window(
        stage, plan, start, solver._advance, lambda t, dt: solver.feet(stage, t, dt), parameters,
        every, solver.steady,
    )  # fmt: skip
    return window.operator()
