"""What the kernels of one node are told besides the arrays: small records of numbers.

For numba they are tuples, which cost nothing once a kernel is inlined; `cip.engines.cuda_source`
makes them structs of C. Flags are 0 or 1.
"""

from __future__ import annotations

from typing import NamedTuple

from cip.jit import Array, Index, Real, Widths


class Line(NamedTuple):
    """The n nodes of a line of the grid: number k is at ``first + k stride`` of a moment."""

    h: Widths
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
    """What is updated: moments of `size` nodes each, in the grid's dimension, for either equation.

    `axis` is the direction of a sweep, 0 in the direct update of a plane; `advect` tells the
    equation p_t + div(c p) = 0 from u_t + c . grad u = 0.
    """

    size: Index
    dim: Index
    axis: Index
    advect: Index


class Limits(NamedTuple):
    """Limiter of a conservative profile, the bounds, and by how much they may be passed."""

    limiter: Index
    low: Real
    high: Real
    slack: Real


class Means(NamedTuple):
    """Where the moments of a line with means begin: values, slopes if it carries them, means."""

    value: Index
    slope: Index
    mean: Index
    carried: Index


class Cell(NamedTuple):
    """A cell of a plane: its nodes k, kr along x and l, lr along y, and the place (s, t) in it."""

    k: Index
    kr: Index
    l: Index
    lr: Index
    s: Real
    t: Real


class Corners(NamedTuple):
    """A moment at the corners of a cell: (left, bottom), (right, bottom), (left, top), the last."""

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
