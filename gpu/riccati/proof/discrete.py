r"""The discrete Riccati equation: its residual, Newton steps, and the proof of a solution.

.. math:: A^T S A - E^T S E - K^T (R + B^T S B) K + Q = 0,\quad (R + B^T S B) K = B^T S A + N^T
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg

from gpu.riccati.problem.candidate import Found
from gpu.riccati.problem.lqr_problem import LQRProblem, solve
from gpu.riccati.problem.state_matrix import EPS
from gpu.riccati.proof.closed_loop import LIMITS as LOOP
from gpu.riccati.proof.refinement import in_extended, solved_in_extended
from skfem_adini.ground.arrays import namespace, to_host


class _Limits(NamedTuple):  # of a certified solution, in balanced units
    residual: float = 1e-9  # relative to the terms of the equation
    error: float = 1e-4  # bound of the relative distance to the solution, by Newton's next step
    doublings: int = 60  # of the series of a Stein equation: 2^60 steps of the loop
    steps: int = 40  # most Newton steps on a candidate


LIMITS = _Limits()


class Residual(NamedTuple):
    """The residual of an equation with a candidate S, and the gain that belongs to S."""

    matrix: Any  # shape (n, n)
    relative: float  # Frobenius norms, over that of the terms; inf on overflow
    terms: Any  # (n, n): the size of the terms of each entry
    gain: Any  # (m, n)
    inner: Any  # (m, m): R + B^T S B


def residual_of(problem: LQRProblem, S: Any, unit: Any) -> Residual:
    """Of a small problem on the host in extended precision, where the platform has it. Norms are
    taken of entries times ``unit_i unit_j``."""
    xp, extended = problem.xp, in_extended(problem)
    data: tuple[Any, ...] = (*problem.full(), problem.B, xp.asarray(problem.R))
    if extended:
        data = tuple(None if M is None else M.astype(np.longdouble) for M in data)
        S = S.astype(np.longdouble)
    A, E, Q, N, B, R = data
    moved = S @ A
    half, cross = A.T @ moved, moved.T @ B
    cross = cross if N is None else cross + N
    mass = S if E is None else E.T @ S @ E
    inner = R + B.T @ (S @ B)
    inner = (inner + inner.T) / 2
    gain = (solved_in_extended if extended else solve)(inner, cross.T)
    parts = (half, mass, cross @ gain, Q)
    left = parts[0] - parts[1] - parts[2] + parts[3]
    weights = unit * unit[:, None]
    size = sum(float(xp.linalg.norm(M * weights)) for M in parts)
    left = (left + left.T) / 2
    error = float(xp.linalg.norm(left * weights))
    relative = error / size if size > 0.0 else error
    terms, gain, inner = sum(abs(M) for M in parts), gain.astype(float), inner.astype(float)
    return Residual(left.astype(float), relative if size < np.inf else np.inf, terms, gain, inner)


@dataclass(frozen=True)
class DiscreteLoop:
    """``E^-1 (A - B K)`` in balanced units, and how well S solves the equation."""

    matrix: Any  # shape (n, n)
    rounding: float  # error of the matrix from round-off of A and of the feedback
    B: Any  # (n, m), in the same units
    inner: Any  # (m, m): R + B^T S B
    doubts: tuple[Any, Any]  # (n, n): bounds of the residual, and of the rounding of the data
    size: float  # norm of S

    @cached_property
    def poles(self) -> np.ndarray:
        """All eigenvalues, the outermost first."""
        values = np.linalg.eigvals(to_host(self.matrix)) + 0j
        return np.asarray(values[np.argsort(-np.abs(values), kind="stable")])

    @property
    def radius(self) -> float:
        """The largest modulus of a pole."""
        return float(abs(self.poles[0]))

    def stein(self, W: Any) -> Any:
        r"""D of :math:`C^T D C - D + W = 0` for this matrix C, by the doubled series (Smith 1968).
        LinAlgError if it does not converge."""
        xp, units = namespace(self.matrix), self._units
        both = units * units[:, None]
        C, D = self.matrix * units / units[:, None], W * both
        for _ in range(LIMITS.doublings):
            step = C.T @ D @ C
            D = D + step
            if not bool(xp.isfinite(D).all()):
                break
            if float(xp.linalg.norm(step)) <= EPS * float(xp.linalg.norm(D)):
                return (D + D.T) / 2 / both
            C = C @ C
        raise np.linalg.LinAlgError("the closed loop is not stable: the powers of its matrix grow")

    @cached_property
    def _units(self) -> Any:
        """Powers of two that balance rows and columns of the matrix, whose powers have less
        rounding then."""
        matrix = to_host(self.matrix)
        units = linalg.matrix_balance(matrix, permute=False, separate=True)[1][0]
        return namespace(self.matrix).asarray(units)

    def newton(self, doubt: Any) -> tuple[float, float]:
        """Relative size of Newton's step for this residual, and the ratio of the step after it to
        this one."""
        norm = namespace(self.matrix).linalg.norm
        try:
            first = self.stein(doubt)
            reach = self.matrix.T @ (first @ self.B)
            second = self.stein(reach @ solve(self.inner, reach.T))
        except np.linalg.LinAlgError:
            return np.inf, np.inf
        size = float(norm(first))
        return size / (self.size or 1.0), float(norm(second)) / (size or 1.0)

    @cached_property
    def error(self) -> float:
        """Relative distance of S to the solution, by Newton's next step."""
        return self.newton(self.doubts[0])[0]

    def is_stable(self) -> bool:
        """Whether every pole lies inside of the unit circle, beyond round-off, and that of no pair
        of the pencil that meets there (see `DenseLoop.is_stable`)."""
        if not np.isfinite(self.poles).all() or not self.radius < 1.0 - self.rounding:
            return False
        return not self._near() or self.newton(self.doubts[0])[1] <= LOOP.squares

    def is_sensitive(self) -> bool:
        """Whether rounding of the data may put a pole on the circle."""
        return self._near() and not self.newton(self.doubts[1])[1] <= LOOP.squares

    def _near(self) -> bool:
        return self.radius >= 1.0 - LOOP.left


class Verdict(NamedTuple):
    """Assessment of a solution S."""

    residual: float
    loop: DiscreteLoop

    @property
    def certified(self) -> bool:
        """Whether it solves the equation and stabilises."""
        loop = self.loop
        solved = self.residual <= LIMITS.residual
        return bool(solved and loop.is_stable() and loop.error <= LIMITS.error)


def loop_of(problem: LQRProblem, S: Any, unit: Any, residual: Residual) -> DiscreteLoop:
    """The closed loop of S, whose residual is known."""
    A, E, _, _ = problem.full()
    xp, B, K = problem.xp, problem.B, residual.gain
    if E is not None:
        moved = solve(E, xp.concatenate([A, B], axis=1))
        A, B = moved[:, : problem.n], moved[:, problem.n :]
    A, B, K = A * unit / unit[:, None], B / unit[:, None], K * unit
    norm, both = xp.linalg.norm, unit * unit[:, None]
    W, data = abs(residual.matrix) * both, EPS * residual.terms.astype(float) * both
    doubt = W if in_extended(problem) else W + data
    rounding = 4 * EPS * float(norm(A) + norm(B) * norm(K))
    mass = S if E is None else E.T @ S @ E
    size = float(norm((mass * both).astype(float)))
    return DiscreteLoop(A - B @ K, rounding, B, residual.inner, (doubt, data), size)


def refined(problem: LQRProblem, unit: Any, S: Any, info: dict[str, Any]) -> Found:
    """Newton steps on S while they shrink (Hewer 1971), then its gain and its assessment."""
    before, taken = np.inf, 0
    S = S.astype(np.longdouble) if in_extended(problem) else S
    residual = residual_of(problem, S, unit)
    while taken < LIMITS.steps:
        loop = loop_of(problem, S, unit, residual)
        step = loop.stein(residual.matrix * unit * unit[:, None])
        size = float(problem.xp.linalg.norm(step))
        # The first step from a gain that stabilises may overshoot; the others then come back.
        if taken > 1 and not size < 0.8 * before:
            break
        S = S + problem.value_of(step, unit)
        S = (S + S.T) / 2
        residual = residual_of(problem, S, unit)
        before, taken = size, taken + 1
        if size <= EPS * loop.size:
            break
    gain, double = residual.gain, S.astype(float)
    rounded = residual_of(problem, double, unit)
    loop = loop_of(problem, S, unit, residual)
    info = {**info, "newton_steps": taken}
    return Found(gain, double, info, Verdict(rounded.relative, loop))
