"""Laws of compliant surfaces as variables of a quadratic program: one for each straight piece."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.result.contact_system import ContactSystem

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class SurfaceSlacks:
    r"""The overclosure of a point as a sum of its parts s_j on the pieces of its law.

    .. math::
        \min \sum_j \int_0^{s_j} A (p_j + k_j \sigma)\, d\sigma \quad
        \text{s.t.} \quad \sum_j s_j \ge u_n - d - h(0), \; 0 \le s_j \le l_j

    is convex for growing pressures; the multiplier of the sum is the contact force."""

    point: Index  # contact point of each slack, shape (k,)
    force: Array  # A p_j where the piece begins, shape (k,)
    stiffness: Array  # A k_j, shape (k,)
    begin: Array  # overclosure where the piece begins, shape (k,)
    length: Array  # l_j, infinite for the last piece of a law, shape (k,)

    @classmethod
    def of(cls, system: ContactSystem) -> Self:
        """The slacks of all points with a law; none for hard contact."""
        rows = system.rows
        soft = np.isfinite(rows.gap) & ~rows.ties
        found: list[tuple[Array, ...]] = []
        for k, law in enumerate(system.overclosure):
            points = np.flatnonzero(soft & (rows.boundary == k))
            if law is None or points.size == 0:
                continue
            p, c = (np.asarray(values) for values in law.stored().values())
            slope = np.diff(p) / np.diff(c)
            length = np.r_[np.diff(c)[:-1], np.inf]
            area = np.repeat(rows.weights[points], slope.size)
            of_piece = (np.tile(values, points.size) for values in (p[:-1], slope, c[:-1], length))
            force, stiffness, begin, lengths = of_piece
            point = np.repeat(points, slope.size).astype(np.float64)
            found.append((point, area * force, area * stiffness, begin, lengths))
        if not found:
            found.append((np.zeros(0),) * 5)
        point, *values = (np.concatenate(part) for part in zip(*found, strict=True))
        return cls(point.astype(np.int64), *values)

    @property
    def start(self) -> tuple[Index, Array]:
        """Points with a law, and h(0) of each, where its first piece begins."""
        points, first = np.unique(self.point, return_index=True)
        return points, self.begin[first]

    def among(self, points: Index) -> tuple[sparse.csr_array, SurfaceSlacks]:
        """The slacks of some points, and the matrix of their sums, shape (points, slacks)."""
        kept = np.flatnonzero(np.isin(self.point, points))
        own = SurfaceSlacks(
            self.point[kept],
            self.force[kept],
            self.stiffness[kept],
            self.begin[kept],
            self.length[kept],
        )
        place = np.searchsorted(points, own.point), np.arange(kept.size)
        total = sparse.coo_array((np.ones(kept.size), place), shape=(points.size, kept.size))
        return sparse.csr_array(total), own

    def energy(self, overclosure: Array) -> float:
        """Energy of the surfaces at the overclosures u_n - d of all points, shape (m,)."""
        s = np.clip(overclosure[self.point] - self.begin, 0.0, self.length)
        return float(self.force @ s + 0.5 * self.stiffness @ s**2)
