"""Small records of numbers: the arguments of the kernels of one node besides the arrays.

For numba they are tuples, which cost nothing once a kernel is inlined; `cip.engines.cuda_source`
translates them to C structs. Flags are 0 or 1.
"""

from __future__ import annotations

from typing import NamedTuple

from cip.jit import Array, Index, Real, Widths


class Line(NamedTuple):
    """The n nodes of a grid line: node k is at index ``first + k stride`` of a moment's array."""

    h: Widths  # cell widths along the line
    first: Index
    stride: Index
    n: Index
    periodic: Index


class Foot(NamedTuple):
    """The foot of one node: component f is ``feet[f stride + first]``."""

    feet: Array
    stride: Index
    first: Index


class Update(NamedTuple):
    """The update: size of the grid, direction and equation."""

    size: Index  # number of nodes
    dim: Index  # of the grid
    axis: Index  # direction of a sweep, 0 for a plane
    advect: Index  # 1: p_t + div(c p) = 0, 0: u_t + c . grad u = 0


class Limits(NamedTuple):
    """Code of a conservative profile's limiter, the bounds, and how far they may be exceeded."""

    limiter: Index
    low: Real
    high: Real
    slack: Real


class Means(NamedTuple):
    """Where values, slopes and means of a line begin in the array."""

    value: Index
    slope: Index  # unused if not carried
    mean: Index
    carried: Index  # whether there are slopes


class Cell(NamedTuple):
    """A cell of a plane: its nodes k, kr along x and l, lr along y, and the place (s, t) in it."""

    k: Index
    kr: Index
    l: Index
    lr: Index
    s: Real
    t: Real


class Corners(NamedTuple):
    """A moment at the corners of a cell: ``c10`` is at the right end of the bottom edge."""

    c00: Real
    c10: Real
    c01: Real
    c11: Real


class Edges(NamedTuple):
    """A number for each edge of a cell."""

    bottom: Real
    top: Real
    left: Real
    right: Real
