r"""The last digits of a solution: residuals that are small in the units of the problem.

Where numbers are large, residuals that are small relative to their terms may still be large. They
are due to rounding, which is reduced in three ways:

* the active set is solved in extended precision and rounded once, see
  `gpu.qp.interior_point.polish`;
* multipliers that are not unique are taken as small as possible, see `least_multipliers`;
* the duality gap :math:`x^TPx + q^Tx + y^Tr + z_\mathrm{box}^Tb` is closed by single numbers of x,
  y, z_box that move it far and the other residuals little. With terms of :math:`10^7` a gap of
  :math:`2\cdot10^{-9}` is one unit of the last digit.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy import sparse

from gpu.errors import GpuError
from gpu.qp.data.qp_problem import QPProblem
from gpu.qp.data.standard_qp import Array, Matrix, StandardQP, largest, residuals
from gpu.qp.interior_point.minimise import minimise
from gpu.qp.interior_point.polish import PrimalDual, extended


class _Limits(NamedTuple):  # limits of the corrections
    rounding: float = float(np.finfo(float).eps) / 4  # average relative rounding error
    luck: float = 8.0  # expected rounding over the least possible residual, as errors cancel
    least: int = 10_000  # most unknowns and rows for least multipliers, which cost a solution
    trials: int = 60  # number of entries that are changed to close the gap
    passes: int = 3  # over these numbers
    parts: tuple[float, ...] = (1.0, 0.5)  # parts of the gap that each number is changed to close
    share: float = 0.9  # of the tolerance: bound of the other residuals while the gap is closed
    side: float = 1e-12  # over a row's terms: distance from its side at which it is active


LIMITS = _Limits()


class Absolute(NamedTuple):
    """Residuals in the units of the problem; the gap has its sign."""

    primal: float
    dual: float
    gap: float

    @property
    def worst(self) -> float:
        """The largest of them; infinite if one is NaN."""
        return max(map(abs, self)) if all(np.isfinite(self)) else np.inf


def absolute(problem: QPProblem, t: PrimalDual) -> Absolute:
    """Absolute residuals in double precision."""
    P, (_, q, A, b, lb, ub, G, row_low, row_high) = problem.factor.P, problem
    x, y, z, z_box = t.x, t.y[: b.size], t.y[b.size :], t.z_box
    Px, Gx = P @ x, G @ x
    dual = Px + q + G.T @ z + A.T @ y + z_box
    outside = (np.abs(A @ x - b), Gx - row_high, row_low - Gx, lb - x, x - ub)
    sides = ((row_high, z, 1), (row_low, z, -1), (lb, z_box, -1), (ub, z_box, 1))
    parts = [_side(*side) for side in sides]
    gap = x @ Px + q @ x + (parts[0] + parts[1]) + b @ y + parts[2] + parts[3]
    primal = largest(*(float(v.max(initial=0.0)) for v in outside))
    return Absolute(primal, float(np.abs(dual).max()), float(gap))


def _side(side: Array, multiplier: Array, sign: int) -> float:
    """Contribution of the multipliers of one sign to the gap."""
    finite = np.flatnonzero(np.isfinite(side))
    return float(side[finite] @ (sign * np.maximum(sign * multiplier, 0.0))[finite])


@np.errstate(all="ignore")  # what overflows shows in the residuals
def last_digits(problem: QPProblem, p: StandardQP, t: PrimalDual, tol: float) -> PrimalDual:
    """The triple with absolute residuals below `tol`, or the best that was found. No relative
    residual becomes larger than it was or than a tenth of `tol`.
    """
    error = absolute(problem, t)
    idle = PrimalDual(t.x, np.zeros_like(t.y), np.zeros_like(t.z_box))
    without = absolute(problem, idle)
    if without.dual <= error.dual and abs(without.gap) <= abs(error.gap):
        return idle  # the multipliers consisted of rounding
    best, least = t, error.worst
    allowed = max(residuals(p, *t).worst, 0.1 * tol)
    for candidate in _candidates(problem, p, t, tol):
        if least <= tol:
            break
        candidate = candidate._replace(x=np.clip(candidate.x, p.lb, p.ub))
        worst = absolute(problem, candidate).worst
        if worst < least and residuals(p, *candidate).worst <= allowed:
            best, least = candidate, worst
    return best


def _candidates(
    problem: QPProblem, p: StandardQP, t: PrimalDual, tol: float
) -> Iterator[PrimalDual]:
    yield t
    yield closed(problem, p, t, tol)
    p = p.stored_sparsely()
    row_sizes = _columns(p.C.T)

    def hopeless(y: Array) -> bool:
        """Whether the rounding error of y alone is too large."""
        return bool((np.abs(y) * row_sizes).max(initial=0.0) * LIMITS.rounding > LIMITS.luck * tol)

    if not hopeless(t.y):
        yield from _sharper(problem, p, t, tol)
    if t.x.size + t.y.size <= LIMITS.least:
        smaller = least_multipliers(p, t.x, t.y, tol)
        if smaller is not None and not hopeless(smaller[0]):
            t = PrimalDual(t.x, *smaller)
            yield t
            yield from _sharper(problem, p, t, tol)


def _sharper(problem: QPProblem, p: StandardQP, t: PrimalDual, tol: float) -> Iterator[PrimalDual]:
    for found in extended(p, t):
        yield found
        yield closed(problem, p, found, tol)


def closed(problem: QPProblem, p: StandardQP, t: PrimalDual, tol: float) -> PrimalDual:
    """The triple with the gap closed by changes of single numbers, if only the gap is too large."""
    error = absolute(problem, t)
    if not (error.primal <= tol and error.dual <= tol < abs(error.gap)):
        return t
    n, m = t.x.size, t.y.size
    inside = (t.x > p.lb) & (t.x < p.ub)
    row = np.where(t.y > 0.0, p.row_high, np.where(t.y < 0.0, p.row_low, 0.0))
    bound = np.where(t.z_box > 0.0, p.ub, np.where(t.z_box < 0.0, p.lb, 0.0))
    # Effect of a unit of each number on the gap, and bound of that on the other residuals.
    effect = np.concatenate([np.where(inside, 2.0 * (p.P @ t.x) + p.q, 0.0), row, bound])
    cost = np.concatenate([np.maximum(_columns(p.P), _columns(p.C)), _columns(p.C.T), np.ones(n)])
    order = np.argsort(-np.abs(effect) / np.where(cost > 0.0, cost, 1.0))
    order = order[effect[order] != 0.0][: LIMITS.trials]

    value, goal = np.concatenate(t), LIMITS.share * tol
    limit = max(goal, error.primal, error.dual)
    for _ in range(LIMITS.passes):
        before = error
        for k in order:
            for part in LIMITS.parts:
                tried = value.copy()
                tried[k] -= part * error.gap / effect[k]
                if tried[k] == value[k] or tried[k] * value[k] < 0.0:
                    continue
                found = absolute(problem, PrimalDual(tried[:n], tried[n : n + m], tried[n + m :]))
                if max(found.primal, found.dual) <= limit and abs(found.gap) < abs(error.gap):
                    value, error = tried, found
            if abs(error.gap) <= goal:
                break
        if abs(error.gap) <= goal or error is before:
            break
    return PrimalDual(value[:n], value[n : n + m], value[n + m :])


def _columns(M: Matrix) -> Array:
    """Largest entry of every column."""
    if not M.shape[0]:
        return np.zeros(M.shape[1])
    return abs(sparse.csc_array(M)).max(axis=0).toarray().ravel()


def least_multipliers(p: StandardQP, x: Array, y: Array, tol: float) -> tuple[Array, Array] | None:
    r"""The least multipliers of rows and bounds at a solution x, or None if they are not found.

    .. math:: \min \tfrac12 |y|^2 + \tfrac12 |z_\mathrm{box}|^2 \quad\text{subject to}\quad
              C^Ty + z_\mathrm{box} = -(Px + q)

    with the signs that sides allow. Of dependent rows, these add the least rounding."""
    n, Cx = x.size, p.C @ x
    slack = LIMITS.side * (abs(p.C) @ np.abs(x))
    high = p.equality | (np.abs(p.row_high - Cx) <= slack) | (y > 0.0)
    low = p.equality | (np.abs(Cx - p.row_low) <= slack) | (y < 0.0)
    rows, held = np.flatnonzero(high | low), np.flatnonzero((x == p.lb) | (x == p.ub))
    columns = sparse.csr_array(
        (np.ones(held.size), (held, np.arange(held.size))), shape=(n, held.size)
    )
    force = -(p.P @ x + p.q)
    size = rows.size + held.size
    above = np.concatenate([high[rows], x[held] == p.ub[held]])
    below = np.concatenate([low[rows], x[held] == p.lb[held]])
    least = StandardQP(
        sparse.csr_array(sparse.eye_array(size)),
        np.zeros(size),
        sparse.csr_array(sparse.hstack([p.C[rows].T, columns])),
        force,
        force,
        np.where(below, -np.inf, 0.0),
        np.where(above, np.inf, 0.0),
    )
    try:
        found = minimise(least, tol, proofs=False)
    except GpuError:
        return None
    if not found.residuals.worst <= tol:
        return None
    multipliers, forces = np.zeros_like(y), np.zeros(n)
    multipliers[rows], forces[held] = found.x[: rows.size], found.x[rows.size :]
    return multipliers, forces
