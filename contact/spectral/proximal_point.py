"""Proximal points on a grid, where Newton's method with given friction goes round in circles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from contact.errors import NotConverged
from contact.laws.iteration import Report
from contact.spectral.friction_newton import GridFriction, friction_newton, residual
from contact.spectral.grid_problem import Grid, GridProblem

_FIRST, _SOFTEST, _STIFFEST = 0.1, 1e3, 1e-9  # compliance of the springs; that of a point is one
_ATTEMPTS = 60
_STEPS = 30  # of Newton's method each


@dataclass(frozen=True)
class Softened(GridProblem):
    """A problem with springs at its points, but not where a side fixes them.

    Attributes
    ----------
    springs : tuple of float
        Compliance of each, along the normal and along the surface.
    """

    springs: tuple[float, float]

    @classmethod
    def near(cls, problem: GridProblem, forces: Grid, delta: float) -> Softened:
        """The problem whose springs are at rest under given forces."""
        normal, along = (delta / c for c in problem.scale)
        step = cls(problem.compliance, problem.v0, problem.gap, problem.force, (normal, along))
        return replace(step, v0=problem.v0 + step._shortened(forces))

    def W(self, forces: Grid) -> Grid:
        """Compliance of the body and of the springs times forces."""
        return super().W(forces) + self._shortened(forces)

    def _shortened(self, forces: Grid) -> Grid:
        """Of the springs; what a side fixes has none."""
        normal, along = self.springs
        u = self.xp.concatenate((normal * forces[:1], along * forces[1:]))
        return u if self.fixed is None else self.xp.where(self.fixed, 0.0, u)


def proximal_point(
    problem: GridProblem,
    friction: GridFriction,
    start: tuple[Grid, Any],
    *,
    tol: float,
    report: Report = lambda iteration: None,
) -> tuple[Grid, Any]:
    r"""Solve a sequence of problems with springs, which Newton's method finds easier.

    As in `contact.laws.proximal_point`: the step
    :math:`W_k = W + \delta_k I, v_{0,k} = v_0 + \delta_k l_k` has the solution as its fixed point.
    With Tresca's law the forces minimise a convex energy, and the iteration converges for any
    delta, which is divided by 4 after a success and multiplied by 4 after a failure.

    Parameters
    ----------
    problem, friction, start, report
        As for `friction_newton`, which solves each.
    tol : float
        On the residual of the problem itself.

    Returns
    -------
    l, a : array, ndarray
        As those of `friction_newton`.

    Raises
    ------
    NotConverged
        The least residual is larger than a hundred times the tolerance.

    References
    ----------
    R. T. Rockafellar, Monotone operators and the proximal point algorithm, SIAM J. Control Optim.
    14 (1976), Theorem 1.
    """
    best, least, delta = start, float("inf"), _FIRST
    for _ in range(_ATTEMPTS):
        step = Softened.near(problem, best[0], delta)
        try:
            now = friction_newton(
                step, friction, best, tol=tol, max_iterations=_STEPS,
                phase=f"proximal {delta:.0e}", report=report,
            )  # fmt: skip
        except NotConverged:
            delta *= 4
            if delta > _SOFTEST:
                break
            continue
        size = residual(problem, friction, *now, problem.displacements(*now))
        best, least = now, size
        if size <= tol:
            break
        delta = max(0.25 * delta, _STIFFEST)
    if least <= 1e2 * tol:
        return best
    raise NotConverged(f"proximal point: residual {least:.1e}, tolerance {tol:.1e}")
