"""The regularised fixed point for friction: equation (4.12) and Algorithm 3 of the dissertation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.errors import NotConverged
from contact.laws.active_set import signorini
from contact.laws.friction import Friction, Tresca
from contact.laws.iteration import Report, outer_step

Array = NDArray[np.float64]


def fixed_point(
    problem: BoundaryProblem,
    start: Forces,
    *,
    eps: Array,
    friction: Friction,
    tol: float,
    max_iterations: int,
    report: Report,
) -> Forces:
    r"""Lagged secant stiffness for the regularised friction law: (4.12), Algorithm 3.

    Each step solves Signorini's problem with friction replaced by the springs ``t = w u_t``, where
    ``w = g / max(eps, |u_t|)`` is taken from the last iterate. For the forces this is the same box
    QP with 1 / w added to the tangential diagonal: the body is not factored again.

    With a fixed bound the regularised energy
    :math:`J_\epsilon = \tfrac12 a(u,u) - f(u) + \sum g \psi_\epsilon(|u_t|)` decreases in every
    step and is reported. The iteration converges linearly. It stops when the displacement of the
    contact points changes by at most `tol` relative to its size and the regularised law
    ``t = g u_t / max(eps, |u_t|)`` holds up to `tol` relative to the largest force.

    Parameters
    ----------
    problem : BoundaryProblem
    start : Forces
    eps : ndarray, shape (m,)
        Slip below which friction is linear, in the problem's scale.
    friction : Friction
        Coulomb's law or a given bound.
    tol : float
    max_iterations : int
    report : callable
        Receives one `Iteration` per step.

    Raises
    ------
    NotConverged
        The limit of iterations is reached.
    """
    now = start
    before: Array | None = None
    for step in range(1, max_iterations + 1):
        g = friction.bound(now.mu)
        _, u_t = problem.displacements(now.mu, now.t, now.a)
        slip = np.maximum(eps, np.linalg.norm(u_t, axis=1))
        with np.errstate(divide="ignore"):
            softness = np.where(g > 0, slip / g, np.inf)
        now = signorini(problem, bound=g, softness=softness, start=now, tol=1e-12)
        u_n, u_t = problem.displacements(now.mu, now.t, now.a)
        moved = np.concatenate((u_n, u_t.ravel()))
        slip = np.maximum(eps, np.linalg.norm(u_t, axis=1))
        g = friction.bound(now.mu)
        missed = np.where(problem.tangent >= 0, now.t - (g / slip)[:, None] * u_t, 0.0)
        violation = float(np.abs(missed).max()) / problem.residual_size(now.mu, now.t)
        change = np.inf if before is None else _largest(moved - before) / _largest(moved)
        before = moved
        energy = np.nan
        if isinstance(friction, Tresca):
            psi = _psi(np.linalg.norm(u_t, axis=1), eps)
            # l^T W l / 2 - s^T a is the energy of body and contact forces alone.
            energy = problem.energy(now.mu, now.t, now.a) + float(g @ psi)
        line = outer_step(problem, step, "fixed point", now, g, violation)
        report(replace(line, energy=energy, change=change))
        if max(change, violation) <= tol:
            return now
    raise NotConverged(
        f"fixed point: relative change {change:.1e}, residual {violation:.1e} after {step} steps, "
        f"tolerance {tol:.1e}; it converges linearly: raise max_iterations or eps, or use "
        "method='newton'"
    )


def _psi(slip: Array, eps: Array) -> Array:
    """C1 regularisation of the modulus, equation (4.11) of the dissertation."""
    return np.where(slip >= eps, slip, 0.5 * slip**2 / eps + 0.5 * eps)


def _largest(x: Array) -> float:
    return max(float(np.abs(x).max(initial=0.0)), np.finfo(float).tiny)
