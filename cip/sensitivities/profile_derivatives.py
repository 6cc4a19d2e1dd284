"""Derivatives of a node's update, from the kernel that computes it.

A node kernel of `cip.profiles.line_kernels` or `plane_kernels` is plain Python. Called with symbols
instead of numbers it gives the formulas of the new moments; they are linear in the old ones at the
corners of the cell, and polynomials in the place in it. Their derivatives are therefore exact.
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
from cip.profiles.catalogue import PLANE, line_jets, moments, plane_jets
from cip.profiles.records import Foot, Line, Update

# Nodes in each direction of the grid on which a kernel is traced; its cell is the first one. They
# differ, so that the kernel's calls tell the directions.
_NODES = (2, 3)
# Corners of a cell by their offsets in each direction, in the order of `ProfileDerivatives`.
CORNERS = {1: ((0,), (1,)), 2: ((0, 0), (1, 0), (0, 1), (1, 1))}


@dataclass(frozen=True)
class ProfileDerivatives:
    """The derivatives of the new moments of a node, as functions of arrays over nodes.

    Attributes
    ----------
    moments : int
    weights : callable
        ``weights(*place, *width, *feet)``: for each new moment, old moment and corner of the cell
        the derivative, in one flat tuple. `place` and `width` have an entry for each direction,
        `feet` are the components of the foot after the displacements.
    slopes : callable
        ``slopes(*place, *width, *feet, *m)``: for each new moment the derivatives with respect to
        the place and these components; `m` are the old moments, each at all corners.
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
    def __init__(self, axis: int) -> None:
        self.axis = axis

    def __getitem__(self, q: int) -> Expression:
        return variable(f"h{self.axis}")


@cache
def profile_derivatives(profile: str, advect: bool) -> ProfileDerivatives:
    """Those of a profile of point values.

    Parameters
    ----------
    profile : {"cubic", "quintic", "adini", "bicubic"}
        The first two on lines.
    advect : bool
    """
    dim = 2 if profile in PLANE else 1
    outputs = _traced(profile, advect, dim)
    jets = plane_jets(profile, advect) if dim == 2 else line_jets(profile, 1, 0, advect)
    feet = [f"f{q}" for q in range(dim, len(jets))]
    places = [f"s{axis}" for axis in range(dim)]
    cell = [*places, *(f"h{axis}" for axis in range(dim)), *feet]
    corners = [int(np.ravel_multi_index(corner, _NODES[:dim])) for corner in CORNERS[dim]]
    size = int(np.prod(_NODES[:dim]))
    reads = [f"m{q * size + corner}" for q in range(len(outputs)) for corner in corners]
    weights = [output.derivative(read) for output in outputs for read in reads]
    slopes = [output.derivative(name) for output in outputs for name in (*places, *feet)]
    return ProfileDerivatives(
        len(outputs), numpy_function(weights, cell), numpy_function(slopes, [*cell, *reads])
    )


def _traced(profile: str, advect: bool, dim: int) -> list[Expression]:
    """The new moments of node 0 whose foot lies in the first cell, as formulas."""
    from cip.profiles import line_kernels, line_profiles, plane_kernels

    names: dict[str, Any] = {}
    for module in (line_profiles, line_kernels, plane_kernels):
        for name, value in vars(module).items():
            plain = getattr(value, "py_func", None)
            names[name] = value if plain is None else FunctionType(plain.__code__, names, name)
    names["locate"] = lambda i, d, n, periodic: (0, 1, variable(f"s{_NODES.index(n)}"))
    out = _Symbols("o")
    foot = Foot(_Symbols("f"), 1, 0)
    size = int(np.prod(_NODES[:dim]))
    lines = [Line(_Widths(axis), 0, 1, _NODES[axis], 0) for axis in range(dim)]
    update = Update(size, dim, 0, int(advect))
    node = (0,) * (1 + dim)  # its index in the arrays and along each line
    names[f"node_{profile}"](_Symbols("m"), out, foot, *lines, update, *node, 0)
    return [out.written[size * q] for q in range(len(moments(profile, dim)))]


def rows(values: tuple[Any, ...], shape: tuple[int, ...], nodes: int) -> np.ndarray[Any, Any]:
    """A flat tuple of arrays or numbers as one array of a shape, nodes last."""
    found = np.empty((len(values), nodes))
    for row, value in zip(found, values, strict=True):
        row[:] = value
    return found.reshape(*shape, nodes)
