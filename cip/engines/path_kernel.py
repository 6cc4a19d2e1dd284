"""Kernel that computes the characteristic of one node within the update.

For a velocity that is a formula the equations of `cip.characteristics.flow_derivatives` become
straight-line code in the kernel language: one function for the rates, one for the classical
Runge-Kutta steps of a node. numba compiles it for the CPU, `cip.engines.cuda_source` translates it
for the device.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import NamedTuple

from cip.characteristics.feet import FEET
from cip.characteristics.flow_derivatives import LOG_DETERMINANT, Jet, System
from cip.engines.snapshot_kernel import (
    Layout,
    derivatives_in,
    room_needed,
    spline_source,
    weight_source,
)
from cip.errors import NotSupported
from cip.formulas.expression import (
    COORDINATES,
    Expression,
    ordered,
    statements,
    variable,
    with_names,
)
from cip.formulas.snapshots import Snapshots
from cip.grid import Grid


class _Path(NamedTuple):  # the kernel of a path
    # Fractions of a sub-step at which the classical Runge-Kutta method evaluates the rates, and its
    # weights in sixths of the sub-step.
    shift: tuple[float, ...] = (0.0, 0.5, 0.5, 1.0)
    weight: tuple[float, ...] = (1.0, 2.0, 2.0, 1.0)
    left: int = 1  # bit of its result: the path left the box
    coarse: int = 2  # bit of its result: the sub-steps were too long
    foot_room: int = 16  # length of a foot's array: quintic sweeps in three dimensions need 12
    spline_room: int = 256  # with values and weights of quintic splines and their derivatives


PATH = _Path()


def box_of(grid: Grid, system: System, limit: float, rounding: float) -> list[float]:
    """The limits that the kernel `path` checks, five numbers for each direction of motion: cells
    per unit of length; lowest and highest coordinate (walls, or `FEET.cells` cells from the ends);
    largest error of a displacement, absolute (`limit` is in cells) and relative (rounding)."""
    noise = 256.0 * rounding  # relative rounding error after some hundred sub-steps
    found = []
    for axis in system.moving:
        low, high = grid.bounds[axis]
        h = grid.spacing[axis]
        margin = (FEET.cells if grid.periodic[axis] else FEET.wall) * h
        found += [1.0 / float(grid.widths[axis][0]), low - margin, high + margin]
        found += [limit * h + noise * max(abs(low), abs(high)), noise]
    return found


def plain(node: Expression) -> bool:
    """Whether a node is a number that code may hold: one by which formulas are simplified."""
    return node.op == "constant" and abs(node.value) in (0.0, 0.5, 1.0, 2.0)


def numbers_as_parameters(system: System) -> tuple[System, list[float]]:
    """The system with further parameters in place of the numbers in its rates, and their values:
    its code is the same for other numbers."""
    nodes = [node for node in ordered(list(system.rates)) if node.op == "constant"]
    found = [node for node in nodes if not plain(node)]
    names = [f"p_{q}" for q in range(len(found))]  # no name of a user begins with a digit
    new = copy(system)
    new.rates = tuple(with_names(system.rates, dict(zip(found, map(variable, names), strict=True))))
    new.parameters = [*system.parameters, *names]
    return new, [node.value for node in found]


def path_source(
    system: System,
    wanted: Sequence[Jet],
    box: Sequence[float],
    constant: bool = True,
    field: Snapshots | None = None,
) -> str:
    """Python source of `rates`, `velocity` and ``path(feet, x1, x2, x3, t, step, count, box)``,
    which writes the jets `wanted`, displacements in cells, and returns 0; `PATH.left` if it leaves
    the box or is not finite; `PATH.coarse` if, for even `count`, the defect of Simpson's rule,
    |y_{n+2} - y_n - (f_n + 4 f_{n+1} + f_{n+2}) h / 3| = O(h^5), is too large. `box` (omitted if
    empty) holds `box_of` unless `constant`, then parameters, then the table of a `field`."""
    numbers = [repr(x) if constant else f"box[{q}]" for q, x in enumerate(box)]
    first = 0 if constant else len(box)
    more = ", box: Array" if system.parameters or field or not constant else ""
    splines = None
    if field is not None:
        start = first + len(system.parameters)
        splines = Layout(field.degrees, field.components, start, PATH.foot_room)
    sides = [numbers[start : start + 5] for start in range(0, len(numbers), 5)]
    lines = [
        *_rate_functions(system, splines),
        "def path(feet: Out, x1: Real, x2: Real, x3: Real, t: Real, step: Real,"
        f" count: Index{more}) -> Index:",
        *(f"    {name} = box[{first + q}]" for q, name in enumerate(system.parameters)),
        "    found = 0",
        *(f"    y{q} = {system.start(jet)!r}" for q, jet in enumerate(system.jets)),
        *(f"    {letter}{q} = 0.0" for letter in "eog" for q in range(len(sides))),
        "    for n in range(count):",
        *(f"        {line}" for line in _substep(system, splines)),
        *(f"        {line}" for line in _leaves(system, sides)),
        *(f"    {line}" for line in _judgement(system, sides, splines)),
        *(f"    {line}" for line in _results(system, wanted, [side[0] for side in sides])),
        f"    if found == {PATH.left}:",
        "        feet[0] = 1e308 * 1e308",
        "    return found",
    ]
    return "\n".join(lines) + "\n"


def _rate_functions(system: System, splines: Layout | None) -> list[str]:
    """The functions `rates` of all unknowns and `velocity` of the displacements alone."""
    jets = [jet.name for jet in system.jets]
    first = system.rates[: len(system.moving)]
    lines = []
    if splines is not None:
        lists = [derivatives_in(rates) for rates in (system.rates, first)]
        if max(room_needed(splines, nodes) for nodes in lists) > PATH.spline_room - PATH.foot_room:
            raise NotSupported("profile: too many derivatives of snapshots; take degree=3")
        lines += [*weight_source(splines, *lists), ""]
    return [
        *lines,
        *rate_function("rates", system.rates, [*jets, *system.parameters], splines),
        *rate_function("velocity", first, system.parameters, splines),
    ]


def rate_function(
    name: str, rates: Sequence[Expression], more: Sequence[str], splines: Layout | None
) -> list[str]:
    """A function of x1, x2, x3, t and `more`; where there are splines also of their room."""
    arguments = [f"{x}: Real" for x in (*COORDINATES, *more)]
    lines: list[str] = []
    first: list[str] = []
    if splines is not None:
        nodes = derivatives_in(rates)
        lines += [*spline_source(splines, f"splines_of_{name}", nodes), ""]
        first.append(f"    splines_of_{name}({', '.join(COORDINATES)}, box, work)")
        first += [f"    s{q} = work[{splines.room + q}]" for q in range(len(nodes))]
        rates = with_names(rates, {node: variable(f"s{q}") for q, node in enumerate(nodes)})
        arguments += ["box: Array", "work: Out"]
    outputs = {f"r{q}": rate for q, rate in enumerate(rates)}
    return [
        *lines,
        f"def {name}({', '.join(arguments)}) -> {kinds(len(outputs))}:",
        *first,
        *statements(outputs),
        f"    return {', '.join(outputs)}",
        "",
    ]


def _substep(system: System, splines: Layout | None) -> list[str]:
    """Code of a Runge-Kutta step; every second one adds the defect of Simpson's rule."""
    moving = range(len(system.moving))
    lines = ["s = t - n * step", *_stage(system, 0, splines), "if n % 2 == 1:"]
    lines += [f"    g{q} = g{q} + 4.0 * a{q}" for q in moving]
    lines += ["else:", "    if n > 0:"]
    lines += [f"        {_defect(q, 'a')}" for q in moving]
    for q in moving:
        lines += [f"    o{q} = y{q}", f"    g{q} = a{q}"]
    return [*lines, *_later_stages(system, splines)]


def runge_kutta(system: System, splines: Layout | None = None) -> list[str]:
    """Code of sub-step n of the classical Runge-Kutta method, which moves y0, y1, ..."""
    first = ["s = t - n * step", *_stage(system, 0, splines)]
    return [*first, *_later_stages(system, splines)]


def _later_stages(system: System, splines: Layout | None) -> list[str]:
    """Code of the Runge-Kutta stages after the first one, and of their weighted sum."""
    lines = [line for stage in (1, 2, 3) for line in _stage(system, stage, splines)]
    for q in range(len(system.jets)):
        total = f"a{q} + 2.0 * b{q} + 2.0 * c{q} + d{q}"
        lines.append(f"y{q} = y{q} + step * (1.0 / 6.0) * ({total})")
    return lines


def _leaves(system: System, sides: Sequence[Sequence[str]]) -> list[str]:
    """Code that sets `PATH.left` if a path is beyond a wall or not finite."""
    lines = []
    for q, (axis, (_, low, high, _, _)) in enumerate(zip(system.moving, sides, strict=True)):
        x = f"x{axis + 1} + y{q}"
        lines += [f"if {x} < {low} or {x} > {high} or {x} != {x}:", f"    found = {PATH.left}"]
    return lines


def _judgement(system: System, sides: Sequence[Sequence[str]], splines: Layout | None) -> list[str]:
    """Code that adds the defect of the last two sub-steps and compares the sum with its limit."""
    point = [*_point(system, "y"), "t - count * step", *system.parameters, *_room(splines)]
    exact = [f"e{q} <= {side[3]} + {side[4]} * abs(y{q})" for q, side in enumerate(sides)]
    results = ", ".join(f"f{q}" for q in range(len(sides)))
    return [
        "if count % 2 == 0 and found == 0:",
        f"    {results} = velocity({', '.join(point)})",
        *(f"    {_defect(q, 'f')}" for q in range(len(sides))),
        f"    found = {PATH.coarse}",
        f"    if {' and '.join(exact)}:",
        "        found = 0",
    ]


def _results(system: System, wanted: Sequence[Jet], cells: Sequence[str]) -> list[str]:
    """Code that writes the wanted jets; `cells` are the cells per length in each direction."""
    place = {jet: q for q, jet in enumerate(system.jets)}
    lines = [f"E = exp(y{place[LOG_DETERMINANT]})"] if LOG_DETERMINANT in wanted else []
    return lines + [f"feet[{f}] = {_component(jet, place, cells)}" for f, jet in enumerate(wanted)]


def kinds(count: int) -> str:
    """Return annotation of a kernel with this number of results."""
    return f"tuple[{', '.join(['Real'] * count)}]" if count > 1 else "Real"


def _defect(q: int, last: str) -> str:
    """Code that adds the defect of Simpson's rule over two sub-steps in direction q."""
    return f"e{q} = e{q} + abs(y{q} - o{q} - step * (1.0 / 3.0) * (g{q} + {last}{q}))"


def _point(system: System, place: str) -> list[str]:
    """Code of a path's coordinates from its displacements, named `place` and a number."""
    return [
        f"{name} + {place}{system.moving.index(axis)}" if axis in system.moving else name
        for axis, name in enumerate(COORDINATES[:3])
    ]


def _room(splines: Layout | None) -> list[str]:
    """The arguments of `rates` and `velocity` for splines."""
    return [] if splines is None else ["box", "feet"]


def _stage(system: System, stage: int, splines: Layout | None) -> list[str]:
    letter, before = "abcd"[stage], "abcd"[stage - 1]
    weight = PATH.shift[stage]
    values = [
        f"y{q}" if stage == 0 else f"y{q} + {weight!r} * step * {before}{q}"
        for q in range(len(system.jets))
    ]
    lines = [f"w{q} = {value}" for q, value in enumerate(values)]
    point = _point(system, "w")
    time = "s" if stage == 0 else f"s - {weight!r} * step"
    values = [f"w{q}" for q in range(len(system.jets))]
    inner = ", ".join([*point, time, *values, *system.parameters, *_room(splines)])
    results = ", ".join(f"{letter}{q}" for q in range(len(system.jets)))
    return [*lines, f"{results} = rates({inner})"]


def _component(jet: Jet, place: dict[Jet, int], cells: Sequence[str]) -> str:
    if jet.component == 3:
        axes = [axis for axis in range(3) for _ in range(jet.orders[axis])]
        slopes = [f"y{place[LOG_DETERMINANT.along(axis)]}" for axis in axes]
        if not axes:
            return "E"
        if len(axes) == 1:
            return f"E * {slopes[0]}"
        return f"E * (y{place[jet]} + {slopes[0]} * {slopes[1]})"
    if any(jet.orders):
        return f"y{place[jet]}"
    return f"y{place[jet]} * {cells[place[jet]]}"
