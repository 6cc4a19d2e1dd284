"""Derivatives of a node's update, from the kernel that computes it.

A node kernel of `cip.profiles.line_kernels` or `plane_kernels` is plain Python. Called with symbols
instead of numbers it gives the formulas of the new moments; they are linear in the old ones at the
corners of the cell, and polynomials in the place in it. Their derivatives are therefore exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from cip.formulas.expression import Expression, variable
from cip.profiles.catalogue import (
    CONSERVATIVE,
    Foot,
    Limits,
    Line,
    Means,
    Update,
    carries_slopes,
    line_jets,
    moments,
    plane_jets,
)
from cip.profiles.plain import plain_kernels

# Nodes of the grid on which a kernel is traced, in its first cell: their numbers differ, so that
# the kernel's calls tell the directions.
_NODES = (2, 3)
# Corners of a cell by their offsets in each direction, in the order of `Traced.reads`.
AROUND = 2
CORNERS = {1: ((0,), (1,)), 2: ((0, 0), (1, 0), (0, 1), (1, 1))}


@dataclass(frozen=True)
class Traced:
    """The update of a node whose foot lies in the first cell of a small grid, as formulas."""

    dim: int
    outputs: tuple[Expression, ...]  # formulas of the new moments
    reads: tuple[str, ...]  # variables of the old moments, each at all corners
    places: tuple[str, ...]  # variables of the place in the cell
    widths: tuple[str, ...]  # variables of the widths of the cell
    feet: tuple[str, ...]  # variables of the components of the foot after the displacements
    sources: tuple[tuple[int, int], ...]  # of each of `reads`: moment, and corner or `AROUND` +
    around: tuple[str, ...] = ()  # variables of the coordinates of nodes around the cell, in sweeps

    @property
    def moments(self) -> int:
        """Number of old moments that are read; some may not be among the new ones."""
        return 1 + max(q for q, _ in self.sources)

    @property
    def corners(self) -> tuple[tuple[int, ...], ...]:
        """Corners of the cell by their offsets in each direction."""
        return CORNERS[self.dim]


class _Symbols:
    """An array whose entry q is the variable named by the letter and q; stores written entries."""

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
def traced(profile: str, advect: bool, dim: int, axis: int | None) -> Traced:
    """The update of a profile on a grid of `dim` directions, swept along `axis` or (None) of a
    plane. A conservative one updates a pair (value, mean), for csl4 with slopes; the mean is
    replaced by the integral of the old profile from the left end of the cell to the foot."""
    if profile in CONSERVATIVE:
        slopes, line = int(profile == "csl4"), Line(_Widths(0), 0, 1, _NODES[0], 0)
        outputs = _conservative(profile, carries_slopes(profile, dim), line)
        return _at_corners(1, outputs, 2 + slopes, len(line_jets(profile, dim, axis or 0, advect)))
    if axis is not None and dim > 1:
        return _sweep(profile, advect, dim, axis)
    outputs = _outputs(profile, advect, dim)
    jets = plane_jets(profile, advect) if dim == 2 else line_jets(profile, 1, 0, advect)
    return _at_corners(dim, outputs, len(outputs), len(jets))


def _at_corners(dim: int, outputs: list[Expression], reads: int, components: int) -> Traced:
    """An update that reads the first `reads` moments at all corners of a cell."""
    corners = [int(np.ravel_multi_index(corner, _NODES[:dim])) for corner in CORNERS[dim]]
    size = int(np.prod(_NODES[:dim]))
    return Traced(
        dim,
        tuple(outputs),
        tuple(f"m{q * size + corner}" for q in range(reads) for corner in corners),
        tuple(f"s{axis}" for axis in range(dim)),
        tuple(f"h{axis}" for axis in range(dim)),
        tuple(f"f{q}" for q in range(dim, components)),
        tuple((q, role) for q in range(reads) for role in range(len(corners))),
    )


def _sweep(profile: str, advect: bool, dim: int, axis: int) -> Traced:
    """The update of a node in a sweep: the ends of the cell are nodes 0 and 1, 2 to 5 around it."""
    names, size = plain_kernels(), AROUND + 4
    names["locate"] = lambda i, d, n, periodic: (0, 1, variable("s0"))
    places = tuple(f"a{q}" for q in range(4))
    nodes = range(AROUND, AROUND + 4)
    names["around"] = lambda line, k: (*nodes, *(variable(name) for name in places))
    count = len(moments(profile, dim))
    out, line = _Symbols("o"), Line(_Widths(0), 0, 1, size, 0)
    update = Update(size, dim, axis, int(advect))
    names[f"node_{profile}"](
        _Symbols("m"), out, Foot(_Symbols("f"), 1, 0), line, update, 0, 0, Limits()
    )
    outputs = [out.written[size * q] for q in range(count)]
    used = set().union(*(output.variables() for output in outputs))
    every = ((q, role) for q in range(count) for role in range(size))
    sources = tuple((q, role) for q, role in every if f"m{q * size + role}" in used)
    return Traced(
        1,
        tuple(outputs),
        tuple(f"m{q * size + role}" for q, role in sources),
        ("s0",),
        ("h0",),
        tuple(f"f{q}" for q in range(1, len(line_jets(profile, dim, axis, advect)))),
        sources,
        places,
    )


def _outputs(profile: str, advect: bool, dim: int) -> list[Expression]:
    """The new moments of node 0 whose foot lies in the first cell, as formulas."""
    names = plain_kernels()
    names["locate"] = lambda i, d, n, periodic: (0, 1, variable(f"s{_NODES.index(n)}"))
    out = _Symbols("o")
    foot = Foot(_Symbols("f"), 1, 0)
    size = int(np.prod(_NODES[:dim]))
    lines = [Line(_Widths(axis), 0, 1, _NODES[axis], 0) for axis in range(dim)]
    update = Update(size, dim, 0, int(advect))
    node = (0,) * (1 + dim)  # its index in the arrays and along each line
    names[f"node_{profile}"](_Symbols("m"), out, foot, *lines, update, *node, Limits())
    return [out.written[size * q] for q in range(len(moments(profile, dim)))]


def _conservative(name: str, carried: bool, line: Line) -> list[Expression]:
    """The new value (and slope if it is `carried`) and, for the mean, the integral up to the foot,
    from which `cip.sensitivities.blocks` obtains the means."""
    quartic, size, foot = name == "csl4", line.n, _Symbols("f")
    means = Means(0, size, (1 + quartic) * size, int(quartic))
    value, slope, mass = plain_kernels()["profile"](
        _Symbols("m"), foot, line, means, 0, variable("s0"), 4 if quartic else 2, Limits()
    )
    J = foot[1]
    slopes = [J * J * slope + foot[2] * value] if carried else []
    return [J * value, *slopes, mass]
