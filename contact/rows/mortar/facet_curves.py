r"""Contact facets in the plane as curves, and the segments of an interface.

A segment is the part of a non-mortar facet that faces one mortar facet. A vertex y of the other
body projects to the point x(s) along the averaged normal n(s), linear in s, if

.. math:: (x(s) - y) \times n(s) = 0,

quadratic in s on a straight facet, cubic on a curved one. The signs at s = 0 and s = 1 decide
whether y lies before, on or beyond the facet, so that no wrong root is chosen and facets that share
a vertex and its normal agree. Of several mortar facets on one line the nearest counts.

M. A. Puso and T. A. Laursen, Comput. Methods Appl. Mech. Engrg. 193 (2004); A. Popp, M. W. Gee and
W. A. Wall, Int. J. Numer. Meth. Engng 79 (2009)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from contact.rows.mortar.facet_trace import FACETS, InterfaceQuadrature, none_opposite
from contact.rows.outline import Outline

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NODES = np.array([[0.0, 0.5, 1.0]])  # of a facet: its ends and the middle between them


@dataclass(frozen=True)
class FacetCurves:
    """Facets of a boundary as curves ``(1 - s) a + s b + s (1 - s) c`` of s in [0, 1]."""

    ends: Array  # places a and b, shape (2, nfacets, 2)
    bulge: Array  # vectors c, zero on straight facets, shape (2, nfacets)
    sign: Array  # 1 if the outward normal is the tangent turned by -90 degrees, else -1
    normals: Array  # averaged unit normals at the ends, shape (2, nfacets, 2)

    @classmethod
    def of(cls, outline: Outline, moved: Array | None = None) -> FacetCurves:
        """Facets of an outline, undeformed or with their `NODES` displaced by (2, nfacets, 3)."""
        at_rest = facet_nodes(outline)
        nodes = at_rest if moved is None else at_rest + moved
        ends, at_ends = nodes[:, :, [0, -1]], outline.at_corners
        along = at_rest[:, :, -1] - at_rest[:, :, 0]
        sign = np.sign(along[1] * at_ends.sum(axis=2)[0] - along[0] * at_ends.sum(axis=2)[1])
        bulge = 4.0 * nodes[:, :, 1] - 2.0 * ends.sum(axis=2)
        noise = FACETS.straight * _length(ends) + 16 * np.finfo(float).eps * np.abs(nodes).max()
        flat = np.linalg.norm(bulge, axis=0) <= noise
        curves = cls(ends, np.where(flat, 0.0, bulge), sign, np.zeros_like(ends))
        facets = np.arange(sign.size)
        own = [curves.outward(facets, np.full(sign.size, s)) for s in (0.0, 1.0)]
        return cls(ends, curves.bulge, sign, outline.averaged(np.stack(own, axis=2), ends))

    @property
    def length(self) -> Array:
        """Lengths of the chords, shape (nfacets,)."""
        return _length(self.ends)

    def added(self, other: FacetCurves, rest: tuple[FacetCurves, FacetCurves]) -> int:
        """Degrees added to the Gauss rules of an interface beyond those of the traces."""
        return FACETS.curved if self.curved or other.curved else 0

    @property
    def curved(self) -> bool:
        """Whether normals vary along a facet."""
        bent = np.abs(self.normals[..., 1] - self.normals[..., 0]).max() > FACETS.straight
        return bool(bent or np.any(self.bulge))

    def at(self, facet: Index, s: Array) -> Array:
        """Places on facets, shape (2, n)."""
        a, b = self.ends[:, facet, 0], self.ends[:, facet, 1]
        return np.asarray(a + s * (b - a) + s * (1.0 - s) * self.bulge[:, facet])

    def slope(self, facet: Index, s: Array) -> Array:
        """Derivatives of the places with respect to s, shape (2, n)."""
        a, b = self.ends[:, facet, 0], self.ends[:, facet, 1]
        return np.asarray(b - a + (1.0 - 2.0 * s) * self.bulge[:, facet])

    def measure(self, facet: Index, s: Array) -> Array:
        """Length of the facet per length of the reference facet, shape (n,)."""
        return np.asarray(np.linalg.norm(self.slope(facet, s), axis=0))

    def relaxed(self, rest: FacetCurves, facet: Index, s: Array, w: Array) -> Array:
        """Quadrature weights on displaced facets, converted to the undeformed facets."""
        return w * rest.measure(facet, s) / self.measure(facet, s)

    def outward(self, facet: Index, s: Array) -> Array:
        """Outward unit normals of the facets themselves, shape (2, n)."""
        x, y = self.slope(facet, s)
        turned = self.sign[facet] * np.array([y, -x])
        return np.asarray(turned / np.linalg.norm(turned, axis=0))

    def direction(self, facet: Index, s: Array) -> Array:
        """Averaged normals, linear between the ends and not of unit length, shape (2, n)."""
        one, two = self.normals[:, facet, 0], self.normals[:, facet, 1]
        return np.asarray((1.0 - s) * one + s * two)

    def met(self, facet: Index, x: Array, n: Array) -> Array:
        """Coordinates, (1, n), where lines through points x along n, (2, n), meet given facets."""
        a, b = (_cross(self.ends[:, facet, k] - x, n) for k in (0, 1))
        if not np.any(self.bulge[:, facet]):
            return np.clip(a / np.where(a == b, 1.0, a - b), 0.0, 1.0)[None]
        c = _cross(self.bulge[:, facet], n)

        def crossing(s: Array) -> tuple[Array, Array]:
            return (1.0 - s) * a + s * b + s * (1.0 - s) * c, b - a + (1.0 - 2.0 * s) * c

        return bracketed_root(crossing, facet.size)[None]

    def cut(self, second: FacetCurves, degree: int) -> InterfaceQuadrature:
        """Gauss points on all segments, exact up to a degree in s.
        Raises InputError as `interface_segments`."""
        pieces = interface_segments(self, second)
        points, weights = np.polynomial.legendre.leggauss(degree // 2 + 1)
        size = pieces.end - pieces.start
        s = (pieces.start[:, None] + 0.5 * (1.0 + points) * size[:, None]).ravel()
        facet, other = (np.repeat(k, points.size) for k in (pieces.facet, pieces.other))
        x, n = self.at(facet, s), self.direction(facet, s)
        Y = second.met(other, x, n)
        return InterfaceQuadrature(
            x,
            second.at(other, Y),
            n / np.linalg.norm(n, axis=0),
            self.measure(facet, s) * (0.5 * weights * size[:, None]).ravel(),
            facet,
            other,
            s[None],
            Y,
        )


def facet_nodes(outline: Outline) -> Array:
    """Places of the nodes of each facet of a plane mesh, shape (2, nfacets, 3)."""
    mesh = outline.body.mesh
    ends = mesh.p[:, outline.corners]
    middle = outline.body.basis.mapping.G(np.array([[0.5]]), find=outline.facets)
    return np.concatenate((ends[:, :, :1], middle, ends[:, :, 1:]), axis=2)


def _length(ends: Array) -> Array:
    return np.asarray(np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=0))


@dataclass(frozen=True)
class Segments:
    """Intervals of non-mortar facets that face one mortar facet each, arrays of shape (n,)."""

    facet: Index
    other: Index
    start: Array  # interval of the coordinate of `facet`
    end: Array

    def chosen(self, which: NDArray[np.bool_] | Index) -> Segments:
        """Some of the segments."""
        return Segments(self.facet[which], self.other[which], self.start[which], self.end[which])


def interface_segments(first: FacetCurves, second: FacetCurves) -> Segments:
    """Pair the facets of two boundaries; segments of a facet are in order and do not overlap.
    Raises InputError if no facet faces another one with an opposite normal, within the size of the
    larger boundary and an overlap of half the smaller one."""
    pieces = _in_line(first, second, 1.0)
    pieces = _nearest(first, second, pieces)
    gap = _gaps(first, second, pieces.facet, pieces.other, _middle(pieces))
    small, large = sorted(np.linalg.norm(np.ptp(c.ends, axis=(1, 2))) for c in (first, second))
    pieces = pieces.chosen((gap <= large) & (gap >= -0.5 * small))
    if not pieces.facet.size:
        same = _in_line(first, second, -1.0).facet.size
        raise none_opposite(bool(same), f" within {large:g}")
    return pieces


def _in_line(first: FacetCurves, second: FacetCurves, facing: float) -> Segments:
    """Pairs of facets connected by lines along the normals, with their common intervals.
    Their normals are opposite (`facing` 1) or parallel (-1)."""
    facet, other = _near_the_lines(first, second)
    n = first.direction(facet, np.full(facet.size, 0.5))
    outward = second.outward(other, np.full(facet.size, 0.5))
    towards = -facing * np.sum(n * outward, axis=0) > FACETS.facing * np.linalg.norm(n, axis=0)
    before, after = _sides(first, second, facet, other)
    off = before.all(axis=0) | after.all(axis=0) | (before & after).any(axis=0)
    facet, other = facet[towards & ~off], other[towards & ~off]
    start, end = np.sort(_met(first, second, facet, other), axis=0)
    size = first.length[facet]
    noise = FACETS.sliver + 8 * np.finfo(float).eps * np.abs(first.ends).max() / size
    start, end = (np.where(s < noise, 0.0, np.where(s > 1.0 - noise, 1.0, s)) for s in (start, end))
    pieces = Segments(facet, other, start, end).chosen(end - start > noise)
    return pieces.chosen(np.lexsort((pieces.start, pieces.facet)))


def _near_the_lines(first: FacetCurves, second: FacetCurves) -> tuple[Index, Index]:
    """Candidate pairs of facets: a superset of those connected by lines along the normals.
    A tree groups mortar facets in discs and excludes discs wholly before or beyond a facet."""
    # The work is least with about as many discs as facets in each.
    together = max(1, round(np.sqrt(0.5 * second.sign.size)))
    middle = second.ends.mean(axis=2)
    order = scipy.spatial.KDTree(middle.T, leafsize=1).indices
    first_of = np.arange(0, order.size, together)
    low = np.minimum.reduceat(second.ends.min(axis=2)[:, order], first_of, axis=1)
    high = np.maximum.reduceat(second.ends.max(axis=2)[:, order], first_of, axis=1)
    centre, radius = 0.5 * (low + high), 0.5 * np.linalg.norm(high - low, axis=0)
    here, there = (
        -first.sign[:, None]
        * _cross(
            first.ends[:, :, None, e] - centre[:, None],
            first.normals[:, :, None, e] / np.linalg.norm(first.normals[:, :, None, e], axis=0),
        )
        for e in (0, 1)
    )
    facet, disc = np.nonzero((here <= 1.001 * radius) & (there >= -1.001 * radius))
    stop = np.append(first_of[1:], order.size)
    size = (stop - first_of)[disc]
    inside = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)
    return np.repeat(facet, size), order[np.repeat(first_of[disc], size) + inside]


def _sides(
    first: FacetCurves, second: FacetCurves, facet: Index, other: Index
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether the ends of mortar facets are before or beyond the non-mortar facets, (2, n)."""
    sign = -first.sign[facet]  # so that the cross product grows along the facet
    before, after = [], []
    for k in (0, 1):
        y = second.ends[:, other, k]
        here, there = (
            sign * _cross(first.ends[:, facet, e] - y, first.normals[:, facet, e]) for e in (0, 1)
        )
        before.append(here >= 0)
        after.append(there <= 0)
    return np.array(before), np.array(after)


def _met(first: FacetCurves, second: FacetCurves, facet: Index, other: Index) -> Array:
    """Coordinate of the projection of each end of the mortar facet, clipped to [0, 1], (2, n)."""
    before, after = _sides(first, second, facet, other)
    met = np.where(before, 0.0, 1.0)
    for k in (0, 1):
        inside = np.flatnonzero(~before[k] & ~after[k])
        on, y = facet[inside], second.ends[:, other[inside], k]
        turn = first.normals[:, on, 1] - first.normals[:, on, 0]

        def crossing(
            s: Array, on: Index = on, y: Array = y, turn: Array = turn
        ) -> tuple[Array, Array]:
            off, n = first.at(on, s) - y, first.direction(on, s)
            return _cross(off, n), _cross(first.slope(on, s), n) + _cross(off, turn)

        met[k, inside] = bracketed_root(crossing, inside.size)
    return met


def _nearest(first: FacetCurves, second: FacetCurves, pieces: Segments) -> Segments:
    """Keep only the segments of the nearest mortar facets where segments overlap."""
    same = pieces.facet[1:] == pieces.facet[:-1]
    over = same & (pieces.start[1:] < pieces.end[:-1] - FACETS.sliver)
    crowded = np.isin(pieces.facet, pieces.facet[1:][over])
    if not crowded.any():
        return pieces
    several = pieces.chosen(crowded)
    facet = np.concatenate((several.facet, several.facet))
    ticks = np.unique(np.array([facet, np.concatenate((several.start, several.end))]), axis=1)
    inner = (ticks[0, 1:] == ticks[0, :-1]) & (np.diff(ticks[1]) > FACETS.sliver)
    on, low, high = ticks[0, :-1][inner].astype(np.int64), ticks[1, :-1][inner], ticks[1, 1:][inner]
    # Pair every short interval with every segment of its facet; both are sorted by facets.
    begin, stop = (np.searchsorted(several.facet, on, side=side) for side in ("left", "right"))
    short = np.repeat(np.arange(on.size), stop - begin)
    offset = np.arange(short.size) - np.repeat(
        np.cumsum(stop - begin) - (stop - begin), stop - begin
    )
    long = begin[short] + offset
    middle = 0.5 * (low + high)[short]
    covers = (several.start[long] < middle) & (several.end[long] > middle)
    short, long, middle = short[covers], long[covers], middle[covers]
    gap = np.abs(_gaps(first, second, on[short], several.other[long], middle))
    order = np.lexsort((gap, short))
    best = order[np.append(True, np.diff(short[order]) > 0)] if order.size else order
    k = short[best]
    rest = pieces.chosen(~crowded)
    joined = Segments(
        np.concatenate((rest.facet, on[k])),
        np.concatenate((rest.other, several.other[long[best]])),
        np.concatenate((rest.start, low[k])),
        np.concatenate((rest.end, high[k])),
    )
    return joined.chosen(np.lexsort((joined.start, joined.facet)))


def _gaps(first: FacetCurves, second: FacetCurves, facet: Index, other: Index, s: Array) -> Array:
    """Signed distance along the normal at s to the mortar facet."""
    x, n = first.at(facet, s), first.direction(facet, s)
    y = second.at(other, second.met(other, x, n))
    return np.asarray(np.sum((y - x) * n, axis=0) / np.linalg.norm(n, axis=0))


def _middle(pieces: Segments) -> Array:
    return 0.5 * (pieces.start + pieces.end)


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[0] * b[1] - a[1] * b[0])


def bracketed_root(function: Callable[[Array], tuple[Array, Array]], count: int) -> Array:
    """Roots in [0, 1], (count,), of functions that change sign there, by safeguarded Newton steps.
    If rounding makes both signs equal, the end nearer to the root is returned.
    W. H. Press et al., Numerical Recipes, 3rd ed., Cambridge 2007, section 9.4."""
    low, high, s = np.zeros(count), np.ones(count), np.full(count, 0.5)
    at_low, at_high = function(low)[0], function(high)[0]
    found = np.zeros(count, dtype=bool)
    for step in range(80):  # the last 64 are halvings, which reach the last digit
        value, slope = function(s)
        below = value * np.sign(at_low) > 0
        low, high = np.where(below, s, low), np.where(below, high, s)
        newton = s - value / np.where(slope == 0, 1.0, slope)
        inside = (newton >= low) & (newton <= high) & (slope != 0) & (step < 16)
        new = np.where(inside, newton, 0.5 * (low + high))
        # Keep found roots, so that a root does not depend on the others of the batch.
        new = np.where(found | (value == 0), s, new)
        found |= np.abs(new - s) <= 2.0 * np.spacing(1.0)
        s = new
        if found.all():
            break
    nearer = np.where(np.abs(at_low) <= np.abs(at_high), 0.0, 1.0)
    return np.where(at_low * at_high > 0, nearer, s)
