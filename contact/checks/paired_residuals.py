"""The residuals of `ContactSystem.kkt`, written anew for pairs of numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.arrays.paired_rows import rows_times
from contact.arrays.pairs import Pairs
from contact.checks.paired_bodies import PairedBody
from contact.result.contact_system import NOISE, ContactState, beside_travel

Array = NDArray[np.float64]


class PairedResiduals:
    """Residuals of a state and its bodies in pairs, and the scales that they are divided by."""

    def __init__(self, state: ContactState, bodies: list[PairedBody]) -> None:
        self.system = state.system
        self.u, self.mu, self.t, self.w = state.u, state.mu, state.t, state.motion
        rows = self.system.rows
        self.rows, self.free = rows, ~rows.ties
        contact = rows_times(rows.G.T, self.mu) + rows_times(rows.T.T, self.t.ravel())
        self.parts = [
            _BodyForces(body, self.u[own], contact[own], self.system.load[own])
            for body, own in zip(bodies, self.system.body.slices, strict=True)
        ]
        give = max(part.body.host.give(part.contact.rounded) for part in self.parts)
        self.length = max(*(part.reach for part in self.parts), give) or 1.0
        self.unbalanced, self.cancelling = max(
            (part.equilibrium() for part in self.parts), key=lambda pair: pair[0] / (pair[1] or 1.0)
        )
        self.noise = NOISE * self.cancelling
        self.size = max(_largest(self.mu), _largest(self.t), self.noise) or 1.0

    def all(self) -> dict[str, float]:
        """The residuals, as `ContactSystem.kkt` names them."""
        u_n, u_t = self._relative()
        ties, gap = self.rows.ties, self.rows.gap
        touchable = np.isfinite(gap)
        off = (u_n - np.where(touchable, gap, 0.0)).rounded
        through = np.where(touchable & self.free, off, -np.inf)
        kkt = {
            "equilibrium": self.unbalanced / (self.cancelling or 1.0),
            "balance": max(part.balance() for part in self.parts),
            "support": max(part.body.support_error(part.u) for part in self.parts) / self.length,
            **self._contact(through),
            **self._friction(u_t),
        }
        if ties.any():
            opened = max(_largest(off[ties]), _largest(u_t.rounded[ties]))
            kkt["tie"] = opened / self.length
        motion = self.system.motion
        if motion is not None and np.any(motion.free):
            kkt["obstacle"] = self._on_obstacles(motion)
        return kkt

    def _relative(self) -> tuple[Pairs, Pairs]:
        """Displacement relative to obstacles, the tangential one since the last step."""
        rows, motion = self.rows, self.system.motion
        u_n = rows_times(rows.G, self.u)
        u_t = rows_times(rows.T, self.u)
        if motion is not None and self.w is not None:
            known = np.nan_to_num(self.w)
            u_n = u_n - rows_times(motion.normal, known)
            u_t = u_t - rows_times(motion.tangent, known)
        u_t = u_t.reshape(*self.t.shape)
        if motion is not None and motion.travel is not None:
            u_t = u_t - motion.travel
        return u_n, u_t if self.system.slip_from is None else u_t - self.system.slip_from

    def _contact(self, through: Array) -> dict[str, float]:
        """The contact law; on compliant surfaces how far forces are off the curve."""
        mu, size, length, free = self.mu, self.size, self.length, self.free
        force = np.maximum(np.abs(mu) - self.noise, 0.0) / size
        found = {
            "penetration": _largest(np.maximum(through, 0.0)) / length,
            "sign": _beyond(-mu[free], self.noise) / size,
            "complementarity": _largest(np.minimum(force, np.abs(through) / length)[free]),
        }
        if self.system.overclosure:
            found |= self.system.off_the_curve(mu, through, size, length)
        return found

    def _friction(self, u_t: Pairs) -> dict[str, float]:
        """The friction law: |t| <= g, and t the projection of ``t + c u_t`` onto that."""
        system, free, t = self.system, self.free, Pairs.of(self.t)
        coulomb = system.law == "coulomb"
        given = Pairs.of(system.friction)
        g = given * np.maximum(self.mu, 0.0) if coulomb else given
        q = t + u_t * (self.size / self.length)
        length = (q * q).sum(axis=1).sqrt()
        beyond = length.rounded > g.rounded
        factor = g / Pairs.where(beyond, length, 1.0)
        slipped = q * factor.reshape(-1, 1)
        returned = (t - Pairs.where(beyond[:, None], slipped, q)).rounded
        over = ((t * t).sum(axis=1).sqrt() - g).rounded
        return {
            "cone": _beyond(over[free], self.noise) / self.size,
            "slip": _beyond(np.abs(returned[free]), self.noise) / self.size,
        }

    def _on_obstacles(self, motion: Any) -> float:
        """Forces on the free motions of obstacles, relative to all contact forces and arms."""
        normal, tangent, force = motion.normal, motion.tangent, np.nan_to_num(motion.force)
        left = rows_times(normal.T, self.mu) + rows_times(tangent.T, self.t.ravel()) + force
        arms = np.maximum(
            np.abs(normal).max(axis=0, initial=0.0), np.abs(tangent).max(axis=0, initial=0.0)
        )
        size = arms * (np.abs(self.mu).sum() + np.abs(self.t).sum()) + np.abs(force)
        return _largest((left.rounded / np.where(size > 0, size, 1.0))[motion.free])


class _BodyForces:
    """Forces on one of the bodies."""

    def __init__(self, body: PairedBody, u: Array, contact: Pairs, load: Array) -> None:
        self.body, self.u, self.contact, self.load = body, u, contact, load
        self.reach = float(body.host.reach(u))
        self.left = body.internal(u) + contact - load  # reactions, and what is out of balance

    def equilibrium(self) -> tuple[float, float]:
        """Largest residual force, and the largest sum of moduli of the forces there."""
        size = self.body.host.equilibrium(self.u, self.contact.rounded, self.load)[1]
        return self.body.unbalanced(self.left), size

    def balance(self) -> float:
        """The sum of all forces relative to that of their moduli."""
        body, load = self.body, self.load
        reactions = body.at_supports(self.left)
        loads = body.total(Pairs.of(np.abs(load))).rounded
        given = loads + body.total(abs(self.contact)).rounded
        if not np.any(given):  # supports alone hold each other
            return 0.0
        size = _largest(given + body.total(abs(reactions)).rounded)
        left = _largest(body.total(reactions - self.contact + load).rounded) / size
        return beside_travel(left, loads, body.host, self.u)


def _beyond(x: Array, bound: float) -> float:
    return float((x - bound).max(initial=0.0))


def _largest(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))
