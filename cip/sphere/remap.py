"""Masses of cells that the flow brings, as line integrals along their traced edges.

With P(lon, s) the integral of f sin(s) from the south pole up to s, the mass of a cell is
-oint P dlon around it. Near the north pole P less its value there serves, which is smooth on the
sphere: both forms are O(r^2) dlon about their pole, so a cell that holds it needs no special case.
They differ by an exact form, whose ends telescope. Each edge is integrated once and enters both
neighbours, so that mass is kept to rounding whatever the quadrature (the idea of Laprise and
Plante, Mon. Weather Rev. 123, 1995, with edges as they are).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import Legendre, Polynomial
from numpy.typing import NDArray

from cip.errors import InputError, NotConverged
from cip.formulas.sphere_spline import (
    PAD,
    at_integers,
    coefficients,
    over_poles,
    padded,
    resolved,
    sines,
)
from cip.grid import Array, Sphere, in_space
from cip.sphere.paths import Wind, traced

# Of an edge: inner nodes that are traced, and points of Gauss's rule on the curve through them.
INNER, POINTS = 3, 4
LONGEST = 1.0  # radians between the ends of a traced edge, beyond which no curve describes it


class Edges(NamedTuple):
    """Traced edges east (0) and north (1) of the corners."""

    points: Array  # (2, nlon, nlat, POINTS, 4): lon, s, weight times dlon, 1 + z or z - 1
    north: NDArray[np.bool_]  # (2, nlon, nlat): whether P counts from the north pole
    lon: Array  # of the traced corners, (nlon, nlat + 1)


class Remap:
    """The step for means in cells by splines of a degree, 2 or 4."""

    def __init__(self, sphere: Sphere, degree: int) -> None:
        self.sphere, self.degree = sphere, degree
        inner = np.sort(Legendre.basis(INNER + 1).deriv().roots().real)
        nodes = np.concatenate([[-1.0], inner, [1.0]])
        self._gauss, self._rule = np.polynomial.legendre.leggauss(POINTS)
        lagrange = [Polynomial.fromroots(np.delete(nodes, q)) for q in range(INNER + 2)]
        lagrange = [one / one(at) for one, at in zip(lagrange, nodes, strict=True)]
        self._values = np.stack([one(self._gauss) for one in lagrange], axis=1)
        self._slopes = np.stack([one.deriv()(self._gauss) for one in lagrange], axis=1)
        part, none = 0.5 * (inner + 1.0), np.zeros(INNER)
        east, up = np.concatenate([[0.0], part, none]), np.concatenate([[0.0], none, part])
        lon, lat = sphere.edges
        start = in_space(
            lon[:-1, None, None] + east * sphere.widths[0][0],
            np.minimum(lat[:, None] + up * sphere.widths[1][0], 0.5 * np.pi),
        )
        start[:2, :, 0, : INNER + 1] = start[:2, :, -1] = 0.0  # the poles, exactly
        self._start = start

    def edges(self, wind: Wind, t_end: float, dt: float, tolerance: float) -> Edges:
        """Trace the edges of all cells back by dt from t_end."""
        from cip.sphere.kernels import edge_points

        start, (nlon, nlat) = self._start, self.sphere.cells
        flat = traced(wind, start.reshape(3, -1), t_end, dt, self.sphere.radius, tolerance)
        nodes = flat.reshape(start.shape)
        corner = nodes[..., 0]
        sides = corner - np.roll(corner, -1, axis=1), np.diff(corner, axis=2)
        if max(float((side**2).sum(0).max()) for side in sides) > LONGEST**2:
            raise InputError(
                f"dt: in a step of {dt:.6g} the flow stretches an edge over {LONGEST:g} radians; "
                "take a smaller one"
            )
        points = np.zeros((2, nlon, nlat, POINTS, 4))
        north = np.zeros((2, nlon, nlat), dtype=bool)
        edge_points(nodes, self._values, self._slopes, self._rule, points, north)
        return Edges(points, north, np.arctan2(corner[1], corner[0]))

    def step(self, means: Array, edges: Edges) -> Array:
        """Means in all cells, shape (fields, nlon, nlat), after the step."""
        from cip.sphere.kernels import cell_masses, edge_integrals

        area, (nlon, nlat) = self.sphere.weights / self.sphere.radius**2, self.sphere.cells
        mean = (means * area).sum((1, 2)) / (4.0 * np.pi)
        # The mean is carried exactly: of it P is mean (1 + z).
        rest = self._density(means - mean[:, None, None])
        coefs, top = self._cumulative(rest)
        integrals = np.zeros((2, len(means), nlon, nlat))
        wrapped = top[:, np.arange(-PAD, nlon + PAD) % nlon]
        edge_integrals(edges.points, edges.north, coefs, wrapped, mean, self.degree, PAD, integrals)
        masses = np.empty((len(means), nlon, nlat))
        cell_masses(integrals, edges.north, self._turns(edges.lon, mean, top), masses)
        return _kept(means * area, masses) / area

    def _density(self, means: Array) -> Array:
        """Coefficients of f sin(s) on whole great circles, whose means over cells are given."""
        density = resolved(means) * sines(means.shape[-1])
        return coefficients(over_poles(density, -1.0), self.degree + 1)

    def _cumulative(self, density: Array) -> tuple[Array, Array]:
        """Coefficients of P, padded, and of its value at the north pole, shape (fields, nlon)."""
        nlat, h = self.sphere.cells[1], self.sphere.widths[1][0]
        found = np.cumsum(padded(density, nlat), axis=2) * h
        found = np.concatenate([np.zeros((*found.shape[:2], 1)), found], axis=2)
        at = at_integers(self.degree + 1)
        found -= (found[:, :, : 2 * PAD + 1] @ at)[..., None]
        return found, found[:, PAD:-PAD, nlat:] @ at

    def _turns(self, lon: Array, mean: Array, top: Array) -> Array:
        """The integral of P at the north pole over lon, from end to end of the edges."""
        from cip.formulas.spline_loops import weights

        nlon, nlat = self.sphere.cells
        # The mean over lon vanishes with the mean of the field.
        sums = np.cumsum(top - top.mean(1, keepdims=True), axis=1) * self.sphere.widths[0][0]
        x = lon / self.sphere.widths[0][0]
        k = np.floor(x).astype(int)
        potential = np.zeros((len(mean), *lon.shape))
        parts = np.empty((self.degree + 2, *x.shape))
        plain: Any = weights
        plain.py_func(x - k, self.degree + 1, parts)
        for p, weight in enumerate(parts):
            potential += weight * sums[:, (k - self.degree // 2 + p - 1) % nlon]
        ends = [np.roll(lon, -1, 0)[:, :nlat], lon[:, 1:]]
        ahead = [np.roll(potential, -1, 1)[:, :, :nlat], potential[:, :, 1:]]
        return np.stack(
            [
                2.0 * mean[:, None, None] * _wrapped(end - lon[:, :nlat])
                + (one - potential[:, :, :nlat])
                for end, one in zip(ends, ahead, strict=True)
            ]
        )


def _wrapped(angle: Array) -> Array:
    """Angles in [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def _kept(before: Array, after: Array) -> Array:
    """Masses after a step with the sum before it: rounding is given back where there is mass.
    Raises `NotConverged` where the sums differ by more, which exact edges cannot."""
    size = np.abs(after).sum((1, 2))
    lost = before.sum((1, 2)) - after.sum((1, 2))
    if not (np.abs(lost) <= 1e-11 * (size + np.abs(before).sum((1, 2)))).all():
        raise NotConverged(
            f"mass: a step lost {np.abs(lost).max():.1e}; its edges wind around a pole, take a "
            "smaller dt"
        )
    share = np.divide(lost, size, out=np.zeros_like(lost), where=size > 0.0)
    return after + share[:, None, None] * np.abs(after)
