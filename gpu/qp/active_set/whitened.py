r"""Primal-dual active sets on whitened rows: one factorisation of P for the whole problem.

With :math:`P = LL^T`, a row b of the constraints is whitened once it becomes active,
:math:`y = L^{-1}b`. The rows Y of an active set A and their sides h give

.. math:: W\mu = Yt_0 - h, \quad W = YY^T, \quad t_0 = -L^{-1}q, \quad
          x = L^{-T}(t_0 - Y^T\mu),

so that an iteration costs a factorisation of the small matrix W and the whitening of rows that were
never active before; P is factored once, and inactive rows only enter through Bx. A row with two
sides, or a bound, has one signed state. Violated rows are added and rows with a multiplier of the
wrong sign dropped, all at once ([1]_; for this form [2]_, algorithm 4). The full exchange may
cycle: where the number of violations has not fallen for some steps, or more rows than unknowns
would be active or are violated at the start, the method fails with an error.

References
----------
.. [1] M. Hintermueller, K. Ito, K. Kunisch, "The primal-dual active set strategy as a semismooth
   Newton method", SIAM J. Optim. 13 (2003) 865-888.
.. [2] M. M. Kostreva, "Block pivot methods for solving the complementarity problem", Linear
   Algebra Appl. 21 (1978) 207-215.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gpu.arrays.dense import cholesky_begun, cholesky_solve, gram, lower_solve
from gpu.arrays.device_triangle import DeviceTriangle
from gpu.errors import NotConverged
from gpu.qp.data.qp_result import Step
from gpu.qp.data.standard_qp import Array, StandardQP
from skfem_adini.ground.arrays import to_host


class _Limits(NamedTuple):  # limits of the exchange
    hopeless: int = 3  # steps without fewer violations before the interior point
    trial: int = 4  # exchanges after which violations must have become half as many
    most: int = 60  # all steps; an interior point costs fifteen factorisations of n x n
    rounding: float = 64 * float(np.finfo(float).eps)  # allowed violation over the moduli of terms
    origin: float = 1e-10  # relative to the forces, with diag(P) = 1: a smaller x may be rounding
    softness: float = 1e-12  # of the largest W_ii, added to W: dependent rows share multipliers
    room: float = 0.9  # most active rows over the number of unknowns, with which W is singular


LIMITS = _Limits()


class WhitenedActiveSet:
    """Rows ``C x`` of a program, then its variables, in one numbering; `L` is the factor of P, by
    which `product` multiplies. Matrices stay where they are; sides and states are on the host,
    where a step through a short vector takes less than its launch on a device."""

    def __init__(self, p: StandardQP, L: Array, product: Callable[[Array], Array]) -> None:
        self.p, self.product, self.xp = p, product, p.xp
        on_host = self.xp is np
        self.to_host: Callable[[Array], np.ndarray] = np.asarray if on_host else to_host
        self.solve: Callable[..., Array] = (
            functools.partial(lower_solve, L) if on_host else DeviceTriangle(L).solve
        )
        self.m, self.n = p.row_low.size, p.q.size
        self.low = np.concatenate([self.to_host(p.row_low), self.to_host(p.lb)])
        self.high = np.concatenate([self.to_host(p.row_high), self.to_host(p.ub)])
        self.equal = self.low == self.high
        self.place = np.full(self.m + self.n, -1)
        xp = self.xp
        self.Y, self.W, self.count = xp.empty((0, self.n)), xp.empty((0, 0)), 0
        self.t0 = -self.solve(p.q)
        self.force = float(xp.abs(p.q).max())
        self.history: list[Step] = []
        self.spend: Callable[[], None] = lambda: None  # called after each step but the last

    def values(self, x: Array) -> Array:
        """Rows and variables at x."""
        return self.xp.concatenate([self.p.C @ x, x])

    def _rows(self, i: np.ndarray) -> Array:
        xp, split = self.xp, int(np.searchsorted(i, self.m))
        rows = self.p.C[xp.asarray(i[:split])]
        if split == i.size:
            return rows
        units = xp.zeros((i.size - split, self.n))
        units[xp.arange(i.size - split), xp.asarray(i[split:] - self.m)] = 1.0
        return xp.concatenate([rows, units])

    def whiten(self, i: np.ndarray) -> None:
        """Whiten the rows i, given in order, that were never active before."""
        new = i[self.place[i] < 0]
        if not new.size:
            return
        xp, k, more = self.xp, self.count, new.size
        Y = self.solve(self._rows(new).T).T
        if k + more > len(self.Y):
            room = k + more if not k else min(k + 2 * more, self.m + self.n)
            grown, square = xp.empty((room, self.n)), xp.empty((room, room))
            grown[:k], square[:k, :k] = self.Y[:k], self.W[:k, :k]
            self.Y, self.W = grown, square
        self.Y[k : k + more] = Y
        if k:
            cross = self.Y[:k] @ Y.T
            self.W[:k, k : k + more], self.W[k : k + more, :k] = cross, cross.T
        self.W[k : k + more, k : k + more] = gram(Y)
        self.place[new] = np.arange(k, k + more)
        self.count = k + more

    def factor(self, state: np.ndarray) -> None:
        """Factor W of the active rows of a state; on a device `check` raises where that failed."""
        xp = self.xp
        self.active = np.flatnonzero((state != 0) | self.equal)
        if self.active.size >= self.n:
            raise NotConverged("as many rows as unknowns")
        self.whiten(self.active)
        self.at = xp.asarray(self.place[self.active])
        self.WA = self.W[self.at[:, None], self.at] if self.at.size else self.W[:0, :0]
        soft = self.WA.copy()
        if self.at.size:
            soft.ravel()[:: len(soft) + 1] += LIMITS.softness * soft.diagonal().max()
        S, self.check = cholesky_begun(soft)
        self.solve_soft: Callable[[Array], Array] = (
            functools.partial(cholesky_solve, S)
            if xp is np or not self.at.size
            else DeviceTriangle(S).solve_both
        )
        at_high = state[self.active] > 0
        self.goal = np.where(at_high, self.high[self.active], self.low[self.active])

    def _multipliers(self, right: Array) -> Array:
        mu = self.solve_soft(right)
        return mu + self.solve_soft(right - self.WA @ mu)

    def _spread(self, mu: Array) -> Array:
        """``Y_A' mu``."""
        whole = self.xp.zeros(self.count)
        whole[self.at] = mu
        return self.Y[: self.count].T @ whole

    def point(self) -> tuple[Array, Array]:
        """x and the active multipliers of the factored state."""
        if not self.at.size:
            return self.solve(self.t0, transposed=True), self.t0[:0]
        t = self.Y[: self.count] @ self.t0
        mu = self._multipliers(t[self.at] - self.xp.asarray(self.goal))
        return self.solve(self.t0 - self._spread(mu), transposed=True), mu

    def refine(self, x: Array, mu: Array) -> tuple[Array, Array]:
        """One step of refinement with P itself."""
        p, xp = self.p, self.xp
        active = xp.asarray(self.active)
        whole = xp.zeros(self.m + self.n)
        whole[active] = mu
        r = -(self.product(x) + p.q + p.C.T @ whole[: self.m] + whole[self.m :])
        u = self.solve(r)
        if self.at.size:
            s = xp.asarray(self.goal) - self.values(x)[active]
            d = self._multipliers((self.Y[: self.count] @ u)[self.at] - s)
            mu, u = mu + d, u - self._spread(d)
        return x + self.solve(u, transposed=True), mu

    def run(self, state: Array) -> tuple[Array, Array]:
        """Exchange until nothing is violated; x and the multipliers of all rows and variables."""
        xp, state = self.xp, self.to_host(state)
        fewest, worst, stalled = self.m + self.n + 1, 0, 0
        while True:
            try:
                self.factor(state)
                x, mu = self.point()
                value = self.to_host(self.values(x))
                self.check()
            except np.linalg.LinAlgError:
                raise NotConverged("rows depend on each other") from None
            multiplier = np.zeros(self.m + self.n)
            multiplier[self.active] = self.to_host(mu)
            length = float(np.abs(value[self.m :]).max())
            # Where x is rounding of the forces, it has their size: P has a diagonal of ones.
            unit = self.force if length <= LIMITS.origin * self.force else min(1.0, self.force)
            size = LIMITS.rounding * (unit + np.abs(value) + length)
            below, above = self.low - value, value - self.high
            off = (state == 0) & ~self.equal
            add = off & ((below > size) | (above > size))
            drop = ~off & ~self.equal & (state * multiplier < 0.0)
            wrong = int(np.count_nonzero(add)) + int(np.count_nonzero(drop))
            self.history.append(Step(self.active.size, wrong))
            if not wrong:
                break
            worst = max(worst, wrong)
            stalled = 0 if wrong < fewest else stalled + 1
            fewest = min(fewest, wrong)
            slow = len(self.history) > LIMITS.trial and 2 * wrong > max(worst, 0.2 * self.n)
            slow = slow or (len(self.history) == 1 and wrong > LIMITS.room * self.n)
            if slow or stalled >= LIMITS.hopeless or len(self.history) >= LIMITS.most:
                raise NotConverged("the full exchange stalls")
            self.latest = x, multiplier
            self.spend()
            state = self._next(state, add, drop, below, above)
        x, mu = self.refine(x, mu)
        whole = xp.zeros(self.m + self.n)
        whole[xp.asarray(self.active)] = mu
        held = self.active >= self.m
        if held.any():
            x[xp.asarray(self.active[held] - self.m)] = xp.asarray(self.goal[held])
        return x, whole

    def _next(
        self,
        state: np.ndarray,
        add: np.ndarray,
        drop: np.ndarray,
        below: np.ndarray,
        above: np.ndarray,
    ) -> np.ndarray:
        room = int(LIMITS.room * self.n) - self.active.size + np.count_nonzero(drop)
        if room <= 0:
            raise NotConverged("too many rows are active")
        if np.count_nonzero(add) > room:
            violation = np.where(add, np.maximum(below, above), -np.inf)
            least = np.sort(violation)[-max(int(room) // 2, 1)]
            add = add & (violation >= least)
        state = np.where(drop, 0, state)
        return np.where(add, np.where(above > below, 1, -1), state).astype(np.int8)
