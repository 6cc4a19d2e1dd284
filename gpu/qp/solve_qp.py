"""Convex quadratic programs."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gpu.arrays.dense import symmetric_product
from gpu.errors import Infeasible, InputError, NotConverged, Unbounded
from gpu.qp.active_set.box import ActiveSet, BoxQP
from gpu.qp.active_set.dual import (
    dual_active_set,
    plain_rows,
    result_of,
    rows_of,
)
from gpu.qp.active_set.whitened import WhitenedActiveSet
from gpu.qp.data.budget import Budget
from gpu.qp.data.equilibrate import largest_side, with_rounding
from gpu.qp.data.qp_problem import (
    EMPTY,
    SOLVED,
    FactoredMatrix,
    QPProblem,
    Rows,
    check_problem,
    power_of_two,
)
from gpu.qp.data.qp_result import (
    QPResult,
    Status,
    Step,
    general_residuals,
    kkt_residuals,
    residuals_of,
)
from gpu.qp.data.standard_qp import ROUNDING, StandardQP, residuals
from gpu.qp.interior_point.minimise import (
    Point,
    certified,
    infeasible,
    minimise,
    polished,
    proven,
)
from gpu.qp.interior_point.polish import PrimalDual, Sides
from gpu.qp.interior_point.presolve import PRESOLVE, nonempty
from gpu.qp.last_digits import last_digits
from skfem_adini.ground.arguments import integer, keywords_named, unmasked
from skfem_adini.ground.arrays import namespace, to_host


class _Limits(NamedTuple):  # limits of proximal points and of absolute residuals
    proximity: float = 1e-6  # of the diagonal of P: enough for a Cholesky factor
    steps: int = 60  # proximal points: where there is a solution, few are the rule
    sparse: int = 300_000  # most nonzeros of P and C for absolute residuals
    move: float = 1e-9  # of lengths with a diagonal of ones: less than this contradicts nothing
    dense: int = 30_000  # the same in dense storage: a few sparse factorisations


LIMITS = _Limits()


logger = logging.getLogger(__name__)


@keywords_named
def solve_qp(
    P: ArrayLike | FactoredMatrix,
    q: ArrayLike,
    G: ArrayLike | None = None,
    h: ArrayLike | None = None,
    A: ArrayLike | None = None,
    b: ArrayLike | None = None,
    lb: ArrayLike | None = None,
    ub: ArrayLike | None = None,
    *,
    h_low: ArrayLike | None = None,
    start: QPResult | ArrayLike | None = None,
    tol: float = 1e-9,
    host_below: int = 0,
    polish: str | None = None,
    time_limit: float | None = None,
    max_steps: int | None = None,
) -> QPResult:
    r"""Solve a convex quadratic program.

    .. math:: \min_x \tfrac12 x^TPx + q^Tx \quad\text{subject to}\quad
              Ax = b,\quad h_l \le Gx \le h,\quad l \le x \le u

    Strictly convex dense problems are solved by active sets: small ones by a compiled dual method,
    `gpu.qp.active_set.dual`, larger ones by primal-dual exchanges, `gpu.qp.active_set.box` with
    bounds and a few equality rows, otherwise `gpu.qp.active_set.whitened`, which factors P once.
    Where that exchange stalls, where P is semidefinite (a linear program has P = 0), and where
    matrices are sparse, an interior point (`gpu.qp.interior_point.interior_point`) finds the active
    set, from which `gpu.qp.interior_point.polish` goes on to the accuracy of the arithmetic.

    Parameters
    ----------
    P : (n, n) array_like, SciPy sparse array, CuPy array or QPFactor
        Symmetric positive semidefinite matrix; an asymmetry of rounding is accepted, and so are,
        with `Status.NEARLY`, eigenvalues that are negative by less than 3e-5 of the diagonal.
    q : (n,) array_like
        Linear term.
    G : (l, n) array_like or sparse array, optional
        Inequality rows.
    h, h_low : float or (l,) array_like, optional
        Their upper and lower sides; entries may be infinite or equal to each other. From 1e20
        on a number counts as infinite, here and in `lb`, `ub`.
    A : (m, n) array_like, optional
        Equality rows; they may depend on each other.
    b : (m,) array_like, optional
        Their right-hand side.
    lb, ub : float or (n,) array_like, optional
        Bounds; entries may be infinite or equal to each other.
    start : QPResult or (n,) array_like, optional
        Where to begin: the result of a nearby problem, its `active` (an int8 array), or a point.
    tol : float, optional
        Largest accepted value of `KKT.worst`. The answer is usually exact to rounding; `tol` also
        decides when an infeasibility is too small to be told from rounding of the data.
    host_below : int, optional
        Device problems with fewer unknowns are solved on the host, which is quicker for small
        ones; the result lives on the device all the same.
    polish : {None, "digits"}, optional
        "digits": where an interior point found the solution of a host problem that is not large,
        seek one whose residuals are below `tol` in the units of the problem too, see
        `gpu.qp.last_digits`. It may take many times as long, and changes last digits only.
    time_limit : float, optional
        Seconds after which no further step begins; looked at between steps only, and not by the
        compiled method of small problems.
    max_steps : int, optional
        Largest number of steps of active sets and of interior points, together with those that
        prove infeasibility. Neither limit stops the polish of a point that is good enough.

    Returns
    -------
    QPResult
        The solution, its multipliers and its residuals.

    Raises
    ------
    Infeasible
        If no point satisfies the constraints; its `certificate` has been verified.
    Unbounded
        If the objective has no lower bound; its `ray` has been verified.
    NotConverged
        If the residuals stay above `tol`. At `time_limit` or `max_steps` its attributes `x` and
        `kkt` are the best point met and its residuals.
    InputError
        If an argument is malformed; an objective that is not convex is such a case.
    NotSupported
        For sparse matrices on a device.

    Notes
    -----
    The problem is scaled to a diagonal of P between 1/2 and 2, by powers of two and hence without
    rounding: multiplying P, or a variable, by such a number changes no digit of the result.

    Residuals are relative to x. Where a translation leaves nothing but its rounding, they cannot be
    made small, and x is accepted once it is known to 1e-12 of the largest side or force (beside
    others that are 1e11 times less), or to 1e-12 in the units given.

    References
    ----------
    M. Hintermüller, K. Ito and K. Kunisch, The primal-dual active set strategy as a semismooth
    Newton method, SIAM J. Optim. 13 (2003), 865-888. S. Mehrotra, On the implementation of a
    primal-dual interior point method, SIAM J. Optim. 2 (1992), 575-601. D. Goldfarb, A. Idnani, A
    numerically stable dual method for solving strictly convex quadratic programs, Math. Program. 27
    (1983), 1-33.

    Examples
    --------
    The point of the unit simplex next to (1, 0.6, -1):

    >>> import numpy as np
    >>> from gpu import solve_qp
    >>> result = solve_qp(np.eye(3), [-1.0, -0.6, 1.0], A=[[1.0, 1.0, 1.0]], b=[1.0], lb=0.0)
    >>> result.x.round(12), result.y.round(12), result.z_box.round(12)
    (array([0.7, 0.3, 0. ]), array([0.3]), array([ 0. ,  0. , -1.3]))
    >>> result.active, result.kkt.worst < 1e-15
    (array([ 0,  0, -1], dtype=int8), True)
    """
    budget = Budget(time_limit, max_steps)
    plain = start is None and polish is None and type(host_below) is int and host_below >= 0
    if plain and type(tol) is float and ROUNDING.sharp <= tol < 1.0:
        rows = plain_rows(P, q, G, h, A, b, lb, ub, h_low)
        result = None if rows is None else result_of(rows, dual_active_set(rows))
        if result is not None and result.iterations <= budget.most:
            return result
    with np.errstate(all="ignore"):  # what overflows shows in the residuals
        problem = check_problem(P, q, G, h, A, b, lb, ub, h_low)
        checked_options(tol, host_below, polish)
        small = None if polish or isinstance(P, FactoredMatrix) else rows_of(problem)
        if host_below and not isinstance(problem.q, np.ndarray) and problem.q.size < host_below:
            limits = {"polish": polish, "time_limit": time_limit, "max_steps": max_steps}
            return _on_host(problem, start, tol=tol, **limits)
        try:
            return _any(problem, start, tol, polish, budget, small)
        except TimeoutError:
            raise _unfinished(problem, budget) from None


def checked_options(tol: Any, host_below: Any, polish: Any = None) -> None:
    """`InputError` where an option is wrong."""
    if not isinstance(tol, int | float | np.number) or not 0.0 < tol < 1.0:
        raise InputError(f"tol is {tol!r}: it must be a number between 0 and 1")
    integer("host_below", host_below, 0)
    if polish is not None and not (isinstance(polish, str) and polish == "digits"):
        raise InputError(f"polish is {polish!r}: it must be None or 'digits'")


def _any(
    problem: QPProblem, start: Any, tol: float, polish: str | None, budget: Budget,
    small: Rows | None,
) -> QPResult:  # fmt: skip
    """The result of checked data; contradictions in single rows and bounds are found first."""
    if not isinstance(start, QPResult):
        unmasked("start", start)
    for low, high, names in (
        (problem.lb, problem.ub, ("the box is empty: lb", "ub")),
        (problem.row_low, problem.row_high, ("a row is empty: h_low", "h")),
    ):
        empty = low > high
        if bool(empty.any()):
            i = int(empty.argmax())
            raise Infeasible(
                f"{names[0]}[{i}] = {low[i]} is above {names[1]}[{i}] = {high[i]}",
                _proof(problem, None if names[1] == "ub" else problem.b.size + i),
            )
    for name, rows, low, high, first in (
        ("A", problem.A, problem.b, problem.b, 0),
        ("G", problem.G, problem.row_low, problem.row_high, problem.b.size),
    ):
        zero = ~nonempty(rows)
        if not bool(zero.any()):
            continue
        rounding = PRESOLVE.activity * largest_side(low, high)
        for wrong, sign in ((zero & (low > rounding), 1.0), (zero & (high < -rounding), -1.0)):
            if bool(wrong.any()):
                i = int(wrong.argmax())
                raise Infeasible(
                    f"{name}[{i}] is zero, and its sides from {low[i]} to {high[i]} are not",
                    _proof(problem, first + i, sign),
                )
    if small is not None:
        result = _dual(problem, small, start, tol, budget)
        if result is not None:
            return result
    return _solved(problem, start, tol, polish, budget)


def _solved(
    problem: QPProblem,
    start: QPResult | ArrayLike | None,
    tol: float,
    polish: str | None,
    budget: Budget,
) -> QPResult:
    """The result, by the ways that the problem allows, one after the other."""
    if problem.boxes_only:
        try:
            return _boxes(problem, start, tol, budget)
        except NotConverged as error:
            try:
                return _general(problem, None, tol, polish, budget)
            except NotConverged:
                raise error from None
    try:
        return _general(problem, start, tol, polish, budget)
    except NotConverged as error:
        result = _proximal(problem, tol, budget)
        if result is None:
            raise
        logger.debug("proximal points where %s", error)
        return result


def _dual(
    problem: QPProblem, rows: Rows, start: Any, tol: float, budget: Budget
) -> QPResult | None:
    """The answer of the compiled dual method, `Infeasible`, or None where another has to decide."""
    state = _first_state(problem, problem.program, start)
    found = dual_active_set(rows, state)
    if len(found.steps) > budget.most:
        return None
    if found.code == EMPTY and with_rounding(problem.program, certain=True) is None:
        proof = proven(_widened(problem), -found.y)
        if proof is not None:
            raise infeasible(proof)
    result = result_of(rows, found)
    if result is None and found.code == SOLVED:
        x, y, z_box = found.x, found.y, found.z_box
        kkt = residuals_of(problem, x, y[: rows.equal], y[rows.equal :], z_box)
        result = result_of(rows, found, kkt)
    if result is None or result.kkt.worst > tol:
        logger.debug("the dual active set did not decide (code %d): %s", found.code, result)
        return None
    return result


def _widened(problem: QPProblem) -> StandardQP:
    """The program with sides apart by a part of all lengths: lesser contradictions may be rounding
    of what they were computed from, and are left to other methods."""
    p, D = problem.program, problem.factor.scale
    unit = abs(p.C) @ D
    rows = np.where(unit > 0.0, unit, 1.0)
    sides = p.row_low / rows, p.row_high / rows, p.lb / D, p.ub / D
    move = LIMITS.move * D * max(float((D * abs(p.q)).max()), largest_side(*sides))
    rows = abs(p.C) @ move
    sides = p.row_low - rows, p.row_high + rows, p.lb - move, p.ub + move
    return replace(p, row_low=sides[0], row_high=sides[1], lb=sides[2], ub=sides[3])


def _unfinished(problem: QPProblem, budget: Budget) -> NotConverged:
    """The error at the limits of the budget, with the best point."""
    p, m = problem.program, problem.b.size
    p = p.on_host() if isinstance(budget.best.x, np.ndarray) else p
    point = certified(p, budget.best.x, budget.best.y)
    y, z = point.y[:m], point.y[m:]
    kkt = residuals_of(problem, point.x, y, z, point.z_box, p, point.residuals)
    return NotConverged(
        f"time_limit, max_steps: after {budget} the residuals are {kkt}; the attribute x is the "
        "best point, where start= can go on",
        x=namespace(problem.q).asarray(point.x),
        kkt=kkt,
    )


def _proximal(problem: QPProblem, tol: float, budget: Budget) -> QPResult | None:
    r"""Solve a box problem with singular P by proximal points (Rockafellar 1976): each minimises
    :math:`\tfrac12 x^TPx + q^Tx + \tfrac12 |x - x_k|_M^2`, M a small diagonal, by active sets,
    exactly where an interior point ends in the rounding."""
    if problem.row_low.size or not isinstance(problem.factor.P, np.ndarray):
        return None
    if problem.b.size > problem.q.size:
        return None
    weight = LIMITS.proximity / problem.factor.scale**2
    factor = FactoredMatrix(problem.factor.P + np.diag(weight))
    if not factor.definite:
        return None
    x, last = np.clip(np.zeros_like(problem.q), problem.lb, problem.ub), None
    for _ in range(LIMITS.steps):
        near = problem._replace(factor=factor, q=problem.q - weight * x)
        try:
            last = _boxes(near, last, tol, budget)
        except (NotConverged, Infeasible):
            return None
        x = last.x
        kkt = general_residuals(problem, x, last.y, last.z, last.z_box)
        if kkt.worst <= tol:
            return replace(last, kkt=kkt)
    return None


def _proof(problem: QPProblem, row: int | None, sign: float = 1.0) -> Any:
    """The Farkas vector of a contradiction in one row, or (zero) in the bounds."""
    proof = namespace(problem.q).zeros(problem.b.size + problem.row_low.size)
    if row is not None:
        proof[row] = sign
    return proof


def _on_host(problem: QPProblem, start: QPResult | ArrayLike | None, **options: Any) -> QPResult:
    """Solve a small device problem with NumPy; the result goes back to the device."""
    xp = namespace(problem.q)
    if isinstance(start, QPResult):
        start = start.moved(to_host)
    elif start is not None:
        start = to_host(start)
    host = [to_host(value) for value in (problem.factor.P, *problem[1:])]
    matrix, q, A, b, lb, ub, G, row_low, row_high = host
    general, equal = bool(row_low.size), bool(b.size)
    try:
        result = solve_qp(
            matrix, q, G if general else None, row_high if general else None,
            A if equal else None, b if equal else None, lb, ub,
            h_low=row_low if general else None, start=start, **options,
        )  # fmt: skip
    except Infeasible as error:
        raise Infeasible(str(error), xp.asarray(error.certificate)) from None
    except Unbounded as error:
        raise Unbounded(str(error), xp.asarray(error.ray)) from None
    except NotConverged as error:
        error.x = None if error.x is None else xp.asarray(error.x)
        raise
    return replace(result.moved(xp.asarray), _problem=problem)


def _boxes(
    problem: QPProblem, start: QPResult | ArrayLike | None, tol: float, budget: Budget
) -> QPResult:
    """Bounds and equality rows, strictly convex, on the host."""
    norms = np.linalg.norm(problem.A * problem.factor.scale, axis=1)
    rows = 1.0 / power_of_two(np.where(norms > 0.0, norms, 1.0))
    iterate = _first_iterate(problem, rows, start)
    iterate.spend = budget.count
    try:
        iterate.run(tol, max_steps=100 + 10 * problem.q.size)
    except Infeasible as error:
        raise Infeasible(str(error), rows * error.certificate) from None
    except TimeoutError:
        x, y = problem.factor.scale * iterate.x, rows * iterate.y
        budget.best = budget.best or certified(problem.program, x, y)
        raise
    except np.linalg.LinAlgError:
        raise NotConverged(
            "a system of free variables and equality rows is singular to working precision: "
            "P is too ill conditioned, or rows are almost dependent; regularise P or drop rows"
        ) from None
    return _box_result(problem, rows, iterate, tol)


def _first_iterate(
    problem: QPProblem, rows: np.ndarray, start: QPResult | ArrayLike | None
) -> ActiveSet:
    """The scaled problem with the active set to begin with."""
    factor, q, A, b, lb, ub, *_ = problem
    d, scaled = factor.scale, factor.scaled
    assert scaled is not None  # the box path is taken with a factor only
    box = BoxQP(scaled, d * q, rows[:, None] * A * d, rows * b, lb / d, ub / d)
    x, y = np.clip(np.zeros_like(q), box.lb, box.ub), np.zeros_like(b)
    active = None
    given = _starting_point(problem, start)
    if isinstance(given, QPResult):
        x, y, active = given.x / d, given.y / rows, given.active
    elif given is not None and given.dtype == np.int8:
        active = given
    elif given is not None:
        x = given / d
        inside = (box.lb < x) & (x < box.ub)
        y = np.linalg.lstsq(box.A[:, inside].T, -box.gradient(x, y)[inside])[0]
    state = box.guess(x, y) if active is None else active.copy()
    state[np.isinf(box.hold(x, state))] = 0
    state[lb == ub] = -1
    return ActiveSet(box, state, x, y, factor.L)


def _starting_point(problem: QPProblem, start: Any) -> Any:
    """The checked start: a result, or an array of numbers or of states, or None."""
    if isinstance(start, QPResult):
        found = start.x.size, start.y.size, start.z.size
        sizes = problem.q.size, problem.b.size, problem.row_low.size
        if found[:2] != sizes[:2] or (found != sizes and not problem.boxes_only):
            raise InputError(
                "start has {} variables, {} equality rows and {} inequality rows: the problem has "
                "{}, {} and {}".format(*found, *sizes)
            )
        return start
    if start is None:
        return None
    point = namespace(problem.q).asarray(start)
    if point.shape != problem.q.shape or point.dtype.kind not in "iuf":
        raise InputError(
            f"start has shape {point.shape} and type {point.dtype}: "
            f"it must be a QPResult, a real or an int8 array of shape {problem.q.shape}"
        )
    if point.dtype == np.int8 and bool((abs(point) > 1).any()):
        raise InputError("start has int8 entries other than -1, 0, 1")
    if not bool(namespace(point).isfinite(point).all()):
        raise InputError("start has entries that are not finite")
    return point


def _box_result(problem: QPProblem, rows: np.ndarray, iterate: ActiveSet, tol: float) -> QPResult:
    """The answer in the units of the problem, if its residuals pass."""
    factor, q, A, _, lb, ub, *_ = problem
    x = np.clip(factor.scale * iterate.x, lb, ub)
    y = rows * iterate.y
    force = -(symmetric_product(factor.P, x) + q + A.T @ y)
    active = np.where(lb == ub, np.where(force > 0.0, 1, -1), iterate.state).astype(np.int8)
    z_box = np.where(active * force > 0.0, force, 0.0)
    kkt = kkt_residuals(problem, x, y, z_box)
    if not np.isfinite(kkt.worst):
        raise NotConverged(
            "the solution, or a product with it, is beyond the range of double precision: "
            "measure the variables or the objective in other units"
        )
    if not kkt.worst <= tol:
        raise NotConverged(
            f"the active set has settled but {kkt} is above tol = {tol}: P is too ill conditioned, "
            "regularise it or accept a larger tol"
        )
    history = tuple(iterate.history)
    status = _status(problem, lb < ub, active, z_box)
    steps = len(history)
    return QPResult(x, y, np.zeros(0), z_box, status, active, kkt, steps, history, _problem=problem)


def _status(problem: QPProblem, loose: Any, active: Any, z_box: Any) -> Status:
    """The status of an answer; `loose` says which variables are not fixed."""
    if problem.factor.nearly_convex:
        return Status.NEARLY
    degenerate = bool(((active != 0) & (z_box == 0.0) & loose).any())
    return Status.DEGENERATE if degenerate else Status.OPTIMAL


def _general(
    problem: QPProblem,
    start: QPResult | ArrayLike | None,
    tol: float,
    polish: str | None,
    budget: Budget,
) -> QPResult:
    """The result of any checked problem, or the errors of `solve_qp`."""
    p = problem.program
    state = _first_state(problem, p, start)
    if problem.factor.definite and 3 * p.q.size >= p.row_low.size:
        found = _whitened(problem, p, state, budget)
        if found is not None:
            result = _general_result(problem, p.on_host(), *found, "active set")
            if result.kkt.worst <= tol:
                return result if p.xp is np else result.moved(p.xp.asarray)
    elif isinstance(start, QPResult):
        sides = Sides(state[p.row_low.size :], state[: p.row_low.size])
        point = polished(p, sides, start.x, p.xp.concatenate([start.y, start.z]))
        if point is not None:
            point = _sharpened(problem, p, point, tol, polish)
            result = _general_result(problem, p, point, (), "active set")
            if result.kkt.worst <= tol:
                return result
    try:
        point = minimise(p, tol, budget)
    except (NotConverged, Unbounded, Infeasible) as error:
        coarse = with_rounding(p, certain=isinstance(error, Infeasible))
        if coarse is None or (isinstance(error, Unbounded) and bool(coarse.q.any())):
            raise
        logger.debug("what may be rounding is not told from zero where %s", error)
        p, point = coarse, minimise(coarse, tol, budget)
    point = _sharpened(problem, p, point, tol, polish)
    result = _general_result(problem, p, point, (), "interior point")
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
    low, high = xp.concatenate([p.row_low, p.lb]), xp.concatenate([p.row_high, p.ub])
    given = _starting_point(problem, start)
    if isinstance(given, QPResult):
        state[problem.b.size : rows], state[rows:] = given.active_rows, given.active
    elif given is not None and given.dtype == np.int8:
        state[rows:] = given
    elif given is not None:
        value = xp.concatenate([p.C @ given, given])
        state = (value >= high).astype(np.int8) - (value <= low).astype(np.int8)
    state = xp.where((state < 0) & xp.isinf(low), 0, state)
    state = xp.where((state > 0) & xp.isinf(high), 0, state)
    return xp.where(low == high, 0, state).astype(np.int8)


def _whitened(
    problem: QPProblem, p: StandardQP, state: Any, budget: Budget
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
    method.spend, spent = budget.count, False
    try:
        x, multipliers = method.run(state)
    except NotConverged:
        return None
    except TimeoutError:
        (x, multipliers), spent = method.latest, True
    x, y = d * x, e * xp.asarray(multipliers)[: e.size]
    if xp is not np:
        p, x, y = p.on_host(), to_host(x), to_host(y)
    point = certified(p, x, y)
    if spent:
        budget.best = point
        raise TimeoutError
    return point, tuple(method.history)


def _sharpened(
    problem: QPProblem, p: StandardQP, point: Point, tol: float, polish: str | None
) -> Point:
    """The point, or one with absolute residuals below `tol` too, where the problem is small."""
    if polish is None or p.xp is not np or not point.residuals.worst <= tol:
        return point
    entries = p.P.nnz + p.C.nnz if p.is_sparse else np.count_nonzero(p.P) + np.count_nonzero(p.C)
    if entries > (LIMITS.sparse if p.is_sparse else LIMITS.dense):
        return point
    best = last_digits(problem, p, PrimalDual(point.x, point.y, point.z_box), tol)
    return replace(point, **best._asdict(), residuals=residuals(p, *best))


def _general_result(
    problem: QPProblem, p: StandardQP, point: Point, history: tuple[Step, ...], path: str
) -> QPResult:
    """The answer, with residuals recomputed."""
    xp, m = p.xp, problem.b.size
    x, y, z, z_box = point.x, point.y[:m], point.y[m:], point.z_box
    kkt = residuals_of(problem, x, y, z, z_box, p, point.residuals)
    active = xp.where(x == p.lb, -1, xp.where(x == p.ub, 1, 0))
    active = xp.where(p.lb == p.ub, xp.where(z_box < 0.0, -1, 1), active).astype(np.int8)
    status = _status(problem, p.lb < p.ub, active, z_box)
    steps, rows = point.iterations or len(history), xp.sign(z).astype(np.int8)
    return QPResult(
        x, y, z, z_box, status, active, kkt, steps, history, rows, path, _problem=problem
    )
