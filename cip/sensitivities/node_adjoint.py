"""The transpose of a node's update as a compiled kernel, generated from the kernel of the step.

With weights w of the new moments, it adds the derivatives of w . (new moments) with respect to the
old moments at the corners of the foot's cell to these, and gives those with respect to the
components of the foot.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import numpy as np

from cip.formulas.expression import RULES, constant, variable
from cip.formulas.reverse_mode import gradient
from cip.formulas.straight_line_code import statements
from cip.jit import Array, Index, Out, Real, generated
from cip.profiles.records import Line
from cip.sensitivities.profile_derivatives import Traced, traced

_AXES = "xy"


def pull_source(update: Traced, apart: bool = False) -> str:
    """Source of the kernel ``pull``.

    ``pull(m, w, back, g, feet, stride, first, x, [y,] size, o, i[, j])`` adds to `back`, laid out
    as the moments m and the weights w, and writes the derivatives with respect to the components to
    `g`; those of displacements have the unit of 1 / length. Where the contributions are wanted
    `apart`, the one to ``update.reads[q]`` is written to ``back[q size + o]`` instead.
    """
    dim = update.dim
    total = constant(0.0)
    for q, output in enumerate(update.outputs):
        total = total + variable(f"w{q}") * output
    names = [*update.reads, *update.places, *update.feet]
    found = {f"d{q}": part for q, part in enumerate(gradient(total, names))}
    used = set().union(*(part.variables() for part in found.values()))
    lines = list(_AXES[:dim])
    nodes = [_corner(*sides) for sides in update.corners]
    nodes += [f"n{q}" for q in range(len(update.around))]
    places = [f"{q} * size + {nodes[role]}" if q else nodes[role] for q, role in update.sources]
    code = [
        "def pull(m: Array, w: Array, back: Out, g: Out, feet: Array, stride: Index, first: Index, "
        f"{', '.join(f'{line}: Line' for line in lines)}, size: Index, o: Index, "
        f"{', '.join(f'{place}: Index' for place in 'ij'[:dim])}) -> None:"
    ]
    for axis, line in enumerate(lines):
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
    if dim == 1:
        code += [f"    {end} = x.first + {end} * x.stride" for end in ends]
    else:
        code += [f"    {end} = {end} * y.n" for end in ends]
    for q, name in enumerate(update.feet):
        code.append(f"    {name} = feet[{dim + q} * stride + first]")
    code += [f"    {name} = m[{at}]" for name, at in zip(update.reads, places, strict=True)
             if name in used]  # fmt: skip
    code += [f"    w{q} = w[{q} * size + o]" for q in range(len(update.outputs))]
    code += statements(found)
    count = len(update.reads)
    if apart:
        code += [f"    back[{q} * size + o] = d{q}" for q in range(count)]
    else:
        code += [f"    back[{at}] += d{q}" for q, at in enumerate(places)]
    code += [f"    g[{axis}] = d{count + axis} / h{axis}" for axis in range(dim)]
    code += [f"    g[{dim + q}] = d{count + dim + q}" for q in range(len(update.feet))]
    return "\n".join(code) + "\n"


def _corner(*sides: int) -> str:
    """Code of the index of a corner of the cell."""
    return " + ".join(f"{'kr'[side]}{axis}" for axis, side in enumerate(sides))


@cache
def pull_kernel(profile: str, advect: bool, dim: int, axis: int | None) -> Any:
    """The compiled kernel `pull` of a profile; parameters as for `slopes_in_foot`."""
    return _compiled(pull_source(traced(profile, advect, dim, axis)))


@cache
def _compiled(source: str) -> Any:
    from cip.profiles import line_profiles

    namespace: dict[str, Any] = {name: getattr(np, name) for name in RULES}
    namespace.update(Real=Real, Index=Index, Array=Array, Out=Out, Line=Line)
    namespace.update(locate=line_profiles.locate, around=line_profiles.around)
    return generated(source, re.findall(r"^def (\w+)", source, re.MULTILINE), namespace, __file__)
