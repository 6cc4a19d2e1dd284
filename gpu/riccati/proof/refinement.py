"""Newton steps on a Riccati solution down to round-off, and their assessment."""

from __future__ import annotations

from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from gpu.riccati.problem.candidate import Found
from gpu.riccati.problem.lqr_problem import LQRProblem
from gpu.riccati.problem.state_matrix import EPS
from gpu.riccati.proof.closed_loop import DenseLoop, closed_loop_of
from skfem_adini.ground.arrays import to_host


class _Limits(NamedTuple):  # tolerances, in balanced units
    residual: float = 1e-9  # largest relative residual that is certified
    error: float = 1e-12  # largest relative distance to the solution that is certified otherwise
    far: int = 250  # exponents from which powers of two have squares near the range's ends
    extended: int = 128  # order up to which residuals are in extended precision on the host
    exact: int = 10  # order up to which, if that is not enough, they are exact: n^3 microseconds


LIMITS = _Limits()


class Verdict(NamedTuple):
    """Assessment of a Riccati solution."""

    residual: float  # relative, in balanced units
    loop: DenseLoop
    rounded: float = 0.0  # relative change of the solution by rounding it to double precision

    @property
    def certified(self) -> bool:
        """Whether it solves the equation and stabilises."""
        solved = bool(self.residual <= LIMITS.residual) or self.error <= LIMITS.error
        return solved and self.loop.is_stable()

    @property
    def error(self) -> float:
        """The distance to the solution if the residual is too large, else NaN. Where ``S A`` is
        much smaller than its terms, no matrix of double precision has a small residual.
        """
        return np.nan if self.residual <= LIMITS.residual else self.rounded + self.loop.newton[0]


def refine(problem: LQRProblem, S: Any, steps: int, exact: bool = False) -> tuple[Any, int]:
    r"""Newton steps :math:`E^T D A_c + A_c^T D E = -\mathrm{res}(S)` while they shrink; S, count.

    Residuals of twice the digits lead to the rounding of S (Higham 2002, chapter 12). A fast loop
    with slow poles needs more digits of S than a double has, so S is kept as the residuals are."""
    standard = problem.standard()
    unit = problem.unit
    extended = in_extended(problem)
    before, taken = np.inf, 0
    if extended:
        S = S.astype(np.longdouble)
    previous = S
    for _ in range(steps if extended else min(steps, 2)):
        residual = riccati_residual(problem, S, unit, extended, exact)
        if not extended and residual.relative <= 4 * EPS * np.sqrt(problem.n):
            break
        loop = closed_loop_of(problem, standard, unit, S)
        try:
            change = loop.lyapunov(residual.matrix * unit * unit[:, None])
        except np.linalg.LinAlgError:
            return previous, taken
        change = problem.value_of(change)
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


def finished(problem: LQRProblem, S: Any, info: dict[str, Any], exact: bool = False) -> Found:
    """Assess a refined solution; its gain is computed before S is rounded to double precision."""
    verdict = judge(problem, S, exact)
    gain = gain_in_extended(problem, S) if in_extended(problem) else problem.gain_of(S)
    return Found(gain, S.astype(float), info, verdict)


def judge(problem: LQRProblem, S: Any, exact: bool = False) -> Verdict:
    """Recompute the residual of S, as rounded to double precision, and the closed loop."""
    standard, unit = problem.standard(), problem.unit
    extended = in_extended(problem)
    residual = riccati_residual(problem, S, unit, extended, exact)
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
    return problem.xp is np and problem.n <= LIMITS.extended


def _balanced_norm(problem: LQRProblem, S: Any, unit: Any) -> float:
    E = problem.full()[1]
    Y = S if E is None else E.T @ S @ E
    return float(problem.xp.linalg.norm((Y * unit * unit[:, None]).astype(float)))


class Residual(NamedTuple):
    """The residual of an equation."""

    matrix: Any  # shape (n, n)
    relative: float  # Frobenius norms, over that of the terms; inf on overflow


def riccati_residual(
    problem: LQRProblem, S: Any, unit: Any = None, extended: bool = False, exact: bool = False
) -> Residual:
    """Compute :math:`E^T S A + A^T S E + Q - (E^T S B + N) R^{-1} (E^T S B + N)^T`, dense. Norms
    are taken of entries times ``unit_i unit_j``; `extended`: in extended precision on the host,
    where the platform has it; `exact`: in fractions."""
    xp = problem.xp
    if extended:
        if xp is not np:
            raise ValueError("extended precision lives on the host")
        number = _fractions if exact else _long
        A, E, Q, N, B, S = (number(M) for M in (*problem.full(), problem.B, S))
        half = (S if E is None else E.T @ S) @ A
        cross = (S if E is None else E.T @ S) @ B
        cross = cross if N is None else cross + N
        gain = solved_in_extended(problem.R, _long(cross.T))
        quadratic = cross @ number(gain)
        if exact:  # right to the square of the error of the gain
            K = number(gain)
            quadratic = quadratic + quadratic.T - K.T @ number(problem.R) @ K
    else:
        A, E, Q, N = problem.full()
        ES = S if E is None else E.T @ S
        half = ES @ A
        cross = ES @ problem.input
        if N is not None:
            cross = cross + N @ xp.asarray(np.linalg.inv(problem.root).T)
        quadratic = (cross * problem.signs) @ cross.T
    R = half + half.T + Q - quadratic
    R = (R + R.T) / 2
    if exact:
        R, half, quadratic, Q = (_long(M) for M in (R, half, quadratic, Q))
    weights = 1.0 if unit is None else unit * unit[:, None]
    # The squares of the terms may overflow where the terms do not.
    largest = max(float(xp.abs(M * weights).max()) for M in (half, quadratic, Q))
    top = np.log2(largest) if 0.0 < largest < np.inf else 0.0
    weights = weights * 2.0 ** -np.round(top) if abs(top) > LIMITS.far else weights
    size = (
        2.0 * float(xp.linalg.norm(half * weights))
        + float(xp.linalg.norm(quadratic * weights))
        + float(xp.linalg.norm(Q * weights))
    )
    error = float(xp.linalg.norm(R * weights))
    R = R.astype(float)
    if not np.isfinite(error + size):
        return Residual(R, np.inf)  # overflow does not show an error of S
    return Residual(R, error / size if size > 0.0 else error)


def gain_in_extended(problem: LQRProblem, S: Any) -> np.ndarray:
    """``R^-1 (B^T S E + N^T)``, shape (m, n), rounded in the end."""
    E, N = (_long(M) for M in (problem.full()[1], problem.N))
    S = np.asarray(S, dtype=np.longdouble)
    cross = (S if E is None else E.T @ S) @ problem.B.astype(np.longdouble)
    return solved_in_extended(problem.R, (cross if N is None else cross + N).T).astype(float)


def _long(M: Any) -> Any:
    return None if M is None else np.asarray(M, dtype=np.longdouble)


def _fractions(M: Any) -> Any:
    """The same numbers as fractions."""
    exact = np.frompyfunc(lambda x: Fraction(*x.as_integer_ratio()), 1, 1)
    return None if M is None else exact(M)


def solved_in_extended(R: np.ndarray, right: np.ndarray) -> np.ndarray:
    """``R^-1 right`` for a symmetric R by elimination in extended precision, with pivots compared
    after scaling R to a diagonal of ones."""
    R = to_host(R).astype(np.longdouble)
    m, size = len(R), np.sqrt(np.abs(R.diagonal()).astype(float))
    unit = np.exp2(-np.round(np.log2(np.where(size > 0.0, size, 1.0))))
    M = np.concatenate([R * unit * unit[:, None], right * unit[:, None]], axis=1)
    for j in range(m):
        pivot = j + int(np.argmax(np.abs(M[j:, j])))
        M[[j, pivot]] = M[[pivot, j]]
        M[j + 1 :] -= M[j + 1 :, j, None] / M[j, j] * M[j]
    for j in reversed(range(m)):
        M[j, m:] = (M[j, m:] - M[j, j + 1 : m] @ M[j + 1 :, m:]) / M[j, j]
    return np.asarray(M[:, m:] * unit[:, None])
