"""Friction laws, as bounds on the tangential force of each contact point.

The first axis of vectors is the component, (dim - 1, ...); arrays are of NumPy or CuPy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from skfem_adini.ground.arrays import namespace

Array = Any
UNMOVED = 1e-12  # rounding of a prescribed slip, over the largest displacement


@dataclass(frozen=True)
class Coulomb:
    """Friction bounded by the pressure, ``g = F mu``, with the coefficient F of each point."""

    coefficient: Array

    def bound(self, mu: Array) -> Array:
        """Bound g of every point for the normal forces mu."""
        return self.coefficient * namespace(mu).maximum(mu, 0.0)

    def rubs(self, can_touch: Array) -> Array:
        """Points where there may be friction."""
        return (self.coefficient > 0) & can_touch

    def times(self, factor: float) -> Coulomb:
        """The same law with the friction multiplied by a factor."""
        return Coulomb(factor * self.coefficient)


@dataclass(frozen=True)
class Tresca:
    """Given friction: a known bound g (a force), also where there is no contact."""

    given: Array

    def bound(self, mu: Array) -> Array:
        """Bound g of every point, independent of the normal forces."""
        return self.given

    def rubs(self, can_touch: Array) -> Array:
        """Points where there may be friction."""
        return self.given > 0

    def times(self, factor: float) -> Tresca:
        """The same law with the friction multiplied by a factor."""
        return Tresca(factor * self.given)


Friction = Coulomb | Tresca


def lengths(v: Array) -> Array:
    """Euclidean length of each vector."""
    return namespace(v).sqrt((v * v).sum(axis=0))


def against(slip: Array, g: Array) -> Array:
    """Friction forces of size g on the obstacle along known slips; zero for no slip."""
    xp, size = namespace(slip), lengths(slip)
    return slip * xp.where(size > 0, g / xp.where(size > 0, size, 1.0), 0.0)


def project(q: Array, g: Array) -> Array:
    """Project vectors q onto the balls of radius g."""
    xp, size = namespace(q), lengths(q)
    return q * xp.where(size > g, g / xp.where(size > 0, size, 1.0), 1.0)
