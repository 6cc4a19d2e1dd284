"""Outer iterations for Coulomb friction, and the regularised fixed point of (4.12)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from contact.condensation.boundary_problem import Array, BoundaryProblem, Forces, Friction, residual
from contact.errors import NotConverged
from contact.laws.active_set import signorini
from contact.laws.semismooth_newton import Iteration, Report

Tresca = Callable[[Array, Forces], Forces]


def tresca_loop(
    problem: BoundaryProblem,
    friction: Friction,
    start: Forces,
    solve: Tresca,
    *,
    tol: float,
    max_iterations: int,
    report: Report,
) -> Forces:
    """Coulomb friction as a fixed point of given friction, g <- F mu (Algorithm 1).

    Parameters
    ----------
    problem : BoundaryProblem
    friction : Friction
        Coulomb's law.
    start : Forces
    solve : callable (bound, start) -> Forces
        Solves the problem with given friction.
    tol : float
        On the residual of Coulomb's law.
    max_iterations : int
    report : callable
        Receives one `Iteration` an outer step.

    Raises
    ------
    NotConverged
        The map is no contraction (large friction), or the cap is too low.
    """
    now = start
    for step in range(1, max_iterations + 1):
        now = solve(friction.bound(now.mu), now)
        line = progress(problem, step, "outer", now, friction.bound(now.mu))
        report(line)
        if line.residual <= tol:
            return now
    raise NotConverged(
        f"tresca loop: residual {line.residual:.1e} after {step} outer steps, tolerance {tol:.1e}; "
        "use method='newton' or raise max_iterations"
    )


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

    Each step solves Signorini's problem with the friction replaced by the springs
    ``t = w u_t``, ``w = g / max(eps, |u_t|)`` of the last iterate. In the forces this is the same
    box QP with 1 / w added to the tangential diagonal: nothing is factored again.

    With a fixed bound the regularised energy
    :math:`J_\epsilon = \tfrac12 a(u,u) - f(u) + \sum g \psi_\epsilon(|u_t|)` falls in every step;
    it is reported. The iteration converges linearly and stops when the displacement of the contact
    points changes by less than `tol` relative to its size and the regularised law
    ``t = g u_t / max(eps, |u_t|)`` is met to `tol` relative to the largest force.

    Parameters
    ----------
    eps : ndarray, shape (m,)
        Slip below which friction is linear, in the problem's scale.
    friction : Friction
        Coulomb's law or a given bound.

    Raises
    ------
    NotConverged
        The cap is reached.
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
        law = float(np.abs(missed).max()) / problem.scale(now.mu, now.t)
        change = np.inf if before is None else _largest(moved - before) / _largest(moved)
        before = moved
        energy = np.nan
        if not friction.coulomb:
            psi = _psi(np.linalg.norm(u_t, axis=1), eps)
            # l^T W l / 2 - s^T a is the energy of body and contact forces alone.
            energy = problem.energy(now.mu, now.t, now.a) + float(g @ psi)
        line = progress(problem, step, "fixed point", now, g, law)
        report(replace(line, energy=energy, change=change))
        if max(change, law) <= tol:
            return now
    raise NotConverged(
        f"fixed point: relative change {change:.1e}, residual {law:.1e} after {step} steps, "
        f"tolerance {tol:.1e}; it converges linearly: raise max_iterations or eps, or use "
        "method='newton'"
    )


def _psi(slip: Array, eps: Array) -> Array:
    """C1 regularisation of the modulus: (4.11)."""
    return np.where(slip >= eps, slip, 0.5 * slip**2 / eps + 0.5 * eps)


def progress(
    problem: BoundaryProblem,
    step: int,
    phase: str,
    now: Forces,
    g: Array,
    size: float | None = None,
) -> Iteration:
    """Describe an outer step; the residual is that of the laws with bound g unless given."""
    rubs = (g > 0) & np.any(problem.tangent >= 0, axis=1)
    slip = rubs & (np.linalg.norm(now.t, axis=1) >= g * (1 - 1e-9))
    return Iteration(
        step,
        phase,
        int((now.mu > 0).sum()),
        int((rubs & ~slip).sum()),
        int(slip.sum()),
        residual(problem, now.mu, now.t, now.a, g) if size is None else size,
    )


def _largest(x: Array) -> float:
    return max(float(np.abs(x).max(initial=0.0)), np.finfo(float).tiny)
