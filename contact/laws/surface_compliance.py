"""The pressure-overclosure laws of all contact points, for forces in scaled units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contact.laws.pressure_overclosure import PressureOverclosure

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SurfaceCompliance:
    """Laws h of the points: ``u_n - d = h(mu)`` where mu > 0, h nondecreasing."""

    laws: tuple[PressureOverclosure | None, ...]
    number: NDArray[np.int64]  # law of each point; -1 for hard contact and bonded points
    area: Array  # force over pressure
    unit: Array  # physical overclosure = scaled overclosure * unit

    def closest(self, q: Array) -> tuple[Array, Array, Array]:
        """mu with ``mu + h(mu) = q``, h and h' there (zero where mu = 0): the resolvent of the law,
        max(0, q) for hard contact.
        """
        mu, h, slope = np.maximum(q, 0.0), np.zeros(q.size), np.zeros(q.size)
        for k, law in enumerate(self.laws):
            at = np.flatnonzero(self.number == k)
            if law is None or at.size == 0:
                continue
            a, b = self.area[at], 1.0 / self.unit[at]
            c = law.resolved(q[at], a, b)
            p, dp = law.evaluated(c)
            mu[at], h[at] = a * p, b * c
            loaded = (p > 0) & (dp > 0)
            slope[at] = np.where(loaded, b / (a * np.where(loaded, dp, 1.0)), 0.0)
        return mu, h, slope

    @property
    def start(self) -> Array:
        """h(0) of each point, shape (m,)."""
        return self.closest(np.full(self.number.size, -np.inf))[1]
