r"""Newton's method for plane contact with friction, with the matrix W on a GPU.

The laws and their linearisation are those of `contact.laws.semismooth_newton`, in two dimensions,
where a contact point has one tangent: every row of the linear system is a multiple of a row of W
plus a diagonal entry plus, for Coulomb's law, an entry in the column of the point's pressure. The
rows of a step are gathered, scaled and factored on the device; active sets and residuals are
computed on the host from products with W. If the iteration stalls, nothing else is tried here: the
methods on the host, `contact.laws.methods`, take over.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from contact.arrays.dense_arrays import HostArrays
from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.laws.friction import Coulomb, Friction, Tresca
from contact.laws.iteration import Iteration, Report
from contact.laws.progress import NEAR, Progress
from contact.laws.residual import residual
from contact.laws.semismooth_newton import PROXIMAL, WEAK
from contact.laws.zones import Zones

START = 15  # frictionless active-set steps, at most, that precede Newton's method on a cold start
# Stiffness, in units of `WEAK`, of the springs that hold free motions during these steps: 1e-2 of
# the stiffness of contact, which is one.
SPRINGS = 1e7


def plane_newton(
    problem: BoundaryProblem,
    arrays: HostArrays,
    friction: Friction | None,
    start: Forces | None,
    *,
    tol: float,
    max_iterations: int,
    report: Report = lambda iteration: None,
) -> Forces:
    """Solve for contact in two dimensions.

    Parameters
    ----------
    problem : BoundaryProblem
    arrays : HostArrays
        Where ``problem.W`` lies.
    friction : Friction or None
    start : Forces or None
        None starts with frictionless steps in which springs hold the free motions.
    tol : float
        On `contact.laws.residual.residual`.
    max_iterations : int
    report : callable
        Receives each `Iteration`.

    Raises
    ------
    NotConverged, LinAlgError
        The iteration stalls, or a linear system is singular.
    """
    none = Tresca(np.zeros(problem.gap.size))
    weak = WEAK * float(np.abs(problem.C).max(initial=0.0)) ** 2
    now = start or Forces(*problem.zeros(), np.zeros(problem.s.size))
    if start is None and friction is not None:
        before: NDArray[np.bool_] | None = None
        for step in range(1, START + 1):
            zones = Zones.of(problem, now, none)
            if before is not None and np.array_equal(before, zones.active):
                break
            before = zones.active
            now = _step(problem, arrays, now, zones, none, False, SPRINGS * weak, anchored=False)
            report(Iteration(step, "frictionless", int(zones.active.sum()), 0, 0, np.nan))
    acting = none if friction is None else friction
    size = residual(problem, now.mu, now.t, now.a, acting.bound(now.mu))
    progress = Progress(tol)
    for step in range(1, max_iterations + 1):
        zones = Zones.of(problem, now, acting)
        now = _step(problem, arrays, now, zones, acting, size >= NEAR, weak)
        size = residual(problem, now.mu, now.t, now.a, acting.bound(now.mu))
        active, stick, slip = (int(kind.sum()) for kind in (zones.active, zones.stick, zones.slip))
        report(Iteration(step, "newton" if friction else "active set", active, stick, slip, size))
        if progress.ended(problem, now, size):
            break
    return progress.best_of(problem, "newton")


def _step(
    problem: BoundaryProblem,
    arrays: HostArrays,
    now: Forces,
    zones: Zones,
    friction: Friction,
    damped: bool,
    weak: float,
    anchored: bool = True,
) -> Forces:
    """Solve the linearised laws for new forces and rigid motion.

    The rows of touching and sticking points are ``W l - C a = v`` with v given. The row of a
    slipping point is ``t - k u_t - F c mu = ...``: k = 0 and c = b in the exact Newton step,
    ``k = g / (|q| - g) (1 - a b)`` and c = a in the damped one, with a and b as in
    `contact.laws.semismooth_newton`.
    """
    xp, k = arrays.xp, problem.s.size
    rub = np.flatnonzero((zones.stick | zones.slip) & (problem.tangent[:, 0] >= 0))
    rows = np.concatenate((problem.normal[zones.active], problem.tangent[rub, 0]))
    n_n, n = int(zones.active.sum()), rows.size
    of_w, diagonal = np.ones(n), np.full(n, PROXIMAL)
    rhs = problem.v0[rows] + PROXIMAL * problem.forces(now.mu, now.t)[rows]
    rhs[:n_n] -= problem.gap[zones.active]

    slip = np.flatnonzero(zones.slip[rub])
    points, at = rub[slip], n_n + slip
    q, g = zones.q[points, 0], zones.g[points]
    b = np.sign(q)
    if damped:
        t = now.t[points, 0]
        b_or_a = t / np.maximum(g, np.abs(t))
        of_w[at] = g / (np.abs(q) - g) * (1.0 - b_or_a * b)
    else:
        b_or_a = b
        of_w[at] = 0.0
    diagonal[at] = 1.0
    rhs[at] *= of_w[at]

    A = xp.zeros((n + k, n + k))
    chosen = xp.asarray(rows)
    A[:n, :n] = arrays.values(problem.W)[chosen[:, None], chosen]
    A[:n, :n] *= xp.asarray(of_w)[:, None]
    i = xp.arange(n)
    A[i, i] += xp.asarray(diagonal)
    if isinstance(friction, Coulomb):
        column = np.cumsum(zones.active) - 1
        A[xp.asarray(at), xp.asarray(column[points])] -= xp.asarray(
            friction.coefficient[points] * b_or_a
        )
    else:
        rhs[at] += g * b_or_a
    if k:
        A[:n, n:] = xp.asarray(-of_w[:, None] * problem.C[rows])
        A[n:, :n] = xp.asarray(problem.C[rows].T)
        A[n:, n:] = xp.asarray(weak * np.eye(k))
        balance = problem.s + weak * now.a if anchored else problem.s
        rhs = np.concatenate((rhs, balance))
    mu, t_new = problem.zeros()
    if n + k == 0:
        return Forces(mu, t_new, np.zeros(0))
    last = np.concatenate((problem.forces(now.mu, now.t)[rows], now.a))
    left = xp.asarray(rhs) - A @ xp.asarray(last)
    # Solve for the change, as in `contact.laws.semismooth_newton`.
    solution = last + np.asarray(arrays.get(xp.linalg.solve(A, left)))
    if not np.all(np.isfinite(solution)):
        raise np.linalg.LinAlgError("singular Newton system")
    mu[zones.active] = solution[:n_n]
    t_new[rub, 0] = solution[n_n:n]
    return Forces(mu, t_new, solution[n:])
