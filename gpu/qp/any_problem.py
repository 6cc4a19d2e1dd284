"""Problems with inequality rows, semidefinite or sparse matrices, or on a device."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gpu.arrays.dense import symmetric_product
from gpu.arrays.namespace import to_host
from gpu.errors import Infeasible, InputError, NotConverged, Unbounded
from gpu.qp.active_set.whitened import GaveUp, WhitenedActiveSet
from gpu.qp.data.kkt import general_residuals, kkt_residuals
from gpu.qp.data.qp_problem import QPProblem, power_of_two
from gpu.qp.data.qp_result import QPResult, Status, boxes_only
from gpu.qp.data.standard_qp import StandardQP, residuals
from gpu.qp.data.step import Step
from gpu.qp.interior_point.extended_precision import PrimalDual
from gpu.qp.interior_point.minimise import NoBound, NoPoint, Point, certified, minimise, polished
from gpu.qp.interior_point.polish import Sides
from gpu.qp.last_digits import last_digits

# Most nonzeros of P and C, in sparse and in dense storage, for absolute residuals: they take a few
# sparse factorisations.
SHARPENED_SPARSE, SHARPENED_DENSE = 300_000, 30_000


def solve_any_problem(
    problem: QPProblem, start: QPResult | ArrayLike | None, tol: float
) -> QPResult:
    """The result of any checked problem, or the errors of `solve_qp`."""
    p = problem.program
    state = _first_state(problem, p, start)
    if problem.factor.definite and 3 * p.q.size >= p.row_low.size:
        found = _whitened(problem, p, state)
        if found is not None:
            result = _result(problem, p.on_host(), *found, "active set")
            if result.kkt.worst <= tol:
                return result if p.xp is np else result.moved(p.xp.asarray)
    elif isinstance(start, QPResult):
        sides = Sides(state[p.row_low.size :], state[: p.row_low.size])
        point = polished(p, sides, start.x, p.xp.concatenate([start.y, start.z]))
        if point is not None:
            point = _sharpened(problem, p, point, tol)
            result = _result(problem, p, point, (), "active set")
            if result.kkt.worst <= tol:
                return result
    try:
        point = minimise(p, tol)
    except NoPoint as error:
        raise Infeasible("no point of the box satisfies the rows", error.certificate) from None
    except NoBound as error:
        raise Unbounded(
            "the objective falls for ever along a feasible direction, see `ray`", error.direction
        ) from None
    result = _result(problem, p, _sharpened(problem, p, point, tol), (), "interior point")
    if not result.kkt.worst <= tol:
        raise NotConverged(
            f"the residuals {result.kkt} stay above tol = {tol}: rescale the problem, drop rows "
            f"that are almost dependent, or accept a larger tol"
        )
    return result


def _first_state(problem: QPProblem, p: StandardQP, start: Any) -> Any:
    """Signed states of rows and variables to begin with."""
    xp, n, rows = p.xp, p.q.size, p.row_low.size
    state = xp.zeros(rows + n, dtype=np.int8)
    if isinstance(start, QPResult):
        if (start.x.size, start.y.size, start.z.size) != (n, problem.b.size, problem.row_low.size):
            raise InputError(
                f"start has {start.x.size} variables, {start.y.size} equality and {start.z.size} "
                f"inequality rows: the problem has {n}, {problem.b.size} and {problem.row_low.size}"
            )
        state[problem.b.size : rows], state[rows:] = start.active_rows, start.active
    elif start is not None:
        point = xp.asarray(start)
        if point.shape != (n,) or point.dtype.kind not in "iuf":
            raise InputError(
                f"start has shape {point.shape} and type {point.dtype}: "
                f"it must be a QPResult, a real or an int8 array of shape {(n,)}"
            )
        if point.dtype == np.int8:
            if bool((abs(point) > 1).any()):
                raise InputError("start has int8 entries other than -1, 0, 1")
            state[rows:] = point
        elif not bool(xp.isfinite(point).all()):
            raise InputError("start has entries that are not finite")
        else:
            value = xp.concatenate([p.C @ point, point])
            low, high = xp.concatenate([p.row_low, p.lb]), xp.concatenate([p.row_high, p.ub])
            state = (value >= high).astype(np.int8) - (value <= low).astype(np.int8)
    low, high = xp.concatenate([p.row_low, p.lb]), xp.concatenate([p.row_high, p.ub])
    state = xp.where((state < 0) & xp.isinf(low), 0, state)
    state = xp.where((state > 0) & xp.isinf(high), 0, state)
    return xp.where(low == high, 0, state).astype(np.int8)


def _whitened(
    problem: QPProblem, p: StandardQP, state: Any
) -> tuple[Point, tuple[Step, ...]] | None:
    """The active-set method in units where P has a diagonal and the rows norms near one."""
    xp, d = p.xp, problem.factor.scale
    scaled_rows = p.C * d
    norms = xp.sqrt((scaled_rows * scaled_rows).sum(axis=1))
    e = 1.0 / power_of_two(xp.where(norms > 0.0, norms, 1.0))
    scaled_rows *= e[:, None]
    scaled = StandardQP(
        p.P, d * p.q, scaled_rows, e * p.row_low, e * p.row_high, p.lb / d,
        p.ub / d,
    )  # fmt: skip
    method = WhitenedActiveSet(
        scaled, problem.factor.L, lambda x: d * symmetric_product(problem.factor.P, d * x)
    )
    try:
        x, multipliers = method.run(state)
    except GaveUp:
        return None
    x, y = d * x, e * multipliers[: e.size]
    if xp is not np:
        p, x, y = p.on_host(), to_host(x), to_host(y)
    return certified(p, x, y), tuple(method.history)


def _sharpened(problem: QPProblem, p: StandardQP, point: Point, tol: float) -> Point:
    """The point, or one with absolute residuals below `tol` too, where the problem is small."""
    if p.xp is not np or not point.residuals.worst <= tol:
        return point
    entries = p.P.nnz + p.C.nnz if p.is_sparse else np.count_nonzero(p.P) + np.count_nonzero(p.C)
    if entries > (SHARPENED_SPARSE if p.is_sparse else SHARPENED_DENSE):
        return point
    best = last_digits(problem, p, PrimalDual(point.x, point.y, point.z_box), tol)
    return replace(point, **best._asdict(), residuals=residuals(p, *best))


def _result(
    problem: QPProblem, p: StandardQP, point: Point, history: tuple[Step, ...], path: str
) -> QPResult:
    """The answer, with residuals recomputed."""
    xp, m = p.xp, problem.b.size
    x, y, z, z_box = point.x, point.y[:m], point.y[m:], point.z_box
    if boxes_only(problem):
        kkt = kkt_residuals(problem, x, y, z_box)
    else:
        kkt = general_residuals(problem, x, y, z, z_box, p, point.residuals)
    active = xp.where(x == p.lb, -1, xp.where(x == p.ub, 1, 0))
    active = xp.where(p.lb == p.ub, xp.where(z_box < 0.0, -1, 1), active).astype(np.int8)
    rows = xp.sign(z).astype(np.int8)
    status = Status.OPTIMAL
    if bool(((active != 0) & (z_box == 0.0) & (p.lb < p.ub)).any()):
        status = Status.DEGENERATE
    if problem.factor.nearly_convex:
        status = Status.NEARLY
    return QPResult(
        x=x,
        y=y,
        z=z,
        z_box=z_box,
        status=status,
        active=active,
        kkt=kkt,
        iterations=point.iterations or len(history),
        history=history,
        active_rows=rows,
        path=path,
    )
