"""Derivatives in the coefficients of sums of splines, which are taken all at once.

Each spline would be a formula of its own in the code of a path. Instead the reverse code gives the
derivative with respect to the value of the sum, and the values of the splines at the points carry
it to the coefficients, direction by direction; forward, the changes of all coefficients make a sum.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cip.formulas.expression import Expression, linear, ordered, variable
from cip.formulas.spline_basis import SplineBasis, SplineFormula
from cip.stages.stage import Stage

# Begins the names of sums of changes.
_CHANGE = "d_"


class Sums:
    """The sums of functions in the rates of a stage, whose coefficients are parameters: `nodes` are
    their derivatives in the coordinates, `others` the parameters that are no coefficients.
    """

    def __init__(self, stage: Stage) -> None:
        system = stage.system
        place = {name: q for q, name in enumerate(system.parameters)}
        self.nodes = tuple(node for node in ordered(system.rates) if node.op == "linear")
        self._places = [np.array([place[one.value] for one in node.args]) for node in self.nodes]
        self._bases = [_basis(stage, node.value[0]) for node in self.nodes]
        taken = {one.value for node in self.nodes for one in node.args}
        self.others = tuple(name for name in system.parameters if name not in taken)
        self._rest = np.array([place[name] for name in self.others], dtype=int)

    def add(self, found: Any, point: list[Any], values: Sequence[Any], shape: Any) -> None:
        """Add to a gradient the derivatives in `others`, then those in the sums' values."""
        count = len(self.others)
        found[self._rest] += [np.sum(np.broadcast_to(one, shape)) for one in values[:count]]
        nodes = zip(self.nodes, self._bases, self._places, values[count:], strict=True)
        for node, basis, places, weight in nodes:
            weights = np.broadcast_to(weight, shape)
            found[places] += basis.weighted(tuple(point[:3]), node.value[1], weights)


def changed(node: Expression, changes: Mapping[str, str]) -> Expression:
    """The sum with the changes of its coefficients, variables by their names, in place of these."""
    name, orders = node.value
    return linear(_CHANGE + name, orders, [variable(changes[one.value]) for one in node.args])


def functions_along(
    stage: Stage, rates: Sequence[Expression], numbers: Mapping[str, Any]
) -> dict[str, Any]:
    """The functions of the sums from `changed` in some rates, by their names in code; `numbers` are
    the changes of the coefficients by their variables.
    """
    found = {}
    for node in ordered(list(rates)):
        if node.op != "linear" or not node.value[0].startswith(_CHANGE):
            continue
        name, orders = node.value
        basis = _basis(stage, name.removeprefix(_CHANGE))
        own = np.array([numbers[one.value] for one in node.args], dtype=float)
        label = f"{name}_{''.join(map(str, orders))}"
        found[label] = basis.sum(own.reshape(basis.counts), orders)
    return found


def _basis(stage: Stage, label: str) -> SplineBasis:
    """The splines of the sum of this name."""
    return next(
        c.basis for c in stage.velocity if isinstance(c, SplineFormula) and c.label == label
    )
