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

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from scipy import sparse

from gpu.qp.data.equilibrate import Scaling, equilibrate
from gpu.qp.data.standard_qp import Array, Matrix, StandardQP, largest, one_sided
from gpu.qp.interior_point.kkt_system import SparseSystem, System


class _Limits(NamedTuple):  # limits of the steps, in scaled units
    huge: float = 1e20  # a diagonal entry beside which one is rounding; no product overflows
    exchanges: int = 6  # most: an interior point guesses nearly all sides
    refinements: int = 6  # most: each gains the digits of the regularisation
    single: int = 2  # wrong sides that may be exchanged again and again
    first: float = 1e-8  # relative residual of the first of them, and
    fine: float = 1e-12  # of the others
    regularisations: tuple[float, ...] = (1e-9, 1e-7, 1e-11)  # rho, delta, in turn
    extended: tuple[float, ...] = (1e-9, 1e-12, 1e-14)  # less for dependent rows
    stalled: int = 4  # steps without the correction becoming half as large
    nothing: float = float(np.finfo(float).eps) / 16  # corrections lost in rounding


LIMITS = _Limits()


class Sides(NamedTuple):
    """Signed states, -1 at the lower side, 0 off both, +1 at the upper side."""

    bounds: Array
    rows: Array


Measure = Callable[[Array, Array], float]
Points = Iterator[tuple[Array, Array]]


def polish(
    p: StandardQP, system: System, sides: Sides, x: Array, y: Array, measure: Measure, target: float
) -> tuple[Array, Array, float]:
    """The best (x, y) that active-set steps find; `measure` is what is made small."""
    best, error = (x, y), measure(x, y)
    for regularisation in LIMITS.regularisations:
        state, point = sides, (x, y)
        for _ in range(LIMITS.exchanges):
            try:
                points = _steps(p, system, state, *point, regularisation)
                found = _least(points, measure, target)
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
            if not _differences(state, following):
                break
            state = following
    return *best, error


def settle(p: StandardQP, system: System, sides: Sides, x: Array, y: Array) -> Points:
    """Points that converge to that of sides that are all but right: sides are exchanged while half
    as many are wrong each time, or next to none, without a look at the residuals."""
    state, fewest, regularisation = sides, np.inf, LIMITS.regularisations[0]
    for _ in range(LIMITS.exchanges):
        points = _steps(p, system, state, x, y, regularisation)
        try:
            x, y = next(points)
        except np.linalg.LinAlgError:
            return
        following = _exchange(p, state, x, y)
        wrong = _differences(state, following)
        if not wrong:
            yield from points
        if not 0 < wrong <= max(0.5 * fewest, LIMITS.single):
            return
        state, fewest = following, wrong


def _steps(
    p: StandardQP, system: System, state: Sides, x: Array, y: Array, regularisation: float
) -> Points:
    """The points of proximal steps at an active set."""
    xp = p.xp
    held = state.bounds != 0
    used = (state.rows != 0) | p.equality
    D = xp.where(held, LIMITS.huge, regularisation)
    E = xp.where(used, regularisation, LIMITS.huge)
    system.factor(D, E)
    x = xp.where(state.bounds < 0, p.lb, xp.where(state.bounds > 0, p.ub, x))
    y = xp.where(used, y, 0.0)
    goal = xp.where(state.rows < 0, p.row_low, xp.where(state.rows > 0, p.row_high, p.row_low))
    goal = xp.where(used, goal, 0.0)
    for fine in (LIMITS.first, *(LIMITS.refinements - 1) * (LIMITS.fine,)):
        rd = xp.where(held, 0.0, p.gradient(x, y))
        rp = xp.where(used, goal - p.C @ x, 0.0)
        dx, dy = system.solve(-rd, rp, fine)
        x, y = x + xp.where(held, 0.0, dx), y + xp.where(used, dy, 0.0)
        yield x, y


def _least(points: Points, measure: Measure, target: float) -> tuple[Array, Array, float] | None:
    """The best of points that improve by half each, and its error."""
    best, found = np.inf, None
    for x, y in points:
        error = measure(x, y)
        if not error < best:  # or it is not a number
            break
        improved, best, found = error < 0.5 * best, error, (x, y, error)
        if best <= target or not improved:
            break
    return found


def _differences(a: Sides, b: Sides) -> int:
    return int((a.bounds != b.bounds).sum() + (a.rows != b.rows).sum())


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


# 64 bits of mantissa on x86, 113 on other Linux machines, and 53 where there is nothing longer.
Long = np.longdouble


class PrimalDual(NamedTuple):
    """x and the multipliers of rows and bounds."""

    x: Array
    y: Array
    z_box: Array


def extended(p: StandardQP, t: PrimalDual) -> Iterator[PrimalDual]:
    """Solutions of the active sets that t suggests, for a program on the host, rounded once, by
    extra-precise iterative refinement (J. Demmel et al., ACM Trans. Math. Softw. 32 (2006)
    325-351). Where rows are all but dependent, a smaller regularisation makes it converge."""
    p = p.stored_sparsely()
    scaled, scaling = equilibrate(p)
    tight, loose = (_active(scaled, scaling, t, loose) for loose in (False, True))
    same = all(np.array_equal(a, b) for a, b in zip(tight, loose, strict=True))
    for active in (tight,) if same else (tight, loose):
        for regularisation in LIMITS.extended:
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
    huge = LIMITS.huge
    system.factor(np.where(held, huge, regularisation), np.where(used, regularisation, huge))
    P, C, Ct = _long(scaled.P), _long(scaled.C), _long(scaled.C.T)
    x, y = np.where(held, bound, x).astype(Long), np.where(used, y, 0.0).astype(Long)
    settled, last, stalled = False, np.inf, 0
    while not settled and stalled < LIMITS.stalled:
        rd = np.where(held, 0.0, P @ x + scaled.q + Ct @ y)
        rp = np.where(used, goal - C @ x, 0.0)
        dx, dy = system.solve(-rd.astype(float), rp.astype(float), thorough=True)
        dx, dy = np.where(held, 0.0, dx), np.where(used, dy, 0.0)
        x, y = x + dx, y + dy
        steps = ((dx, x), (dy, y))
        change = largest(*(_largest(step) / (_largest(whole) or 1.0) for step, whole in steps))
        settled = bool(change <= LIMITS.nothing)
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
