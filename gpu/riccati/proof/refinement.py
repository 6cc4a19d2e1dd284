"""Newton steps on a Riccati solution, as far as round-off allows, and their verdict."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gpu.riccati.problem.candidate import Found
from gpu.riccati.problem.lqr_problem import LQRProblem
from gpu.riccati.problem.state_matrix import EPS
from gpu.riccati.proof.closed_loop import DenseLoop, closed_loop_of
from gpu.riccati.proof.residual import EXTENDED, gain_in_extended, riccati_residual

# Largest relative residual, in balanced units, that is certified.
RESIDUAL = 1e-9
# Or else the largest distance to the solution, relative, in the same units.
ERROR = 1e-12


class Verdict(NamedTuple):
    """How good a Riccati solution is.

    Attributes
    ----------
    residual : float
        Relative, in balanced units.
    loop : DenseLoop
    rounded : float
        What rounding to double precision has changed the solution by, relative.
    """

    residual: float
    loop: DenseLoop
    rounded: float = 0.0

    @property
    def certified(self) -> bool:
        """Whether it solves the equation and stabilises."""
        solved = bool(self.residual <= RESIDUAL) or self.error <= ERROR
        return solved and self.loop.is_stable()

    @property
    def error(self) -> float:
        """The distance to the solution, where the residual is too large; NaN elsewhere.

        Where ``S A`` is much smaller than its terms, no matrix of double precision has a small
        residual, the solution rounded included.
        """
        return np.nan if self.residual <= RESIDUAL else self.rounded + self.loop.newton[0]


def refine(problem: LQRProblem, S: Any, steps: int) -> tuple[Any, int]:
    r"""Add solutions D of :math:`E^T D A_c + A_c^T D E = -\mathrm{res}(S)` while they shrink.

    With residuals of twice the digits they shrink to the rounding of S itself, also where the
    equation is ill-conditioned; see N. J. Higham, Accuracy and Stability of Numerical Algorithms,
    SIAM 2002, chapter 12, for this kind of refinement. Where slow poles stand beside a fast
    loop, its gain needs more digits of S than double precision has: S is kept in extended
    precision where residuals are.

    Returns
    -------
    S : array
    steps : int
        How many were taken.
    """
    standard = problem.standard()
    unit = problem.unit
    extended = in_extended(problem)
    before, taken = np.inf, 0
    if extended:
        S = S.astype(np.longdouble)
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
        whole = _balanced_norm(problem, S, unit)
        left = (size / whole if whole > 0.0 else np.inf) if size > 0.0 else 0.0
        slowly, before, taken = size > 1e-3 * before, size, taken + 1
        if left <= (1e-3 * EPS if slowly else EPS):
            break
    return S, taken


def finished(problem: LQRProblem, S: Any, info: dict[str, Any]) -> Found:
    """Judge a refined solution; its gain is computed before S is rounded to double precision."""
    verdict = judge(problem, S)
    gain = gain_in_extended(problem, S) if in_extended(problem) else problem.gain_of(S)
    return Found(gain, S.astype(float), info, verdict)


def judge(problem: LQRProblem, S: Any) -> Verdict:
    """Recompute the residual of S, as rounded to double precision, and the closed loop."""
    standard, unit = problem.standard(), problem.unit
    extended = in_extended(problem)
    residual = riccati_residual(problem, S, unit, extended)
    loop = closed_loop_of(problem, standard, unit, S, residual=residual.matrix, extended=extended)
    rounded = 0.0
    if S.dtype != np.float64:
        double = S.astype(float)
        change = _balanced_norm(problem, S - double, unit)
        rounded = change / (_balanced_norm(problem, double, unit) or 1.0)
        residual = riccati_residual(problem, double, unit, extended)
    return Verdict(residual.relative, loop, rounded)


def in_extended(problem: LQRProblem) -> bool:
    """Whether residuals are computed in extended precision."""
    return problem.xp is np and problem.n <= EXTENDED


def _balanced_norm(problem: LQRProblem, S: Any, unit: Any) -> float:
    E = problem.full()[1]
    Y = S if E is None else E.T @ S @ E
    return float(problem.xp.linalg.norm((Y * unit * unit[:, None]).astype(float)))
