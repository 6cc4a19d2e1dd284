"""When an iteration on the boundary problem ends."""

from __future__ import annotations

import numpy as np

from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.errors import NotConverged
from contact.laws.residual import rounding

PATIENCE = 8  # steps without a new least residual after which the iteration counts as cycling
ROUND_OFF = 1e2  # times the tolerance: nearer than that a stalled iteration has come to its end
# Residual from which on a solution is near: Newton's undamped step is trusted there, and a stall
# may be one of rounding.
NEAR = 0.1


class Progress:
    """When an iteration has converged, has come down to its rounding, or goes in circles.

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
        """Take note of a step and of the residual it left."""
        self._since_best += 1
        self._since_half += 1
        if size < self._least:
            self._best, self._least, self._since_best = now, size, 0
        if size <= 0.5 * self._half:
            self._half, self._since_half = size, 0
        if not size > self._tol or not np.isfinite(size):
            return True
        # A step of Newton's method near the solution that does not halve the residual has met
        # rounding: of what cancels in it, or, for bad conditioning, a multiple of that.
        if self._since_half >= 2 and self._least <= ROUND_OFF * self._tol:
            return True
        if self._since_half >= 1 and self._at_rounding(problem):
            return True
        return self._since_best >= PATIENCE

    def _at_rounding(self, problem: BoundaryProblem) -> bool:
        best = self._best
        if best is None or self._least > NEAR:
            return False
        forces = problem.forces(best.mu, best.t)
        return self._least <= rounding(
            problem, forces, best.a, problem.residual_size(best.mu, best.t)
        )

    def best_of(self, problem: BoundaryProblem, phase: str) -> Forces:
        """The step of least residual.

        Raises
        ------
        NotConverged
            It is neither within the tolerance nor rounding.
        """
        near = self._least <= ROUND_OFF * self._tol or self._at_rounding(problem)
        if self._best is None or not near:
            raise NotConverged(
                f"{phase}: residual {self._least:.1e} at best, tolerance {self._tol:.1e}"
            )
        return self._best
