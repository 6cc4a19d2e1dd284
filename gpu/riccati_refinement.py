"""Newton steps on a Riccati solution, as far as round-off allows, and their verdict."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gpu.closed_loop import DenseLoop, closed_loop_of
from gpu.hamiltonian_balance import balance
from gpu.lqr_problem import LQRProblem
from gpu.riccati_residual import EXTENDED, riccati_residual
from gpu.state_matrix import EPS

# Largest relative residual, in balanced units, that is certified.
RESIDUAL = 1e-9


class Verdict(NamedTuple):
    """How good a Riccati solution is.

    Attributes
    ----------
    residual : float
        Relative, in balanced units.
    loop : DenseLoop
    """

    residual: float
    loop: DenseLoop

    @property
    def certified(self) -> bool:
        """Whether it solves the equation and stabilises."""
        return bool(self.residual <= RESIDUAL) and self.loop.is_stable()


def refine(problem: LQRProblem, S: Any, steps: int) -> tuple[Any, int]:
    r"""Add solutions D of :math:`E^T D A_c + A_c^T D E = -\mathrm{res}(S)` while they shrink.

    With residuals of twice the digits they shrink to the rounding of S itself, also where the
    equation is ill-conditioned; see N. J. Higham, Accuracy and Stability of Numerical Algorithms,
    SIAM 2002, chapter 12, for this kind of refinement.

    Returns
    -------
    S : array
    steps : int
        How many were taken.
    """
    standard = problem.standard()
    unit = balance(standard)
    extended = in_extended(problem)
    before, taken = np.inf, 0
    previous = S
    for _ in range(steps if extended else min(steps, 2)):
        residual = riccati_residual(problem, S, unit, extended)
        if not extended and residual.relative <= 4 * EPS * np.sqrt(problem.n):
            break
        loop = closed_loop_of(problem, standard, unit, S)
        try:
            change = loop.lyapunov(residual.matrix * unit * unit[:, None])
        except np.linalg.LinAlgError:
            return previous, taken
        change = problem.value_of(change / unit / unit[:, None])
        size = _balanced_norm(problem, change, unit)
        if not np.isfinite(size) or size >= 0.5 * before:
            break
        previous = S
        S = S + change
        S = (S + S.T) / 2
        before, taken = size, taken + 1
        if size <= EPS * _balanced_norm(problem, S, unit):
            break
    return S, taken


def judge(problem: LQRProblem, S: Any) -> Verdict:
    """Recompute the residual of S and the closed loop of its gain."""
    standard = problem.standard()
    unit = balance(standard)
    residual = riccati_residual(problem, S, unit, in_extended(problem))
    loop = closed_loop_of(problem, standard, unit, S, residual=residual.matrix)
    return Verdict(residual.relative, loop)


def in_extended(problem: LQRProblem) -> bool:
    """Whether residuals are computed in extended precision."""
    return problem.xp is np and problem.n <= EXTENDED


def _balanced_norm(problem: LQRProblem, S: Any, unit: Any) -> float:
    E = problem.full()[1]
    Y = S if E is None else E.T @ S @ E
    return float(problem.xp.linalg.norm(Y * unit * unit[:, None]))
