"""Adhesion: a tension between surfaces that falls with the gap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from contact.errors import InputError
from skfem_adini.ground.arguments import choice, finite_number, positive_number
from skfem_adini.ground.arrays import namespace

Array = Any
JUMP = 1e-9  # relative width of the jump at the range, within which either value is right
LEAST_RAMP, MOST_RAMP = 0.1, 0.9
COARSE = 1.5  # needed ramp beyond which forces are those of a lattice
# Ramp over sigma_0 W / h_0, with the displacement W of a point under unit traction on it alone:
# below 1/2 points part one by one.
SPAN = 2.0
NEGLIGIBLE = 37.0  # of gaps over the range: exp(-37) is the rounding of one


@dataclass(frozen=True)
class Adhesion:
    r"""A tension sigma(g) between surfaces at the gap g, in addition to Signorini's conditions.

    The normal traction is :math:`p = \lambda - \sigma(g)` with :math:`\lambda \ge 0`, :math:`g \ge
    0`, :math:`\lambda g = 0`, and the work of adhesion :math:`w = \int_0^\infty \sigma`. With the
    range :math:`h_0 = w / \sigma_0`,

    * ``"dugdale"``: :math:`\sigma = \sigma_0` for :math:`g \le h_0`, zero beyond (Dugdale-Maugis);
      over the width :math:`2 r h_0` about :math:`h_0` it falls linearly, with the ramp r;
    * ``"exponential"``: :math:`\sigma = \sigma_0 \exp(-g / h_0)`.

    The tension falls with the gap, so that several equilibria may exist: a solution is the one near
    the step before, or near contact without adhesion where there is none. Friction is that of the
    compressive part of p only. A mesh or grid must resolve the cohesive zone, whose length is about
    :math:`\pi E^* w / 4 \sigma_0^2` at the edge of a contact.

    Parameters
    ----------
    tension : float
        sigma_0 > 0, in the unit of E.
    work : float
        w > 0, per area: unit of E times length.
    law : {"dugdale", "exponential"}
    ramp : float, optional
        r of Dugdale's law, less than one. Where it is too short for a mesh, points let go one by
        one, and forces jump with each. By default each point has a ramp that spans the gaps
        between it and its neighbours, at least .1; meshes too coarse for any are warned of.

    Raises
    ------
    InputError
        Not positive numbers, or an unknown law.

    References
    ----------
    D. Maugis, Adhesion of spheres: the JKR-DMT transition using a Dugdale model, J. Colloid
    Interface Sci. 150 (1992), 243-269.

    Examples
    --------
    A plane held by adhesion under a tension of half of sigma_0, without a gap:

    >>> from skfem import MeshQuad
    >>> from contact import Adhesion, ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> body = body.fix("left", "x").load("top", (0.0, 0.01))
    >>> glue = Adhesion(tension=0.02, work=1e-4)
    >>> result = ContactProblem(body, "bottom", 0.0, adhesion=glue).solve()
    >>> bool(abs(result.pressure + 0.01).max() < 1e-10), glue.range
    (True, 0.005)
    """

    tension: float
    work: float
    law: str = "dugdale"
    ramp: float | None = None

    def __post_init__(self) -> None:
        for name in ("tension", "work"):
            object.__setattr__(self, name, positive_number(name, getattr(self, name)))
        choice("law", self.law, ("dugdale", "exponential"))
        if self.ramp is None:
            return
        object.__setattr__(self, "ramp", finite_number("ramp", self.ramp))
        if not 0 <= self.ramp < 1:
            raise InputError(f"ramp={self.ramp!r}: expected a number from 0, less than 1, or None")

    @property
    def range(self) -> float:
        """The length h_0 = work / tension."""
        return self.work / self.tension

    def ramps(self, moved: Array) -> Array | None:
        """Ramps with which points part together that move by `moved` under unit tractions; they may
        exceed `MOST_RAMP`, the largest of the law. None if given, or not Dugdale's."""
        if self.ramp is not None or self.law != "dugdale":
            return None
        return np.asarray(np.maximum(SPAN * self.tension / self.range * moved, LEAST_RAMP))

    def pull(self, gap: Array, held: Array, ramps: Array | None = None) -> tuple[Array, Array]:
        """Tension at gaps >= 0 and its derivative; `held`: points under tension now, of which those
        at the jump of Dugdale's law stay so. `ramps` replace a ramp that is not given."""
        xp, h = namespace(gap), self.range
        r: Any = LEAST_RAMP if self.ramp is None else self.ramp
        if self.ramp is None and ramps is not None:
            r = xp.minimum(ramps, MOST_RAMP)
        if self.law == "dugdale" and self.ramp == 0.0:
            reach = h * xp.where(held, 1.0 + JUMP, 1.0 - JUMP)
            return xp.where(gap <= reach, self.tension, 0.0), xp.zeros_like(gap)
        if self.law == "dugdale":
            share = (1.0 + r - xp.minimum(gap / h, 2.0)) / (2.0 * r)
            slope = xp.where((share > 0) & (share < 1), -self.tension / (2 * r * h), 0.0)
            return self.tension * xp.clip(share, 0.0, 1.0), slope
        x = xp.minimum(gap / h, NEGLIGIBLE)
        sigma = xp.where(x < NEGLIGIBLE, self.tension * xp.exp(-x), 0.0)
        return sigma, -sigma / h


def checked_adhesion(value: Any) -> Adhesion | None:
    """The law, or an `InputError` that says what it is made of."""
    if value is not None and not isinstance(value, Adhesion):
        raise InputError(f"adhesion={value!r}: expected Adhesion(tension, work), or None")
    return value
