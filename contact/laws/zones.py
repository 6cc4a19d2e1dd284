"""Zones of contact, stick and slip at an iterate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.laws.friction import Friction

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Zones:
    """The sets of contact points of the primal-dual active set method at an iterate.

    Attributes
    ----------
    active, stick, slip : ndarray of bool, shape (m,)
        Points in contact, points that stick, and points whose friction is at its bound.
    q : ndarray, shape (m, dim - 1)
        ``t + c u_t``, which the friction law projects onto the ball of radius g.
    g : ndarray, shape (m,)
        Friction bound; bonded points are active, and stick under an infinite one.
    opening, slope : ndarray, shape (m,)
        The linearised law of compliant surfaces, ``u_n - d = opening + slope mu``; both zero for
        hard contact.
    c : ndarray, shape (m,)
        One; larger where supports prescribe that a point slips, so that it does from the start.
    """

    active: NDArray[np.bool_]
    stick: NDArray[np.bool_]
    slip: NDArray[np.bool_]
    q: Array
    g: Array
    opening: Array
    slope: Array
    c: Array

    @classmethod
    def of(cls, problem: BoundaryProblem, now: Forces, friction: Friction) -> Zones:
        """Zones from forces and the displacements that they cause."""
        u_n, u_t = problem.displacements(now.mu, now.t, now.a)
        contact = now.mu + problem.penetration(u_n)
        opening = slope = np.zeros(contact.size)
        if problem.compliance is not None:
            contact, h, slope = problem.compliance.closest(contact)
            opening = h - slope * contact
        active = (contact > 0) | (problem.ties & problem.can_touch)
        g = problem.bound(friction.bound(np.where(active, contact, 0.0)))
        c, live = np.ones(g.size), problem.tangent >= 0
        q = np.where(live, now.t + u_t, 0.0)
        length = np.linalg.norm(q, axis=1)
        if problem.swept is not None:
            moves = np.linalg.norm(np.where(live, u_t, 0.0), axis=1)
            stuck = problem.swept & (length <= g) & (moves > 0)
            size = 4.0 * (g + np.linalg.norm(now.t, axis=1))
            c[stuck] += (size / np.where(stuck, moves, 1.0))[stuck]
            q = np.where(live, now.t + c[:, None] * u_t, 0.0)
            length = np.linalg.norm(q, axis=1)
        rubs = (g > 0) & np.any(live, axis=1)
        return cls(active, rubs & (length <= g), rubs & (length > g), q, g, opening, slope, c)
