r"""The solution of an active set in extended precision, rounded once.

The system of the active set, see `gpu.qp.interior_point.polish`, is solved by refinement whose
residuals are computed, and whose solution is kept, with more digits than the factorisation has
[1]_. Where rows are all but dependent, a smaller regularisation of the system makes the refinement
converge.

References
----------
.. [1] J. Demmel, Y. Hida, W. Kahan, X. S. Li, S. Mukherjee, E. J. Riedy, "Error bounds from
   extra-precise iterative refinement", ACM Trans. Math. Softw. 32 (2006) 325-351.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy import sparse

from gpu.qp.data.standard_qp import Array, Matrix, StandardQP, largest, one_sided
from gpu.qp.interior_point.equilibrate import Scaling, equilibrate
from gpu.qp.interior_point.kkt_system import SparseSystem
from gpu.qp.interior_point.polish import HUGE, Sides

# 64 bits of mantissa on x86, 113 on other Linux machines, and 53 where there is nothing longer.
Long = np.longdouble
# In scaled units; the first that converges counts, smaller ones serve rows that are almost
# dependent.
EXTENDED_REGULARISATIONS = (1e-9, 1e-12, 1e-14)
# Steps that may pass without the correction becoming half as large.
STALLED_REFINEMENTS = 4
# Relative to the largest entry: smaller corrections are lost in rounding.
NOTHING = np.finfo(float).eps / 16


class PrimalDual(NamedTuple):
    """x and the multipliers of rows and bounds."""

    x: Array
    y: Array
    z_box: Array


def extended(p: StandardQP, t: PrimalDual) -> Iterator[PrimalDual]:
    """Solutions of the active sets that t suggests, for a program on the host."""
    p = p.stored_sparsely()
    scaled, scaling = equilibrate(p)
    tight, loose = (_active(scaled, scaling, t, loose) for loose in (False, True))
    same = all(np.array_equal(a, b) for a, b in zip(tight, loose, strict=True))
    for active in (tight,) if same else (tight, loose):
        for regularisation in EXTENDED_REGULARISATIONS:
            try:
                found, settled = _refined(p, scaled, scaling, t, active, regularisation)
            except np.linalg.LinAlgError:
                continue
            yield found
            if settled:
                return


def _active(p: StandardQP, scaling: Scaling, t: PrimalDual, loose: bool) -> Sides:
    """Rows with a multiplier and variables at their bounds, in the scaled program p; if `loose`,
    also those whose multiplier is larger than the distance to the side.
    """
    x, y = scaling.scaled_point(t.x, t.y)
    z_box = t.z_box * scaling.variables * scaling.objective
    low, high = x == p.lb, x == p.ub
    rows = np.sign(y)
    if loose:
        low, high = low | (-z_box > x - p.lb), high | (z_box > p.ub - x)
        Cx = p.C @ x
        rows = np.where(np.where(y > 0.0, p.row_high - Cx, Cx - p.row_low) < np.abs(y), rows, 0.0)
    bounds = np.where(low, -1, np.where(high, 1, 0))
    return Sides(bounds, np.where(p.equality, 1, rows).astype(int))


def _refined(
    p: StandardQP,
    scaled: StandardQP,
    scaling: Scaling,
    t: PrimalDual,
    active: Sides,
    regularisation: float,
) -> tuple[PrimalDual, bool]:
    """The solution of an active set, from t on, rounded once; and whether it has settled."""
    x, y = scaling.scaled_point(t.x, t.y)
    held, used = active.bounds != 0, active.rows != 0
    bound = np.where(active.bounds < 0, scaled.lb, scaled.ub)
    goal = np.where(active.rows < 0, scaled.row_low, np.where(used, scaled.row_high, 0.0))

    system = SparseSystem(scaled)
    system.factor(np.where(held, HUGE, regularisation), np.where(used, regularisation, HUGE))
    P, C, Ct = _long(scaled.P), _long(scaled.C), _long(scaled.C.T)
    x, y = np.where(held, bound, x).astype(Long), np.where(used, y, 0.0).astype(Long)
    settled, last, stalled = False, np.inf, 0
    while not settled and stalled < STALLED_REFINEMENTS:
        rd = np.where(held, 0.0, P @ x + scaled.q + Ct @ y)
        rp = np.where(used, goal - C @ x, 0.0)
        dx, dy = system.solve(-rd.astype(float), rp.astype(float), thorough=True)
        dx, dy = np.where(held, 0.0, dx), np.where(used, dy, 0.0)
        x, y = x + dx, y + dy
        steps = ((dx, x), (dy, y))
        change = largest(*(_largest(step) / (_largest(whole) or 1.0) for step, whole in steps))
        settled = bool(change <= NOTHING)
        stalled = 0 if change < 0.5 * last else stalled + 1
        last = min(last, change)
    return _rounded(p, *scaling.point(x, y)), settled


def _largest(a: Array) -> float:
    return float(np.abs(a).max(initial=0.0))


def _rounded(p: StandardQP, x: Array, y: Array) -> PrimalDual:
    """The solution in double precision, with forces only at bounds and only of the right sign."""
    x = np.clip(x.astype(float), p.lb, p.ub)
    y = one_sided(y.astype(float), p.row_low, p.row_high)
    force = -(_long(p.P) @ x.astype(Long) + p.q + _long(p.C.T) @ y.astype(Long)).astype(float)
    at_side = ((force > 0.0) & (x == p.ub)) | ((force < 0.0) & (x == p.lb))
    return PrimalDual(x, y, np.where(at_side, force, 0.0))


def _long(M: Matrix) -> Matrix:
    return sparse.csr_array(M).astype(Long)
