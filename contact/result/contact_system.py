"""The discrete contact problem and its state, which a solver finds and a certificate checks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError
from contact.laws.friction import UNMOVED, Coulomb, Friction, Tresca, against, project
from contact.laws.iteration import Iteration
from contact.laws.newton import LIMITS
from contact.laws.pressure_overclosure import PressureOverclosure
from contact.laws.surface_law import SurfaceLaw, SurfaceState
from contact.obstacles.rigid import ObstacleMotion
from contact.portable import carried
from contact.rows.contact_rows import ContactRows

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class ContactSystem:
    """Equilibrium ``S u + G^T mu + T^T t = f`` and the laws at the contact points."""

    body: Any  # a Solid
    rows: ContactRows  # its `gap` is the current one
    load: Array  # (ndofs,)
    law: str | None  # "coulomb", "tresca"
    friction: Array  # (m,), the coefficient F, or Tresca's bound as a force: traction times weight
    # Tangential displacement (m, dim - 1) at the last converged step of a history, from which
    # friction counts the slip. None: zero.
    slip_from: Array | None = None
    motion: ObstacleMotion | None = None  # displacements of contact points are relative to it
    overclosure: tuple[PressureOverclosure | None, ...] = ()  # by boundary; empty: hard contact
    obstacle: Any = None  # source of the gap; the next step derives its motion from it
    moduli: Array | None = None  # sum of the moduli of the load's terms, if they cancel, as inertia
    surface: SurfaceState | None = None  # `rows.gap` includes what it has lost

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"obstacle": carried(self.obstacle)}

    def relative(self, u: Array, w: Array | None) -> tuple[Array, Array]:
        """Normal (m,) and tangential (m, dim - 1) displacement relative to obstacles with motion
        w."""
        u_n = self.body.at_points(self.rows.G, u)
        u_t = self.body.at_points(self.rows.T, u).reshape(u_n.size, -1)
        if self.motion is None:
            return u_n, u_t
        w = np.zeros(self.motion.prescribed.size) if w is None else w
        w_n, w_t = self.motion.displacement(w)
        return u_n - w_n, u_t - w_t

    def slip_increment(self, u_t: Array) -> Array:
        """Slip since the last step, which enters the friction law, (m, dim - 1)."""
        return u_t if self.slip_from is None else u_t - self.slip_from

    @property
    def held(self) -> NDArray[np.bool_]:
        """Points (m,) whose whole slip is prescribed, except by symmetry on the axis of a ring."""
        rows = self.rows
        free = self.body.unconstrained(rows.T).reshape(rows.gap.size, -1).any(axis=1)
        if self.body.is_ring:
            rounding = 1e-9  # of radii over the extent, and of radial parts of normals
            on_axis = np.abs(rows.x_nominal[0]) <= rounding * self.body.extent
            free = free | (on_axis & (np.abs(rows.normals[0]) <= rounding))
        if self.motion is not None and np.any(self.motion.free):
            free = free | self.motion.drags.any(axis=1)
        return np.asarray(~free & ~rows.ties)

    def with_held_points(self, u: Array, mu: Array, t: Array, w: Array | None) -> Array:
        """t, (m, dim - 1), with friction g along the slip where the whole slip is prescribed.
        Zero for zero prescribed slip, where friction cannot be distinguished from reactions."""
        held = self.held if np.any(self.friction > 0) else np.zeros(mu.size, dtype=bool)
        if not held.any():
            return t
        u_t = self.relative(u, w)[1]
        slip = self.slip_increment(u_t)
        parts = [u_t] if self.slip_from is None else [u_t, self.slip_from]
        if self.motion is not None and w is not None:
            parts.append(self.motion.displacement(w)[1])
        size = max(self.body.largest_displacement(self.body.placed(u)), *map(_largest, parts))
        moves = np.linalg.norm(slip, axis=1) > UNMOVED * size
        known = against(np.where(moves[:, None], slip, 0.0).T, self.bound(mu)).T
        return np.where(held[:, None], known, t)

    def bound(self, mu: Array) -> Array:
        """Friction bound g of every point for the normal forces mu, shape (m,)."""
        of_law = Coulomb if self.law == "coulomb" else Tresca
        return of_law(self.friction).bound(mu)

    def scaled_friction(self, scale: Array) -> Friction | None:
        """The friction law, forces multiplied by the scale of each point; None if frictionless."""
        if self.law is None:
            return None
        return Coulomb(self.friction) if self.law == "coulomb" else Tresca(self.friction * scale)

    @property
    def lawful(self) -> bool:
        """Whether the normal law is another than Signorini's."""
        return bool(self.overclosure) or self.surface is not None

    @property
    def given_gap(self) -> Array:
        """Gap of the obstacle, without what earlier steps took off the surfaces."""
        return self.rows.gap if self.surface is None else self.rows.gap - self.surface.lost

    def compliance(self, scale: Array) -> SurfaceLaw | None:
        """The laws of the surfaces, if any: forces times scale, displacements over it."""
        return self._laws(self.rows.weights * scale, scale, scale) if self.lawful else None

    def _laws(self, area: Array, unit: Array, along: Any) -> SurfaceLaw:
        rows = self.rows
        number = np.where(rows.ties, -1, rows.boundary)
        return SurfaceLaw(area, unit, along, self.surface, self.overclosure, number, rows.ties)

    def left(self, u: Array, mu: Array, w: Array | None) -> tuple[Array, Array]:
        """Depths indented (m,) and worn (2, m) in this step."""
        u_n, u_t = self.relative(u, w)
        unit = np.ones(mu.size)
        gap = np.where(np.isfinite(self.rows.gap), self.rows.gap, 0.0)
        through = np.where(np.isfinite(self.rows.gap), u_n - gap, -np.inf)
        slip = np.linalg.norm(self.slip_increment(u_t), axis=1)
        return self._laws(self.rows.weights, unit, 1.0).left(mu, through, slip)

    def kkt(self, u: Array, mu: Array, t: Array, w: Array | None = None) -> dict[str, float]:
        """Relative residuals of every law; `ContactResult.kkt` defines their scales."""
        rows, (here, load) = self.rows, map(self.body.placed, (u, self.load))
        contact = self.body.placed(self.body.contact_forces(rows, mu, t))
        more = () if self.moduli is None else (self.moduli,)
        unbalanced, cancelling = self.body.equilibrium(here, contact, load, *more)
        # If forces cancel without motion, displacements are rounding of their individual effects.
        length = (
            max(self.body.largest_displacement(here), self.body.local_displacement(contact)) or 1.0
        )
        # Forces below the rounding of internal forces have no digits, as in a body moved by its
        # supports until it just touches.
        noise = LIMITS.noise * cancelling
        size = max(_largest(mu), _largest(t), noise) or 1.0
        ties = rows.ties
        free = ~ties
        reachable = np.isfinite(rows.gap) & free
        u_n, u_t = self.relative(u, w)
        through = np.where(reachable, u_n - np.where(reachable, rows.gap, 0.0), -np.inf)
        u_t = self.slip_increment(u_t)
        g = self.bound(mu)
        returned = t - project((t + size / length * u_t).T, g).T
        result = {
            "equilibrium": unbalanced / (cancelling or 1.0),
            "balance": self._unbalanced(here, contact, load),
            "support": self.body.support_error(here) / length,
            "penetration": _largest(np.maximum(through, 0.0)) / length,
            "sign": _beyond(-mu[free], noise) / size,
            "complementarity": _largest(
                np.minimum(np.maximum(np.abs(mu) - noise, 0.0) / size, np.abs(through) / length)[
                    free
                ]
            ),
            "cone": _beyond((np.linalg.norm(t, axis=1) - g)[free], noise) / size,
            "slip": _beyond(np.abs(returned[free]), noise) / size,
        }
        if self.lawful:
            moved = np.linalg.norm(u_t, axis=1)
            result |= self.off_the_curve(mu, through, moved, size, length)
            if self.surface is not None and self.surface.adhesion is not None:
                del result["sign"]
        if ties.any():
            opened = max(_largest((u_n - rows.gap)[ties]), _largest(u_t[ties]))
            result["tie"] = opened / length
        if self.motion is not None and np.any(self.motion.free):
            result["obstacle"] = self._unbalanced_obstacle(self.motion, mu, t)
        if any(np.isnan(value) for value in result.values()):
            raise InputError("kkt: the state (u, mu, t) holds NaN")
        return result

    def off_the_curve(
        self, mu: Array, closed: Array, slip: Array, size: float, length: float
    ) -> dict[str, float]:
        """Deficit and excess of mu relative to the force on the curve of a surface.
        The point on the curve has the same ``mu + size / length (u_n - d)``; `closed` is ``u_n -
        d``, `slip` the length of the slip increment."""
        laws = self._laws(self.rows.weights, np.full(mu.size, length / size), 1.0)
        free = ~self.rows.ties
        off = (laws.at(mu, size / length * closed, slip).mu - mu)[free]
        return {
            "penetration": _largest(np.maximum(off, 0.0)) / size,
            "complementarity": _largest(np.maximum(-off, 0.0)) / size,
        }

    def balance(self, u: Any, mu: Array, t: Array) -> float:
        """The residual ``balance`` of `kkt`, for a displacement on host or device."""
        here, load = map(self.body.placed, (u, self.load))
        contact = self.body.placed(self.body.contact_forces(self.rows, mu, t))
        return self._unbalanced(here, contact, load)

    def _unbalanced(self, u: Any, contact: Any, load: Any) -> float:
        """Residual of the resultant of all forces on a body, the maximum over all bodies."""
        # Needed since equilibrium in slender cells is relative to large forces that cancel.
        pairs = zip(self.body.bodies, self.body.slices, strict=True)
        terms = abs(load) if self.moduli is None else self.moduli
        return max(
            _unbalanced_body(body, u[own], contact[own], load[own], terms[own])
            for body, own in pairs
        )

    def _unbalanced_obstacle(self, motion: ObstacleMotion, mu: Array, t: Array) -> float:
        """Residual forces on free motions, relative to all contact forces times their arms."""
        free = motion.free
        arms = np.maximum(
            np.abs(motion.normal).max(axis=0, initial=0.0),
            np.abs(motion.tangent).max(axis=0, initial=0.0),
        )
        size = arms * (np.abs(mu).sum() + np.abs(t).sum()) + np.abs(np.nan_to_num(motion.force))
        return _largest(motion.unbalanced(mu, t) / np.where(size > 0, size, 1.0)[free])

    def energy(self, u: Array) -> float:
        """Potential energy ``u^T S u / 2 - f^T u``, without friction."""
        return 0.5 * self.body.dot(u, self.body.stiffness @ u) - self.body.dot(self.load, u)


@dataclass(frozen=True, eq=False, repr=False)
class ContactState:
    """The primary data of a `ContactResult`, which a file stores and a certificate checks."""

    system: ContactSystem
    u: Array
    mu: Array
    t: Array
    method: str
    history: tuple[Iteration, ...]
    motion: Array | None = None
    tol: float | None = None
    slack: float = 0.0
    jump: str = ""


def _unbalanced_body(body: Any, u: Any, contact: Any, load: Any, terms: Any) -> float:
    u, contact, load, terms = map(body.placed, (u, contact, load, terms))
    loads = body.total(terms)
    given = loads + body.total(abs(contact))
    if not np.any(given):  # only support reactions, which balance each other
        return 0.0
    reactions = body.at_supports(body.internal(u) + contact - load)
    size = _largest(given + body.total(abs(reactions)))
    left = _largest(body.total(load + reactions - contact)) / size
    return beside_travel(left, loads, body, u)


def beside_travel(left: float, loads: Array, body: Any, u: Any) -> float:
    """A balance residual, reduced by the rounding of the prescribed motion if there are no loads: a
    body moved by its supports until it just touches has forces of this size only."""
    if left > 1e-12 and not np.any(loads):  # above the rounding of sums
        left /= max(1.0, 1e-3 * body.largest_displacement(u) / (body.deformation(u) or 1e-300))
    return left


def _beyond(x: Array, bound: float) -> float:
    return float((x - bound).max(initial=0.0))


def _largest(x: Any) -> float:
    return float(np.abs(x).max(initial=0.0))
