"""When an iteration on the boundary problem ends."""

from __future__ import annotations

import numpy as np

from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.errors import NotConverged
from contact.laws.residual import rounding

PATIENCE = 8  # steps without a new least residual after which the iteration counts as cycling
ROUND_OFF = 1e2  # times the tolerance: below this residual a stall counts as rounding error
# Residual below which the iterate is near a solution: the undamped Newton step is used there, and a
# stall may be due to rounding.
NEAR = 0.1


def at_rounding(problem: BoundaryProblem, best: Forces, least: float) -> bool:
    """Whether the residual of forces near a solution is the rounding of the terms in it."""
    if least > NEAR:
        return False
    size = problem.residual_size(best.mu, best.t)
    return least <= rounding(problem, problem.forces(best.mu, best.t), best.a, size)


class Progress:
    """Detects that an iteration has converged, has reached rounding error, or cycles.

    Parameters
    ----------
    tol : float
        On the residual.
    """

    def __init__(self, tol: float) -> None:
        self._tol, self._least = tol, np.inf
        self._best: Forces | None = None
        self._since_best = self._since_half = 0
        self._half = np.inf

    def ended(self, problem: BoundaryProblem, now: Forces, size: float) -> bool:
        """Record a step and its residual; True if the iteration is to end."""
        self._since_best += 1
        self._since_half += 1
        if size < self._least:
            self._best, self._least, self._since_best = now, size, 0
        if size <= 0.5 * self._half:
            self._half, self._since_half = size, 0
        if not size > self._tol or not np.isfinite(size):
            return True
        # Near the solution, a Newton step that does not halve the residual has reached rounding
        # error: that of the terms that cancel in it, or a multiple if badly conditioned.
        if self._since_half >= 2 and self._least <= ROUND_OFF * self._tol:
            return True
        if self._since_half >= 1 and self._at_rounding(problem):
            return True
        return self._since_best >= PATIENCE

    def _at_rounding(self, problem: BoundaryProblem) -> bool:
        return self._best is not None and at_rounding(problem, self._best, self._least)

    def best_of(self, problem: BoundaryProblem, phase: str) -> Forces:
        """The forces of least residual.

        Raises
        ------
        NotConverged
            That residual exceeds `ROUND_OFF` times the tolerance, and rounding error too.
        """
        near = self._least <= ROUND_OFF * self._tol or self._at_rounding(problem)
        if self._best is None or not near:
            raise NotConverged(
                f"{phase}: residual {self._least:.1e} at best, tolerance {self._tol:.1e}"
            )
        return self._best
