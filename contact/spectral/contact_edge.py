r"""Where contact ends between points of a grid, and the pressure next to it.

Forces over the area of a point are accurate pressures inside the contact, but not next to its edge,
where the pressure falls as a square root and the edge is anywhere between two points. For smooth
frictionless surfaces, the pressure inside and the slope of the gap g outside are parts of one
analytic function: with the distances :math:`\rho` into the contact and t out of it,

.. math::
    p = \sqrt\rho \sum_k c_k \rho^k, \qquad
    \frac{E^*}{2} \frac{dg}{dt} = \sqrt t \sum_k c_k (-t)^k, \qquad E^* = \frac{E}{1 - \nu^2},

on layers as on a half space, since their kernels differ by smooth functions. The edge and four
coefficients are fitted to pressures inside and gaps outside along each grid line that crosses the
edge, without the two points on either side of it.

On a surface a line crosses the edge at an angle to its normal, whose cosine is n, and the edge has
a curvature k. With the distance t along the line the gap is then n (1 + b t) times the one above,
:math:`b = 3 k (1 - n^2) / (5 n) - k n / 5`; the last term is that of Hertz' ball. Values of lines
along the two axes are averaged with the weights n^2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class _Fit(NamedTuple):  # parameters of the fit along a grid line
    skipped: int = 2  # omitted points on either side
    inside: int = 5  # most points used in contact
    outside: int = 4  # most points used out of contact
    terms: int = 4  # terms of the pressure series


FIT = _Fit()


@dataclass(frozen=True)
class ContactEdge:
    """Edge of contact and the pressure at the grid points, those next to the edge included.

    Attributes
    ----------
    places : ndarray, shape (dim - 1, m)
        Where lines of the grid cross the edge: in the plane the ends of contact.
    pressure : ndarray, shape (nx[, ny])
        Forces over area, except at the points `recovered` next to the edge.
    recovered : ndarray of bool, shape (nx[, ny])
        Points whose pressure was fitted.

    References
    ----------
    K. L. Johnson, Contact Mechanics, Cambridge University Press 1985, section 2.7 and chapter 4;
    J. R. Barber, Contact Mechanics, Springer 2018, chapter 6.

    Examples
    --------
    The radius of Hertz' contact, on a half space; Johnson, (4.22):

    >>> from contact import GridContact, HalfSpace, Parabola, Rigid
    >>> ball = Rigid(Parabola((0.5, 0.5, 0.0), radius=2.0), force=(None, None, 1e-3))
    >>> result = GridContact(HalfSpace((1.0, 1.0), (96, 96), E=1.0, nu=0.3), ball).solve()
    >>> radius = np.hypot(*(result.edge().places - 0.5)).mean()
    >>> print(radius.round(3), round((0.75 * 1e-3 * 2.0 * 0.91) ** (1 / 3), 3))
    0.111 0.111
    """

    places: Array
    pressure: Array
    recovered: NDArray[np.bool_]


def contact_edge(
    pressure: Array,
    opening: Array,
    spacing: Sequence[float],
    modulus: float,
    mirrored: Sequence[bool] = (),
) -> ContactEdge:
    """Edge of frictionless contact from pressure and gap on a grid, for E* `modulus`; omitted where
    no square root fits, as for contact spots of few points.
    """
    inner = tuple(slice(n) for n in pressure.shape)
    sides = [axis for axis, twice in enumerate(mirrored) if twice]
    for axis in sides:
        pressure, opening = _unfolded(pressure, axis), _unfolded(opening, axis)
    sums, weights = np.zeros_like(pressure), np.zeros_like(pressure)
    places = []
    for axis, h in enumerate(spacing):
        for sense in (1, -1):
            line = _Lines(pressure, 0.75 * modulus / h * opening, axis, sense, spacing)
            for index, value, share in line.points():
                np.add.at(sums, index, share * value)
                np.add.at(weights, index, share)
            places.append(line.places)
    fitted = weights > 0
    found = np.where(fitted, sums / np.where(fitted, weights, 1.0), pressure)
    crossings = np.concatenate(places, axis=1)
    for axis in sides:
        crossings = crossings[:, crossings[axis] <= inner[axis].stop - 1]
    return ContactEdge(
        crossings * np.reshape(spacing, (-1, 1)), found[inner].copy(), fitted[inner].copy()
    )


def _unfolded(values: Array, axis: int) -> Array:
    """Extend a mirrored direction to a periodic one."""
    back = np.flip(values.take(range(1, values.shape[axis] - 1), axis=axis), axis)
    return np.concatenate([values, back], axis=axis)


class _Lines:
    """Points where lines along one axis leave the contact in one direction. Lengths are in units of
    the spacing along the lines, `gap` in units of the pressure.
    """

    def __init__(
        self, pressure: Array, gap: Array, axis: int, sense: int, spacing: Sequence[float]
    ) -> None:
        self.p, self.axis, self.sense = pressure, axis, sense
        self.last = np.nonzero((pressure > 0) & ~(np.roll(pressure, -sense, axis) > 0))
        n, curvature = direction(pressure, axis, sense, spacing, self.at)
        t = np.r_[FIT.skipped : FIT.skipped + FIT.inside, -FIT.skipped - np.arange(FIT.outside)]
        beside = gap[self.at(t)]
        used = self._used(t) & np.isfinite(beside)
        values = np.where(t > 0, pressure[self.at(t)], np.where(used, beside, 0.0))
        oblique = 0.3  # smallest cosine of a crossing that is used
        beyond = beside_edge(np.maximum(n, oblique), curvature)
        self.e, self.c, good = fitted(t.astype(float), values, used, beyond)
        near = np.arange(1 - FIT.skipped, FIT.skipped)
        rho = np.maximum(near + self.e[:, None], 0.0)
        self._values = _sum(self.c, rho)
        self._good = good & (n > oblique) & np.all(self._values >= 0, axis=1)
        self._near, self._shares = self.at(near), n**2

    def at(self, t: Any) -> tuple[Any, ...]:
        """Indices of the points t inwards of the last ones in contact, shape (lines, t)."""
        index = [np.asarray(i)[:, None] for i in self.last]
        size = self.p.shape[self.axis]
        index[self.axis] = (index[self.axis] - self.sense * np.atleast_1d(t)) % size
        return tuple(index)

    def _used(self, t: Array) -> NDArray[np.bool_]:
        """Points before the next edge, without the omitted ones next to it."""
        touches = self.p[self.at(np.arange(2 * FIT.skipped + FIT.inside))] > 0
        opens = ~(self.p[self.at(-1 - np.arange(FIT.skipped + FIT.outside))] > 0)
        run, free = (np.cumprod(part, axis=1).sum(axis=1)[:, None] for part in (touches, opens))
        return np.where(t > 0, t < run - FIT.skipped, -t < free)

    @property
    def places(self) -> Array:
        """Crossings in units of the spacings, shape (dim - 1, m)."""
        where = np.array([np.asarray(i, dtype=float) for i in self.last])
        where[self.axis] = (where[self.axis] + self.sense * self.e) % self.p.shape[self.axis]
        return where[:, self._good]

    def points(self) -> list[tuple[tuple[Any, ...], Array, Array]]:
        """Indices, pressures and shares of the points next to the edge."""
        good, shape = self._good, self._values.shape
        index = [np.broadcast_to(i, shape)[good] for i in self._near]
        shares = np.broadcast_to(self._shares[:, None], shape)[good]
        return [(tuple(index), self._values[good], shares)]


def direction(
    p: Array, axis: int, sense: int, spacing: Sequence[float], at: Callable[[Any], Any]
) -> tuple[Array, Array]:
    """Cosine between lines and edge normals, and the curvature (zero if unknown), from the squared
    pressure, which is smooth up to the edge, at the fourth to sixth point.
    """
    count = at(0)[0].size
    if p.ndim == 1:
        return np.ones(count), np.zeros(count)
    square, across = p**2, 1 - axis
    stretch = float(spacing[axis]) / float(spacing[across])
    slopes = _difference(square, axis), stretch * _difference(square, across)
    there = []
    for slope, sign in zip(slopes, (-sense, 1), strict=True):
        near, far = slope[at([3, 5])].T
        there.append(sign * (near + 1.5 * (near - far)))  # extrapolated linearly to the edge
    length = np.hypot(*there)
    length = np.where(length > 0, length, 1.0)
    n, s = there[0] / length, there[1] / length
    along, side = _second(square, axis), stretch**2 * _second(square, across)
    mixed = -sense * stretch * _difference(slopes[0], across)
    xx, yy, xy = (part[at(4)][:, 0] for part in (along, side, mixed))
    known, block = n > 0, at([3, 4, 5])
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            known &= (np.roll(p, (i, j), (0, 1))[block] > 0).all(axis=1)
    curvature = -(s**2 * xx - 2 * s * n * xy + n**2 * yy) / length
    return np.where(known, n, 0.0), np.where(known, curvature, 0.0)


def beside_edge(n: Array, curvature: Array) -> Array:
    """Gap relative to that of a straight orthogonal edge: coefficients of 1 and t, (lines, 2)."""
    return np.stack([n, curvature * (0.6 * (1 - n**2) - 0.2 * n**2)], axis=1)


def _difference(values: Array, axis: int) -> Array:
    return np.asarray(0.5 * (np.roll(values, -1, axis) - np.roll(values, 1, axis)))


def _second(values: Array, axis: int) -> Array:
    return np.asarray(np.roll(values, -1, axis) - 2 * values + np.roll(values, 1, axis))


def _sum(c: Array, rho: Array) -> Array:
    """Pressure series at distances rho into the contact, shape (lines, points)."""
    powers = rho[..., None] ** np.arange(FIT.terms)
    return np.asarray(np.sqrt(rho) * np.sum(c[:, None] * powers, -1))


def fitted(t: Array, values: Array, used: Any, bend: Array) -> tuple[Array, Array, Any]:
    """Edges e beyond the last point, coefficients (lines, 4), and which lines fit, by Gauss and
    Newton's method: values, (lines, points), are pressures inside and gaps outside.
    """
    inside = t > 0
    within, beyond = (used & inside).sum(axis=1), (used & ~inside).sum(axis=1)
    kept = np.arange(FIT.terms) < np.where(within > 4, FIT.terms, FIT.terms - 1)[:, None]
    e, c = np.full(len(values), 0.25), np.zeros((len(values), FIT.terms))
    for step in range(30):
        rho = np.abs(t + e[:, None])
        B, slope = _functions(rho, inside, kept)
        more = np.where(inside, 1.0, bend[:, :1] + bend[:, 1:] * rho)
        B, slope = more[..., None] * B, more[..., None] * slope
        # Weight as errors of the squared pressure and its analogue outside; grid errors decrease
        # with the distance, faster inside.
        w = used * np.where(inside, 2 * rho**2.5, rho**0.5)
        J = np.concatenate([B, slope @ c[..., None]], axis=2) if step else B
        left = values - (B @ c[..., None])[..., 0]
        change = np.linalg.pinv(J * w[..., None], rcond=1e-12) @ (w * left)[..., None]
        c = c + change[:, : FIT.terms, 0]
        if step:
            moved = np.clip(e + np.clip(change[:, -1, 0], -0.3, 0.3), -0.5, 1.25)
            settled, e = np.abs(moved - e).max(initial=0.0) < 1e-10, moved
            if settled:
                break
    off = np.abs((B @ c[..., None])[..., 0] - values) > 0.05 * values  # not a square-root edge
    good = (within >= 3) & (beyond >= 2) & (c[:, 0] > 0) & ~np.any(off & used & inside, axis=1)
    return e, c, good


def _functions(rho: Array, inside: Any, kept: Any) -> tuple[Array, Array]:
    """Basis functions of the series, and their derivatives with respect to the edge position."""
    k = np.arange(FIT.terms)
    powers, root = rho[..., None] ** k * kept[:, None], np.sqrt(rho)[..., None]
    outer = 1.5 * (-1.0) ** k
    where = inside[:, None]
    B = np.where(where, root * powers, outer / (k + 1.5) * root**3 * powers)
    return B, np.where(where, (k + 0.5) / root * powers, -outer * root * powers)
