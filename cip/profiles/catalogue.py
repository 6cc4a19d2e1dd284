"""The profiles: the moments that each one carries and the derivatives of the feet that it needs.

The `NamedTuple` records are arguments of the kernels of one node besides the arrays: tuples for
numba, at no cost once a kernel is inlined, and C structs in `cip.engines.cuda_source`. Flags are 0
or 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from cip.characteristics.flow_derivatives import LOG_DETERMINANT, Jet, foot
from cip.errors import InputError
from cip.formulas.expression import Orders
from skfem_adini.ground.jit import Array, Index, Real, Widths

LINE = ("linear", "piecewise_linear", "smoothed", "cubic", "quintic", "csl2", "csl4")
PLANE = ("adini", "bicubic")
CONSERVATIVE = ("csl2", "csl4")
# Splines on a sphere, with their degrees: of values, or of means over cells.
SPHERE = {"cubic_spline": 3, "quintic_spline": 5, "csl2_spline": 2, "csl4_spline": 4}
LIMITERS: dict[str, tuple[str, ...]] = {
    "linear": (),
    "piecewise_linear": (),
    "smoothed": (),
    "cubic": ("clamp", "eno", "rational"),
    "quintic": ("clamp",),
    "csl2": ("bounds", "rational"),
    "csl4": ("bounds",),
    "adini": ("clamp", "eno"),
    "bicubic": ("clamp", "eno"),
}
LIMITER_CODES = {None: 0, "clamp": 1, "eno": 2, "rational": 3, "bounds": 4}


@dataclass(frozen=True)
class Moment:
    """A functional of the field at each node: a derivative, or a mean over cells."""

    name: str
    orders: Orders  # of the derivative
    averaged: tuple[int, ...] = ()  # directions of the mean over the cell that begins at the node


def _derivative(*axes: int) -> Moment:
    orders = [0, 0, 0, 0]
    for axis in axes:
        orders[axis] += 1
    name = "u" + ("_" + "".join("xyz"[axis] for axis in axes) if axes else "")
    return Moment(name, (orders[0], orders[1], orders[2], 0))


def carries_slopes(profile: str, dim: int) -> bool:
    """Whether a conservative profile carries slopes, not only values and means: csl4 on lines."""
    return profile == "csl4" and dim == 1


def moments(profile: str, dim: int) -> tuple[Moment, ...]:
    """The moments that a profile carries at every node of a grid, in the order of their storage."""
    if not isinstance(profile, str):
        raise InputError(f"profile: expected one of {', '.join(LINE + PLANE)}, got {profile!r}")
    u = _derivative()
    if profile == "linear" or profile in ("cubic_spline", "quintic_spline"):
        return (u,)
    if profile in SPHERE:
        return (Moment("mean", u.orders, (0, 1)),)
    if profile in ("piecewise_linear", "smoothed", "cubic"):
        return (u, *(_derivative(axis) for axis in range(dim)))
    if profile == "quintic":
        pairs = [(_derivative(axis), _derivative(axis, axis)) for axis in range(dim)]
        return (u, *(moment for pair in pairs for moment in pair))
    if carries_slopes(profile, dim):
        return (u, _derivative(0), Moment("mean", u.orders, (0,)))
    if profile in CONSERVATIVE:
        found = []
        for bits in range(2**dim):
            axes = tuple(axis for axis in range(dim) if bits >> axis & 1)
            name = "u" if not axes else "mean_" + "".join("xyz"[axis] for axis in axes)
            found.append(Moment("mean" if len(axes) == dim else name, u.orders, axes))
        return tuple(found)
    if profile in PLANE:
        if dim != 2:
            raise InputError(f"profile: {profile!r} is two-dimensional, the grid has {dim}")
        base = (u, _derivative(0), _derivative(1))
        return base if profile == "adini" else (*base, _derivative(0, 1))
    raise InputError(f"profile: expected one of {', '.join(LINE + PLANE)}, got {profile!r}")


def moment_names(fields: tuple[str, ...], profile: str, dim: int) -> tuple[str, ...]:
    """Names of the moments of all fields: ``u_x`` becomes ``dust_x``, ``mean`` ``dust_mean``."""
    own = [moment.name for moment in moments(profile, dim)]
    ends = [name[1:] if name.startswith("u") else f"_{name}" for name in own]
    return tuple(field + end for field in fields for end in ends) if fields else tuple(own)


def line_jets(profile: str, dim: int, axis: int, advect: bool) -> tuple[Jet, ...]:
    """Components of the feet of a sweep, in the order in which the kernels read them."""
    along = [foot(axis), foot(axis, axis), foot(axis, axis, axis), foot(axis, axis, axis, axis)]
    if profile == "linear":
        return tuple(along[: 1 + advect])
    if profile in CONSERVATIVE:
        return tuple(along[: 2 + carries_slopes(profile, dim)])
    order = 2 if profile == "quintic" else 1
    found = along[: 1 + order + advect]
    for other in range(dim):
        if other != axis:
            found += [foot(axis, *([other] * q)) for q in range(1, order + 1)]
            if advect:
                found += [foot(axis, axis, *([other] * q)) for q in range(1, order + 1)]
    return tuple(found)


def plane_jets(profile: str, advect: bool) -> tuple[Jet, ...]:
    """Components of the feet of a direct update, in the order in which the kernels read them;
    derivatives of log det(dX/dx) denote those of the determinant, which replace them there."""
    found = [foot(0), foot(1), foot(0, 0), foot(0, 1), foot(1, 0), foot(1, 1)]
    if profile == "bicubic":
        found += [foot(0, 0, 1), foot(1, 0, 1)]
    if advect:
        found += [LOG_DETERMINANT, LOG_DETERMINANT.along(0), LOG_DETERMINANT.along(1)]
        if profile == "bicubic":
            found.append(LOG_DETERMINANT.along(0, 1))
    return tuple(found)


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
    """The arguments of an update: size of the grid, direction and equation."""

    size: Index  # number of nodes
    dim: Index  # of the grid
    axis: Index  # direction of a sweep, 0 for a plane
    advect: Index  # 1: p_t + div(c p) = 0, 0: u_t + c . grad u = 0
    coasts: Index = 0  # 1: the feet are followed by the sides of coasts of all blocks


class Limits(NamedTuple):
    """Code of the limiter, and for "bounds" the bounds and how far they may be exceeded."""

    limiter: Index = 0
    low: Real = 0.0
    high: Real = 0.0
    slack: Real = 0.0


class Means(NamedTuple):
    """Offsets of the values, slopes and means of a line in the array."""

    value: Index
    slope: Index  # unused if not carried
    mean: Index
    carried: Index  # whether there are slopes
    sides: Index = -1  # offset among the feet of the sides of coasts; -1: there are none


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
