"""Normal laws beyond Signorini's: compliance, adhesion, hardness and wear, and their tangents.

A point has the force mu and the penetration u_n - d. With the tension sigma(g) at the gap g = d -
u_n >= 0 and the hardness H,

* contact, mu > -sigma A: ``u_n - d = h(mu) + k |s| mu / A``, the compliance and the wear of a step;
* capped, mu = H A: ``u_n - d`` larger than that by the plastic indentation of the step;
* apart: ``mu = -sigma(d - u_n) A``.

What is worn and indented in a step adds to the gap of the next one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError
from contact.laws.adhesion import Adhesion, checked_adhesion
from contact.laws.pressure_overclosure import PressureOverclosure
from contact.laws.wear import Wear, coefficients
from contact.portable import carried
from skfem_adini.ground.arrays import namespace

Array = Any


class Tangent(NamedTuple):
    """The law at trial states, all of one shape."""

    mu: Array  # forces on the law
    touches: Array  # points in contact, capped ones included
    opening: Array  # in contact: u_n - d = opening + slope mu
    slope: Array
    given: Array  # capped or pulled points: mu = known + turn (u_n - d)
    turn: Array
    known: Array
    worn: Array  # physical depths k |s| p of both sides, (2, m)

    def rows(self) -> dict[str, Array]:
        """What `contact.laws.law.Zones` takes of it."""
        names = ("opening", "slope", "given", "turn", "known")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class SurfaceState:
    """Adhesion, hardness and wear of the contact points, and what earlier steps left, physical."""

    adhesion: Adhesion | None = None
    hardness: Array | None = None  # (m,), infinite where there is none
    wear: Any = None  # coefficients (2, m), or two functions of the pressure
    indented: Array = 0.0  # depth (m,)
    worn: Array = 0.0  # depths (2, m)
    ramps: Any = None  # of Dugdale's law, (m,)
    # Of finite sliding: volumes worn off before this step (2,), and what this step leaves of tools.
    volume: Any = None
    tools: Any = None  # see `contact.obstacles.tool.WornTools`
    frames: Any = None  # where the shapes of tools are, (sides, dim, dim + 1)

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"wear": carried(self.wear)}

    @staticmethod
    def of(adhesion: Any, hardness: Any, wear: Any, x: Array) -> SurfaceState | None:
        """The surface from the caller's arguments at places x, (dim, ...); None without any."""
        glue, H, k = checked_adhesion(adhesion), None, None
        if hardness is not None:
            H = coefficients("hardness", hardness, x)
            if not np.all(H > 0):
                raise InputError("hardness: expected positive pressures")
        if wear is not None:
            k = (wear if isinstance(wear, Wear) else Wear(wear)).at(x)
        if glue is None and H is None and k is None:
            return None
        m = x.shape[1:]
        return SurfaceState(glue, H, k, np.zeros(m), np.zeros((2, *m)))

    @property
    def lost(self) -> Array:
        """Depth that earlier steps added to the gap."""
        return self.indented + self.worn.sum(axis=0)

    def coefficients(self, p: Array) -> Array | None:
        """Coefficients of wear of both sides under the pressures p, (2, m)."""
        if self.wear is None or isinstance(self.wear, np.ndarray):
            return self.wear
        return np.stack([coefficients("wear", k, p, p.shape) for k in self.wear])

    def ramped(self, moved: Array) -> SurfaceState:
        """With ramps for points that move by `moved` under unit tractions on them alone."""
        return self if self.adhesion is None else replace(self, ramps=self.adhesion.ramps(moved))

    @property
    def remembers(self) -> bool:
        """Whether a step depends on what earlier ones took off."""
        return self.hardness is not None or self.wear is not None

    def after(self, indented: Array, worn: Array) -> SurfaceState:
        """The surface of the next step."""
        return replace(self, indented=indented, worn=worn)

    def stored(self, p: Array) -> dict[str, Array | None]:
        """Arrays of a file; functions of the pressure by their values."""
        return {
            "hardness": self.hardness, "wear": self.coefficients(p), "indented": self.indented,
            "worn": self.worn, "ramps": self.ramps, "volume": self.volume, "tools": self.tools,
            "frames": self.frames,
        }  # fmt: skip


@dataclass(frozen=True)
class SurfaceLaw:
    """The laws of the points between scaled forces and displacements."""

    area: Array  # force over pressure
    unit: Array  # physical normal displacement = scaled one * unit
    along: Array  # physical slip = scaled one * along
    surface: SurfaceState | None = None
    laws: tuple[PressureOverclosure | None, ...] = ()
    number: NDArray[np.int64] | None = None  # law of each point; -1 for hard contact
    bonded: Array = False  # they have no such law

    @property
    def softens(self) -> bool:
        """Whether tensions fall with the gap, so that several equilibria may exist."""
        return self.surface is not None and self.surface.adhesion is not None

    @property
    def _nonlinear(self) -> bool:
        return self.surface is not None and isinstance(self.surface.wear, tuple)

    @property
    def capped(self) -> bool:
        """Whether a hardness bounds the forces."""
        return self.surface is not None and self.surface.hardness is not None

    @property
    def pull(self) -> float:
        """Largest adhesive force of a point."""
        glue = None if self.surface is None else self.surface.adhesion
        return 0.0 if glue is None else float(np.max(self.area)) * glue.tension

    @property
    def start(self) -> Array:
        """Penetration h(0) at which the pressure begins, of each point."""
        far = np.full(np.shape(self.area), -np.inf)
        return self._compliance(far, 0.0 * self.area)[1]

    def at(self, mu: Array, through: Array, slip: Array) -> Tangent:
        """The law at forces mu, penetrations and lengths of slip."""
        xp = namespace(mu)
        pull, turn = self._pull(mu, through)
        q, force = mu + through, mu
        for _ in range(50):  # Newton's method for k(p) p, one step if k is constant
            depth, rise, worn = self._wear(force, slip)
            found, h, slope = self._compliance(q - depth, rise)
            missed, force = xp.abs(xp.maximum(force, 0.0) - found), found
            if not self._nonlinear or not bool((missed > 1e-15 * found).any()):
                break
        presses = found > 0
        if self.softens:
            found = xp.where(presses, found, q)
        touches = found > -pull
        slope = xp.where(presses, slope + rise, 0.0)
        pressed = xp.where(presses, found, 0.0)
        opening = xp.where(presses, h + (rise - slope) * pressed + depth, 0.0)
        given, known = ~touches & (pull > 0), -pull
        known = known - turn * xp.where(given, through, 0.0)
        found = xp.where(touches, found, -pull)
        if self.surface is not None and self.surface.hardness is not None:
            cap = self.area * xp.asarray(self.surface.hardness)
            capped = touches & (found > cap) & ~self._none(mu)
            found, given = xp.where(capped, cap, found), given | capped
            known, turn = xp.where(capped, cap, known), xp.where(capped, 0.0, turn)
        return Tangent(found, touches, opening, slope, given, turn, known, worn)

    def left(self, mu: Array, through: Array, slip: Array) -> tuple[Array, Array]:
        """Physical depths indented in this step (m,) and worn (2, m), at a solution."""
        now = self.at(mu, through, slip)
        beyond = through - (now.opening + now.slope * mu)
        indented = np.where(now.given & now.touches, np.maximum(beyond, 0.0), 0.0)
        return indented * self.unit, now.worn

    def _none(self, mu: Array) -> Array:
        return namespace(mu).zeros(mu.shape, dtype=bool) | self.bonded

    def _pull(self, mu: Array, through: Array) -> tuple[Array, Array]:
        """Adhesive forces, and their derivative by the gap: that of mu by the penetration."""
        law = None if self.surface is None else self.surface.adhesion
        if law is None:
            return 0.0 * mu, 0.0 * mu
        xp = namespace(mu)
        gap = xp.where(self._none(mu), np.inf, xp.maximum(-through, 0.0) * self.unit)
        ramps = self.surface and self.surface.ramps
        sigma, slope = law.pull(gap, mu < -0.5 * law.tension * self.area, ramps)
        return sigma * self.area, slope * self.area * self.unit

    def _wear(self, mu: Array, slip: Array) -> tuple[Array, Array, Array]:
        """The worn depth as ``depth + rise mu``, scaled, and for each side, physical."""
        zero = 0.0 * mu
        if self.surface is None or self.surface.wear is None:
            return zero, zero, zero
        xp, surface = namespace(mu), self.surface
        p, s = xp.maximum(mu, 0.0) / self.area, slip * self.along
        s = xp.where(self._none(mu), 0.0, s)
        k = xp.asarray(surface.coefficients(p))
        each = k * p * s
        rise = slope = k.sum(axis=0)
        if self._nonlinear:  # d(k p) / dp by central differences
            step = 1e-5 * p + 1e-12 * float(p.max())
            up, down = (
                surface.coefficients(q).sum(axis=0) * q  # type: ignore[union-attr]
                for q in (p + step, xp.maximum(p - step, 0.0))
            )
            change = p + step - xp.maximum(p - step, 0.0)
            slope = xp.where(change > 0, (up - down) / xp.where(change > 0, change, 1.0), rise)
        scaled = s / self.unit
        return (rise - slope) * p * scaled, slope * scaled / self.area, each

    def _compliance(self, q: Array, rise: Array) -> tuple[Array, Array, Array]:
        """mu with ``(1 + rise) mu + h(mu) = q``, h and h' there (zero where mu = 0)."""
        xp = namespace(q)
        mu, h, slope = xp.maximum(q, 0.0) / (1.0 + rise), xp.zeros_like(q), xp.zeros_like(q)
        for k, law in enumerate(self.laws):
            at = np.flatnonzero(self.number == k)
            if law is None or at.size == 0:
                continue
            a, b, more = self.area[at], 1.0 / self.unit[at], 1.0 + rise[at]
            c = law.resolved(q[at], a * more, b)
            p, dp = law.evaluated(c)
            mu[at], h[at] = a * p, b * c
            loaded = (p > 0) & (dp > 0)
            slope[at] = np.where(loaded, b / (a * np.where(loaded, dp, 1.0)), 0.0)
        return mu, h, slope
