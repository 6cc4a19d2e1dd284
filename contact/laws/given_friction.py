"""Tresca friction by a box QP or by Newton's method; where Newton stalls, two further attempts."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.errors import NotConverged
from contact.laws.active_set import signorini
from contact.laws.friction import Tresca
from contact.laws.iteration import Report
from contact.laws.load_balance import check_held
from contact.laws.proximal_point import proximal_point
from contact.laws.semismooth_newton import semismooth_newton
from gpu import GpuError, Infeasible

Array = NDArray[np.float64]
DOUBLINGS = (1, 2, 4, 8, 16)  # of a bound that cannot balance the loads


@dataclass(frozen=True)
class GivenFriction:
    """Solver of a boundary problem for any given friction bound.

    Attributes
    ----------
    problem : BoundaryProblem
    damped : bool
        Use the damped Newton method, (4.16) of the dissertation, also where the problem is a box
        QP.
    tol : float
    peer : str, optional
        Solver of qpsolvers for the box QP.
    """

    problem: BoundaryProblem
    damped: bool
    tol: float
    peer: str | None = None

    def __call__(
        self, bound: Array, start: Forces, report: Report = lambda iteration: None
    ) -> Forces:
        """Forces under the bound g, shape (m,), from a start.

        Raises
        ------
        NotConverged
            Newton's method and the proximal point method stalled, or the solver `peer` failed.
        gpu.Infeasible
            No friction forces within the bound balance the loads.
        """
        if not self.box:
            return self._by_newton(Tresca(bound), start, report)
        return signorini(
            self.problem, bound=bound, start=start, tol=self.tol, peer=self.peer, report=report
        )

    def of_last_step(self, bound: Array, start: Forces) -> Forces:
        """Forces under the bound of the last step, in an iteration for Coulomb's law.

        If these cannot balance the loads, forces within Coulomb's law still may: the pressure of
        the last step is too low then, and that under a higher bound balances the loads.

        Raises
        ------
        NotConverged
            As in `__call__`, or forces within no multiple of this bound balance the loads.
        """
        for times in DOUBLINGS:
            with suppress(Infeasible):
                if self.problem.s.size and not self.box:  # where Newton's method would only stall
                    check_held(self.problem, Tresca(times * bound))
                return self(times * bound, start)
        raise NotConverged("the friction of the last step cannot hold the loads")

    @property
    def box(self) -> bool:
        """Whether the problem is a box QP, solved as such."""
        box = self.problem.tangent.shape[1] == 1 and self.problem.compliance is None
        return box and not self.damped

    def _by_newton(self, friction: Tresca, start: Forces, report: Report) -> Forces:
        """Newton's method; if it stalls, damped from other starts, then proximal points."""
        problem, tol = self.problem, self.tol
        rest = Forces(*problem.zeros(), np.zeros(problem.s.size))
        form = "damped" if self.damped else "switched"
        for near, kind in ((start, form), (rest, "damped")):
            with suppress(NotConverged, LinAlgError):
                phase = f"{kind} newton"
                return semismooth_newton(
                    problem, near, friction, form=kind, tol=tol, phase=phase, report=report
                )
        if problem.tangent.shape[1] == 1:
            with suppress(NotConverged, LinAlgError, GpuError):  # from hard surfaces, a box QP
                hard = replace(problem, compliance=None)
                near = signorini(hard, bound=friction.given, start=start, tol=tol, report=report)
                return semismooth_newton(problem, near, friction, tol=tol, report=report)
        return proximal_point(problem, friction, start, tol=tol, report=report)
