r"""The law of contact and friction at points, and its linearisation.

Points have forces (mu, t), penetrations u_n - d, tangential displacements v, and a parameter c, a
force per displacement. Where ``mu + c (u_n - d) > 0`` they are active with ``u_n = d``; elsewhere
mu = 0. On other surfaces (`contact.laws.surface_law`) active points have ``u_n - d = opening +
slope mu``, or a given force ``mu = known + turn (u_n - d)``, linearised at the last iterate. For
friction with bound g let q = t + c v, b = q / |q| and r = g / |q|:

* g = 0: t = 0;
* stick, |q| <= g: v = 0;
* slip, |q| > g: the linearised law, in one of two forms,

  - radial return, the exact Newton step of t = g q / |q|:
    ``t+ = g b + r (I - b b^T) (t+ + c v+)``;
  - damped, equation (4.16) of the dissertation, in its corrected form, with a = t / max(g, |t|):
    ``(1 - r) t+ = r (I - a b^T) c v+ + (1 - r) g a``.

The damped form converges from far away, radial return is fast near the solution. For Coulomb's law
g = F mu+ on active points is an unknown of the same linear system (monolithic).

References
----------
S. Hueeber, G. Stadler and B. Wohlmuth, A primal-dual active set algorithm for three-dimensional
contact problems with Coulomb friction, SIAM J. Sci. Comput. 30 (2008). The dissertation: S. A.
King, Multi-Moment Methods for PDEs and GPUs for Large-Scale Scientific Computations, North Carolina
State University, 2012.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from contact.laws.friction import Coulomb, Friction, lengths, project
from skfem_adini.ground.arrays import namespace

Array = Any  # NumPy or CuPy: (...) for points, (dim - 1, ...) for tangential vectors


# Share of the slope of a falling tension in each form of the linearised laws.
SOFTENING = {"radial": 1.0, "steep": 0.9, "half": 0.5, "damped": 0.0}


@dataclass(frozen=True)
class State:
    """Forces, in the problem's form and per point, and the displacements that they cause."""

    forces: Any
    mu: Array
    t: Array
    through: Array  # u_n - d, minus infinity where contact is impossible
    v: Array


@dataclass(frozen=True)
class Zones:
    """Sets of points, with the trial force q = t + c v and its bound g. Bonded points are active
    and stick, with infinite g.
    """

    active: Array
    stick: Array
    slip: Array
    q: Array
    g: Array
    c: Array
    opening: Array = 0.0  # of other surfaces: c (u_n - d) = opening + slope mu
    slope: Array = 0.0
    given: Array | None = None  # active points whose force is known + turn c (u_n - d) instead
    turn: Array = 0.0
    known: Array = 0.0

    def pulls(self, form: str, through: Array) -> tuple[Array, Array]:
        """turn and known in the form "radial", Newton's, or with a share of the slope, see
        `SOFTENING`."""
        share = SOFTENING[form]
        at = namespace(self.known).where(self.given, through, 0.0)
        return share * self.turn, self.known + (1.0 - share) * self.turn * at


@dataclass(frozen=True)
class ContactLaw:
    """The law of all points, with their masks and the parameters c."""

    friction: Friction
    scale: tuple[float, float] = (1.0, 1.0)  # c in normal and tangential direction
    live: Array | None = None  # tangential components that can move, (dim - 1, ...)
    bonded: Array | None = None  # points tied to the obstacle
    swept: Array | None = None  # points that slip as prescribed, for any forces
    surface: Any = None  # a `contact.laws.surface_law.SurfaceLaw`

    def bound(self, mu: Array) -> Array:
        """The friction bound under normal forces mu, infinite at bonded points."""
        g = self.friction.bound(mu)
        return g if self.bonded is None else np.where(self.bonded, np.inf, g)

    def _moving(self, v: Array) -> Array:
        return v if self.live is None else namespace(v).where(self.live, v, 0.0)

    def violation(self, state: State) -> float:
        """Largest violation of the contact and the friction law, a force."""
        mu, t, xp = state.mu, state.t, namespace(state.mu)
        trial = mu + self.scale[0] * state.through
        if self.surface is None:
            contact = mu - xp.maximum(trial, 0.0)
        else:
            contact = mu - self.surface.at(mu, trial - mu, lengths(state.v)).mu
        if self.bonded is not None:
            tied = self.bonded & np.isfinite(state.through)
            contact = np.where(tied, state.through, contact)
        q = self._moving(t + self.scale[1] * state.v)
        rub = self._moving(t - project(q, self.bound(mu)))
        return max(float(xp.abs(part).max()) if part.size else 0.0 for part in (contact, rub))

    def zones(self, state: State) -> Zones:
        """The sets of the primal-dual active set method."""
        t, v, xp = state.t, state.v, namespace(state.mu)
        through = self.scale[0] * state.through
        trial, tangent = state.mu + through, None
        active = trial > 0
        if self.surface is not None:
            tangent = self.surface.at(state.mu, through, lengths(v))
            trial, active = tangent.mu, tangent.touches | tangent.given
        if self.bonded is not None:
            active |= self.bonded & np.isfinite(state.through)
        g, c = self.bound(xp.where(active, trial, 0.0)), self.scale[1]
        q = self._moving(t + c * v)
        length = lengths(q)
        if self.swept is not None:  # they slip from the first step, with another c if needed
            moves = lengths(self._moving(v))
            stuck = self.swept & (length <= g) & (moves > 0)
            more = 4.0 * (g + lengths(t)) / xp.where(stuck, moves, 1.0)
            c = c + xp.where(stuck, more, 0.0)
            q = self._moving(t + c * v)
            length = lengths(q)
        rubs = g > 0 if self.live is None else (g > 0) & self.live.any(axis=0)
        zones = Zones(active, rubs & (length <= g), rubs & (length > g), q, g, c)
        return zones if tangent is None else replace(zones, **tangent.rows())

    def slip(self, zones: Zones, t: Array, form: str, at: Any = slice(None)) -> SlipLaw:
        """The linearised law in the form "radial" or "damped", of the points `at`."""
        xp, slip, q = namespace(zones.q), zones.slip[at], zones.q[..., at]
        g = xp.where(slip, zones.g[at], 0.0)
        length = xp.where(slip, lengths(q), 1.0)
        b, ratio = q / length, g / length
        a, weight = b, xp.ones_like(ratio)
        if form != "radial":
            a = t[..., at] / xp.where(slip, xp.maximum(g, lengths(t[..., at])), 1.0)
            weight = 1.0 - ratio
        if isinstance(self.friction, Coulomb):
            coefficient, bound = self.friction.coefficient[at], xp.zeros_like(ratio)
        else:
            coefficient, bound = xp.zeros_like(ratio), g
        c = zones.c[at] if isinstance(zones.c, type(zones.g)) else zones.c
        return SlipLaw(a, b, ratio, weight, c, coefficient, bound, form == "radial")


@dataclass(frozen=True)
class SlipLaw:
    """``own t - ratio (I - a b^T) c v = weight a (coefficient mu + bound)`` at slipping points:
    radial ``own = I - ratio (I - b b^T)``, weight = 1, a = b; damped own = weight = 1 - ratio.
    """

    a: Array
    b: Array
    ratio: Array
    weight: Array
    c: Array
    coefficient: Array
    bound: Array
    radial: bool

    def turned(self, v: Array) -> Array:
        """``(I - a b^T) v``."""
        return v - self.a * (self.b * v).sum(axis=0)

    def left(self, t: Array, cv: Array) -> Array:
        """``own t - ratio (I - a b^T) c v`` of forces t and of c v."""
        if self.radial:
            return t - self.ratio * self.turned(t + cv)
        return self.weight * t - self.ratio * self.turned(cv)

    def blocks(self) -> tuple[Array, Array]:
        """The matrices of t and of v, shape (points, dim - 1, dim - 1)."""
        identity = np.eye(len(self.b))[:, :, None]
        turned = self.ratio * (identity - self.a[:, None] * self.b)
        own = identity - turned if self.radial else self.weight * identity
        return np.moveaxis(own, 2, 0), np.moveaxis(self.c * turned, 2, 0)
