"""Exact quadrature on polygons that grid lines cut."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import array_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Polygon:
    """A polygon, with holes if wanted.

    ``a & b`` is the intersection, ``a | b`` the union and ``a - b`` the difference of two polygons,
    which may consist of several pieces. Its sides are the parts of a's sides, in their order, then
    those of b's. A polygon is not composed with level sets.

    Parameters
    ----------
    vertices
        Corners in order, either way round, shape (2, n) with n >= 3.
    holes
        Polygons cut out of it, each of shape (2, n).

    Raises
    ------
    InputError
        Fewer than three corners, two equal ones in a row, not finite, no area, or sides that cross;
        a composition of which nothing is left, or with something that is no polygon.

    Examples
    --------
    >>> triangle = Polygon([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    >>> triangle.start.shape
    (2, 3)
    >>> frame = triangle - Polygon([[0.1, 0.3, 0.1], [0.1, 0.1, 0.3]])
    >>> frame.contains(np.array([[0.05, 0.2], [0.05, 0.15]])).tolist()
    [True, False]
    """

    def __init__(self, vertices: ArrayLike, holes: Sequence[ArrayLike] = ()) -> None:
        loops = [_loop(vertices, 1.0)] + [_loop(hole, -1.0) for hole in holes]
        self.start: Array = np.concatenate(loops, axis=1)
        self.end: Array = np.concatenate([np.roll(loop, -1, axis=1) for loop in loops], axis=1)
        _refuse_crossings(self.start, self.end)

    def contains(self, x: Array) -> NDArray[np.bool_]:
        """Return which points, shape (2, n), lie inside: an odd number of sides to the right."""
        a, b = self.start[:, :, None], self.end[:, :, None]
        spans = (a[1] <= x[1]) != (b[1] <= x[1])
        with np.errstate(divide="ignore", invalid="ignore"):
            at = a[0] + (x[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        return np.sum(spans & (at > x[0]), axis=0) % 2 == 1

    def __and__(self, other: Any) -> Polygon:
        return self._composed(other, keep=(True, True))

    def __or__(self, other: Any) -> Polygon:
        return self._composed(other, keep=(False, False))

    def __sub__(self, other: Any) -> Polygon:
        return self._composed(other, keep=(False, True))

    def _composed(self, other: Any, keep: tuple[bool, bool]) -> Polygon:
        """Return the polygon of the sides of each that lie inside, or outside, the other. The
        second polygon's sides are reversed if one is inside and the other outside."""
        if not isinstance(other, Polygon):
            raise InputError(
                f"polygon: a Polygon is not composed with a {type(other).__name__}, but with other "
                "polygons; compose its sides, half planes as LevelSet(lambda x: ...), instead"
            )
        turn = -1 if keep[0] != keep[1] else 1
        first, second = _divided(self, other), _divided(other, self)
        sides = [
            first[:, :, _kept(first, other, keep[0], turn)],
            second[:, ::turn, _kept(second, self, keep[1], 0)],
        ]
        result = Polygon.__new__(Polygon)
        result.start, result.end = np.concatenate(sides, axis=2).swapaxes(0, 1)
        if result.start.size == 0:
            raise InputError("polygon: nothing is left of the two polygons")
        return result


def _divided(polygon: Polygon, other: Polygon) -> Array:
    """Return the sides, divided where they meet those of the other, as (2, 2 ends, sides)."""
    a, step = polygon.start.T, (polygon.end - polygon.start).T
    c, other_step = other.start, other.end - other.start
    # Nearer points of the two polygons are one.
    slack = 64 * np.finfo(float).eps * max(np.abs(polygon.start).max(), np.abs(other.start).max())
    pieces = []
    for origin, along in zip(a, step, strict=True):
        length = np.hypot(*along)
        gap = c - origin[:, None]
        cross = along[0] * other_step[1] - along[1] * other_step[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (gap[0] * other_step[1] - gap[1] * other_step[0]) / cross
            s = (gap[0] * along[1] - gap[1] * along[0]) / cross
        reach = slack / np.hypot(*other_step)
        meets = (s >= -reach) & (s <= 1 + reach) & (np.abs(cross) > slack * length)
        # Corners of the other polygon on this side, also where sides lie in one line.
        foot = (along @ gap) / length**2
        on_side = np.abs(along[0] * gap[1] - along[1] * gap[0]) <= slack * length
        inner = np.concatenate([t[meets], foot[on_side]])
        inner = np.sort(inner[(inner * length > slack) & ((1 - inner) * length > slack)])
        apart = np.diff(inner, prepend=-1.0) * length > slack
        ticks = np.concatenate([[0.0], inner[apart], [1.0]])
        ends = origin[:, None] + along[:, None] * ticks
        ends[:, -1] = origin + along
        pieces.append(np.stack([ends[:, :-1], ends[:, 1:]], axis=1))
    return np.concatenate(pieces, axis=2)


def _kept(sides: Array, other: Polygon, inside: bool, common: int) -> NDArray[np.bool_]:
    """Return which sides lie inside (or outside) the other polygon. On its boundary, sides of the
    same direction are kept for `common` 1, of the opposite one for -1, none for 0."""
    middle = sides.mean(axis=1)
    along = sides[:, 1] - sides[:, 0]
    start, step = other.start[:, None], (other.end - other.start)[:, None]
    gap = middle[:, :, None] - start
    length = np.hypot(*step)
    slack = 64 * np.finfo(float).eps * max(np.abs(sides).max(), np.abs(other.start).max())
    foot = np.sum(gap * step, axis=0) / length**2
    off = np.abs(step[0] * gap[1] - step[1] * gap[0]) / length
    on = (off <= slack) & (foot > 0) & (foot < 1)
    direction = np.sign(np.sum(along[:, :, None] * step, axis=0))
    same = (on & (direction == common)).any(axis=1)
    return np.where(on.any(axis=1), same, other.contains(middle) == inside)


def _loop(vertices: ArrayLike, turn: float) -> Array:
    """Return corners anticlockwise for turn 1, clockwise for -1, so the inside is on the left."""
    p = array_of("vertices", vertices)
    if p.dtype.kind not in "iuf":
        raise InputError(f"vertices: expected real numbers, got an array of {p.dtype}")
    p = p.astype(float)
    if p.ndim != 2 or p.shape[0] != 2 or p.shape[1] < 3 or not np.isfinite(p).all():
        raise InputError(f"vertices: expected finite corners of shape (2, n >= 3), got {p.shape}")
    following = np.roll(p, -1, axis=1)
    if (np.abs(following - p).max(axis=0) == 0).any():
        raise InputError("vertices: two corners in a row are equal; leave one out")
    offset = p.mean(axis=1, keepdims=True)
    a, b = p - offset, following - offset
    area = np.sum(a[0] * b[1] - a[1] * b[0]) / 2
    if abs(area) < 1e-14 * np.ptp(p) ** 2:  # some fifty roundings of its terms
        raise InputError("vertices: the polygon has no area")
    return p if area * turn > 0 else p[:, ::-1]


def _refuse_crossings(start: Array, end: Array) -> None:
    def turn(p: Array, q: Array, r: Array) -> Array:
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    a, b = start[:, :, None], end[:, :, None]
    c, d = start[:, None], end[:, None]
    crossing = (turn(a, b, c) * turn(a, b, d) < 0) & (turn(c, d, a) * turn(c, d, b) < 0)
    if crossing.any():
        i, k = np.argwhere(crossing)[0]
        raise InputError(f"vertices: sides {i} and {k} cross; give a simple polygon")


def cut_polygon(
    polygon: Polygon, lower: Array, upper: Array, q: int
) -> tuple[
    NDArray[np.bool_], Indices, Array, Array, Indices, Array, Array, Array, Indices
]:  # fmt: skip
    """Return the fields of `CutQuadrature` after `lower`, `upper`, exact for total degree 2q - 2.
    Cut cells are divided into strips at corners of the polygon and at crossings with the cell's
    sides; trapezoids between two sides of the polygon in a strip get q x q Gauss points."""
    nodes, weights = np.polynomial.legendre.leggauss(q)
    nodes, weights = (nodes + 1) / 2, weights / 2
    a, b = polygon.start, polygon.end
    # Rounding of coordinates.
    slack = 4 * np.finfo(float).eps * max(np.abs(lower).max(), np.abs(upper).max())
    near = _near(a, b, lower - slack, upper + slack)
    full = polygon.contains((lower + upper) / 2) & ~near.any(axis=0)
    volume: list[tuple[int, Array, Array]] = []
    edge: list[tuple[int, Array, Array, Array, int]] = []
    for cell in np.flatnonzero(near.any(axis=0)).tolist():
        low, high = lower[:, cell], upper[:, cell]
        sides = np.flatnonzero(near[:, cell])
        clipped = [_clip(a[:, s], b[:, s], low, high, slack) for s in sides]
        strips = _trapezoids(polygon, low, high, sides, slack)
        area = sum(strip[-1] for strip in strips)
        whole = area >= np.prod(high - low) * (1 - 1e-14)  # up to some fifty roundings
        full[cell] = whole
        for left, right, bottom, top, _ in strips if not whole else ():
            x = left + (right - left) * nodes
            y0 = bottom[0] + (bottom[1] - bottom[0]) * nodes
            y1 = top[0] + (top[1] - top[0]) * nodes
            y = y0[:, None] + (y1 - y0)[:, None] * nodes
            w = (right - left) * weights[:, None] * (y1 - y0)[:, None] * weights
            xy = np.array([np.repeat(x, q), y.ravel()])
            volume.append((cell, xy, w.ravel()))
        for s, piece in zip(sides.tolist(), clipped, strict=True):
            if piece is None:
                continue
            p, r = piece
            tangent = (b[:, s] - a[:, s]) / np.linalg.norm(b[:, s] - a[:, s])
            normal = np.array([tangent[1], -tangent[0]])
            if _lies_outside(p, r, normal, low, high, slack):
                continue
            points = p[:, None] + (r - p)[:, None] * nodes
            edge.append((cell, points, np.linalg.norm(r - p) * weights, normal, s))
    return (full, *_gathered(volume, edge, q))


def _near(a: Array, b: Array, lower: Array, upper: Array) -> NDArray[np.bool_]:
    """Return which sides meet which closed cells, shape (sides, cells)."""
    meets = np.ones((a.shape[1], lower.shape[1]), dtype=bool)
    for i in range(2):
        least, most = np.minimum(a[i], b[i]), np.maximum(a[i], b[i])
        meets &= (least[:, None] <= upper[i]) & (most[:, None] >= lower[i])
    # A side meets a cell only if the cell's corners do not all lie on one side of its line.
    n = np.array([b[1] - a[1], a[0] - b[0]])
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    distance = n[0, :, None] * (middle[0] - a[0, :, None]) + n[1, :, None] * (
        middle[1] - a[1, :, None]
    )
    reach = np.abs(n[0, :, None]) * half[0] + np.abs(n[1, :, None]) * half[1]
    return meets & (np.abs(distance) <= reach)


def _clip(a: Array, b: Array, low: Array, high: Array, slack: float) -> tuple[Array, Array] | None:
    """Return the ends of the part of a side in a closed cell, None if it is empty or a point."""
    first, last = 0.0, 1.0
    for i in range(2):
        step = b[i] - a[i]
        if abs(step) <= slack:
            if not low[i] - slack <= a[i] <= high[i] + slack:
                return None
            continue
        t0, t1 = (low[i] - a[i]) / step, (high[i] - a[i]) / step
        first, last = max(first, min(t0, t1)), min(last, max(t0, t1))
    if (last - first) * np.linalg.norm(b - a) <= slack:
        return None
    return a + first * (b - a), a + last * (b - a)


def _lies_outside(p: Array, r: Array, normal: Array, low: Array, high: Array, slack: float) -> bool:
    """Return whether a piece lies on a side of the cell with the cell on its outer side."""
    for i in range(2):
        for bound, outward in ((low[i], -1.0), (high[i], 1.0)):
            if abs(p[i] - bound) <= slack and abs(r[i] - bound) <= slack:
                return bool(outward * normal[i] < 0)
    return False


def _trapezoids(
    polygon: Polygon, low: Array, high: Array, sides: Indices, slack: float
) -> list[tuple[float, float, Array, Array, float]]:
    """Return (left, right, bottom at both, top at both, area) of the parts of a cell inside."""
    a, b = polygon.start[:, sides], polygon.end[:, sides]
    breaks = [low[0], high[0], *a[0], *b[0]]
    for bound in (low[1], high[1]):
        sloped = np.abs(b[1] - a[1]) > slack
        t = (bound - a[1, sloped]) / (b[1, sloped] - a[1, sloped])
        breaks.extend(a[0, sloped] + t * (b[0, sloped] - a[0, sloped]))
    ticks = np.unique(np.clip(breaks, low[0], high[0]))
    found = []
    for left, right in pairwise(ticks):
        if right - left <= slack:
            continue
        middle = (left + right) / 2
        spans = (np.minimum(a[0], b[0]) < middle) & (np.maximum(a[0], b[0]) > middle)
        chosen = np.flatnonzero(spans)

        def heights(x: float, chosen: Indices = chosen) -> Array:
            t = (x - a[0, chosen]) / (b[0, chosen] - a[0, chosen])
            return np.clip(a[1, chosen] + t * (b[1, chosen] - a[1, chosen]), low[1], high[1])

        order = np.argsort(heights(middle), kind="stable")
        first, last = heights(left)[order], heights(right)[order]
        first = np.concatenate([[low[1]], first, [high[1]]])
        last = np.concatenate([[low[1]], last, [high[1]]])
        thick = (first[1:] - first[:-1] + last[1:] - last[:-1]) / 2
        for j in np.flatnonzero(thick > slack):
            height = (first[j] + first[j + 1] + last[j] + last[j + 1]) / 4
            if polygon.contains(np.array([[middle], [height]]))[0]:
                bottom, top = np.array([first[j], last[j]]), np.array([first[j + 1], last[j + 1]])
                found.append((left, right, bottom, top, (right - left) * thick[j]))
    return found


def _gathered(
    volume: list[tuple[int, Array, Array]],
    edge: list[tuple[int, Array, Array, Array, int]],
    q: int,
) -> tuple[Indices, Array, Array, Indices, Array, Array, Array, Indices]:
    """Return the pieces as arrays."""
    cells = np.repeat(np.array([piece[0] for piece in volume], dtype=np.int64), q * q)
    points = np.concatenate([np.zeros((2, 0)), *(piece[1] for piece in volume)], axis=1)
    weights = np.concatenate([np.zeros(0), *(piece[2] for piece in volume)])
    owners = np.repeat(np.array([piece[0] for piece in edge], dtype=np.int64), q)
    places = np.concatenate([np.zeros((2, 0)), *(piece[1] for piece in edge)], axis=1)
    lengths = np.concatenate([np.zeros(0), *(piece[2] for piece in edge)])
    normals = np.array([piece[3] for piece in edge]).reshape(-1, 2).T
    parts = np.array([piece[4] for piece in edge], dtype=np.int64)
    return (
        cells, points, weights, owners, places, lengths,
        np.repeat(normals, q, axis=1), np.repeat(parts, q),
    )  # fmt: skip
