"""Derivatives of a node's update, from the kernel that computes it.

A node kernel of `cip.profiles.line_kernels` is plain Python. Called with symbols instead of numbers
it gives the formulas of the new moments; they are linear in the old ones at the two ends of the
cell, and polynomials in the place in the cell. Their derivatives are therefore exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from types import FunctionType
from typing import Any

import numpy as np

from cip.formulas.expression import Expression, variable
from cip.formulas.straight_line_code import numpy_function
from cip.profiles.catalogue import line_jets, moments
from cip.profiles.records import Foot, Line, Update

# Nodes of the line on which the kernel is traced: the ends of one cell.
_ENDS = 2


@dataclass(frozen=True)
class ProfileDerivatives:
    """The derivatives of the new moments of a node, as functions of arrays over nodes.

    Attributes
    ----------
    moments : int
    weights : callable
        ``weights(place, width, *feet)``: for each new moment, old moment and end of the cell the
        derivative, in one flat tuple. `feet` are the components of the foot after the first.
    slopes : callable
        ``slopes(place, width, *feet, *m)``: for each new moment the derivatives with respect to the
        place and the components of the foot; `m` are the old moments, each at both ends.
    """

    moments: int
    weights: Callable[..., tuple[Any, ...]]
    slopes: Callable[..., tuple[Any, ...]]


class _Symbols:
    """An array whose entry q is a variable, the letter and q; what is written is kept."""

    def __init__(self, letter: str) -> None:
        self.letter = letter
        self.written: dict[int, Expression] = {}

    def __getitem__(self, q: int) -> Expression:
        return variable(f"{self.letter}{q}")

    def __setitem__(self, q: int, value: Expression) -> None:
        self.written[q] = value


class _Widths:
    def __getitem__(self, q: int) -> Expression:
        return variable("h")


@cache
def profile_derivatives(profile: str, advect: bool) -> ProfileDerivatives:
    """Those of a profile of point values in one dimension.

    Parameters
    ----------
    profile : {"cubic", "quintic"}
    advect : bool
    """
    outputs = _traced(profile, advect)
    components = len(line_jets(profile, 1, 0, advect))
    feet = [f"f{q}" for q in range(1, components)]
    reads = [f"m{q}" for q in range(_ENDS * len(outputs))]
    weights = [output.derivative(read) for output in outputs for read in reads]
    slopes = [output.derivative(name) for output in outputs for name in ("s", *feet)]
    return ProfileDerivatives(
        len(outputs),
        numpy_function(weights, ["s", "h", *feet]),
        numpy_function(slopes, ["s", "h", *feet, *reads]),
    )


def _traced(profile: str, advect: bool) -> list[Expression]:
    """The new moments of node 0 whose foot lies in the cell from node 0 to node 1, as formulas."""
    from cip.profiles import line_kernels, line_profiles

    names: dict[str, Any] = {}
    for name, value in [*vars(line_profiles).items(), *vars(line_kernels).items()]:
        plain = getattr(value, "py_func", None)
        names[name] = value if plain is None else FunctionType(plain.__code__, names, name)
    names["locate"] = lambda i, d, n, periodic: (0, 1, variable("s"))
    out = _Symbols("o")
    foot = Foot(_Symbols("f"), 1, 0)
    line = Line(_Widths(), 0, 1, _ENDS, 0)
    update = Update(_ENDS, 1, 0, int(advect))
    names[f"node_{profile}"](_Symbols("m"), out, foot, line, update, 0, 0, 0)
    return [out.written[_ENDS * q] for q in range(len(moments(profile, 1)))]


def rows(values: tuple[Any, ...], shape: tuple[int, ...], nodes: int) -> np.ndarray[Any, Any]:
    """A flat tuple of arrays or numbers as one array of a shape, nodes last."""
    found = np.empty((len(values), nodes))
    for row, value in zip(found, values, strict=True):
        row[:] = value
    return found.reshape(*shape, nodes)
