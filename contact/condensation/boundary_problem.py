"""The contact problem condensed to its boundary: a few dense arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class BoundaryProblem:
    """Displacements ``v = v0 - W l + C a`` of the live rows under contact forces l = (mu, t).
    Motions a of bodies and obstacles are balanced by ``C^T l = s``. Every point is scaled by its
    own compliance, so that the laws are ``mu = max(0, mu + u_n - d)`` and ``t = P_g(t + u_t)``."""

    W: Array  # s.p.d. compliance of the live rows, or DeviceMatrix, shape (n, n)
    v0: Array  # displacement without contact forces and rigid motion, shape (n,)
    C: Array  # displacements of the rows for unit motions a, shape (n, k)
    s: Array  # work of the loads on unit motions a, shape (k,)
    gap: Array  # d, infinite where contact is impossible, shape (m,)
    normal: Index  # row of each point's normal, -1 where prescribed, shape (m,)
    tangent: Index  # rows of the tangents, -1 where prescribed, shape (m, dim - 1)
    prescribed_slip: Array  # tangential displacement where prescribed, (m, dim - 1)
    K: Array | None = None  # stiffness of motions that are not rigid, C^T l + K a = s, (k, k)
    bonded: NDArray[np.bool_] | None = None  # u_n = d, u_t = 0 for any forces, shape (m,)
    compliance: Any = None  # a `contact.laws.surface_law.SurfaceLaw` replaces u_n = d
    swept: NDArray[np.bool_] | None = None  # one of two slips is prescribed: cannot stick, (m,)
    systems: list[Any] | None = None  # the last linear systems of Newton's method, factored
    D: Array | None = None  # replaces C in the balance, if forces follow the motions, (n, k)

    @property
    def balanced(self) -> Array:
        """The matrix whose transpose times the forces balances the loads, shape (n, k)."""
        return self.C if self.D is None else self.D

    @property
    def ties(self) -> NDArray[np.bool_]:
        """The mask `bonded`, all False where it is None, shape (m,)."""
        return np.zeros(self.gap.size, dtype=bool) if self.bonded is None else self.bonded

    def bound(self, g: Array) -> Array:
        """The friction bound g, infinite at bonded points, shape (m,)."""
        return g if self.bonded is None else np.where(self.bonded, np.inf, g)

    @property
    def can_touch(self) -> NDArray[np.bool_]:
        """Points with a live normal row and a finite gap, shape (m,)."""
        return (self.normal >= 0) & np.isfinite(self.gap)

    def zeros(self) -> tuple[Array, Array]:
        """Forces (mu, t) that are all zero."""
        return np.zeros(self.gap.size), np.zeros(self.tangent.shape)

    def forces(self, mu: Array, t: Array) -> Array:
        """Stack point forces into one vector of the live rows."""
        stacked = np.zeros(self.v0.size)
        stacked[self.normal[self.normal >= 0]] = mu[self.normal >= 0]
        stacked[self.tangent[self.tangent >= 0]] = t[self.tangent >= 0]
        return stacked

    def displacements(self, mu: Array, t: Array, a: Array) -> tuple[Array, Array]:
        """Normal and tangential displacement of every point, shapes (m,) and (m, dim - 1)."""
        v = self.v0 - self.W @ self.forces(mu, t) + self.C @ a
        u_n = np.where(self.normal >= 0, v[self.normal], 0.0)
        u_t = np.where(self.tangent >= 0, v[self.tangent], self.prescribed_slip)
        return u_n, u_t

    def penetration(self, u_n: Array) -> Array:
        """u_n - d where contact is possible, minus infinity elsewhere."""
        return np.where(self.can_touch, u_n - self.gap, -np.inf)

    def residual_size(self, mu: Array, t: Array) -> float:
        """Scale of residuals: the largest force, at least 1e-12 times the size of the data."""
        overlap = np.maximum(-self.gap, 0.0)
        if self.compliance is not None:
            overlap, mu = np.maximum(-self.gap - self.compliance.start, 0.0), np.abs(mu)
        if self.bonded is not None:
            overlap, mu = np.where(self.bonded, np.abs((self.gap, mu)), (overlap, mu))
        pull = 0.0 if self.compliance is None else self.compliance.pull
        causes = (float(np.abs(part).max(initial=pull)) for part in (self.v0, self.s, overlap))
        # Smaller forces are rounding of the data.
        tiny = 1e-12 * max(*causes, np.finfo(float).tiny)
        return max(float(mu.max(initial=0.0)), float(np.abs(t).max(initial=0.0)), tiny)

    def energy(self, mu: Array, t: Array, a: Array) -> float:
        """Potential energy up to a constant: l^T W l / 2 - s^T a."""
        forces = self.forces(mu, t)
        return float(0.5 * forces @ self.W @ forces - self.s @ a)


@dataclass(frozen=True)
class Forces:
    """Contact forces mu (m,), t (m, dim - 1) and rigid motion a (k,) of a boundary problem."""

    mu: Array
    t: Array
    a: Array
