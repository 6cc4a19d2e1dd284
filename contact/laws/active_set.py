"""Contact laws that are box quadratic programs: frictionless, and given friction in 2-D."""

from __future__ import annotations

import numpy as np

from contact.condensation.boundary_problem import Array, BoundaryProblem, Forces
from contact.errors import InputError, NotConverged
from contact.laws.iteration import Iteration, Report
from contact.laws.newton import LIMITS
from contact.laws.qp_peers import solve_box_with
from gpu import QPFactor, QPResult, solve_qp


def signorini(
    problem: BoundaryProblem,
    *,
    bound: Array | None = None,
    softness: Array | None = None,
    start: Forces | None = None,
    tol: float = 1e-12,
    springs: float = 0.0,
    peer: str | None = None,
    phase: str = "active set",
    report: Report = lambda iteration: None,
) -> Forces:
    r"""Minimise the complementary energy over the forces by the primal-dual active set method.

    .. math::
        \min \tfrac12 l^T W l - l^T (v_0 - d) \quad
        \text{s.t.} \quad \mu \ge 0, \; |t| \le g, \; C^T l = s

    is the dual of Signorini's problem with gap d and friction bound g (infinite: t is free); forces
    of bonded points are free. In two dimensions it is a box QP, solved by `gpu.solve_qp` or by
    `peer`, a solver of qpsolvers. `softness` adds ``softness |t|^2 / 2``, the regularised law t =
    u_t / softness; positive `springs` on free motions replace the load balance.
    """
    g = problem.bound(np.zeros(problem.gap.size) if bound is None else bound)
    if bound is not None and problem.tangent.shape[1] > 1 and softness is None:
        raise InputError("given friction in 3-D is no box QP; use method 'newton' or 'pdas'")
    can_touch = problem.can_touch
    live_t = (problem.tangent >= 0) & (g[:, None] > 0)
    if problem.bonded is not None:  # a component fixed by supports needs no tie force
        live_t &= (problem.W.diagonal()[problem.tangent] > 0) | ~problem.bonded[:, None]
    used = np.concatenate((problem.normal[can_touch], problem.tangent[live_t]))
    count = int(can_touch.sum())
    point_t = np.nonzero(live_t)[0]

    P = problem.W[np.ix_(used, used)]
    q = -problem.v0[used]
    q[:count] += problem.gap[can_touch]
    C = problem.C[used]
    lb, ub = np.zeros(used.size), np.full(used.size, np.inf)
    lb[:count][problem.ties[can_touch]] = -np.inf
    lb[count:], ub[count:] = -g[point_t], g[point_t]
    if softness is not None:
        P = P.copy()
        P[np.arange(count, used.size), np.arange(count, used.size)] += softness[point_t]
        lb[count:], ub[count:] = -np.inf, np.inf
    A, b = (C.T, problem.s) if C.shape[1] and not springs else (None, None)
    if springs:
        P = P + C @ C.T / springs
        q = q - C @ problem.s / springs

    mu, t = problem.zeros()
    if used.size == 0:
        return Forces(mu, t, np.zeros(problem.s.size))
    if peer is not None:
        x, y = solve_box_with(peer, P, q, A, b, lb, ub)
    else:
        guess = None if start is None else problem.forces(start.mu, start.t)[used]
        result = _box_qp(P, q, A, b, lb, ub, guess, tol)
        x, y = result.x, result.y
        for step, line in enumerate(result.history, 1):
            report(Iteration(step, phase, used.size - line.active, 0, 0, np.nan))
    mu[can_touch] = x[:count]
    t[live_t] = x[count:]
    return Forces(mu, t, (problem.s - C.T @ x) / springs if springs else -y)


def _box_qp(
    P: Array,
    q: Array,
    A: Array | None,
    b: Array | None,
    lb: Array,
    ub: Array,
    guess: Array | None,
    tol: float,
) -> QPResult:
    r"""Minimise :math:`\tfrac12 x^T P x + q^T x`; P may be singular.

    Linearly dependent rows leave the forces undetermined, but not the displacements. The proximal
    point method (Rockafellar 1976) then selects one solution: a step solves with :math:`P + \delta
    I` and :math:`q - \delta x_k`, and violates the conditions by at most :math:`\delta |x_{k+1} -
    x_k|`.
    """
    factor = _factored(P)
    if factor.definite:
        try:
            return solve_qp(factor, q, A=A, b=b, lb=lb, ub=ub, start=guess, tol=tol)
        except NotConverged:  # nearly singular
            pass
    added = 1e-9  # compliance added to each row's own of about one
    factor = _factored(P + added * np.eye(q.size))
    x = np.zeros(q.size) if guess is None else guess
    start: Array | QPResult | None = guess
    least, best = np.inf, None
    for _ in range(30):
        result = solve_qp(factor, q - added * x, A=A, b=b, lb=lb, ub=ub, start=start, tol=tol)
        x, before, start = result.x, x, result
        missed = added * float(np.abs(x - before).max())
        largest, driving = float(np.abs(x).max()), float(np.abs(q).max())
        # Forces are this large only if conditions of dependent rows contradict each other.
        if largest > 1e-2 / added * driving:
            least = np.inf
            break
        # Forces below 1e-12 of the displacements are rounding.
        size = max(largest, 1e-12 * driving, np.finfo(float).tiny)
        if missed / size < least:
            least, best = missed / size, result
        if least <= tol:
            break
    if best is None or least > LIMITS.round_off * tol:
        raise NotConverged(
            f"dependent contact rows: residual {least:.1e} at best, tolerance {tol:.1e}; they may "
            "ask for displacements that exclude each other: open the gap, choose another "
            "functional, or refine"
        )
    return best


def _factored(P: Array) -> QPFactor:
    try:
        return QPFactor(P)
    except InputError as error:
        raise InputError(
            f"functional: the compliance of its rows is not positive semidefinite ({error}); "
            "choose another functional, or refine"
        ) from error
