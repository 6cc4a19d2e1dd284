"""The blocks of feet of a stage, each with the moments that it moves.

A sweep of a conservative profile in several dimensions moves each pair of a value and its mean
along the sweep by feet of its own: on the lines it is the scheme in one dimension. All other stages
have one block, which moves all moments.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from cip.sensitivities.node_slopes import NodeSlopes
from cip.stages.stage import Stage

Array = Any  # arrays of NumPy or CuPy


class Block:
    """A block of feet.

    Parameters
    ----------
    stage : Stage
    number : int
        Among the blocks of the stage.
    xp : module
        That of the arrays, NumPy or CuPy.

    Attributes
    ----------
    rows : slice
        The moments that the block moves.
    components : slice
        The components of its feet, among those of all blocks.
    """

    def __init__(self, stage: Stage, number: int, xp: Any = np) -> None:
        self.stage, self.number, self._xp = stage, number, xp
        self.bits, count = stage.blocks[number], len(stage.jets)
        self.components = slice(number * count, (number + 1) * count)
        self.rows = slice(None)
        if self.paired:
            assert stage.axis is not None
            step = 1 << stage.axis
            self.rows = slice(self.bits, self.bits + step + 1, step)

    @property
    def paired(self) -> bool:
        """Whether the block moves a value and a mean among other moments."""
        return self.stage.conservative and self.stage.grid.dim > 1

    @property
    def scheme(self) -> tuple[str, bool, int, int | None]:
        """Arguments of `cip.sensitivities.profile_derivatives.traced`."""
        stage = self.stage
        return stage.profile, stage.advect, stage.grid.dim, stage.axis

    @cached_property
    def _slopes(self) -> NodeSlopes | None:
        if not (self.paired and self.stage.profile == "csl4"):
            return None
        return NodeSlopes(self.stage.grid, self.stage.axis or 0, self._xp)

    def read(self, z: Array) -> Array:
        """The moments of the block, with slopes of csl4 between value and mean."""
        own = z[self.rows]
        if self._slopes is None:
            return own
        return self._xp.stack([own[0], self._slopes.of(own[0], own[1]), own[1]])

    def read_transposed(self, weight: Array) -> Array:
        """The weights of the moments of the block from those of what `read` gives."""
        if self._slopes is None:
            return weight
        on_values, on_means = self._slopes.transposed(weight[1])
        return self._xp.stack([weight[0] + on_values, weight[2] + on_means])


def blocks_of(stage: Stage, xp: Any = np) -> list[Block]:
    """The blocks of a stage; `xp` is the module of the arrays that they read."""
    return [Block(stage, number, xp) for number in range(len(stage.blocks))]
