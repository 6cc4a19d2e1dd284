r"""Derivatives of the feet with respect to the velocity's parameters.

With the equations :math:`y' = f(y, p)` of a foot and its derivatives, :math:`Y = dy/dp` obeys
:math:`Y' = f_y Y + f_p`. A Runge-Kutta method with fixed sub-steps, applied to both together, gives
the exact derivative of what it gives for y (Hairer, Norsett and Wanner, Solving Ordinary
Differential Equations I, 1993, section I.14).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.characteristics.feet import integrate
from cip.characteristics.flow_derivatives import LOG_DETERMINANT, Jet, System
from cip.formulas.expression import COORDINATES, Expression, constant, variable
from cip.sensitivities.blocks import Block
from cip.stages.stage import StageFeet

Array = np.ndarray[Any, np.dtype[np.float64]]


class Extended(System):
    """A system together with the derivatives of its unknowns in all of its parameters.

    Parameters
    ----------
    system : System

    Attributes
    ----------
    jets : tuple of Jet
        Those of `system`, then for each parameter the derivatives of all these. The latter are jets
        with component 4 + number, which means nothing elsewhere.
    """

    def __init__(self, system: System) -> None:
        self.moving, self.parameters = system.moving, system.parameters
        self._evaluator = None
        count = len(system.jets)
        jets, rates = list(system.jets), list(system.rates)
        for p, name in enumerate(system.parameters):
            own = [Jet(4 + p * count + q, jet.orders) for q, jet in enumerate(system.jets)]
            jets += own
            rates += [_along(system, rate, own, name) for rate in system.rates]
        self.jets, self.rates = tuple(jets), tuple(rates)

    def start(self, jet: Jet) -> float:
        """Value at tau = 0; 0 for derivatives in parameters."""
        return super().start(jet) if jet.component < 4 else 0.0


def _along(system: System, rate: Expression, own: list[Jet], name: str) -> Expression:
    """The derivative of a rate along that of all unknowns in a parameter."""
    total = constant(0.0) + rate.derivative(name)
    for q, (jet, slope) in enumerate(zip(system.jets, own, strict=True)):
        # The first unknowns are displacements, which move the point x1, x2, x3.
        moved = q < len(system.moving)
        what = COORDINATES[system.moving[q]] if moved else jet.name
        total = total + rate.derivative(what) * variable(slope.name)
    return total


def foot_derivatives(block: Block, feet: StageFeet) -> Array:
    """Derivatives of the components of the feet, shape (parameters, components, nodes).

    Displacements are in units of length here, not in cells.

    Parameters
    ----------
    block : Block
        Of a stage of a velocity with formulas.
    feet : StageFeet
        With the number of sub-steps that led to them, which is kept.
    """
    stage = block.stage
    system = Extended(stage.system)
    length = feet.t_end - feet.t_start
    points = stage.points(block.bits)
    arguments = (stage.grid, stage.velocity, system, points, feet.t_end, length)
    jets = integrate(*arguments, substeps=feet.substeps[block.number]).jets
    count = len(stage.system.jets)
    place = {jet: q for q, jet in enumerate(stage.system.jets)}
    found = np.empty((len(system.parameters), len(stage.jets), stage.grid.size))
    for p, rows in enumerate(found):
        change = {jet: jets[system.jets[count * (1 + p) + q]] for jet, q in place.items()}
        for row, jet in zip(rows, stage.jets, strict=True):
            row[:] = change[jet] if jet.component < 3 else _determinant(jet, jets, change)
    return found


def _determinant(jet: Jet, jets: dict[Jet, Array], change: dict[Jet, Array]) -> Array:
    """The change of det(dX/dx) = exp(l) or a derivative of it from that of l and its derivatives.

    Of order 0, 1 and 2 these are E, E l_a and E (l_ab + l_a l_b) with E = exp(l).
    """
    E, dl = np.exp(jets[LOG_DETERMINANT]), change[LOG_DETERMINANT]
    axes = [axis for axis in range(3) for _ in range(jet.orders[axis])]
    if not axes:
        return np.asarray(E * dl)
    first = [LOG_DETERMINANT.along(axis) for axis in axes]
    if len(axes) == 1:
        return np.asarray(E * (change[first[0]] + dl * jets[first[0]]))
    (a, b), (da, db) = (jets[one] for one in first), (change[one] for one in first)
    return np.asarray(E * (change[jet] + da * b + a * db + dl * (jets[jet] + a * b)))
