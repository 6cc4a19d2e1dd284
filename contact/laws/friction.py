"""Friction laws, as bounds on the tangential force of each contact point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
UNMOVED = 1e-12  # prescribed slip over the largest displacement: what is less is rounding


@dataclass(frozen=True)
class Coulomb:
    """Friction bounded by the pressure, ``g = F mu``.

    Attributes
    ----------
    coefficient : ndarray, shape (m,)
        The coefficient F.
    """

    coefficient: Array

    def bound(self, mu: Array) -> Array:
        """Bound g of every point for the normal forces mu, shape (m,)."""
        return self.coefficient * np.maximum(mu, 0.0)

    def rubs(self, can_touch: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Points where there may be friction, shape (m,)."""
        return (self.coefficient > 0) & can_touch

    def times(self, factor: float) -> Coulomb:
        """The same law with the friction multiplied by a factor."""
        return Coulomb(factor * self.coefficient)


@dataclass(frozen=True)
class Tresca:
    """Given friction: a known bound g, which holds also where there is no contact.

    Attributes
    ----------
    given : ndarray, shape (m,)
        g, a force.
    """

    given: Array

    def bound(self, mu: Array) -> Array:
        """Bound g of every point, whatever the normal forces, shape (m,)."""
        return self.given

    def rubs(self, can_touch: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Points where there may be friction, shape (m,)."""
        return self.given > 0

    def times(self, factor: float) -> Tresca:
        """The same law with the friction multiplied by a factor."""
        return Tresca(factor * self.given)


Friction = Coulomb | Tresca


def against(slip: Array, g: Array) -> Array:
    """Forces of size g, shape (m,), along slips that are known, (m, dim - 1); zero where none is.

    They are those on the obstacle, as t is: the shear on the body opposes its slip.
    """
    length = np.linalg.norm(slip, axis=1)
    return slip * np.where(length > 0, g / np.where(length > 0, length, 1.0), 0.0)[:, None]


def project(q: Array, g: Array) -> Array:
    """Project each row of q, shape (m, dim - 1), onto the ball of radius g, shape (m,)."""
    length = np.linalg.norm(q, axis=1)
    factor = np.where(length > g, g / np.where(length > 0, length, 1.0), 1.0)
    return q * factor[:, None]
