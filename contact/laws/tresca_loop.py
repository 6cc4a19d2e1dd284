"""Coulomb friction by an outer loop over given friction."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from contact.condensation.boundary_problem import Array, BoundaryProblem, Forces
from contact.errors import NotConverged
from contact.laws.condensed_newton import Condensed, outer_step
from contact.laws.friction import Coulomb
from contact.laws.iteration import Report
from contact.laws.newton import LIMITS, at_rounding

Tresca = Callable[[Array, Forces], Forces]


def tresca_loop(
    problem: BoundaryProblem,
    friction: Coulomb,
    start: Forces,
    solve: Tresca,
    *,
    tol: float,
    max_iterations: int,
    report: Report,
) -> Forces:
    """Coulomb friction as a fixed point of given friction, g <- F mu: Algorithm 1 of the
    dissertation. Raises `NotConverged` if the map is not a contraction (large friction).
    """
    now, best, least, laws = start, start, np.inf, Condensed(problem, friction)
    for step in range(1, max_iterations + 1):
        now = solve(friction.bound(now.mu), now)
        line = outer_step(problem, step, "outer", now, friction.bound(now.mu))
        report(line)
        if line.residual <= tol:
            return now
        if line.residual < least:
            best, least = now, line.residual
        elif at_rounding(laws, laws.state(best), least):
            return best
    if least <= LIMITS.round_off * tol or at_rounding(laws, laws.state(best), least):
        return best
    raise NotConverged(
        f"tresca loop: residual {line.residual:.1e} after {step} outer steps, tolerance {tol:.1e}; "
        "use method='newton' or raise max_iterations"
    )
