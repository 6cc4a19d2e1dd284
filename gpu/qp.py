"""Dense strictly convex quadratic programs."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from gpu.box_qp import ActiveSet, BoxQP, Step
from gpu.dense import symmetric_product
from gpu.errors import Infeasible, InputError, NotConverged
from gpu.kkt import KKT, kkt_residuals
from gpu.problem import Problem, QPFactor, check_problem, power_of_two


class Status(Enum):
    """What is known about an answer, and what to do about it.

    Failures are raised; a result exists only with one of these.

    =============  =====================================================================
    `OPTIMAL`      every recomputed residual is below `tol`
    `DEGENERATE`   the same, but the active set is not the only one that leads to x
    =============  =====================================================================
    """

    OPTIMAL = "optimal: every recomputed residual is below tol, nothing is left to do"
    DEGENERATE = (
        "optimal, but some held variables carry no multiplier: compare x and the multipliers of "
        "two runs, not their active sets"
    )


@dataclass(frozen=True, eq=False)
class QPResult:
    """Solution of a quadratic program, with its proof.

    Attributes
    ----------
    x : (n,) numpy.ndarray
        The minimiser; a held variable is exactly at its bound.
    y : (m,) numpy.ndarray
        Multipliers of the equality rows.
    z : (0,) numpy.ndarray
        Multipliers of general inequality rows, of which there are none yet.
    z_box : (n,) numpy.ndarray
        Multipliers of the bounds, not positive at a lower, not negative at an upper one:
        ``P x + q + A'y + z_box = 0``.
    status : Status
        What is known about the answer.
    active : (n,) numpy.ndarray of int8
        -1 held at the lower bound, 0 free, +1 held at the upper bound; for a fixed variable the
        side its multiplier points to.
    kkt : KKT
        Relative residuals, recomputed from the problem.
    iterations : int
        Number of active-set steps.
    history : tuple of Step
        Number of held and of violated variables in each step.
    """

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    z_box: np.ndarray
    status: Status
    active: np.ndarray
    kkt: KKT
    iterations: int
    history: tuple[Step, ...]

    def residuals(
        self,
        P: ArrayLike | QPFactor,
        q: ArrayLike,
        G: ArrayLike | None = None,
        h: ArrayLike | None = None,
        A: ArrayLike | None = None,
        b: ArrayLike | None = None,
        lb: ArrayLike | None = None,
        ub: ArrayLike | None = None,
        *,
        h_low: ArrayLike | None = None,
    ) -> KKT:
        """Residuals of this answer in a problem given like in `solve_qp`."""
        problem = check_problem(P, q, G, h, A, b, lb, ub, h_low)
        return kkt_residuals(problem, self.x, self.y, self.z_box)


def solve_qp(
    P: ArrayLike | QPFactor,
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
) -> QPResult:
    r"""Solve a strictly convex quadratic program with bounds and equality rows.

    .. math:: \min_x \tfrac12 x^TPx + q^Tx \quad\text{subject to}\quad
              Ax = b,\quad l \le x \le u

    by primal-dual active sets, see `gpu.box_qp`. A step costs one Cholesky factorisation of the
    block of P that belongs to the free variables.

    Parameters
    ----------
    P : (n, n) array_like or QPFactor
        Symmetric positive definite matrix; only its symmetric part counts and an asymmetry of
        rounding is accepted.
    q : (n,) array_like
        Linear term.
    G, h, h_low : None
        Rows ``h_low <= G x <= h``; not supported yet.
    A : (m, n) array_like, optional
        Equality rows, few of them; they may depend on each other.
    b : (m,) array_like, optional
        Their right-hand side.
    lb, ub : float or (n,) array_like, optional
        Bounds; entries may be infinite or equal to each other.
    start : QPResult or (n,) array_like, optional
        Where to begin: the result of a nearby problem, its `active` (an int8 array), or a point.
    tol : float, optional
        Largest accepted value of `KKT.worst`. The answer is usually exact to rounding; `tol` also
        decides when an infeasibility is too small to be told from rounding of the data.

    Returns
    -------
    QPResult
        The solution, its multipliers and its residuals.

    Raises
    ------
    Infeasible
        If no point satisfies the constraints; its `certificate` has been verified.
    NotConverged
        If the residuals stay above `tol`.
    InputError
        If an argument is malformed; P not positive definite is such a case.
    NotSupported
        For inequality rows, sparse matrices and device arrays.

    Notes
    -----
    The problem is scaled to a diagonal of P between 1/2 and 2, by powers of two and hence without
    rounding: multiplying P, or a variable, by such a number changes no digit of the result.

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
    problem = check_problem(P, q, G, h, A, b, lb, ub, h_low)
    if not 0.0 < tol < 1.0:
        raise InputError(f"tol is {tol}: it must lie between 0 and 1")
    empty = problem.lb > problem.ub
    if empty.any():
        i = int(np.argmax(empty))
        raise Infeasible(
            f"the box is empty: lb[{i}] = {problem.lb[i]} is above ub[{i}] = {problem.ub[i]}",
            np.zeros(problem.b.size),
        )
    norms = np.linalg.norm(problem.A * problem.factor.scale, axis=1)
    rows = 1.0 / power_of_two(np.where(norms > 0.0, norms, 1.0))
    iterate = _first_iterate(problem, rows, start)
    try:
        iterate.run(tol, max_steps=100 + 10 * problem.q.size)
    except Infeasible as error:
        raise Infeasible(str(error), rows * error.certificate) from None
    except np.linalg.LinAlgError:
        raise NotConverged(
            "a system of free variables and equality rows is singular to working precision: "
            "P is too ill conditioned, or rows are almost dependent; regularise P or drop rows"
        ) from None
    return _result(problem, rows, iterate, tol)


def _first_iterate(
    problem: Problem, rows: np.ndarray, start: QPResult | ArrayLike | None
) -> ActiveSet:
    """The scaled problem with the active set to begin with."""
    factor, q, A, b, lb, ub = problem
    d = factor.scale
    box = BoxQP(factor.scaled, d * q, rows[:, None] * A * d, rows * b, lb / d, ub / d)
    x, y = np.clip(np.zeros_like(q), box.lb, box.ub), np.zeros_like(b)
    active = None
    if isinstance(start, QPResult):
        if start.x.shape != q.shape or start.y.shape != b.shape:
            raise InputError(
                f"start has {start.x.size} variables and {start.y.size} equality rows: "
                f"the problem has {q.size} and {b.size}"
            )
        x, y, active = start.x / d, start.y / rows, start.active
    elif start is not None:
        point = np.asarray(start)
        if point.shape != q.shape or point.dtype.kind not in "iuf":
            raise InputError(
                f"start has shape {point.shape} and type {point.dtype}: "
                f"it must be a QPResult, a real or an int8 array of shape {q.shape}"
            )
        if point.dtype == np.int8:
            active = point
            if np.any(np.abs(active) > 1):
                raise InputError("start has int8 entries other than -1, 0, 1")
        elif not np.isfinite(point).all():
            raise InputError("start has entries that are not finite")
        else:
            x = point / d
            inside = (box.lb < x) & (x < box.ub)
            y = np.linalg.lstsq(box.A[:, inside].T, -box.gradient(x, y)[inside])[0]
    state = box.guess(x, y) if active is None else active.copy()
    state[np.isinf(box.hold(x, state))] = 0
    state[lb == ub] = -1
    return ActiveSet(box, state, x, y, factor.L)


def _result(problem: Problem, rows: np.ndarray, iterate: ActiveSet, tol: float) -> QPResult:
    """The answer in the units of the problem, if its residuals pass."""
    factor, q, A, _, lb, ub = problem
    x = np.clip(factor.scale * iterate.x, lb, ub)
    y = rows * iterate.y
    force = -(symmetric_product(factor.P, x) + q + A.T @ y)
    active = np.where(lb == ub, np.where(force > 0.0, 1, -1), iterate.state).astype(np.int8)
    z_box = np.where(active * force > 0.0, force, 0.0)
    kkt = kkt_residuals(problem, x, y, z_box)
    if not kkt.worst <= tol:
        raise NotConverged(
            f"the active set has settled but {kkt} is above tol = {tol}: P is too ill conditioned, "
            "regularise it or accept a larger tol"
        )
    degenerate = np.any((active != 0) & (z_box == 0.0) & (lb < ub))
    history = tuple(iterate.history)
    return QPResult(
        x=x,
        y=y,
        z=np.zeros(0),
        z_box=z_box,
        status=Status.DEGENERATE if degenerate else Status.OPTIMAL,
        active=active,
        kkt=kkt,
        iterations=len(history),
        history=history,
    )
