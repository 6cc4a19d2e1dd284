r"""Gradients in the velocity's parameters from derivatives with respect to feet, in reverse.

A foot is what the classical Runge-Kutta method makes of :math:`y' = f(y, p)`. With
:math:`\lambda = \partial L / \partial y` after a sub-step of length h, its stages
:math:`k_s = f(w_s, p)`, :math:`w_s = y + a_s h k_{s-1}`, are differentiated backward:

.. math::
    b_s = \tfrac{h}{6} c_s \lambda + a_{s+1} h v_{s+1}, \qquad v_s = f_y^T b_s, \qquad
    \lambda \leftarrow \lambda + \sum_s v_s, \qquad
    \frac{dL}{dp} \leftarrow \frac{dL}{dp} + \sum_s f_p^T b_s,

with a = (0, 1/2, 1/2, 1) and c = (1, 2, 2, 1). The cost does not grow with the number of parameters
(W. W. Hager, Runge-Kutta methods in optimal control and the transformed adjoint system, Numer.
Math. 87 (2000), 247-282). The sub-steps are those that led to the feet.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from cip.characteristics.flow_derivatives import Jet, System
from cip.engines.cpu_loops import address, kernel_of, share
from cip.engines.path_kernel import PATH, kinds
from cip.formulas.expression import (
    COORDINATES,
    RULES,
    Expression,
    constant,
    gradient,
    numpy_function,
    ordered,
    rows_of,
    statements,
    variable,
    with_names,
)
from cip.formulas.formula import functions_of
from cip.formulas.snapshots import snapshots_of
from cip.sensitivities.blocks import blocks_of
from cip.sensitivities.path_tangent import Sums, component
from cip.stages.stage import Stage, StageFeet
from skfem_adini.ground.jit import Array, Index, Out, Real, loop_over

# Placeholder that `loop_over` replaces by a kernel.
unwind: Any = None


def parameter_gradient(stage: Stage, feet: StageFeet, g: Any) -> Any:
    """The derivatives in the parameters of the system, shape (parameters,), from those in the
    components of all feet, `g`, shape (components, nodes), displacements as lengths. The feet have
    their numbers of sub-steps; paths that begin on a wall are left out."""
    compiled = all(c.exact for c in stage.velocity) and snapshots_of(stage.velocity) is None
    found = np.zeros(len(stage.system.parameters))
    for block in blocks_of(stage):
        points, own = [x.ravel() for x in stage.points(block.bits)], g[block.components]
        if feet.bounded or feet.stops:  # beyond the wall the velocity need not be defined
            inside = feet.interior(stage.grid.size, block.number)
            points, own = [x[inside] for x in points], own[:, inside]
        count = feet.substeps[block.number]
        found += (_by_numba if compiled else _by_numpy)(stage, feet, count, points, own)
    return found


def _once_a_system(make: Callable[..., Any]) -> Callable[..., Any]:
    """Cache a function of a system and further arguments as long as the system exists."""
    known: WeakKeyDictionary[System, dict[Any, Any]] = WeakKeyDictionary()

    @wraps(make)
    def found(system: System, *more: Any) -> Any:
        own = known.setdefault(system, {})
        if more not in own:
            own[more] = make(system, *more)
        return own[more]

    return found


@_once_a_system
def _pulled(
    system: System, parameters: tuple[str, ...], sums: tuple[Expression, ...] = ()
) -> list[Expression]:
    """``f_y^T b`` for all unknowns, then ``f_p^T b``, with b in variables b0, b1, ..., and last the
    derivatives in `sums`, nodes of the rates."""
    total = constant(0.0)
    for q, rate in enumerate(system.rates):
        total = total + variable(f"b{q}") * rate
    # The first unknowns are displacements, which move the point x1, x2, x3.
    names = [COORDINATES[axis] for axis in system.moving]
    names += [jet.name for jet in system.jets[len(system.moving) :]]
    return gradient(total, [*names, *parameters], sums)


def _seeds(system: System, wanted: tuple[Jet, ...]) -> list[Expression]:
    """Derivatives with respect to the unknowns of the sum of g0, g1, ... times the components."""
    total = constant(0.0)
    for q, jet in enumerate(wanted):
        total = total + variable(f"g{q}") * component(jet)
    return gradient(total, [jet.name for jet in system.jets])


def _by_numpy(stage: Stage, feet: StageFeet, count: int, points: list[Any], g: Any) -> Any:
    """The gradient for velocities known by their values."""
    system, length = stage.system, feet.t_end - feet.t_start
    jets = [jet.name for jet in system.jets]
    sums = Sums(stage)
    pulled = _pulled(system, sums.others, sums.nodes)
    steps = (*stage.grid.spacing, *([1.0] * (3 - stage.grid.dim)), 1.0)
    functions = functions_of(stage.velocity, [*system.rates, *pulled], steps)
    arguments = [*COORDINATES, *jets]
    backward = [*arguments, *(f"b{q}" for q in range(len(jets)))]
    rates = numpy_function(system.rates, arguments, functions)
    pull = numpy_function(pulled, backward, functions)
    seeds = [f"g{q}" for q in range(len(stage.jets))]
    seed = numpy_function(_seeds(system, tuple(stage.jets)), [*jets, *seeds])
    start = np.array([system.start(jet) for jet in system.jets])
    found = np.zeros(len(system.parameters))
    for first in range(0, points[0].size, 4096):  # number of nodes at a time
        part = slice(first, first + 4096)
        base = [x[part] for x in points]
        y = np.repeat(start[:, None], base[0].size, axis=1)
        run = _Chunk(system, sums, rates, pull, base, feet.t_end, length / count)
        trail = []
        for n in range(count):
            y, stages = run.forward(y, n)
            trail.append(stages)
        slopes = rows_of(seed(*y, *g[:, part]), y.shape[1:])
        for n in range(count - 1, -1, -1):
            slopes, more = run.backward(slopes, trail[n], n)
            found += more
    return found


class _Chunk:
    def __init__(
        self, system: System, sums: Sums, rates: Any, pull: Any, base: list[Any], t_end: float,
        step: float,
    ) -> None:  # fmt: skip
        self.system, self.sums, self.rates, self.pull = system, sums, rates, pull
        self.base, self.t_end, self.step = base, t_end, step

    def forward(self, y: Any, n: int) -> tuple[Any, list[Any]]:
        """The unknowns after a sub-step, and the places of its stages."""
        k, total, stages = np.zeros_like(y), np.zeros_like(y), []
        for s in range(4):
            stages.append(y + PATH.shift[s] * self.step * k)
            k = rows_of(self.rates(*self._point(stages[s], n, s), *stages[s]), y.shape[1:])
            total += PATH.weight[s] * k
        return y + self.step / 6.0 * total, stages

    def backward(self, slopes: Any, stages: list[Any], n: int) -> tuple[Any, Any]:
        """Derivatives with respect to the unknowns before a sub-step, and to the parameters."""
        found, v = np.zeros(len(self.system.parameters)), np.zeros_like(slopes)
        total = np.zeros_like(slopes)
        for s in (3, 2, 1, 0):
            later = PATH.shift[s + 1] * self.step * v if s < 3 else 0.0
            b = self.step / 6.0 * PATH.weight[s] * slopes + later
            point = self._point(stages[s], n, s)
            values = self.pull(*point, *stages[s], *b)
            v = rows_of(values[: len(b)], slopes.shape[1:])
            self.sums.add(found, point, values[len(b) :], b.shape[1:])
            total = total + v
        return slopes + total, found

    def _point(self, y: Any, n: int, s: int) -> list[Any]:
        place = {axis: q for q, axis in enumerate(self.system.moving)}
        point = [x + y[place[axis]] if axis in place else x for axis, x in enumerate(self.base)]
        point += [np.zeros(())] * (3 - len(point))
        return [*point, self.t_end - n * self.step - PATH.shift[s] * self.step]


@_once_a_system
def unwind_source(system: System, wanted: tuple[Jet, ...]) -> str:
    """Source of `rates`, `pull` and ``unwind(g, size, o, x1, x2, x3, t, step, count, values, trail,
    grad)``, which adds derivatives in the parameters to `grad`. `trail`, of `trail_length` numbers,
    keeps the unknowns of all stages and the (costly) functions shared by rates and derivatives."""
    m, jets = len(system.jets), [jet.name for jet in system.jets]
    kept = _kept(system)
    width = m + len(kept)
    seeds = {f"l{q}": part for q, part in enumerate(_seeds(system, wanted))}
    place = {axis: q for q, axis in enumerate(system.moving)}

    def at(row: int, q: int) -> str:
        return f"trail[free + {row * m + q}]"

    point = [f"{x} + u{place[a]}" if a in place else x for a, x in enumerate(COORDINATES[:3])]
    call = ", ".join([*point, "s", *(f"u{q}" for q in range(m)), *system.parameters])
    shift = ["c = 0.5", "if stage == 0:", "    c = 0.0", "if stage == 3:", "    c = 1.0"]
    weight = ["e = 2.0", "if stage == 0 or stage == 3:", "    e = 1.0"]
    every, names = range(m), [f"e{q}" for q in range(len(kept))]
    results = ", ".join([*(f"r{q}" for q in every), *names])
    forward = [
        *shift, *weight, "s = t - n * step - c * step",
        *(f"u{q} = {at(0, q)} + c * step * {at(1, q)}" for q in every),
        *(f"trail[(4 * n + stage) * {width} + {q}] = u{q}" for q in every),
        f"{results} = rates({call})",
        *(f"trail[(4 * n + stage) * {width} + {m + q}] = e{q}" for q in range(len(kept))),
        *(f"{at(1, q)} = r{q}" for q in every),
        *(f"{at(2, q)} += e * r{q}" for q in every),
    ]  # fmt: skip
    backward = [
        "stage = 3 - turn", *shift, *weight, "s = t - n * step - c * step",
        *(f"u{q} = trail[(4 * n + stage) * {width} + {q}]" for q in every),
        *(f"e{q} = trail[(4 * n + stage) * {width} + {m + q}]" for q in range(len(kept))),
        *(f"b{q} = step * (1.0 / 6.0) * e * {at(0, q)} + later * step * {at(1, q)}" for q in every),
        f"{', '.join(f'v{q}' for q in every)} = "
        f"pull({call}, {', '.join([f'b{q}' for q in every] + names)}, grad)",
        *(f"{at(1, q)} = v{q}" for q in every),
        *(f"{at(2, q)} += v{q}" for q in every),
        "later = c",
    ]  # fmt: skip
    lines = [
        *_rates_and_pull(system, kept),
        "def unwind(g: Array, size: Index, o: Index, x1: Real, x2: Real, x3: Real, t: Real, "
        "step: Real, count: Index, values: Array, trail: Out, grad: Out) -> None:",
        *(f"    {name} = values[{q}]" for q, name in enumerate(system.parameters)),
        f"    free = 4 * count * {width}",
        *(f"    {at(0, q)} = {system.start(jet)!r}" for q, jet in enumerate(system.jets)),
        "    for n in range(count):",
        *(f"        {at(row, q)} = 0.0" for row in (1, 2) for q in every),
        "        for stage in range(4):",
        *(f"            {line}" for line in forward),
        *(f"        {at(0, q)} += step * (1.0 / 6.0) * {at(2, q)}" for q in every),
        *(f"    {name} = {at(0, q)}" for q, name in enumerate(jets)),
        *(f"    g{q} = g[{q} * size + o]" for q in range(len(wanted))),
        *statements(seeds),
        *(f"    {at(0, q)} = l{q}" for q in every),
        "    for back in range(count):",
        "        n = count - 1 - back",
        "        later = 0.0",
        *(f"        {at(row, q)} = 0.0" for row in (1, 2) for q in every),
        "        for turn in range(4):",
        *(f"            {line}" for line in backward),
        *(f"        {at(0, q)} += {at(2, q)}" for q in every),
    ]
    return "\n".join(lines) + "\n"


def _rates_and_pull(system: System, kept: list[Expression]) -> list[str]:
    """Code of `rates`, which also gives the functions to keep, and of `pull`, which takes them."""
    m, jets = len(system.jets), [jet.name for jet in system.jets]
    results = {f"r{q}": rate for q, rate in enumerate(system.rates)}
    results.update({f"e{q}": node for q, node in enumerate(kept)})
    known = {node: variable(f"e{q}") for q, node in enumerate(kept)}
    slopes = {
        f"d{q}": part
        for q, part in enumerate(with_names(_pulled(system, tuple(system.parameters)), known))
    }
    given = [*COORDINATES, *jets, *system.parameters]
    more = [*(f"b{q}" for q in range(m)), *(f"e{q}" for q in range(len(kept)))]
    head, rest = (", ".join(f"{name}: Real" for name in names) for names in (given, more))
    return [
        f"def rates({head}) -> {kinds(len(results))}:",
        *statements(results),
        f"    return {', '.join(results)}",
        "",
        f"def pull({head}, {rest}, grad: Out) -> {kinds(m)}:",
        *statements(slopes),
        *(f"    grad[{q}] += d{m + q}" for q in range(len(system.parameters))),
        f"    return {', '.join(f'd{q}' for q in range(m))}",
        "",
    ]


def trail_length(system: System, count: int) -> int:
    """Numbers that `unwind` needs for `count` sub-steps."""
    m = len(system.jets)
    return 4 * count * (m + len(_kept(system))) + 3 * m


@_once_a_system
def _kept(system: System) -> list[Expression]:
    """Functions in the reverse formulas that do not depend on the variables b."""
    later = {f"b{q}" for q in range(len(system.jets))}
    return [
        node
        for node in ordered(_pulled(system, tuple(system.parameters)))
        if node.op in RULES and not later & node.variables()
    ]


def run_nodes(
    start: Index, stop: Index, g: Array, size: Index, x: Array, y: Array, z: Array, t: Real,
    step: Real, count: Index, values: Array, trail: Out, grad: Out,
) -> None:  # fmt: skip
    """Process nodes start..stop; their gradients are added to `grad`."""
    g, values, trail, grad = address(g), address(values), address(trail), address(grad)
    x, y, z = address(x), address(y), address(z)
    for o in range(start, stop):
        unwind(g, size, o, x[o], y[o], z[o], t, step, count, values, trail, grad)


def _by_numba(stage: Stage, feet: StageFeet, count: int, points: list[Any], g: Any) -> Any:
    """The gradient for velocities that are formulas."""
    system, size = stage.system, points[0].size
    run = loop_over(run_nodes, unwind=kernel_of(unwind_source(system, tuple(stage.jets))))
    points = [np.ascontiguousarray(x) for x in points]
    points += [np.zeros(size)] * (3 - stage.grid.dim)
    values, length = np.array(stage.parameters), feet.t_end - feet.t_start
    length_of_trail = trail_length(system, count)
    # Strips, and so the rounding of sums, do not depend on the number of threads.
    strips = max(1, min(4, size // 2_000))
    cuts = [size * strip // strips for strip in range(strips + 1)]
    found = np.zeros((strips, len(values)))
    flat = np.ascontiguousarray(g).reshape(-1)

    def work(first: int, last: int) -> None:
        trail = np.empty(length_of_trail)
        for strip in range(first, last):
            run(
                cuts[strip], cuts[strip + 1], flat, size, *points, feet.t_end, length / count,
                count, values, trail, found[strip],
            )  # fmt: skip

    share(work, strips, size)
    return found.sum(axis=0)
