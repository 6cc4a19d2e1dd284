r"""Moments of a product g u, for a known function g, and the transpose of that map.

Derivatives follow by Leibniz's rule,
:math:`(g u)_a = \sum_{b \le a} \binom{a}{b} g_{a-b} u_b`. Means over cells are those of a rule of
Simpson's kind with the midpoint value that the profile has there,
:math:`\bar u = (u_0 + 4 u_{1/2} + u_1) / 6`, or of the rule of degree five with slopes, so that
products follow each other as their factors do: (g f) u = g (f u), also for means.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from math import comb
from typing import Any

import numpy as np

from cip.grid import Grid
from cip.profiles.catalogue import CONSERVATIVE, Moment, carries_slopes, moments

Orders = tuple[int, ...]
Factors = Mapping[Orders, Any]


class Products:
    """Products with the moments of a profile, shape (moments,) + grid.nodes. `wanted` are the
    moments of g that they need, by keys: orders of derivatives, or for means for each direction
    whether the midpoint is meant; the slope beside means has the key (2,)."""

    def __init__(self, grid: Grid, profile: str, xp: Any) -> None:
        self._grid, self._xp = grid, xp
        self._moments = moments(profile, grid.dim)
        self.means = profile in CONSERVATIVE
        self._slopes = carries_slopes(profile, grid.dim)
        self.wanted: dict[Orders, Moment] = {}
        if not self.means:
            self.wanted = {moment.orders[:3]: moment for moment in self._moments}
            return
        for bits in product((0, 1), repeat=grid.dim):
            averaged = tuple(axis for axis, bit in enumerate(bits) if bit)
            self.wanted[bits] = Moment("", (0, 0, 0, 0), averaged)
        if self._slopes:
            self.wanted[(2,)] = Moment("", (1, 0, 0, 0))

    def times(self, data: Any, factors: Factors) -> Any:
        """The moments of g u, of shape (moments,) + grid.nodes, from those of u and those of g."""
        if self._slopes:
            return self._with_slopes(data, factors)
        return self._with_means(data, factors) if self.means else self._leibniz(data, factors)

    def transposed(self, weight: Any, factors: Factors) -> Any:
        """The transpose of `times` for the same factors."""
        if self._slopes:
            return self._with_slopes_transposed(weight, factors)
        if self.means:
            return self._with_means_transposed(weight, factors)
        return self._leibniz(weight, factors, True)

    def _leibniz(self, data: Any, factors: Factors, transpose: bool = False) -> Any:
        place = {orders: q for q, orders in enumerate(self.wanted)}
        new = self._xp.zeros_like(data)
        for above, q in place.items():
            for below in product(*(range(order + 1) for order in above)):
                rest = tuple(a - b for a, b in zip(above, below, strict=True))
                count = np.prod([comb(a, b) for a, b in zip(above, below, strict=True)])
                to, of = (place[below], q) if transpose else (q, place[below])
                new[to] += (float(count) * factors[rest] * data[of]).astype(data.dtype)
        return new

    def _with_means(self, data: Any, factors: Factors) -> Any:
        """Along each direction by nodes and midpoints, and back."""
        new = data.astype(float)
        for axis, value, mean in self._pairs():
            new[mean] = 1.5 * new[mean] - 0.25 * self._sum_of_ends(new[value], axis)
        self._scale(new, factors)
        for axis, value, mean in self._pairs():
            new[mean] = (4.0 * new[mean] + self._sum_of_ends(new[value], axis)) / 6.0
        return new.astype(data.dtype)

    def _with_means_transposed(self, weight: Any, factors: Factors) -> Any:
        new = weight.astype(float)
        for axis, value, mean in reversed(self._pairs()):
            new[value] += self._of_cells(new[mean], axis) / 6.0
            new[mean] *= 4.0 / 6.0
        self._scale(new, factors)
        for axis, value, mean in reversed(self._pairs()):
            new[value] -= 0.25 * self._of_cells(new[mean], axis)
            new[mean] *= 1.5
        return new

    def _pairs(self) -> list[tuple[int, int, int]]:
        """For each direction the numbers of the moments of values and of means along it."""
        every = range(2**self._grid.dim)
        return [
            (axis, bits, bits | 1 << axis)
            for axis in range(self._grid.dim)
            for bits in every
            if not bits >> axis & 1
        ]

    def _scale(self, new: Any, factors: Factors) -> None:
        for bits in range(len(new)):
            new[bits] *= factors[tuple(bits >> axis & 1 for axis in range(self._grid.dim))]

    def _with_slopes(self, data: Any, factors: Factors) -> Any:
        """Values, slopes and means: the rule with slopes is exact to degree five."""
        u, slope, mean = data.astype(float)
        middle = (30.0 * mean - self._ends(u, slope)) / 16.0 * factors[(1,)]
        u, slope = factors[(0,)] * u, factors[(0,)] * slope + factors[(2,)] * u
        mean = (16.0 * middle + self._ends(u, slope)) / 30.0
        return self._xp.stack([u, slope, mean]).astype(data.dtype)

    def _with_slopes_transposed(self, weight: Any, factors: Factors) -> Any:
        u, slope, mean = weight.astype(float)
        for_u, for_slope = self._ends_transposed(mean / 30.0)
        u, slope = u + for_u, slope + for_slope
        u, slope = factors[(0,)] * u + factors[(2,)] * slope, factors[(0,)] * slope
        middle = 16.0 / 30.0 * factors[(1,)] * mean
        for_u, for_slope = self._ends_transposed(middle / 16.0)
        return self._xp.stack([u - for_u, slope - for_slope, 30.0 / 16.0 * middle])

    def _ends(self, u: Any, slope: Any) -> Any:
        """What both ends of each cell give to 30 times the mean in the rule with slopes."""
        jump = self._sum_of_ends(slope, 0) - 2.0 * self._in_cells(slope)  # of the slope over it
        return 7.0 * self._sum_of_ends(u, 0) - self._half * jump

    def _ends_transposed(self, weight: Any) -> tuple[Any, Any]:
        jump = self._half * weight
        return 7.0 * self._of_cells(weight, 0), 2.0 * self._in_cells(jump) - self._of_cells(jump, 0)

    @property
    def _half(self) -> Any:
        (widths,), (nodes,) = self._grid.widths, self._grid.nodes
        return 0.5 * self._xp.asarray(np.append(widths, widths[-1])[:nodes])

    def _in_cells(self, values: Any, axis: int = 0) -> Any:
        """The values; 0 at nodes where no cell begins."""
        found = values.copy()
        if not self._grid.periodic[axis]:
            self._xp.moveaxis(found, axis, 0)[-1] = 0.0
        return found

    def _sum_of_ends(self, values: Any, axis: int) -> Any:
        """Values at both ends of each cell, added; 0 where no cell begins."""
        return self._in_cells(values + self._xp.roll(values, -1, axis), axis)

    def _of_cells(self, weight: Any, axis: int) -> Any:
        """The transpose of `_sum_of_ends`."""
        inside = self._in_cells(weight, axis)
        return inside + self._xp.roll(inside, 1, axis)
