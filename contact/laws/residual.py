"""Residual of the laws of contact and friction on the boundary problem."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from contact.condensation.boundary_problem import BoundaryProblem
from contact.laws.friction import project

Array = NDArray[np.float64]
_ROUNDING = 10.0  # in machine precisions: sums and solves of some hundred terms lose a digit


def residual(problem: BoundaryProblem, mu: Array, t: Array, a: Array, bound: Array) -> float:
    """Largest violation of the contact and the friction law, relative to the largest force.

    Parameters
    ----------
    problem : BoundaryProblem
    mu, t, a : ndarray, shapes (m,), (m, dim - 1) and (k,)
        Forces and rigid motion.
    bound : ndarray, shape (m,)
        Friction bound g, for Coulomb's law F mu.
    """
    u_n, u_t = problem.displacements(mu, t, a)
    through = problem.penetration(u_n)
    if problem.compliance is None:
        contact = mu - np.maximum(0.0, mu + through)
    else:
        contact = mu - problem.compliance.closest(mu + through)[0]
    if problem.bonded is not None:
        contact = np.where(problem.bonded & problem.can_touch, through, contact)
    live = problem.tangent >= 0
    friction = np.where(live, t - project(np.where(live, t + u_t, 0.0), problem.bound(bound)), 0.0)
    balance = problem.C.T @ problem.forces(mu, t) - problem.s
    if problem.K is not None:
        balance = balance + problem.K @ a
    worst = max(np.abs(part).max(initial=0.0) for part in (contact, friction, balance))
    return float(worst) / problem.residual_size(mu, t)


def rounding(problem: BoundaryProblem, forces: Array, a: Array, size: float) -> float:
    """Rounding error of `residual`: that of the terms that cancel in it, relative to the forces.

    Parameters
    ----------
    problem : BoundaryProblem
    forces : ndarray, shape (n,)
        Forces on the live rows.
    a : ndarray, shape (k,)
        Rigid motion.
    size : float
        Size of the forces, from `BoundaryProblem.residual_size`.
    """
    l, C = np.abs(forces), np.abs(problem.C)
    gap = np.where(np.isfinite(problem.gap), np.abs(problem.gap), 0.0)
    # W is positive definite with a diagonal of about one: no entry is larger.
    moved = np.abs(problem.v0) + l.sum() + C @ np.abs(a)
    balanced = C.T @ l + np.abs(problem.s)
    if problem.K is not None:
        balanced = balanced + np.abs(problem.K) @ np.abs(a)
    terms = (float(part.max(initial=0.0)) for part in (moved, balanced, gap))
    return _ROUNDING * float(np.finfo(float).eps) * max(terms) / size
