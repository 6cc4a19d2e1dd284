"""The linearised friction law of slipping points, for any form of the linear system."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contact.condensation.boundary_problem import Array, Forces
from contact.laws.friction import Coulomb, Friction
from contact.laws.zones import Zones


@dataclass(frozen=True)
class SlipLaw:
    """``own t - of_v v = bound * direction``; the bound is g or, for Coulomb's law, F mu.

    Attributes
    ----------
    points : ndarray of int, shape (p,)
        The slipping points.
    own, of_v : ndarray, shape (p, dim - 1, dim - 1)
    direction : ndarray, shape (p, dim - 1)
    bound : ndarray, shape (p,)
        g where it is known, else zero.
    coefficient : ndarray, shape (p,)
        F of Coulomb's law, else zero.
    ratio : ndarray, shape (p,)
        g / |q|, which is one where slip begins.
    """

    points: NDArray[np.int64]
    own: Array
    of_v: Array
    direction: Array
    bound: Array
    coefficient: Array
    ratio: Array

    @classmethod
    def of(cls, now: Forces, zones: Zones, friction: Friction, form: str) -> SlipLaw:
        """The law at forces, see `contact.laws.semismooth_newton`.

        Parameters
        ----------
        now : Forces
        zones : Zones
        friction : Friction
        form : {"radial", "damped"}
        """
        points = np.flatnonzero(zones.slip)
        q, g = zones.q[points], zones.g[points]
        length = np.linalg.norm(q, axis=1)
        b, identity = q / length[:, None], np.eye(q.shape[1])
        if form == "radial":
            P = (g / length)[:, None, None] * (identity - b[:, :, None] * b[:, None, :])
            own, of_v, direction = identity - P, P, b
        else:
            a = now.t[points] / np.maximum(g, np.linalg.norm(now.t[points], axis=1))[:, None]
            own = np.broadcast_to(identity, (points.size, *identity.shape))
            of_v = (g / (length - g))[:, None, None] * (identity - a[:, :, None] * b[:, None, :])
            direction = a
        of_v = zones.c[points, None, None] * of_v
        zero = np.zeros(points.size)
        if isinstance(friction, Coulomb):
            bound, coefficient = zero, friction.coefficient[points]
        else:
            bound, coefficient = g, zero
        return cls(points, own, of_v, direction, bound, coefficient, g / length)
