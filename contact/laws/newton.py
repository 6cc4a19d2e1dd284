"""The semismooth Newton iteration for contact with friction, and the proximal point method.

The form "switched" uses the damped form of the linearised law (`contact.laws.law`) until the
residual falls below .1 and radial return from there. It needs 3 to 9 steps on blocks, curved parts
and 3-D bodies for friction .1 to 3, where radial return alone cycles in a third of the cases. In
two dimensions radial return is an active-set method on the sign of the slip: where it converges, it
ends after finitely many steps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.linalg import LinAlgError

from contact.errors import NoEquilibrium, NotConverged
from contact.laws.iteration import Iteration, Report
from contact.laws.law import ContactLaw, State, Zones


class _Limits(NamedTuple):  # of residuals
    inner: float = 1e-2  # tolerance of a boundary problem, over the certificate's
    near: float = 0.1  # residual below which steps are undamped, and a stall may be rounding
    round_off: float = 1e2  # a stall below this multiple of the tolerance is rounding
    noise: float = 10 * float(np.finfo(float).eps)  # relative rounding of a sum of a hundred terms


LIMITS = _Limits()


class Compliance(Protocol):
    """A body with its contact points and their law, for `newton`; it defines the form of forces."""

    @property
    def law(self) -> ContactLaw:
        """The law of the points."""

    @property
    def patience(self) -> int:
        """Steps without a new least residual that count as cycling."""

    def state(self, forces: Any) -> State:
        """Forces and the displacements that they cause."""

    def residual(self, state: State) -> float:
        """Largest violation of the laws and the load balance, over the largest force."""

    def step(self, state: State, zones: Zones, form: str, size: float) -> Any:
        """Forces that solve the laws linearised at a state with the residual `size`."""

    def rounding(self, state: State) -> float:
        """Rounding error of the residual; zero if unknown."""

    def softened(self, forces: Any, delta: float) -> Compliance:
        """The problem with springs of compliance delta at all points, stress-free at `forces`."""


def at_rounding(compliance: Compliance, best: State | None, least: float) -> bool:
    """Whether the residual of a state near a solution is at the level of its rounding error."""
    return best is not None and least <= LIMITS.near and least <= compliance.rounding(best)


class Progress:
    """Detects that an iteration has converged, has reached rounding error, or cycles."""

    def __init__(self, compliance: Compliance, tol: float, first: float) -> None:
        self._compliance, self._tol, self._least = compliance, tol, np.inf
        self._first = first  # residual of the start, which does not count as the best
        self._best: State | None = None
        self._since_best = self._since_half = 0
        self._half = np.inf

    def ended(self, now: State, size: float) -> bool:
        """Record a step and its residual; True if the iteration is to end."""
        self._since_best += 1
        self._since_half += 1
        if size < min(self._least, self._first):
            self._since_best = 0
        if size < self._least:
            self._best, self._least = now, size
        if size <= 0.5 * self._half:
            self._half, self._since_half = size, 0
        if not size > self._tol or not np.isfinite(size):
            return True
        # Near the solution, a Newton step that does not halve the residual has reached its rounding
        # error, or a multiple if badly conditioned.
        if self._since_half >= 2 and self._least <= LIMITS.round_off * self._tol:
            return True
        if self._since_half >= 1 and at_rounding(self._compliance, self._best, self._least):
            return True
        return self._since_best >= self._compliance.patience

    def best_of(self, phase: str) -> Any:
        """The forces with the smallest residual; `NotConverged` if it is larger than rounding."""
        near = self._least <= LIMITS.round_off * self._tol
        if self._best and (near or at_rounding(self._compliance, self._best, self._least)):
            return self._best.forces
        raise NotConverged(
            f"{phase}: residual {self._least:.1e} at best, tolerance {self._tol:.1e}"
        )


def newton(
    compliance: Compliance,
    start: Any,
    *,
    zones: Zones | None = None,
    form: str = "switched",
    tol: float = 1e-12,
    max_iterations: int = 50,
    phase: str = "newton",
    report: Report = lambda iteration: None,
) -> Any:
    """Contact forces from a start, or `NotConverged`; `zones` replace those of the start."""
    now = compliance.state(start)
    size = compliance.residual(now) if zones is None else np.inf
    progress, radial = Progress(compliance, tol, size), size < LIMITS.near
    for step in range(1, max_iterations + 1):
        zones = zones or compliance.law.zones(now)
        kind = ("radial" if radial else "damped") if form == "switched" else form
        now = compliance.state(compliance.step(now, zones, kind, size))
        before, size = size, compliance.residual(now)
        active, stick, slip = (int(part.sum()) for part in (zones.active, zones.stick, zones.slip))
        report(Iteration(step, phase, active, stick, slip, size))
        if progress.ended(now, size):
            break
        # Radial return without progress is cycling: the damped form ends the cycle.
        radial, zones = size < LIMITS.near and not (radial and size > 0.9 * before), None
    return progress.best_of(phase)


def followed(
    compliance: Any,
    start: Any,
    stable: Callable[[Any, Any], bool] = lambda compliance, forces: True,
    *,
    tol: float,
    max_iterations: int,
    report: Report = lambda iteration: None,
) -> Any:
    """The equilibrium with adhesion near a start, by Newton's method; where that ends at none, or
    at one not `stable`, by iterations with less of the tensions' slopes first, at last none: more
    tension closes gaps, so that these are monotone, an overdamped motion. `NoEquilibrium` if all
    fail."""
    failure: Exception = NotConverged("newton: the equilibrium that it found is unstable")
    limits: dict[str, Any] = {"max_iterations": max_iterations, "report": report}
    slow = limits | {"max_iterations": 4 * max_iterations}
    for form in ("radial", "steep", "half", "damped", "steep to the end"):
        first, goal = start, tol if form.endswith("end") else 1e-6
        try:
            if form != "radial":
                first = newton(compliance, start, form=form.split()[0], tol=goal, **slow)
            found = first if goal == tol else newton(compliance, first, tol=tol, **limits)
            if stable(compliance, found):
                return found
        except (NotConverged, LinAlgError) as error:
            failure = error
    raise NoEquilibrium(
        f"{failure}; no equilibrium was found near the last one: adhesion may have pulled off or "
        "jumped into contact; take smaller steps, control the motion instead of the force, or "
        "refine until the cohesive zone has several points"
    ) from failure


def proximal_point(
    compliance: Compliance,
    start: Any,
    *,
    tol: float,
    max_iterations: int = 50,
    report: Report = lambda iteration: None,
) -> Any:
    r"""Solve a sequence of problems with springs at the points, which `newton` finds easier.

    .. math::
        W_k = W + \delta_k I, \qquad v_{0,k} = v_0 + \delta_k l_k

    has the solution l of the problem as fixed point. The compliance delta is divided by 4 after
    each success and multiplied by 4 after a failure. With given friction the laws are the gradient
    of a convex energy, and the iteration converges for any delta, also if rows are linearly
    dependent (R. T. Rockafellar, SIAM J. Control Optim. 14 (1976), Theorem 1); with Coulomb's law
    it is a heuristic. Raises `NotConverged` if the least residual is above 100 `tol`.
    """
    now = best = start
    least, delta = np.inf, 0.1  # a tenth of a row's compliance
    for _ in range(100):  # twenty steps reduce delta from its upper to its lower limit
        try:
            now = newton(
                compliance.softened(now, delta),
                now,
                tol=tol,
                max_iterations=max_iterations,
                phase=f"proximal {delta:.0e}",
                report=report,
            )
        except (NotConverged, LinAlgError):
            delta *= 4
            if delta > 1e3:
                break
            continue
        size = compliance.residual(compliance.state(now))
        if size < least:
            best, least = now, size
        if size <= tol:
            break
        delta = max(0.25 * delta, 1e-9)
    if least <= LIMITS.round_off * tol:
        return best
    raise NotConverged(f"proximal point: residual {least:.1e} at best, tolerance {tol:.1e}")
