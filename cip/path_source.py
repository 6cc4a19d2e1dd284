"""The characteristic of one node as a kernel: feet computed where they are used.

For a velocity that is a formula the equations of `cip.jets` become straight-line code in the kernel
language: one function for the rates, one for the classical Runge-Kutta steps of a node. numba
compiles it for the CPU, `cip.device_source` translates it for the device.
"""

from __future__ import annotations

from collections.abc import Sequence

from cip.characteristics import MOST_CELLS
from cip.emit import statements
from cip.expression import COORDINATES
from cip.grid import Grid
from cip.jets import LOG_DETERMINANT, Jet, System

_STAGES = ((0.5, "0.5"), (0.5, "0.5"), (1.0, "1.0"))


def box_of(grid: Grid, system: System) -> list[float]:
    """For each direction of motion: cells a length, and how far a path may go.

    To the walls with their margin; in a period as many cells as kernels can count.
    """
    found = []
    for axis in system.moving:
        low, high = grid.bounds[axis]
        margin = (MOST_CELLS if grid.periodic[axis] else 1e-9) * grid.spacing[axis]
        found += [1.0 / float(grid.widths[axis][0]), low - margin, high + margin]
    return found


def path_source(grid: Grid, system: System, wanted: Sequence[Jet], constant: bool = True) -> str:
    """Python of the kernels `rates` and `path`.

    ``path(feet, x1, x2, x3, t, step, count)`` writes the jets in the order of `wanted`, the
    displacements in cells (uniform directions only), and returns 0, or 1 where the path leaves the
    box through a wall or is not finite: then the first of them is infinite. `t` is the end of the
    last of `count` steps of length `step`. The numbers of `box_of` are constants in the code, or a
    last argument, which makes one kernel of a velocity on all grids.
    """
    jets = system.jets
    names = [jet.name for jet in jets]
    reals = ", ".join(f"{name}: Real" for name in (*COORDINATES, *names))
    kinds = f"tuple[{', '.join(['Real'] * len(jets))}]" if len(jets) > 1 else "Real"
    rates = {f"r{q}": rate for q, rate in enumerate(system.rates)}
    box = [repr(x) if constant else f"box[{q}]" for q, x in enumerate(box_of(grid, system))]
    lines = [
        f"def rates({reals}) -> {kinds}:",
        *statements(rates),
        f"    return {', '.join(rates)}",
        "",
        "def path(feet: Out, x1: Real, x2: Real, x3: Real, t: Real, step: Real,"
        f" count: Index{'' if constant else ', box: Array'}) -> Index:",
        "    outside = 0",
    ]
    lines += [f"    y{q} = {system.start(jet)!r}" for q, jet in enumerate(jets)]
    lines.append("    for n in range(count):")
    lines.append("        s = t - n * step")
    for stage in range(4):
        args = _stage(system, stage)
        lines += [f"        {line}" for line in args]
    for q in range(len(jets)):
        total = f"a{q} + 2.0 * b{q} + 2.0 * c{q} + d{q}"
        lines.append(f"        y{q} = y{q} + step * (1.0 / 6.0) * ({total})")
    for q, axis in enumerate(system.moving):
        x = f"x{axis + 1} + y{q}"
        low, high = box[3 * q + 1 : 3 * q + 3]
        lines.append(f"        if {x} < {low} or {x} > {high} or {x} != {x}:")
        lines.append("            outside = 1")
    place = {jet: q for q, jet in enumerate(jets)}
    if LOG_DETERMINANT in wanted:
        lines.append(f"    E = exp(y{place[LOG_DETERMINANT]})")
    for f, jet in enumerate(wanted):
        lines.append(f"    feet[{f}] = {_component(jet, place, box)}")
    lines += ["    if outside == 1:", "        feet[0] = 1e308 * 1e308", "    return outside"]
    return "\n".join(lines) + "\n"


def _stage(system: System, stage: int) -> list[str]:
    letter, before = "abcd"[stage], "abcd"[stage - 1]
    weight = 0.0 if stage == 0 else _STAGES[stage - 1][0]
    values = [
        f"y{q}" if stage == 0 else f"y{q} + {weight!r} * step * {before}{q}"
        for q in range(len(system.jets))
    ]
    lines = [f"w{q} = {value}" for q, value in enumerate(values)]
    point = []
    for axis, name in enumerate(COORDINATES[:3]):
        moved = axis in system.moving
        point.append(f"{name} + w{system.moving.index(axis)}" if moved else name)
    time = "s" if stage == 0 else f"s - {weight!r} * step"
    inner = ", ".join([*point, time, *(f"w{q}" for q in range(len(system.jets)))])
    results = ", ".join(f"{letter}{q}" for q in range(len(system.jets)))
    return [*lines, f"{results} = rates({inner})"]


def _component(jet: Jet, place: dict[Jet, int], box: Sequence[str]) -> str:
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
    return f"y{place[jet]} * {box[3 * place[jet]]}"
