"""What generated kernels of one node begin with: the cell of its foot and the old moments there."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import numpy as np

from cip.formulas.expression import RULES
from cip.jit import Array, Index, Out, Real, generated
from cip.profiles.records import Line
from cip.sensitivities.profile_derivatives import Traced

_AXES = "xy"


def signature(name: str, arguments: str, update: Traced) -> str:
    """The first line of a kernel of node o with these arguments, its foot, lines and indices."""
    axes, places = _AXES[: update.dim], "ij"[: update.dim]
    lines = ", ".join(f"{axis}: Line" for axis in axes)
    indices = ", ".join(f"{place}: Index" for place in places)
    return (
        f"def {name}({arguments}, feet: Array, stride: Index, first: Index, {lines}, "
        f"size: Index, o: Index, {indices}) -> None:"
    )


def places_of(update: Traced) -> list[str]:
    """Code of the index of each of ``update.reads`` among the old moments."""
    nodes = [_corner(*sides) for sides in update.corners]
    nodes += [f"n{q}" for q in range(len(update.around))]
    return [f"{q} * size + {nodes[role]}" if q else nodes[role] for q, role in update.sources]


def _corner(*sides: int) -> str:
    """Code of the index of a corner of the cell."""
    return " + ".join(f"{'kr'[side]}{axis}" for axis, side in enumerate(sides))


def beginning(update: Traced, used: set[str]) -> list[str]:
    """Code that locates the foot and reads its components and the old moments that are `used`. The
    widths of its cell are called h0 and h1.
    """
    code = []
    for axis, line in enumerate(_AXES[: update.dim]):
        displacement = f"feet[{axis} * stride + first]"
        code.append(
            f"    k{axis}, r{axis}, s{axis} = "
            f"locate({'ij'[axis]}, {displacement}, {line}.n, {line}.periodic)"
        )
        code.append(f"    h{axis} = {line}.h[k{axis}]")
    ends = [f"{end}0" for end in "kr"]
    if update.around:
        ends += [f"n{q}" for q in range(4)]
        code.append(f"    {', '.join([*ends[2:], *update.around])} = around(x, k0)")
    if update.dim == 1:
        code += [f"    {end} = x.first + {end} * x.stride" for end in ends]
    else:
        code += [f"    {end} = {end} * y.n" for end in ends]
    for q, name in enumerate(update.feet):
        code.append(f"    {name} = feet[{update.dim + q} * stride + first]")
    places = zip(update.reads, places_of(update), strict=True)
    return [*code, *(f"    {name} = m[{at}]" for name, at in places if name in used)]


@cache
def compiled(source: str) -> Any:
    """The last kernel of a source, for the CPU."""
    from cip.profiles import line_profiles

    namespace: dict[str, Any] = {name: getattr(np, name) for name in RULES}
    namespace.update(Real=Real, Index=Index, Array=Array, Out=Out, Line=Line)
    namespace.update(locate=line_profiles.locate, around=line_profiles.around)
    return generated(source, re.findall(r"^def (\w+)", source, re.MULTILINE), namespace, __file__)
