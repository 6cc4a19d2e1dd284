"""The transpose of a node's update as a compiled kernel, generated from the kernel of the step.

With weights w of the new moments, it adds the derivatives of w . (new moments) with respect to the
old moments at the corners of the foot's cell to these, and gives those with respect to the
components of the foot.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from cip.formulas.expression import constant, variable
from cip.formulas.reverse_mode import gradient
from cip.formulas.straight_line_code import statements
from cip.sensitivities.foot_places import beginning, compiled, places_of, signature
from cip.sensitivities.profile_derivatives import Traced, traced


def pull_source(update: Traced, apart: bool = False) -> str:
    """Source of the kernel ``pull(m, w, back, g, feet, stride, first, x, [y,] size, o, i[, j])``,
    which adds to `back`, laid out as m and w, and writes derivatives in the components to `g`, for
    displacements per length. `apart`: that of ``update.reads[q]`` goes to ``back[q size + o]``."""
    dim, count = update.dim, len(update.reads)
    total = constant(0.0)
    for q, output in enumerate(update.outputs):
        total = total + variable(f"w{q}") * output
    names = [*update.reads, *update.places, *update.feet]
    found = {f"d{q}": part for q, part in enumerate(gradient(total, names))}
    used = set().union(*(part.variables() for part in found.values()))
    code = [
        signature("pull", "m: Array, w: Array, back: Out, g: Out", update),
        *beginning(update, used),
        *(f"    w{q} = w[{q} * size + o]" for q in range(len(update.outputs))),
        *statements(found),
    ]
    if apart:
        code += [f"    back[{q} * size + o] = d{q}" for q in range(count)]
    else:
        code += [f"    back[{at}] += d{q}" for q, at in enumerate(places_of(update))]
    code += [f"    g[{axis}] = d{count + axis} / h{axis}" for axis in range(dim)]
    code += [f"    g[{dim + q}] = d{count + dim + q}" for q in range(len(update.feet))]
    return "\n".join(code) + "\n"


@cache
def pull_kernel(profile: str, advect: bool, dim: int, axis: int | None) -> Any:
    """The compiled kernel `pull` of a profile; parameters as for `traced`."""
    return compiled(pull_source(traced(profile, advect, dim, axis)))
