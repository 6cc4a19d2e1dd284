"""Newton's method for contact with friction, with the matrix W on a GPU.

The steps are those of `contact.laws.semismooth_newton`: their rows are gathered, scaled and
factored where W lies, with one tangent or two. Here is the cold start, which must not move W to the
host as the box QP of `contact.laws.active_set` does. If the iteration stalls, nothing else is tried
here: the methods of `contact.laws.methods` take over.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.laws.friction import Friction, Tresca
from contact.laws.iteration import Iteration, Report
from contact.laws.semismooth_newton import newton_step, semismooth_newton
from contact.laws.zones import Zones

START = 15  # frictionless active-set steps, at most, that precede Newton's method on a cold start
# Stiffness, relative to the square of the largest entry of C, of the springs that hold free motions
# during these steps: soft compared with contact, whose stiffness is one.
SPRINGS = 1e-2


def device_newton(
    problem: BoundaryProblem,
    friction: Friction | None,
    start: Forces | None,
    *,
    tol: float,
    max_iterations: int,
    report: Report = lambda iteration: None,
) -> Forces:
    """Solve for contact in two or three dimensions, where ``problem.W`` lies.

    Parameters
    ----------
    problem : BoundaryProblem
        Of hard surfaces.
    friction : Friction or None
    start : Forces or None
        None starts with frictionless steps in which springs hold the free motions.
    tol : float
        On `contact.laws.residual.residual`.
    max_iterations : int
    report : callable
        Receives each `Iteration`.

    Raises
    ------
    NotConverged, LinAlgError
        The iteration stalls, or a linear system is singular.
    """
    none = Tresca(np.zeros(problem.gap.size))
    now = start or Forces(*problem.zeros(), np.zeros(problem.s.size))
    if start is None and friction is not None:
        now = _without_friction(problem, now, none, report)
    phase = "active set" if friction is None else "newton"
    return semismooth_newton(
        problem,
        now,
        friction or none,
        tol=tol,
        max_iterations=max_iterations,
        phase=phase,
        report=report,
    )


def _without_friction(
    problem: BoundaryProblem, now: Forces, none: Tresca, report: Report
) -> Forces:
    """Active-set steps until the set of active points repeats."""
    before: NDArray[np.bool_] | None = None
    for step in range(1, START + 1):
        zones = Zones.of(problem, now, none)
        if before is not None and np.array_equal(before, zones.active):
            break
        before = zones.active
        now = newton_step(problem, now, zones, none, "radial", SPRINGS, anchored=False)
        report(Iteration(step, "frictionless", int(zones.active.sum()), 0, 0, np.nan))
    return now
