"""The stages of a solver's step, with the data on walls as these need them."""

from __future__ import annotations

from typing import Any

from cip.formulas.formula import Formula
from cip.grid import Grid
from cip.profiles.catalogue import LINE
from cip.sources.reaction import Reaction
from cip.sources.wall_data import reacted
from cip.stages.stage import Stage, stages
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
