"""Where the interior point begins: distances and multipliers that are positive and of one size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpu.qp.data.standard_qp import Array, StandardQP
from gpu.qp.interior_point.kkt_system import System

# A multiplier at the start is at most so many times the size that all have: a tiny distance to a
# side must not make it huge.
LARGEST_MULTIPLIER = 1e3
# Least proximal term, in scaled units: pivots of that size still have six digits.
LEAST_REGULARISATION = 1e-10
# In the system of the first point variables without a bound get the diagonal entry LOOSE, the
# others 1, and equality rows -FIRM: small, so that it does not move what is determined.
LOOSE, FIRM = 1e-6, 1e-8


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
    _factor(p, system, rows, xp.where(bounded, 1.0, LOOSE), FIRM)
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
    _factor(p, system, rows, xp.ones(n), LEAST_REGULARISATION)
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
    z_low = xp.where(has_low, up + xp.minimum(product / t_low, LARGEST_MULTIPLIER * dual_push), 0.0)
    z_high = xp.where(
        has_high, down + xp.minimum(product / t_high, LARGEST_MULTIPLIER * dual_push), 0.0
    )
    return v, y, Sides(low, high, has_low, has_high, t_low, t_high, z_low, z_high)


def _factor(p: StandardQP, system: System, rows: Array, diagonal: Array, least: float) -> None:
    """Factor with equality rows as soft as it takes where they depend on each other."""
    while True:
        E = p.xp.full(p.row_low.size, least)
        E[rows] = 1.0
        try:
            system.factor(diagonal, E)
        except np.linalg.LinAlgError:
            if least >= 1.0:
                raise
            least *= 100.0
        else:
            return
