"""Contact laws that are box quadratic programs: frictionless, and given friction in 2-D."""

from __future__ import annotations

import numpy as np

from contact.boundary import Array, BoundaryProblem
from contact.errors import InputError
from contact.newton import Forces, Iteration, Report
from contact.peers import solve_box_with
from gpu import QPFactor, solve_qp


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

    is the dual of Signorini's problem with given friction. In two dimensions the friction ball is
    an interval and the whole is a box QP, solved by `gpu.solve_qp`.

    Parameters
    ----------
    problem : BoundaryProblem
    bound : ndarray, shape (m,), optional
        Friction bound g of each point; None for no friction. ``inf`` leaves t free.
    softness : ndarray, shape (m,), optional
        Adds ``softness |t|^2 / 2``: the regularised friction law t = u_t / softness of one
        fixed-point step.
    start : Forces, optional
        Warm start.
    tol : float
        Of the QP.
    springs : float
        Hold free rigid motions by springs of this stiffness instead of by balance.
    peer : str, optional
        Solver of qpsolvers that takes the place of `gpu.solve_qp`.
    phase, report
        Label and receiver of the history.

    Raises
    ------
    gpu.Infeasible
        No admissible forces balance the loads on a free rigid motion.
    """
    g = np.zeros(problem.gap.size) if bound is None else bound
    if bound is not None and problem.tangent.shape[1] > 1 and softness is None:
        raise InputError("given friction in 3-D is no box QP; use method 'newton' or 'pdas'")
    can_touch = problem.can_touch
    live_t = (problem.tangent >= 0) & (g[:, None] > 0)
    used = np.concatenate((problem.normal[can_touch], problem.tangent[live_t]))
    count = int(can_touch.sum())
    point_t = np.nonzero(live_t)[0]

    P = problem.W[np.ix_(used, used)]
    q = -problem.v0[used]
    q[:count] += problem.gap[can_touch]
    C = problem.C[used]
    lb, ub = np.zeros(used.size), np.full(used.size, np.inf)
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
        # A singular compliance means dependent rows, which the caller reports by name.
        factor = QPFactor(P, semidefinite=False)
        result = solve_qp(factor, q, A=A, b=b, lb=lb, ub=ub, start=guess, tol=tol)
        x, y = result.x, result.y
        for step, line in enumerate(result.history, 1):
            report(Iteration(step, phase, used.size - line.active, 0, 0, np.nan))
    mu[can_touch] = x[:count]
    t[live_t] = x[count:]
    return Forces(mu, t, (problem.s - C.T @ x) / springs if springs else -y)
