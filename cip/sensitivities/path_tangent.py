r"""The change of feet along a direction of the velocity's parameters.

With the equations :math:`y' = f(y, p)` of a foot and its derivatives, the change
:math:`Y = (dy/dp)\,d` obeys :math:`Y' = f_y Y + f_p\,d`. A Runge-Kutta method with fixed sub-steps,
applied to both together, gives the exact change of its result for y (Hairer, Norsett and Wanner,
Solving Ordinary Differential Equations I, 1993, section I.14). The cost does not grow with the
number of parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from cip.characteristics.feet import integrate
from cip.characteristics.flow_derivatives import LOG_DETERMINANT, Jet, System, exponential
from cip.engines.path_kernel import rate_function, runge_kutta
from cip.formulas.expression import (
    COORDINATES,
    Expression,
    apply,
    constant,
    gradient,
    linear,
    numpy_function,
    ordered,
    rows_of,
    statements,
    variable,
)
from cip.formulas.snapshots import snapshots_of
from cip.formulas.spline_basis import SplineBasis, SplineFormula
from cip.sensitivities.blocks import Block
from cip.stages.stage import Stage, StageFeet

Array = Any  # arrays of NumPy or CuPy
# Number of nodes from which on compiling a system (seconds) saves time.
_COMPILE_FROM = 20_000


class Directional(System):
    """A system together with the changes of its unknowns along a direction of its parameters. The
    changes are further `jets`, with component 4 + number, and further `parameters`."""

    def __init__(self, system: System) -> None:
        self.moving, self._evaluator = system.moving, None
        self.directions = [f"d_{name}" for name in system.parameters]
        self.parameters = [*system.parameters, *self.directions]
        changes = tuple(Jet(4 + q, jet.orders) for q, jet in enumerate(system.jets))
        self.changes = dict(zip(system.jets, changes, strict=True))
        self.jets = (*system.jets, *changes)
        # The first unknowns are displacements, which move the point x1, x2, x3.
        names = [COORDINATES[axis] for axis in system.moving]
        names += [jet.name for jet in system.jets[len(names) :]]
        moves = dict(zip(names, (jet.name for jet in changes), strict=True))
        moves.update(zip(system.parameters, self.directions, strict=True))
        self.rates = (*system.rates, *(_along(rate, moves) for rate in system.rates))

    def start(self, jet: Jet) -> float:
        """Value at tau = 0; 0 for changes."""
        return super().start(jet) if jet.component < 4 else 0.0

    def change(self, wanted: Jet) -> Expression:
        """The change of a component of the foot, displacements as lengths."""
        moves = {jet.name: change.name for jet, change in self.changes.items()}
        return _along(component(wanted), moves)


def _along(value: Expression, moves: dict[str, str]) -> Expression:
    """The derivative along the variables that are the changes of others. Coefficients of sums occur
    nowhere else, so the changes of all of them make one sum."""
    sums = [node for node in ordered([value]) if node.op == "linear"]
    coefficients = {one.value for node in sums for one in node.args}
    total = constant(0.0)
    for name, change in moves.items():
        if name not in coefficients:
            total = total + value.derivative(name) * variable(change)
    for node, slope in zip(sums, gradient(value, (), sums), strict=True):
        total = total + slope * changed(node, moves)
    return total


def component(jet: Jet) -> Expression:
    """A component of the foot in the unknowns: det(dX/dx) = exp(l) and its derivatives."""
    if jet.component < 3:
        return variable(jet.name)
    E = apply("exp", variable(LOG_DETERMINANT.name))
    found: Expression = exponential(jet, lambda one: variable(one.name), E)
    return found


def tangent_source(system: Directional, wanted: tuple[Jet, ...]) -> str:
    """Source of `rates` and ``tangent(feet, x1, x2, x3, t, step, count, box)``, which writes the
    changes of the components and returns 0; `box` holds the values of the parameters and their
    changes, the other arguments are those of `cip.engines.path_kernel.path_source`."""
    jets = [jet.name for jet in system.jets]
    found = {f"z{f}": system.change(jet) for f, jet in enumerate(wanted)}
    lines = [
        *rate_function("rates", system.rates, [*jets, *system.parameters], None),
        "def tangent(feet: Out, x1: Real, x2: Real, x3: Real, t: Real, step: Real, count: Index, "
        "box: Array) -> Index:",
        *(f"    {name} = box[{q}]" for q, name in enumerate(system.parameters)),
        *(f"    y{q} = {system.start(jet)!r}" for q, jet in enumerate(system.jets)),
        "    for n in range(count):",
        *(f"        {line}" for line in runge_kutta(system)),
        *(f"    {name} = y{q}" for q, name in enumerate(jets)),
        *statements(found),
        *(f"    feet[{f}] = z{f}" for f in range(len(wanted))),
        "    return 0",
    ]
    return "\n".join(lines) + "\n"


class PathTangent:
    """The changes of the feet of a stage of a velocity with parameters."""

    xp: Any = np

    def __init__(self, stage: Stage) -> None:
        self._stage, self._system = stage, Directional(stage.system)
        formula = all(c.exact for c in stage.velocity) and snapshots_of(stage.velocity) is None
        self._compiled = formula and stage.grid.size >= _COMPILE_FROM

    def along(self, blocks: list[Block], feet: StageFeet, direction: Array) -> Array:
        """The changes of all components, shape (components, nodes), displacements as lengths, for a
        change of the system's parameters, shape (parameters,). Numbers of sub-steps do not change;
        paths that begin on a wall get change 0."""
        size, count = self._stage.grid.size, len(self._stage.jets)
        found = self.xp.empty((len(blocks) * count, size))
        for block in blocks:
            rows = found[block.components]
            if self._compiled:
                values = np.array([*self._stage.parameters, *direction], dtype=float)
                self._by_kernel(block, feet, values, rows)
            else:
                rows[:] = self.xp.asarray(self._by_numpy(block, feet, direction))
            if feet.stops or feet.exits[block.number] is not None:
                rows[:, self.xp.asarray(~feet.interior(size, block.number))] = 0.0
        return found

    def _step(self, block: Block, feet: StageFeet) -> tuple[float, int]:
        """Length and number of the sub-steps of a block."""
        count = feet.substeps[block.number]
        return (feet.t_end - feet.t_start) / count, count

    @cached_property
    def source(self) -> str:
        """Source of the kernel ``tangent``."""
        return tangent_source(self._system, tuple(self._stage.jets))

    def _by_kernel(self, block: Block, feet: StageFeet, values: Array, out: Array) -> None:
        """The changes for formulas on many nodes."""
        from cip.engines.cpu_loops import follow_all, kernel_of

        given = feet.t_end, *self._step(block, feet), values, out.reshape(-1)
        follow_all(kernel_of(self.source), self._stage, block.bits, *given)

    def _by_numpy(self, block: Block, feet: StageFeet, direction: Array) -> Array:
        """The changes for velocities known by their values, and for few nodes."""
        stage, system = self._stage, self._system
        length, points = feet.t_end - feet.t_start, stage.points(block.bits)
        known: dict[str, Any] = dict(
            zip(system.directions, map(np.float64, direction), strict=True)
        )
        known |= functions_along(stage, system.rates, known)
        jets = integrate(
            stage.grid, stage.velocity, system, points, feet.t_end, length,
            substeps=feet.substeps[block.number], known=known,
        ).jets  # fmt: skip
        changes = numpy_function(
            [system.change(jet) for jet in stage.jets], [jet.name for jet in system.jets]
        )
        return rows_of(changes(*jets.values()), (stage.grid.size,))


# Prefix of the names of sums of changes.
_CHANGE = "d_"


class Sums:
    """The sums of splines in the rates of a stage, whose coefficients are parameters: `nodes` are
    their derivatives in the coordinates, `others` the parameters that are no coefficients. Reverse
    code gives the derivative in the value of a sum, the values of the splines carry it to all
    coefficients at once, direction by direction."""

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
    """The sum with the changes of its coefficients, as variables, in place of the coefficients."""
    name, orders = node.value
    return linear(_CHANGE + name, orders, [variable(changes[one.value]) for one in node.args])


def functions_along(
    stage: Stage, rates: Sequence[Expression], numbers: Mapping[str, Any]
) -> dict[str, Any]:
    """The functions of the sums from `changed` in some rates, by their names in code; `numbers` are
    the changes of the coefficients by their variables."""
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
