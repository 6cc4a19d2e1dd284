r"""Interior point for a convex quadratic program, with proximal terms.

Inequality rows get a slack w, ``Cx - w = 0``, whose bounds are the row's; then all bounds are
bounds of variables :math:`v = (x, w)`, with distances :math:`t_l = v - l`, :math:`t_u = u - v`
and multipliers :math:`z_l, z_u > 0`. A step is Newton's for

.. math:: Px + q + C^Ty - z_l + z_u + \rho(x - x_k) = 0, \quad
          Cx - w - \delta(y - y_k) = r, \quad t_l z_l = t_u z_u = \sigma\mu,

predictor and corrector from one factorisation ([1]_), with further corrections of products that
are off centre ([2]_). The proximal terms in x and y [3]_ leave the solution where it is, and make
every system quasidefinite: P may be semidefinite or zero, rows may depend on each other.

References
----------
.. [1] S. Mehrotra, "On the implementation of a primal-dual interior point method", SIAM J. Optim.
   2 (1992) 575-601.
.. [2] J. Gondzio, "Multiple centrality corrections in a primal-dual method for linear
   programming", Comput. Optim. Appl. 6 (1996) 137-156.
.. [3] M. P. Friedlander, D. Orban, "A primal-dual regularized interior-point method for convex
   quadratic programs", Math. Program. Comput. 4 (2012) 71-107.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gpu.qp.data.standard_qp import ROUNDING, Array, StandardQP, largest
from gpu.qp.interior_point.kkt_system import System


class _Limits(NamedTuple):  # limits of the iteration; matrices are scaled to about one
    steps: int = 200  # a few dozen are usual
    stalled: int = 40  # steps in which neither residual nor merit falls by a tenth
    at_floor: int = 10  # the same at the least products: the rest is rounding
    near: float = 1e-4  # relative: below, extended precision can end from the active set
    coarse: float = 1e-7  # merit above which points are not judged while it falls
    slow: int = 2  # steps in which it does not become half as large, and no longer falls
    settling: float = 1e-2  # residual below which an active set is tried, at the cost of a step
    doubtful: float = 0.1  # of the held sides: most whose multiplier is near the distance then
    spare: float = 0.25  # of the unknowns that are not held: the same
    corner: float = 0.02  # of the held sides: so many always may
    apart: float = 10.0  # quotient of multiplier and distance beyond which they are not near
    settled: float = 1e-7  # residual below which an active set is tried whatever it is
    below_target: int = 2  # steps without gain after which a point below the target is taken
    proximal: float = 1e-6  # first proximal terms; they fall with the average product
    corrections: int = 2  # most of Gondzio's, each of which costs one solve
    central: float = 1e-4  # of the average product: no product is below after a step
    parts: tuple[float, ...] = (0.999, 0.99, *(6 * (0.9,)))  # of the step, one after the other
    least_proximal: float = 1e-14  # below, pivots are rounding
    most_proximal: float = 1e-3  # above, steps hardly move
    solved: float = 1e-8  # relative residual of an accurate solve
    fine: float = 1e-10  # of a step that is taken: the next one makes up for the rest
    boost: float = 1e8  # how much the proximal terms may grow to reach it
    multiplier: float = 1e3  # largest at the start, over their size: where distances are tiny
    regularisation: float = 1e-10  # at the start: pivots with six digits
    loose: float = 1e-6  # diagonal of variables without a bound at the start; of others 1
    soft: float = 50.0  # minus that of inequality rows: of those tried, the one of fewest steps
    firm: float = 1e-8  # minus that of equality rows: too small to move what is determined


LIMITS = _Limits()


logger = logging.getLogger(__name__)


@dataclass
class Step:
    """Direction in all unknowns."""

    v: Array
    y: Array
    z_low: Array
    z_high: Array


class InteriorPoint:
    """Iterates x, w, y with the sides of (x, w)."""

    def __init__(
        self,
        program: StandardQP,
        system: System,
        separate: bool = False,
        spread: float = 1.0,
    ) -> None:
        self.p, self.system, self.xp = program, system, program.xp
        xp = self.xp
        self.n = program.q.size
        self.rows = xp.flatnonzero(~program.equality)
        self.equal = xp.flatnonzero(program.equality)
        self.linear = separate
        low = xp.concatenate([program.lb, program.row_low[self.rows]])
        high = xp.concatenate([program.ub, program.row_high[self.rows]])
        self.count = int(xp.isfinite(low).sum() + xp.isfinite(high).sum())
        self.reg, self.boost, self.last, self.floor = LIMITS.proximal, 1.0, 1.0, 0.0
        begin = (program, system, self.rows, low, high)
        self.v, self.y, self.s = inside(*begin, spread) if spread else balanced(*begin)
        self._settle()

    def _dual(self, x: Array, y: Array) -> Array:
        """Gradient of the Lagrangian in (x, w) without the bounds."""
        return self.xp.concatenate([self.p.gradient(x, y), -y[self.rows]])

    def _primal(self) -> Array:
        p, x, w = self.p, self.v[: self.n], self.v[self.n :]
        r = self.xp.where(p.equality, p.row_low, 0.0) - p.C @ x
        r[self.rows] += w
        return r

    @property
    def mu(self) -> float:
        """Average product of a distance and its multiplier."""
        s = self.s
        return float((s.z_low * s.t_low).sum() + (s.z_high * s.t_high).sum()) / max(self.count, 1)

    def sides(self) -> tuple[Array, Array]:
        """Sides whose multiplier is larger than the distance, of bounds and of rows."""
        xp, s = self.xp, self.s
        low = s.has_low & (s.z_low > s.t_low)
        high = s.has_high & (s.z_high > s.t_high)
        both = low & high
        low, high = low & ~(both & (s.z_high > s.z_low)), high & ~(both & (s.z_high <= s.z_low))
        state = high.astype(np.int8) - low.astype(np.int8)
        rows = xp.zeros(self.y.size, dtype=np.int8)
        rows[self.rows] = state[self.n :]
        return state[: self.n], rows

    def doubts(self) -> tuple[int, int]:
        """How many sides cannot be told from those that are held, or may be; and how many are."""
        s, doubtful, held = self.s, 0, 0
        for has, t, z in ((s.has_low, s.t_low, s.z_low), (s.has_high, s.t_high, s.z_high)):
            ratio = z[has] / t[has]
            near = (ratio < LIMITS.apart) & (ratio * LIMITS.apart > 1.0)
            doubtful, held = doubtful + int(near.sum()), held + int((ratio > 1.0).sum())
        return doubtful, held

    def _settle(self) -> None:
        """The residuals of the present iterate."""
        self.rd = self._dual(self.v[: self.n], self.y) - self.s.z_low + self.s.z_high
        self.rp = self._primal()

    def merit(self) -> float:
        """Largest of the average product and of the residuals, in scaled units."""
        return largest(self.mu, *(float(abs(r).max()) for r in (self.rd, self.rp) if r.size))

    def factor(self) -> None:
        """Factor the system of the present iterate."""
        xp, n = self.xp, self.n
        self.sigma = self.s.curvature()
        sizes = [max(1.0, float(xp.abs(a).max())) if a.size else 1.0 for a in (self.v, self.y)]
        low, high = LIMITS.least_proximal, LIMITS.most_proximal
        rho, delta = (min(self.boost * max(self.reg / size, low), high) for size in sizes)
        E = xp.full(self.y.size, delta)
        self.slack = self.sigma[n:] + rho
        E[self.rows] += 1.0 / self.slack
        self.system.factor(self.sigma[:n] + rho, E, rough=True)

    def direction(
        self,
        rd: Array,
        rp: Array,
        c_low: Array,
        c_high: Array,
        fine: float = LIMITS.fine,
        trusted: bool = True,
    ) -> Step:
        """Newton's direction for dual and primal right-hand sides and for the products."""
        s, n = self.s, self.n
        off_low, off_high = self.off_low, self.off_high
        f = rd + (c_low - s.z_low * off_low) / s.t_low - (c_high - s.z_high * off_high) / s.t_high
        rows = rp.copy()
        rows[self.rows] += f[n:] / self.slack
        dx, dy = self.system.solve(f[:n], rows, fine, trusted=trusted)
        dw = (f[n:] + dy[self.rows]) / self.slack
        dv = self.xp.concatenate([dx, dw])
        dz_low = (c_low - s.z_low * (dv + off_low)) / s.t_low
        dz_high = (c_high - s.z_high * (off_high - dv)) / s.t_high
        return Step(dv, dy, dz_low, dz_high)

    def lengths(self, d: Step) -> tuple[float, float]:
        """Largest steps that keep distances and multipliers positive."""
        s, xp = self.s, self.xp
        dt_low, dt_high = d.v + self.off_low, self.off_high - d.v

        def reach(value: Array, change: Array, has: Array) -> float:
            rate = xp.where(has, change, 0.0) / xp.where(has, value, 1.0)
            fastest = -float(rate.min()) if rate.size else 0.0
            return 1.0 / fastest if fastest > 0.0 or fastest != fastest else np.inf

        primal = min(reach(s.t_low, dt_low, s.has_low), reach(s.t_high, dt_high, s.has_high))
        dual = min(reach(s.z_low, d.z_low, s.has_low), reach(s.z_high, d.z_high, s.has_high))
        return min(primal, 1.0), min(dual, 1.0)

    def central(self, d: Step, ap: float, ad: float) -> tuple[float, float]:
        """Steps shortened until no product is left far below the average."""
        s, xp = self.s, self.xp
        dt_low, dt_high = d.v + self.off_low, self.off_high - d.v
        for part in LIMITS.parts:
            low = (s.t_low + ap * dt_low) * (s.z_low + ad * d.z_low)
            high = (s.t_high + ap * dt_high) * (s.z_high + ad * d.z_high)
            mu = (float(low[s.has_low].sum()) + float(high[s.has_high].sum())) / self.count
            least = min(
                float(xp.where(s.has_low, low, xp.inf).min()),
                float(xp.where(s.has_high, high, xp.inf).min()),
            )
            if least >= LIMITS.central * mu:
                break
            ap, ad = part * ap, part * ad
        return ap, ad

    def step(self) -> tuple[float, float]:
        """One predictor-corrector step; its two lengths."""
        xp, s = self.xp, self.s
        mu = self.mu
        self.reg = max(min(self.reg, 1e-1 * LIMITS.proximal * mu), LIMITS.regularisation)
        self.boost = max(1.0, 0.2 * self.boost)
        right = -self.rd, self.rp
        self.off_low = xp.where(s.has_low, self.v - xp.where(s.has_low, s.low, 0.0) - s.t_low, 0.0)
        self.off_high = xp.where(
            s.has_high, xp.where(s.has_high, s.high, 0.0) - self.v - s.t_high, 0.0
        )
        d, ap, ad = self._predicted(right), 1.0, 1.0
        if self.count:
            d, ap, ad = self._corrected(d, right, mu)
            back = max(0.995, 1.0 - mu) if mu < 1 else 0.995
            ap, ad = self.central(d, min(1.0, back * ap), min(1.0, back * ad))
        dt_low, dt_high = d.v + self.off_low, self.off_high - d.v
        self.v = self.v + ap * d.v
        s.t_low, s.t_high = s.t_low + ap * s.has_low * dt_low, s.t_high + ap * s.has_high * dt_high
        self.y = self.y + ad * d.y
        s.z_low, s.z_high = s.z_low + ad * d.z_low, s.z_high + ad * d.z_high
        self.last = min(ap, ad)
        self._settle()
        return ap, ad

    def _predicted(self, right: tuple[Array, Array]) -> Step:
        """Newton's direction for products of zero, regularised until the system is accurate."""
        s = self.s
        while True:
            try:
                self.factor()
                products = -(s.z_low * s.t_low), -(s.z_high * s.t_high)
                fine = LIMITS.solved if self.count else LIMITS.fine
                d = self.direction(*right, *products, fine, trusted=False)
                if self.system.accuracy <= LIMITS.solved or self.boost > LIMITS.boost:
                    return d
            except np.linalg.LinAlgError:
                if self.boost > LIMITS.boost:
                    raise
            self.boost *= 10.0

    def _corrected(
        self, d: Step, right: tuple[Array, Array], mu: float
    ) -> tuple[Step, float, float]:
        """Mehrotra's corrector of the predictor d, Gondzio's corrections, and their lengths."""
        s = self.s
        ap, ad = self._lengths(d)
        dt_low, dt_high = d.v + self.off_low, self.off_high - d.v
        ahead = (
            float(
                ((s.t_low + ap * dt_low) * (s.z_low + ad * d.z_low)).sum()
                + ((s.t_high + ap * dt_high) * (s.z_high + ad * d.z_high)).sum()
            )
            / self.count
        )
        sigma = min(max(ahead / mu, 0.0), 1.0) ** 4 if mu > 0.0 else 0.0
        second = 1.0
        if self.last < 0.1:
            # Products far off centre stop both steps: bring them back before going on.
            sigma, second = max(sigma, 0.8), 0.0
        x = self.v[: self.n]
        size = abs(float(self.p.q @ x)) + abs(float(x @ (self.p.P @ x)))
        self.floor = 1e-12 * size / self.count
        target = max(sigma * mu, self.floor)
        c_low = s.has_low * (target - s.z_low * s.t_low - second * dt_low * d.z_low)
        c_high = s.has_high * (target - s.z_high * s.t_high - second * dt_high * d.z_high)
        d = self.direction(*right, c_low, c_high)
        ap, ad = self.lengths(d)
        for _ in range(LIMITS.corrections):
            if min(ap, ad) > 0.95 or target <= 0:
                break
            e_low, e_high = self._off_centre(d, ap, ad, target)
            tried = self.direction(*right, c_low + e_low, c_high + e_high)
            tp, td = self.lengths(tried)
            if tp + td < ap + ad + 0.02:
                break
            d, ap, ad, c_low, c_high = tried, tp, td, c_low + e_low, c_high + e_high
        if not self.linear:
            ap = ad = min(ap, ad)
        return d, ap, ad

    def _lengths(self, d: Step) -> tuple[float, float]:
        """The same steps for x and for the multipliers, unless the problem allows two."""
        ap, ad = self.lengths(d)
        return (ap, ad) if self.linear else (min(ap, ad),) * 2

    def _off_centre(self, d: Step, ap: float, ad: float, target: float) -> tuple[Array, Array]:
        """Corrections that bring products, after a longer step, to .1 to 10 times the target."""
        s, xp = self.s, self.xp
        bp, bd = min(1.0, 1.5 * ap + 0.1), min(1.0, 1.5 * ad + 0.1)

        def lacking(t: Array, z: Array, dt: Array, dz: Array, has: Array) -> Array:
            product = (t + bp * dt) * (z + bd * dz)
            short = xp.clip(product, 0.1 * target, 10 * target) - product
            return has * xp.maximum(short, -10 * target)

        return (
            lacking(s.t_low, s.z_low, d.v + self.off_low, d.z_low, s.has_low),
            lacking(s.t_high, s.z_high, self.off_high - d.v, d.z_high, s.has_high),
        )


Finish = Callable[[Array, Array, tuple[Array, Array]], bool]


def interior_point(
    program: StandardQP,
    system: System,
    measure: Callable[[Array, Array], float],
    target: float,
    separate: bool = False,
    spread: float = 1.0,
    hurried: bool = False,
    finish: Finish | None = None,
    watched: bool = False,
) -> tuple[Array, Array, tuple[Array, Array], int]:
    """Iterate until `measure` is below `target` and nothing improves, or if `hurried` until only
    rounding is left (extended precision is to follow). Returns x and y where `measure` was least,
    the signed states of bounds and rows there, and the number of steps. `finish` tells
    whether a point and its states near the end lead to the solution. Points on their way are
    judged only if `watched`."""
    iterate = InteriorPoint(program, system, separate, spread)
    best, least, stalled, steps, slow, lowest = np.inf, np.inf, 0, 0, 0, np.inf
    x, y, sides = iterate.v[: iterate.n], iterate.y, iterate.sides()
    room, last = iterate.n - iterate.equal.size, True
    most = np.inf  # doubtful sides with which an active set is tried

    def patience() -> int:
        at_floor = best <= LIMITS.near and iterate.mu <= 2.0 * iterate.floor
        if best <= target:
            return 0 if at_floor else LIMITS.below_target
        return LIMITS.at_floor if hurried and at_floor else LIMITS.stalled

    while steps < LIMITS.steps and best > ROUNDING.sharp and stalled < patience():
        try:
            iterate.step()
        except np.linalg.LinAlgError:
            break
        steps += 1
        merit = iterate.merit()
        slow = 0 if merit < 0.5 * lowest else slow + 1
        lowest = min(lowest, merit)
        doubtful, held = iterate.doubts()
        few = max(LIMITS.corner * held, min(LIMITS.doubtful * held, LIMITS.spare * (room - held)))
        likely = held <= room and doubtful <= min(few, most)
        coming = merit > LIMITS.coarse and slow < LIMITS.slow and not likely
        if watched or not coming:
            value = measure(iterate.v[: iterate.n], iterate.y)
        if coming:
            continue
        logger.debug(
            "%3d mu %.1e residual %.2e scaled %.2e boost %.0e",
            steps, iterate.mu, value, merit, iterate.boost,
        )  # fmt: skip
        if not np.isfinite(merit):
            break
        better = value < 0.9 * best or (best > target and merit < 0.9 * least)
        stalled = 0 if better else stalled + 1
        least = min(least, merit)
        if value < best:
            best, x, y = value, iterate.v[: iterate.n], iterate.y
            sides = iterate.sides()
        if finish is None or not target < best <= LIMITS.settling:
            continue
        if likely or (last and best <= LIMITS.settled):
            last, most = last and best > LIMITS.settled, 0.5 * doubtful
            if finish(iterate.v[: iterate.n], iterate.y, iterate.sides()):
                break
    return x, y, sides, steps


@dataclass
class Sides:
    """Distances to the sides that exist, and multipliers; 1 and 0 where there is none."""

    low: Array
    high: Array
    has_low: Array
    has_high: Array
    t_low: Array
    t_high: Array
    z_low: Array
    z_high: Array

    def curvature(self) -> Array:
        """Diagonal that the sides add to the Hessian."""
        return self.z_low / self.t_low + self.z_high / self.t_high


Start = tuple[Array, Array, Sides]  # v = (x, w), y, sides


def balanced(p: StandardQP, system: System, rows: Array, low: Array, high: Array) -> Start:
    """Mehrotra's start (1992, section 7): one shift of all distances, one of all multipliers."""
    xp, n = p.xp, p.q.size
    has_low, has_high = xp.isfinite(low), xp.isfinite(high)
    bounded = (has_low | has_high)[:n]
    _factor(p, system, rows, xp.where(bounded, 1.0, LIMITS.loose), LIMITS.firm)
    goal = xp.where(bounded, xp.clip(xp.zeros_like(p.q), p.lb, p.ub), 0.0)
    x, y = system.solve(goal - p.q, xp.clip(xp.zeros_like(p.row_low), p.row_low, p.row_high))
    v = xp.concatenate([x, (p.C @ x)[rows]])
    t_low = v - xp.where(has_low, low, 0.0)
    t_high = xp.where(has_high, high, 0.0) - v
    g = xp.concatenate([p.gradient(x, y), -y[rows]])
    g = xp.where(has_low & has_high, 0.5 * g, g)
    z_low, z_high = g, -g
    if bool((has_low | has_high).any()):
        t = xp.concatenate([t_low[has_low], t_high[has_high]])
        z = xp.concatenate([z_low[has_low], z_high[has_high]])
        dt, dz = max(-1.5 * float(t.min()), 0.0), max(-1.5 * float(z.min()), 0.0)
        product = float(((t + dt) * (z + dz)).sum())
        if product <= 0.0:
            dt, dz = dt + 1.0, dz + 1.0
            product = float(((t + dt) * (z + dz)).sum())
        shift = 0.5 * product / float((z + dz).sum()), 0.5 * product / float((t + dt).sum())
        t_low, t_high = t_low + dt + shift[0], t_high + dt + shift[0]
        z_low, z_high = z_low + dz + shift[1], z_high + dz + shift[1]
    t_low, t_high = xp.where(has_low, t_low, 1.0), xp.where(has_high, t_high, 1.0)
    z_low, z_high = xp.where(has_low, z_low, 0.0), xp.where(has_high, z_high, 0.0)
    return v, y, Sides(low, high, has_low, has_high, t_low, t_high, z_low, z_high)


def inside(
    p: StandardQP, system: System, rows: Array, low: Array, high: Array, spread: float
) -> Start:
    """A point well inside its bounds, with multipliers of at least the size `spread`."""
    xp, n = p.xp, p.q.size
    has_low, has_high = xp.isfinite(low), xp.isfinite(high)
    _factor(p, system, rows, xp.ones(n), LIMITS.regularisation)
    target = xp.clip(xp.zeros_like(p.row_low), p.row_low, p.row_high)
    goal = xp.clip(xp.zeros_like(p.q), p.lb, p.ub)
    x, y = system.solve(goal - p.q, target)
    v = xp.concatenate([x, (p.C @ x)[rows]])
    outside = xp.maximum(low - v, v - high)
    push = max(1.0, 1.5 * float(outside.max())) if outside.size else 1.0
    push = xp.minimum(push, 0.25 * (high - low))
    v = xp.where(has_low, xp.maximum(v, low + push), v)
    v = xp.where(has_high, xp.minimum(v, high - push), v)
    t_low = xp.maximum(xp.where(has_low, v - xp.where(has_low, low, 0.0), 1.0), push)
    t_high = xp.maximum(xp.where(has_high, xp.where(has_high, high, 0.0) - v, 1.0), push)
    t_low, t_high = xp.where(has_low, t_low, 1.0), xp.where(has_high, t_high, 1.0)
    x = v[:n]
    g = xp.concatenate([p.gradient(x, y), -y[rows]])
    up, down = xp.maximum(g, 0.0), xp.maximum(-g, 0.0)
    wrong = xp.where(has_low, 0.0, up) + xp.where(has_high, 0.0, down)
    wrong = xp.where(has_low | has_high, wrong, 0.0)
    dual_push = max(spread, float(wrong.max()) if wrong.size else 1.0)
    product = dual_push * (float(push.max()) if push.size else 1.0)
    z_low = xp.where(has_low, up + xp.minimum(product / t_low, LIMITS.multiplier * dual_push), 0.0)
    z_high = xp.where(
        has_high, down + xp.minimum(product / t_high, LIMITS.multiplier * dual_push), 0.0
    )
    return v, y, Sides(low, high, has_low, has_high, t_low, t_high, z_low, z_high)


def _factor(p: StandardQP, system: System, rows: Array, diagonal: Array, least: float) -> None:
    """Factor with a regularisation of equality rows that grows until dependent rows succeed."""
    while True:
        E = p.xp.full(p.row_low.size, least)
        E[rows] = LIMITS.soft
        try:
            system.factor(diagonal, E, rough=True)
        except np.linalg.LinAlgError:
            if least >= 1.0:
                raise
            least *= 100.0
        else:
            return
