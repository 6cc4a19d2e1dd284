r"""Inflow data as the transport needs them between the halves of sources and decay.

What enters at the time t* within a step undergoes source and decay from then on, :math:`t_{end} -
t^*`, but the splitting lets them act on it for the half after the transport, from the middle
:math:`t_m` of the step on. So the transport takes in the data carried on for :math:`t_m - t^*`,
:math:`g e^{-k (t_m - t^*)} + (t_m - t^*) s`, which keeps the second order up to the walls.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cip.errors import NotSupported
from cip.formulas.expression import Expression, apply, variable
from cip.formulas.formula import Formula
from cip.sources.reaction import Reaction
from cip.stages.walls import MIDDLE, Wall


class ReactedData(Formula):
    """The data of a wall, carried on until the middle of the step."""

    def __init__(self, data: Formula, reaction: Reaction) -> None:
        node, left = data.expression, variable(MIDDLE) - variable("t")
        self._parts = [data]
        if reaction.decay is not None:
            self._parts.append(reaction.decay_formula)
            node = node * apply("exp", -(reaction.decay_formula.expression * left))
        if reaction.source is not None:
            self._parts.append(reaction.source_formula)
            node = node + left * reaction.source_formula.expression
        super().__init__(node, data.dim)

    def functions(self, nodes: Sequence[Expression], steps: Sequence[float]) -> dict[str, Any]:
        """What `nodes` need of data, source and decay besides coordinates, by the names in code."""
        found: dict[str, Any] = {}
        for part in self._parts:
            found.update(part.functions(nodes, steps))
        return found


def reacted(
    data: dict[Wall, Formula], reaction: Reaction | None, split: bool
) -> dict[Wall, Formula]:
    """The data of all walls as the transport of a step needs them. Those of a `split` step are
    constant and stay as they are; raises `NotSupported` if decay would change them.
    """
    if reaction is None:
        return data
    if not split:
        return {wall: ReactedData(formula, reaction) for wall, formula in data.items()}
    for (axis, side), formula in data.items():
        node = formula.expression
        if reaction.decay is not None and not (node.op == "constant" and node.value == 0.0):
            raise NotSupported(
                f"decay: with splitting the data of the wall {'xyz'[axis]}{'-+'[side]} must be "
                "zero; take a direct profile ('adini', 'bicubic') for other data"
            )
    return data
