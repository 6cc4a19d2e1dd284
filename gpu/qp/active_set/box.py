r"""Primal-dual active sets for a strictly convex QP with bounds and a few equality rows.

The state of a variable is -1 (fixed at its lower bound), 0 (free) or +1 (fixed at its upper bound).
A state determines x and the multipliers by one linear system. Free variables outside their bounds
and fixed ones with a multiplier of the wrong sign are violated and change their state, all at once.
This full exchange ([1]_, [2]_; as a semismooth Newton method [3]_) takes few steps but may cycle.
When the number of violated indices has not fallen below its best value in `LIMITS.stalled` steps
(the count of [4]_), the method follows a path [5]_: bounds and multipliers are shifted until the
best state so far solves the problem, and the shift is continuously reduced to zero. On it x is
continuous and piecewise linear, one variable changes its state at each kink, and as P is positive
definite no state returns, so that it ends (ties go to the last index).

Equality rows enter by proximal steps in their multiplier [6]_: for a centre y_c

.. math:: \min_{l \le x \le u} \tfrac12 x^TPx + q^Tx + y_c^T(Ax - b) + \tfrac1{2\rho}|Ax - b|^2

is a problem with bounds only, its Hessian is positive definite, and
:math:`y = y_c + (Ax - b)/\rho` is the next centre. With the free set F every system is

.. math:: \begin{pmatrix} P_{FF} & A_F^T \\ A_F & -\rho I \end{pmatrix}
          \begin{pmatrix} dx \\ dy \end{pmatrix} =
          \begin{pmatrix} r \\ s \end{pmatrix},

whose Schur complement :math:`A_FP_{FF}^{-1}A_F^T + \rho I` is regular for dependent rows and for
fewer free variables than rows; rho is small, two or three centres are the rule. At a fixed state
they are the iterative refinement of the system with rho = 0. If the rows contradict the bounds,
the steps of y tend to a vector that separates them, which is verified.

References
----------
.. [1] M. M. Kostreva, "Block pivot methods for solving the complementarity problem", Linear
   Algebra Appl. 21 (1978) 207-215.
.. [2] L. F. Portugal, J. J. Judice, L. N. Vicente, "A comparison of block pivoting and
   interior-point algorithms for linear least squares problems with nonnegative variables",
   Math. Comp. 63 (1994) 625-643.
.. [3] M. Hintermueller, K. Ito, K. Kunisch, "The primal-dual active set strategy as a semismooth
   Newton method", SIAM J. Optim. 13 (2003) 865-888.
.. [4] J. Kim, H. Park, "Fast nonnegative matrix factorization: an active-set-like method and
   comparisons", SIAM J. Sci. Comput. 33 (2011) 3261-3281.
.. [5] H. J. Ferreau, H. G. Bock, M. Diehl, "An online active set strategy to overcome the
   limitations of explicit MPC", Int. J. Robust Nonlinear Control 18 (2008) 816-830.
.. [6] R. T. Rockafellar, "Augmented Lagrangians and applications of the proximal point algorithm
   in convex programming", Math. Oper. Res. 1 (1976) 97-116.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gpu.arrays.dense import cholesky, cholesky_solve, lower_solve, symmetric_product
from gpu.errors import Infeasible, NotConverged
from gpu.qp.data.qp_result import Step


class _Limits(NamedTuple):  # limits of the exchange
    stalled: int = 5  # steps without fewer violations that count as a cycle, except on a path
    centres: int = 100  # most proximal points of equality rows: usually two or three
    rounding: float = 64 * float(np.finfo(float).eps)  # allowed violation over the moduli of terms
    rho: float = 1e-8  # over the largest a'P^-1 a of a row: far below that of free variables
    least_rho: float = 1e-13  # the same, far above the rounding of the Schur complement


LIMITS = _Limits()


@dataclass(frozen=True)
class BoxQP:
    """Problem in units where the diagonal of P lies in [1/2, 2] and the rows of A have norm 1."""

    P: np.ndarray
    q: np.ndarray
    A: np.ndarray
    b: np.ndarray
    lb: np.ndarray
    ub: np.ndarray

    def gradient(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Gradient of the Lagrangian without the bounds, ``Px + q + A'y``."""
        return symmetric_product(self.P, x) + self.q + self.A.T @ y

    def terms(self, i: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Sum of the moduli of the terms in the entries i of the gradient."""
        return (
            np.abs(self.P[i]) @ np.abs(x) + np.abs(self.q[i]) + np.abs(self.A[:, i].T) @ np.abs(y)
        )

    def hold(self, x: np.ndarray, state: np.ndarray) -> np.ndarray:
        """`x` with the fixed variables at their bounds."""
        return np.where(state < 0, self.lb, np.where(state > 0, self.ub, x))

    def slack(self, state: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Quantities that must not be negative, shape (2, n): of free variables the distances to
        both bounds, of fixed ones the multiplier towards the bound, then infinity.
        """
        held = state != 0
        pressure = np.where(self.lb < self.ub, -state * self.gradient(x, y), np.inf)
        return np.stack(
            [np.where(held, pressure, x - self.lb), np.where(held, np.inf, self.ub - x)]
        )

    def row_rounding(self) -> np.ndarray:
        """Rounding error of ``Ax`` for an x of the size of q."""
        return LIMITS.rounding * np.abs(self.A).sum(axis=1) * np.abs(self.q).max()

    def row_errors(self, x: np.ndarray) -> tuple[float, float]:
        """Largest residual of a row relative to its terms: whole, and beyond the rounding of q."""
        terms = np.abs(self.A) @ np.abs(x) + np.abs(self.b)
        residual = np.abs(self.A @ x - self.b)
        beyond = np.maximum(residual - self.row_rounding(), 0.0)
        size = np.where(terms > 0, terms, 1.0)
        return float(np.max(residual / size)), float(np.max(beyond / size))

    def separator(self, state: np.ndarray, y: np.ndarray, tol: float) -> np.ndarray | None:
        """A y with ``max (A'y)'x < y'b`` over the box, by more than `tol` times the terms. It is
        searched for near the given y, where ``A'y`` vanishes on the free variables.
        """
        U, size, _ = np.linalg.svd(self.A[:, state == 0], full_matrices=False)
        U = U[:, size > LIMITS.rounding * size.max(initial=0.0)]
        y = y - U @ (U.T @ y)
        c = self.A.T @ y
        c[np.abs(c) <= LIMITS.rounding * (np.abs(self.A.T) @ np.abs(y))] = 0.0
        corner = np.where(c > 0, self.ub, np.where(c < 0, self.lb, 0.0))
        margin = y @ self.b - c @ corner
        terms = np.abs(y) @ np.abs(self.b) + np.abs(c) @ np.abs(corner)
        return y if margin > tol * terms + np.abs(y) @ self.row_rounding() else None

    def guess(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """State in which each variable alone, with the others fixed, would be optimal."""
        t = x - self.gradient(x, y) / self.P.diagonal()
        return (t > self.ub).astype(np.int8) - (t < self.lb).astype(np.int8)


class FreeBlock:
    """Factor of the system of the free variables, see the module's second formula."""

    def __init__(self, problem: BoxQP, state: np.ndarray, rho: float) -> None:
        self.state = state.copy()
        self.free = np.flatnonzero(state == 0)
        self.L = cholesky(problem.P[self.free[:, None], self.free])
        self.X = lower_solve(self.L, problem.A[:, self.free].T)
        self.S = cholesky(self.X.T @ self.X + rho * np.eye(len(problem.b)))

    def solve(self, r: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Solve for (dx, dy)."""
        u = lower_solve(self.L, r)
        dy = cholesky_solve(self.S, self.X.T @ u - s)
        return lower_solve(self.L, u - self.X @ dy, transposed=True), dy


class ActiveSet:
    """Iterate of the method: state, x, y and the factor from which they were computed."""

    def __init__(
        self, problem: BoxQP, state: np.ndarray, x: np.ndarray, y: np.ndarray, L: np.ndarray
    ) -> None:
        self.problem = problem
        self.state = state
        self.x = x
        self.y = y
        self.compliance = float(np.max(lower_solve(L, problem.A.T) ** 2, initial=0.0)) or 1.0
        self.rho = LIMITS.rho * self.compliance
        self.history: list[Step] = []
        self.spend: Callable[[], None] = lambda: None  # called after each step but the last
        self.block: FreeBlock | None = None

    def point(self, problem: BoxQP, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The x and y of the current state in `problem`, by one correction of x."""
        if self.block is None or not np.array_equal(self.block.state, self.state):
            self.block = FreeBlock(self.problem, self.state, self.rho)
        x = problem.hold(self.x, self.state)
        free = self.block.free
        dx, dy = self.block.solve(-problem.gradient(x, centre)[free], problem.b - problem.A @ x)
        x[free] += dx
        return x, centre + dy

    def violated(self, slack: np.ndarray, allowance: float) -> np.ndarray:
        """Indices whose slack is negative by more than `allowance` times the terms of a row."""
        p = self.problem
        violation = -slack.min(axis=0)
        # 2|x|_1 bounds |P||x|, as entries are at most 2: only doubtful cases are compared exactly.
        bound = 2 * np.abs(self.x).sum() + np.abs(p.q) + np.abs(self.y).sum()
        i = np.flatnonzero((violation > 0) & (violation <= allowance * bound))
        violation[i[violation[i] <= allowance * p.terms(i, self.x, self.y)]] = 0.0
        return np.flatnonzero(violation > 0)

    def exchange(self, i: np.ndarray, order: np.ndarray) -> None:
        """Free the fixed variables of i; fix the free ones at the bound with the lower `order`."""
        side = np.where(order[0] < order[1], -1, 1)
        self.state[i] = np.where(self.state[i] == 0, side, 0)

    def settle(self, tol: float, max_steps: int) -> None:
        """Full exchanges until nothing is violated or progress stalls; then single ones."""
        centre = self.y
        fewest, stalled = self.state.size + 1, 0
        while stalled < LIMITS.stalled:
            self.x, self.y = self.point(self.problem, centre)
            slack = self.problem.slack(self.state, self.x, self.y)
            wrong = self.violated(slack, LIMITS.rounding)
            self.record(wrong, max_steps)
            if not wrong.size:
                return
            stalled = 0 if wrong.size < fewest else stalled + 1
            if wrong.size <= fewest:
                fewest, best = wrong.size, self.state.copy()
            self.exchange(wrong, slack[:, wrong])
        self.state = best
        self.follow_path(centre, tol, max_steps)

    def follow_path(self, centre: np.ndarray, tol: float, max_steps: int) -> None:
        """Single exchanges along the path from a problem that the current state solves."""
        p = self.problem
        self.x, self.y = self.point(p, centre)
        slack = p.slack(self.state, self.x, self.y)
        shift = np.where(slack < 0, -2.0 * slack, 0.0)
        dq, free = self.state * shift[0], self.state == 0
        weight = 1.0
        while True:
            easier = replace(
                p,
                q=p.q - weight * dq,
                lb=p.lb - weight * free * shift[0],
                ub=p.ub + weight * free * shift[1],
            )
            here = easier.slack(self.state, *self.point(easier, centre))
            self.x, self.y = self.point(p, centre)
            there = p.slack(self.state, self.x, self.y)
            wrong = self.violated(there, max(LIMITS.rounding, 0.1 * tol))
            self.record(wrong, max_steps)
            if not wrong.size:
                return
            here, there = np.maximum(here[:, wrong], 0.0), there[:, wrong]
            reach = np.full_like(here, np.inf)
            np.divide(here, here - np.minimum(there, 0.0), out=reach, where=there < 0)
            first = reach.min(axis=0)
            last = np.flatnonzero(first == first.min())[-1:]
            weight *= 1.0 - first[last[0]]
            self.exchange(wrong[last], reach[:, last])

    def record(self, wrong: np.ndarray, max_steps: int) -> None:
        """Count a step; raise `NotConverged` at the limit of steps."""
        self.history.append(Step(int(np.count_nonzero(self.state)), wrong.size))
        if wrong.size and len(self.history) >= max_steps:
            raise NotConverged(
                f"the active set has not settled in {max_steps} steps, {wrong.size} variables "
                "are violated: pass start= from a nearby problem, or regularise P"
            )
        if wrong.size:
            self.spend()

    def run(self, tol: float, max_steps: int) -> None:
        """Exchange until the active set is right; with equality rows, for each proximal centre."""
        p = self.problem
        if not p.b.size:
            self.settle(tol, max_steps)
            self.x, self.y = self.point(p, self.y)
            return
        error, refined = np.inf, False
        for _ in range(LIMITS.centres):
            centre = self.y
            self.settle(tol, max_steps)
            before, (whole, error) = error, p.row_errors(self.x)
            if error <= LIMITS.rounding / 16:
                # A bound on rounding may hide a violation that one more centre removes.
                if refined or whole <= LIMITS.rounding / 16:
                    return
                refined = True
                continue
            if 0.5 * before < error <= 0.1 * tol:
                return
            separator = p.separator(self.state, centre - self.y, tol)
            if separator is not None:
                raise Infeasible("no point of the box satisfies A x = b", separator)
            if error > 0.01 * before:
                self.rho = max(0.01 * self.rho, LIMITS.least_rho * self.compliance)
                self.block = None
        if error <= tol:
            return
        raise NotConverged(
            f"the equality rows hold to {error:.1e} only, and are not seen to contradict the "
            "bounds: they may be almost dependent, or almost infeasible; drop or rescale rows"
        )
