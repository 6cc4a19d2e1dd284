r"""Exact decay of moments over a time: u' = -k u at each place, so u is multiplied by E.

With :math:`K = \int k \, dt` and :math:`E = e^{-K}`, derivatives of E u follow by the product rule.
Means of E u over cells are those of a rule of Simpson's kind with the midpoint value that the
profile has there; so means are exact where k is the same everywhere.
"""

from __future__ import annotations

from itertools import product
from math import comb
from typing import Any

import numpy as np

from cip.errors import InputError
from cip.formulas.formula import Formula
from cip.grid import Grid, node_name
from cip.profiles.catalogue import CONSERVATIVE, Moment, carries_slopes, moments
from cip.sources.nodal_moments import NodalMoments

Orders = tuple[int, ...]


class Decay:
    """Decay of all moments of a profile, and its transpose.

    Parameters
    ----------
    grid : Grid
    profile : str
    formula : Formula
        The rate k, in 1 / time.
    steady : bool
    xp : module
        NumPy or CuPy.
    """

    def __init__(self, grid: Grid, profile: str, formula: Formula, steady: bool, xp: Any) -> None:
        self._grid, self._profile, self._xp = grid, profile, xp
        self._rate, self._moments = formula.expression, moments(profile, grid.dim)
        self._integrals = NodalMoments(grid, formula, steady, xp)
        self._uniform = self._rate.op == "constant"
        self._kept: tuple[float, dict[Orders, Any]] | None = None

    def applied(self, data: Any, t: float, length: float) -> Any:
        """The moments after a time, shape as `data`."""
        factors = self._factors(t, length)
        if self._uniform:
            return data * factors[(0, 0, 0)]
        if self._profile in CONSERVATIVE:
            return self._means(data, factors)
        return self._products(data, factors, False)

    def transposed(self, weight: Any, t: float, length: float) -> Any:
        """The transpose of `applied`, for profiles whose moments are derivatives."""
        factors = self._factors(t, length)
        if self._uniform:
            return weight * factors[(0, 0, 0)]
        return self._products(weight, factors, True)

    def _products(self, data: Any, factors: dict[Orders, Any], transpose: bool) -> Any:
        """Leibniz's rule: (E u)_a is the sum over b <= a of binom(a, b) E_{a-b} u_b."""
        place: dict[Orders, int] = {moment.orders[:3]: q for q, moment in enumerate(self._moments)}
        new = self._xp.zeros_like(data)
        for above, q in place.items():
            for below in product(*(range(order + 1) for order in above)):
                rest = tuple(a - b for a, b in zip(above, below, strict=True))
                count = np.prod([comb(a, b) for a, b in zip(above, below, strict=True)])
                to, of = (place[below], q) if transpose else (q, place[below])
                new[to] += (float(count) * factors[rest] * data[of]).astype(data.dtype)
        return new

    def _factors(self, t: float, length: float) -> dict[Orders, Any]:
        """E and its derivatives (for means: E at nodes and midpoints, by the binary digits)."""
        if self._kept is not None and self._kept[0] == length and self._integrals.steady:
            return self._kept[1]
        if self._uniform:
            found: dict[Orders, Any] = {(0, 0, 0): float(np.exp(-self._rate.value * length))}
        elif self._profile in CONSERVATIVE:
            found = self._at_midpoints(t, length)
        else:
            found = self._derivatives(t, length)
        self._kept = length, found
        return found

    def _integral(self, moment: Moment, t: float, length: float) -> Any:
        return self._integrals.integral(self._rate, moment, t, length)

    def _exponential(self, moment: Moment, t: float, length: float) -> Any:
        """E at the nodes; raises unless k >= 0 there."""
        exponent = self._integrals.integral(self._rate, moment, t, length, midpoints=True)
        if not bool((exponent >= 0.0).all()):  # also where it is NaN
            bad = exponent if isinstance(exponent, np.ndarray) else exponent.get()
            node = int(np.flatnonzero(~(bad.ravel() >= 0.0))[0])
            raise InputError(
                f"decay: expected a rate >= 0, got {bad.ravel()[node] / length:.6g} at "
                f"{node_name(self._grid, node)}, t = {t:.6g}; what grows belongs into source"
            )
        return self._xp.exp(-exponent)

    def _derivatives(self, t: float, length: float) -> dict[Orders, Any]:
        found: dict[Orders, Any] = {}
        for moment in self._moments:  # u first
            orders = moment.orders[:3]
            axes = [axis for axis in range(3) for _ in range(orders[axis])]
            if not axes:
                found[orders] = self._exponential(moment, t, length)
                continue
            slopes = []
            for axis in axes:
                i, j, k = (int(axis == q) for q in range(3))
                slopes.append(self._integral(Moment("", (i, j, k, 0)), t, length))
            if len(axes) == 1:
                factor = -slopes[0]
            else:
                factor = slopes[0] * slopes[1] - self._integral(moment, t, length)
            found[orders] = factor * found[0, 0, 0]
        return found

    def _at_midpoints(self, t: float, length: float) -> dict[Orders, Any]:
        found = {}
        for bits in product((0, 1), repeat=self._grid.dim):
            moment = Moment("", (0, 0, 0, 0), tuple(a for a, bit in enumerate(bits) if bit))
            found[bits] = self._exponential(moment, t, length)
        if carries_slopes(self._profile, self._grid.dim):
            slope = self._integral(Moment("", (1, 0, 0, 0)), t, length)
            found[(2,)] = -slope * found[(0,)]
        return found

    def _means(self, data: Any, factors: dict[Orders, Any]) -> Any:
        """Values and means of E u: along each direction by nodes and midpoints, and back."""
        new = data.astype(float)
        if carries_slopes(self._profile, self._grid.dim):
            return self._means_with_slopes(new, factors).astype(data.dtype)
        pairs = [
            (axis, bits, bits | 1 << axis)
            for axis in range(self._grid.dim)
            for bits in range(2**self._grid.dim)
            if not bits >> axis & 1
        ]
        for axis, value, mean in pairs:
            new[mean] = 1.5 * new[mean] - 0.25 * self._sum_of_ends(new[value], axis)
        for bits in range(len(new)):
            digits = tuple(bits >> axis & 1 for axis in range(self._grid.dim))
            new[bits] *= factors[digits]
        for axis, value, mean in pairs:
            new[mean] = (4.0 * new[mean] + self._sum_of_ends(new[value], axis)) / 6.0
        return new.astype(data.dtype)

    def _means_with_slopes(self, data: Any, factors: dict[Orders, Any]) -> Any:
        """The same for the profile of degree four with slopes; its rule is exact to degree five."""
        xp, grid = self._xp, self._grid
        width = np.append(grid.widths[0], grid.widths[0][-1])[: grid.nodes[0]]
        half = 0.5 * xp.asarray(width)
        u, slope, mean = data

        def ends() -> Any:
            jump = self._sum_of_ends(slope, 0) - 2.0 * slope  # of the slope over the cell
            if not grid.periodic[0]:
                jump[-1] = 0.0
            return 7.0 * self._sum_of_ends(u, 0) - half * jump

        middle = (30.0 * mean - ends()) / 16.0 * factors[(1,)]
        u, slope = factors[(0,)] * u, factors[(0,)] * slope + factors[(2,)] * u
        return xp.stack([u, slope, (16.0 * middle + ends()) / 30.0])

    def _sum_of_ends(self, values: Any, axis: int) -> Any:
        """Values at both ends of each cell, added; 0 where no cell begins."""
        total = values + self._xp.roll(values, -1, axis)
        if not self._grid.periodic[axis]:
            self._xp.moveaxis(total, axis, 0)[-1] = 0.0
        return total
