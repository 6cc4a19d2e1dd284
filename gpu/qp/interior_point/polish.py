r"""Active-set steps from a point near the solution, to the accuracy of the arithmetic.

The sides that hold are guessed from distances and multipliers, and the equality-constrained problem
they leave is solved by proximal steps from the present point,

.. math:: \begin{pmatrix} P + \rho I + D & C^T \\ C & -\delta I - E \end{pmatrix}
          \begin{pmatrix} dx \\ dy \end{pmatrix} = \begin{pmatrix} -r_d \\ -r_p \end{pmatrix},

where a huge entry of D holds a variable at its bound and a huge entry of E takes a row out. At a
fixed active set they are refinement of the system with :math:`\rho = \delta = 0`, which may be
singular: rows that depend on each other and directions without curvature do no harm. Sides that
turn out wrong change, all at once, as in the primal-dual active set method; the best point counts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gpu.qp.data.standard_qp import Array, StandardQP
from gpu.qp.interior_point.kkt_system import System

# A diagonal entry beside which entries of about one are rounding; no product with them overflows.
HUGE = 1e20
# Most steps: an interior point guesses nearly all sides, and each refinement gains the digits of
# the regularisation.
EXCHANGES, POLISH_REFINEMENTS = 6, 6
# rho and delta, in scaled units, tried in turn: between rounding and what refinement takes back.
POLISH_REGULARISATIONS = (1e-9, 1e-7, 1e-11)


class Sides(NamedTuple):
    """Signed states, -1 at the lower side, 0 off both, +1 at the upper side."""

    bounds: Array
    rows: Array


def polish(
    p: StandardQP,
    system: System,
    sides: Sides,
    x: Array,
    y: Array,
    measure: Callable[[Array, Array], float],
    target: float,
) -> tuple[Array, Array, float]:
    """The best (x, y) that active-set steps find; `measure` is what is made small."""
    best, error = (x, y), measure(x, y)
    for regularisation in POLISH_REGULARISATIONS:
        state, point = sides, (x, y)
        for _ in range(EXCHANGES):
            try:
                found = _at(p, system, state, *point, regularisation, measure, target)
            except np.linalg.LinAlgError:
                break
            if found is None:
                break
            if found[2] < error:
                best, error = found[:2], found[2]
            if error <= target:
                return *best, error
            point = found[:2]
            following = _exchange(p, state, *point)
            if bool((following.bounds == state.bounds).all()) and bool(
                (following.rows == state.rows).all()
            ):
                break
            state = following
    return *best, error


def _at(
    p: StandardQP,
    system: System,
    state: Sides,
    x: Array,
    y: Array,
    regularisation: float,
    measure: Callable[[Array, Array], float],
    target: float,
) -> tuple[Array, Array, float] | None:
    """The point to which an active set leads."""
    xp = p.xp
    held = state.bounds != 0
    used = (state.rows != 0) | p.equality
    D = xp.where(held, HUGE, regularisation)
    E = xp.where(used, regularisation, HUGE)
    system.factor(D, E)
    x = xp.where(state.bounds < 0, p.lb, xp.where(state.bounds > 0, p.ub, x))
    y = xp.where(used, y, 0.0)
    goal = xp.where(state.rows < 0, p.row_low, xp.where(state.rows > 0, p.row_high, p.row_low))
    goal = xp.where(used, goal, 0.0)
    best, found = np.inf, None
    for _ in range(POLISH_REFINEMENTS):
        rd = xp.where(held, 0.0, p.gradient(x, y))
        rp = xp.where(used, goal - p.C @ x, 0.0)
        dx, dy = system.solve(-rd, rp)
        x, y = x + xp.where(held, 0.0, dx), y + xp.where(used, dy, 0.0)
        error = measure(x, y)
        if not np.isfinite(error):
            break
        if error < best:
            improved, best, found = error < 0.5 * best, error, (x, y, error)
            if best <= target or not improved:
                break
        else:
            break
    return found


def _exchange(p: StandardQP, state: Sides, x: Array, y: Array) -> Sides:
    """Sides with a multiplier of the wrong sign are released, violated ones are held."""
    xp = p.xp
    g, Cx = -p.gradient(x, y), p.C @ x
    bounds = xp.where(state.bounds * g > 0, state.bounds, 0)
    bounds = xp.where((state.bounds == 0) & (x < p.lb), -1, bounds)
    bounds = xp.where((state.bounds == 0) & (x > p.ub), 1, bounds)
    rows = xp.where(state.rows * y > 0, state.rows, 0)
    rows = xp.where((state.rows == 0) & (Cx < p.row_low), -1, rows)
    rows = xp.where((state.rows == 0) & (Cx > p.row_high), 1, rows)
    rows = xp.where(p.equality, 0, rows)
    return Sides(bounds.astype(np.int8), rows.astype(np.int8))
