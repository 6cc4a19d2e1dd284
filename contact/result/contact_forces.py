"""What happens on the contact boundary: gap and slip, pressure and shear, and their resultants.

Bonded points transmit forces of ties, not of contact: these have names of their own.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from contact.laws.status import Status
from contact.result.contact_state import ContactState

Array = NDArray[np.float64]
Chosen = NDArray[np.bool_]


class ContactForces(ContactState):
    """Fields of the contact points of a result, read from its numbers.

    Lengths have the unit of the mesh, pressures and tractions that of E.
    """

    @property
    def x(self) -> Array:
        """Places of the contact points: the functional's means, shape (dim, m)."""
        return self.system.rows.x

    @property
    def x_nominal(self) -> Array:
        """Nominal places of the contact points, shape (dim, m)."""
        return self.system.rows.x_nominal

    @property
    def pressure(self) -> Array:
        """Contact pressure at `x`, force per area, positive in compression, shape (m,).

        Zero at bonded points, which have `tie_pressure`.
        """
        return self._normal(~self.system.rows.ties)

    @property
    def shear(self) -> Array:
        """Shear traction that acts on the body at `x`, along the tangents, (m, dim - 1).

        Where supports prescribe the whole slip and it is not zero, the shear opposes it at its
        bound. Where they prescribe that there is none, the shear cannot be told apart from their
        reactions and counts as part of these: it is zero, see `Status.UNDETERMINED`.
        Zero at bonded points, which have `tie_shear`.
        """
        return self._tangential(~self.system.rows.ties)

    @property
    def tie_pressure(self) -> Array:
        """Normal traction of ties at `x`, negative where they pull, shape (m,); else zero."""
        return self._normal(self.system.rows.ties)

    @property
    def tie_shear(self) -> Array:
        """Tangential traction of ties on the body at `x`, shape (m, dim - 1); else zero."""
        return self._tangential(self.system.rows.ties)

    def _normal(self, chosen: Chosen) -> Array:
        return np.where(chosen, self.mu / self.system.rows.weights, 0.0)

    def _tangential(self, chosen: Chosen) -> Array:
        return np.where(chosen[:, None], -self.t / self.system.rows.weights[:, None], 0.0)

    @cached_property
    def normal_displacement(self) -> Array:
        """u_n of the contact points along the outward normal, shape (m,)."""
        return np.asarray(self.system.rows.G @ self.u)

    @cached_property
    def slip(self) -> Array:
        """Tangential displacement relative to the obstacle, u_t - w_t, shape (m, dim - 1)."""
        return self.system.relative(self.u, self.motion)[1]

    @cached_property
    def slip_increment(self) -> Array:
        """Slip since the last step of a load history, which friction opposes, (m, dim - 1)."""
        return self.system.slip_increment(self.slip)

    @property
    def gap(self) -> Array:
        """What is left of the gap, d - (u_n - w_n), shape (m,).

        It is the geometric one: negative by the overclosure where compliant surfaces are pressed.
        """
        return self.system.rows.gap - self.system.relative(self.u, self.motion)[0]

    @property
    def part(self) -> NDArray[np.int64]:
        """Number of the contact boundary of each contact point, shape (m,)."""
        part = self.system.rows.part
        return part if part.size else np.zeros(self.mu.size, dtype=np.int64)

    @cached_property
    def status(self) -> NDArray[np.int8]:
        """`Status` of each contact point, shape (m,)."""
        size = max(float(self.mu.max(initial=0.0)), float(np.abs(self.t).max(initial=0.0)))
        g = self.system.bound(self.mu)
        loaded = self.mu > 1e-12 * size
        if self.system.law == "tresca":
            loaded = loaded | (g > 0)
        force = np.linalg.norm(self.t, axis=1)
        # What rounding leaves of a displacement is no slip.
        moves = np.linalg.norm(self.slip_increment, axis=1) > 1e-10 * self.system.body.reach(self.u)
        held = loaded & (g > 0)
        held = held & self.system.held if held.any() else held
        moves = np.where(held, force > 0, moves)  # where it is zero, so is the slip
        slides = loaded & moves & (force >= g * (1 - 1e-9))
        status = np.where(slides, Status.SLIP, np.where(loaded, Status.STICK, Status.OPEN))
        status = np.where(held & ~slides, Status.UNDETERMINED, status)
        return np.where(self.system.rows.ties, Status.BONDED, status).astype(np.int8)

    @property
    def zone(self) -> Array:
        """Span of the nominal places of loaded points, shape (dim, 2): least and largest.

        NaN where nothing is in contact; bonded points do not count.
        """
        p = self.mu[~self.system.rows.ties]
        loaded = (self.mu > 1e-12 * float(p.max(initial=0.0))) & ~self.system.rows.ties
        if not loaded.any():
            return np.full((self.x.shape[0], 2), np.nan)
        where = self.x_nominal[:, loaded]
        return np.column_stack((where.min(axis=1), where.max(axis=1)))

    @cached_property
    def resultant(self) -> Array:
        """Force of the obstacle on the body, pressure and friction together, shape (dim,).

        Where bodies touch each other: the sum of the `resultants`. Ties have `tie_resultants`.
        """
        if self.system.rows.axes.size:
            return np.asarray(self.resultants.sum(axis=0))
        return self.system.body.total(-self.contact_forces)

    @property
    def resultants(self) -> Array:
        """The resultant of each contact boundary, shape (nboundaries, dim).

        Where two bodies meet it is the force on the one that carries the contact points; the force
        on the other is equal and opposite. Zero where they are tied, see `tie_resultants`.
        """
        return self._totals(~self.system.rows.ties)

    @property
    def tie_resultants(self) -> Array:
        """The resultants of ties, as `resultants` are those of contact, (nboundaries, dim)."""
        return self._totals(self.system.rows.ties)

    def _totals(self, chosen: Chosen) -> Array:
        boundaries = [chosen & (self.part == k) for k in range(self.part.max() + 1)]
        axes = self.system.rows.axes
        if not axes.size:
            return np.array([self.system.body.total(-self._forces(p)) for p in boundaries])
        on_points = -np.einsum("ma,mac->mc", np.column_stack((self.mu, self.t)), axes)
        if self.system.body.is_ring:
            on_points[:, 0] = 0.0  # around the ring these cancel
        return np.array([on_points[p].sum(axis=0) for p in boundaries])

    def _forces(self, chosen: Chosen) -> Array:
        rows, t = self.system.rows, np.where(chosen[:, None], self.t, 0.0)
        return np.asarray(rows.G.T @ np.where(chosen, self.mu, 0.0) + rows.T.T @ t.ravel())

    @property
    def contact_force(self) -> float:
        """Sum of the normal forces of contact."""
        return float(self.mu[~self.system.rows.ties].sum())

    @property
    def tie_force(self) -> float:
        """Sum of the normal forces of ties, negative where they pull."""
        return float(self.mu[self.system.rows.ties].sum())

    @cached_property
    def contact_forces(self) -> Array:
        """``G^T mu + T^T t`` on all dofs: the contact forces with the opposite sign."""
        return self._forces(~self.system.rows.ties)

    @cached_property
    def tie_forces(self) -> Array:
        """As `contact_forces`, of the bonded points."""
        return self._forces(self.system.rows.ties)

    @property
    def centre_of_pressure(self) -> Array:
        """Where the resultant of the pressure acts, on each contact boundary, (nboundaries, dim).

        NaN where nothing is in contact. The forces act at the nominal places: the moment about
        any point is that which the body feels.
        """
        contact = ~self.system.rows.ties
        parts = [contact & (self.part == k) for k in range(self.part.max() + 1)]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.array([self.x_nominal[:, p] @ self.mu[p] / self.mu[p].sum() for p in parts])
