"""Newton's method where the compliance is applied by the factors of the bodies."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from scipy.linalg import LinAlgError

from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.errors import NotConverged
from contact.laws.device_newton import device_newton
from contact.laws.friction import Friction, Tresca
from contact.laws.iteration import Report
from contact.laws.options import Options
from contact.laws.proximal_point import proximal_point

# Tolerance of the boundary problem relative to that of the certificate, as in
# `contact.laws.methods`.
_INNER = 1e-2


def product_newton(
    problem: BoundaryProblem,
    friction: Friction | None,
    options: Options,
    start: Forces | None,
    report: Report,
) -> Forces:
    """Solve for contact; see `contact.laws.methods.solve_boundary`.

    Parameters
    ----------
    problem : BoundaryProblem
        Its W is a `FactorCompliance`.
    friction : Friction or None
    options : Options
        Its method must be "newton".
    start : Forces or None
    report : callable
        Receives each `Iteration`.

    Raises
    ------
    NotConverged
        Newton's method stalls, and so do proximal points.
    """
    tol = _INNER * options.tol
    with suppress(NotConverged, LinAlgError):
        return device_newton(
            problem, friction, start, tol=tol, max_iterations=options.max_iterations, report=report
        )
    begin = start or Forces(*problem.zeros(), np.zeros(problem.s.size))
    law = friction or Tresca(np.zeros(problem.gap.size))
    return proximal_point(problem, law, begin, tol=tol, report=report)
