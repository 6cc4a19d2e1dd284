"""A solver's step: its stages, with the data on walls as these need them, and their order."""

from __future__ import annotations

from typing import Any

from cip.engines.engine import Engine
from cip.formulas.formula import Formula
from cip.grid import Grid
from cip.profiles.catalogue import LINE
from cip.sources.half_step import halves
from cip.sources.reaction import Reaction
from cip.sources.wall_data import reacted
from cip.stages.stage import Stage, stages
from cip.stages.state import State, state_of
from cip.stages.walls import check_split, walls


def made_stages(
    grid: Grid,
    velocity: tuple[Formula, ...],
    profile: str,
    advect: bool,
    boundary: Any,
    reaction: Reaction | None,
) -> list[Stage]:
    """The stages of one step.

    Parameters
    ----------
    grid : Grid
    velocity : tuple of Formula
    profile : str
    advect : bool
    boundary : object
        The argument of the solver.
    reaction : Reaction or None
        What acts before and after the stages.
    """
    data = walls(boundary, grid)
    split = grid.dim > 1 and profile in LINE
    if split:
        check_split(data, advect)
    return stages(grid, velocity, profile, advect, reacted(data, reaction, split))


def advanced(
    kernels: Engine, made: list[Stage], reaction: Reaction | None, state: State, dt: float
) -> State:
    """The state after a step: the stages between the halves of sources and decay.

    Parameters
    ----------
    kernels : Engine
    made : list of Stage
    reaction : Reaction or None
    state : State
    dt : float
    """
    data, t = state.data, state.t
    before, after = halves(reaction, t, dt) if reaction is not None else (None, None)
    if before is not None:
        data = before.applied(data)
    for stage in made:
        data = kernels.apply(stage, data, t, dt)
    if after is not None:
        data = after.applied(data)
    return state_of(state.grid, state.profile, data, t + dt)
