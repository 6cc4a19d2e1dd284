"""The characteristic of one node as a kernel: feet computed where they are used.

For a velocity that is a formula the equations of `cip.characteristics.flow_derivatives` become
straight-line code in the kernel language: one function for the rates, one for the classical
Runge-Kutta steps of a node. numba compiles it for the CPU, `cip.engines.cuda_source` translates it
for the device.
"""

from __future__ import annotations

from collections.abc import Sequence

from cip.characteristics.feet import MOST_CELLS
from cip.characteristics.flow_derivatives import LOG_DETERMINANT, Jet, System
from cip.formulas.expression import COORDINATES
from cip.formulas.straight_line_code import statements
from cip.grid import Grid

_STAGES = ((0.5, "0.5"), (0.5, "0.5"), (1.0, "1.0"))
# What `path` says of a path: it left the box, or its sub-steps were too long. Codes are bits.
LEFT, COARSE = 1, 2
_NUMBERS = 5  # of `box_of` for each direction


def box_of(grid: Grid, system: System, limit: float, rounding: float) -> list[float]:
    """For each direction of motion: cells a length, how far a path may go, how far it may err.

    It may go to the walls with their margin; in a period as many cells as kernels can count. It may
    err by a length and by a part of its own.

    Parameters
    ----------
    grid : Grid
    system : System
    limit : float
        Largest defect of a foot, in cells, but for rounding.
    rounding : float
        Spacing of the numbers in which the kernel computes.
    """
    noise = 256.0 * rounding  # of some hundred sub-steps
    found = []
    for axis in system.moving:
        low, high = grid.bounds[axis]
        h = grid.spacing[axis]
        margin = (MOST_CELLS if grid.periodic[axis] else 1e-9) * h
        found += [1.0 / float(grid.widths[axis][0]), low - margin, high + margin]
        found += [limit * h + noise * max(abs(low), abs(high)), noise]
    return found


def path_source(
    system: System, wanted: Sequence[Jet], box: Sequence[float], constant: bool = True
) -> str:
    r"""Python of the kernels `rates`, `velocity` and `path`.

    ``path(feet, x1, x2, x3, t, step, count)`` writes the jets in the order of `wanted`, the
    displacements in cells (uniform directions only), and returns 0; or `LEFT` where the path leaves
    the box through a wall or is not finite: then the first of the jets is infinite; or `COARSE`
    where the sub-steps, if their number is even, are too long. `t` is the end of the last of
    `count` steps of length `step`. The numbers of `box_of` are constants in the code, or a last
    argument, which makes one kernel of a velocity on all grids.

    Notes
    -----
    Every two sub-steps leave the defect of Simpson's rule,

    .. math:: |y_{n+2} - y_n - (f_n + 4 f_{n+1} + f_{n+2}) h / 3|,

    of the order of the Runge-Kutta method's own error, :math:`h^5`, and made of rates that it
    computes anyway. Their sum is 1.7 times the error for y' = ay and 15 times where the rates
    depend on t alone. The displacements speak for the derivatives too: where these err by a part,
    neighbouring feet move by that part of a cell against each other.
    """
    jets = system.jets
    names = [jet.name for jet in jets]
    reals = ", ".join(f"{name}: Real" for name in (*COORDINATES, *names))
    kinds = _kinds(len(jets))
    rates = {f"r{q}": rate for q, rate in enumerate(system.rates)}
    moving = range(len(system.moving))
    first = {f"r{q}": system.rates[q] for q in moving}
    numbers = [repr(x) if constant else f"box[{q}]" for q, x in enumerate(box)]
    sides = [numbers[_NUMBERS * q : _NUMBERS * (q + 1)] for q in moving]
    lines = [
        f"def rates({reals}) -> {kinds}:",
        *statements(rates),
        f"    return {', '.join(rates)}",
        "",
        f"def velocity({', '.join(f'{name}: Real' for name in COORDINATES)}) -> "
        f"{_kinds(len(moving))}:",
        *statements(first),
        f"    return {', '.join(first)}",
        "",
        "def path(feet: Out, x1: Real, x2: Real, x3: Real, t: Real, step: Real,"
        f" count: Index{'' if constant else ', box: Array'}) -> Index:",
        "    found = 0",
    ]
    lines += [f"    y{q} = {system.start(jet)!r}" for q, jet in enumerate(jets)]
    lines += [f"    {letter}{q} = 0.0" for letter in "eog" for q in moving]
    lines.append("    for n in range(count):")
    lines.append("        s = t - n * step")
    for stage in range(4):
        lines += [f"        {line}" for line in _stage(system, stage)]
        if stage == 0:
            lines += ["        if n % 2 == 1:"]
            lines += [f"            g{q} = g{q} + 4.0 * a{q}" for q in moving]
            lines += ["        else:", "            if n > 0:"]
            lines += [f"                {_defect(q, 'a')}" for q in moving]
            for q in moving:
                lines += [f"            o{q} = y{q}", f"            g{q} = a{q}"]
    for q in range(len(jets)):
        total = f"a{q} + 2.0 * b{q} + 2.0 * c{q} + d{q}"
        lines.append(f"        y{q} = y{q} + step * (1.0 / 6.0) * ({total})")
    for q, axis in enumerate(system.moving):
        x, (_, low, high, _, _) = f"x{axis + 1} + y{q}", sides[q]
        lines.append(f"        if {x} < {low} or {x} > {high} or {x} != {x}:")
        lines.append(f"            found = {LEFT}")
    point = [*_point(system, "y"), "t - count * step"]
    exact = [f"e{q} <= {side[3]} + {side[4]} * abs(y{q})" for q, side in enumerate(sides)]
    results = ", ".join(f"f{q}" for q in moving)
    lines += [
        "    if count % 2 == 0 and found == 0:",
        f"        {results} = velocity({', '.join(point)})",
        *(f"        {_defect(q, 'f')}" for q in moving),
        f"        found = {COARSE}",
        f"        if {' and '.join(exact)}:",
        "            found = 0",
    ]
    place = {jet: q for q, jet in enumerate(jets)}
    if LOG_DETERMINANT in wanted:
        lines.append(f"    E = exp(y{place[LOG_DETERMINANT]})")
    cells = [side[0] for side in sides]
    for f, jet in enumerate(wanted):
        lines.append(f"    feet[{f}] = {_component(jet, place, cells)}")
    lines += [f"    if found == {LEFT}:", "        feet[0] = 1e308 * 1e308", "    return found"]
    return "\n".join(lines) + "\n"


def _kinds(count: int) -> str:
    return f"tuple[{', '.join(['Real'] * count)}]" if count > 1 else "Real"


def _defect(q: int, last: str) -> str:
    """Add that of two sub-steps."""
    return f"e{q} = e{q} + abs(y{q} - o{q} - step * (1.0 / 3.0) * (g{q} + {last}{q}))"


def _point(system: System, place: str) -> list[str]:
    """Where a path is."""
    return [
        f"{name} + {place}{system.moving.index(axis)}" if axis in system.moving else name
        for axis, name in enumerate(COORDINATES[:3])
    ]


def _stage(system: System, stage: int) -> list[str]:
    letter, before = "abcd"[stage], "abcd"[stage - 1]
    weight = 0.0 if stage == 0 else _STAGES[stage - 1][0]
    values = [
        f"y{q}" if stage == 0 else f"y{q} + {weight!r} * step * {before}{q}"
        for q in range(len(system.jets))
    ]
    lines = [f"w{q} = {value}" for q, value in enumerate(values)]
    point = _point(system, "w")
    time = "s" if stage == 0 else f"s - {weight!r} * step"
    inner = ", ".join([*point, time, *(f"w{q}" for q in range(len(system.jets)))])
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
