"""The change of a node's update with its foot as a compiled kernel, from the kernel of the step.

With changes d of the components of the foot, it gives those of the new moments at given old ones.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from cip.formulas.expression import constant, variable
from cip.formulas.straight_line_code import statements
from cip.sensitivities.foot_places import beginning, compiled, signature
from cip.sensitivities.profile_derivatives import Traced, traced


def push_source(update: Traced) -> str:
    """Source of the kernel ``push(m, d, out, feet, stride, first, x, [y,] size, o, i[, j])``, which
    writes the changes of the new moments of node o to `out`. The changes `d` of the components are
    laid out as the feet, those of displacements as lengths."""
    found = {}
    for q, output in enumerate(update.outputs):
        total = constant(0.0)
        for c, name in enumerate((*update.places, *update.feet)):
            total = total + output.derivative(name) * variable(f"e{c}")
        found[f"d{q}"] = total
    used = set().union(*(part.variables() for part in found.values()))
    code = [
        signature("push", "m: Array, d: Array, out: Out", update),
        *beginning(update, used),
        *(f"    e{axis} = d[{axis} * stride + first] / h{axis}" for axis in range(update.dim)),
    ]
    for q in range(len(update.feet)):
        code.append(f"    e{update.dim + q} = d[{update.dim + q} * stride + first]")
    code += statements(found)
    code += [f"    out[{q} * size + o] = d{q}" for q in range(len(update.outputs))]
    return "\n".join(code) + "\n"


@cache
def push_kernel(profile: str, advect: bool, dim: int, axis: int | None) -> Any:
    """The compiled kernel `push` of a profile; parameters as for `traced`."""
    return compiled(push_source(traced(profile, advect, dim, axis)))
