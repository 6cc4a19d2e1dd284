"""Proximal point iteration, which converges where Newton's method alone stalls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import LinAlgError

from contact.arrays.dense_arrays import arrays_of
from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.errors import NotConverged
from contact.laws.friction import Friction
from contact.laws.iteration import Report
from contact.laws.progress import ROUND_OFF
from contact.laws.residual import residual
from contact.laws.semismooth_newton import semismooth_newton

SOFTEST, STIFFEST = 1e3, 1e-9  # limits of the compliance delta; that of each row is one
ATTEMPTS = 100  # Newton solves at most; twenty reduce delta from the upper limit to the lower one


def proximal_point(
    problem: BoundaryProblem,
    friction: Friction,
    start: Forces,
    *,
    tol: float,
    report: Report = lambda iteration: None,
) -> Forces:
    r"""Solve a sequence of problems with a spring of compliance delta in each contact row.

    .. math::
        W_k = W + \delta_k I, \qquad v_{0,k} = v_0 + \delta_k l_k

    has the solution l of the problem as its fixed point, and every step is a well-conditioned
    problem for Newton's method. The compliance delta is divided by 4 after each success and
    multiplied by 4 after a failure. With given friction the laws are the gradient of a convex
    energy, and the iteration converges for any delta, also if rows are linearly dependent; with
    Coulomb's law it is a heuristic.

    Parameters
    ----------
    problem : BoundaryProblem
    friction : Friction
    start : Forces
    tol : float
        On the residual. If the steps end at up to 100 times as much, that counts as rounding.
    report : callable
        Receives each `Iteration`.

    Raises
    ------
    NotConverged
        The least residual is larger.

    References
    ----------
    R. T. Rockafellar, Monotone operators and the proximal point algorithm, SIAM J. Control Optim.
    14 (1976), Theorem 1.
    """
    now = best = start
    least, delta = np.inf, 0.1  # a tenth of the compliance of a row
    for _ in range(ATTEMPTS):
        shifted = replace(
            problem,
            W=arrays_of(problem.W).shifted(problem.W, delta),
            v0=problem.v0 + delta * problem.forces(now.mu, now.t),
            swept=None,  # the springs yield
        )
        try:
            now = semismooth_newton(
                shifted, now, friction, tol=tol, phase=f"proximal {delta:.0e}", report=report
            )
        except (NotConverged, LinAlgError):
            delta *= 4
            if delta > SOFTEST:
                break
            continue
        size = residual(problem, now.mu, now.t, now.a, friction.bound(now.mu))
        if size < least:
            best, least = now, size
        if size <= tol:
            break
        delta = max(0.25 * delta, STIFFEST)
    if least <= ROUND_OFF * tol:
        return best
    raise NotConverged(f"proximal point: residual {least:.1e} at best, tolerance {tol:.1e}")
