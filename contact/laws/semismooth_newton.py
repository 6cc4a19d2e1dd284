r"""Semismooth Newton methods for contact with friction, on the condensed boundary problem.

The contact law is imposed by an active set: ``u_n = d`` where ``mu + u_n - d > 0``, and ``mu = 0``
elsewhere, with gap d. On compliant surfaces ``u_n - d = h(mu)``: the step linearises h at the
solution of ``mu + h(mu) = q`` for the last q = mu + u_n - d. For friction with bound g let
q = t + u_t and b = q / |q|:

* g = 0: t = 0;
* stick, |q| <= g: u_t = 0;
* slip, |q| > g: the linearised law, in one of two forms,

  - radial return, the exact Newton step of t = g q / |q|:
    ``t+ = g b + P (t+ + u_t+)`` with ``P = (g / |q|) (I - b b^T)``;
  - damped, equation (4.16) of the dissertation, in its corrected
    form: ``t+ = g / (|q| - g) (I - a b^T) u_t+ + g a`` with ``a = t / max(g, |t|)``.

The damped form converges from far away, radial return is fast near the solution. The default,
"switched", takes the damped form until the residual falls below .1 and radial return from there. It
needs 3 to 9 steps on blocks, curved parts and 3-D bodies for friction .1 to 3, where radial return
alone cycles in a third of the cases.

For Coulomb's law g = F mu+ on active points is an unknown of the same linear system (monolithic).
In two dimensions radial return is an active-set method on the sign of the slip: where it
converges, it ends after finitely many steps.

References
----------
S. Hueeber, G. Stadler and B. Wohlmuth, A primal-dual active set algorithm for three-dimensional
contact problems with Coulomb friction, SIAM J. Sci. Comput. 30 (2008). The dissertation: S. A.
King, Multi-Moment Methods for PDEs and GPUs for Large-Scale Scientific Computations, North Carolina
State University, 2012.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, lapack

from contact.condensation.boundary_problem import Array, BoundaryProblem, Forces
from contact.laws.friction import Coulomb, Friction
from contact.laws.iteration import Iteration, Report
from contact.laws.progress import NEAR, Progress
from contact.laws.residual import residual
from contact.laws.zones import Zones

# Compliance that acts on the change of the forces; that of each row is one. It makes the step
# unique where rows are linearly dependent, has no effect at convergence, and is too small to cost a
# step.
PROXIMAL = 1e-13
# Stiffness, relative to the square of the largest entry of C, that acts on the change of free
# motions: it makes the step unique while too few points are in contact to hold the body, and has no
# effect at convergence either.
WEAK = 1e-9


def semismooth_newton(
    problem: BoundaryProblem,
    start: Forces,
    friction: Friction,
    *,
    form: str = "switched",
    tol: float = 1e-12,
    max_iterations: int = 50,
    phase: str = "newton",
    report: Report = lambda iteration: None,
) -> Forces:
    """Solve for contact with Coulomb's friction or with a given friction bound.

    Parameters
    ----------
    problem : BoundaryProblem
    start : Forces
    friction : Friction
        The law, in the scale of the problem.
    form : {"switched", "radial", "damped"}
    tol : float
        On the relative residual of `contact.laws.residual.residual`.
    max_iterations : int
    phase : str
        Label in the history.
    report : callable
        Receives each `Iteration`.

    Returns
    -------
    Forces

    Raises
    ------
    NotConverged
        The limit of iterations is reached, or the residual stalls.
    """
    now = start
    size = residual(problem, now.mu, now.t, now.a, friction.bound(now.mu))
    progress = Progress(tol)
    for step in range(1, max_iterations + 1):
        zones = Zones.of(problem, now, friction)
        kind = ("radial" if size < NEAR else "damped") if form == "switched" else form
        now = _step(problem, now, zones, friction, kind)
        size = residual(problem, now.mu, now.t, now.a, friction.bound(now.mu))
        report(
            Iteration(
                step,
                phase,
                int(zones.active.sum()),
                int(zones.stick.sum()),
                int(zones.slip.sum()),
                size,
            )
        )
        if progress.ended(problem, now, size):
            break
    return progress.best_of(problem, phase)


def _step(
    problem: BoundaryProblem, now: Forces, zones: Zones, friction: Friction, form: str
) -> Forces:
    """Solve the linearised laws for new forces and rigid motion."""
    tangent, k = problem.tangent, problem.s.size
    rubbing = (zones.stick | zones.slip)[:, None] & (tangent >= 0)
    rows_n = problem.normal[zones.active]
    rows_t = tangent[rubbing]
    rows = np.concatenate((rows_n, rows_t))
    n_n, n = rows_n.size, rows.size

    # Displacement rows: W l - C a = v0 - d (contact) and = v0 (stick). LAPACK takes column-major
    # arrays.
    A = np.zeros((n + k, n + k), order="F")
    A[:n, :n] = problem.W.take(rows, axis=0).take(rows, axis=1)
    A[np.arange(n), np.arange(n)] += PROXIMAL
    A[:n, n:] = -problem.C[rows]
    rhs = np.concatenate((problem.v0[rows], np.zeros(k)))
    rhs[:n_n] -= problem.gap[zones.active]
    if problem.compliance is not None:
        A[np.arange(n_n), np.arange(n_n)] += zones.slope[zones.active]
        rhs[:n_n] -= zones.opening[zones.active]
    rhs[:n] += PROXIMAL * problem.forces(now.mu, now.t)[rows]

    # At slipping points the linearised law replaces the equation for u_t.
    place = np.full(tangent.shape, -1)
    place[rubbing] = n_n + np.arange(rows_t.size)
    normal_place = np.full(zones.active.size, -1)
    normal_place[zones.active] = np.arange(n_n)
    _impose_slip(A, rhs, now, zones, place, normal_place, friction, form)

    if k:
        # The balance of loads.
        weak = np.full(k, WEAK * float(np.abs(problem.C).max()) ** 2)
        A[n:, :n] = problem.C[rows].T
        if problem.K is not None:
            weak[np.diag(problem.K) > 0] = 0.0  # elastic motions have their own stiffness
            A[n:, n:] = problem.K
        A[np.arange(n, n + k), np.arange(n, n + k)] += weak
        rhs[n:] = problem.s + weak * now.a
    last = np.concatenate((problem.forces(now.mu, now.t)[rows], now.a))
    # Solve for the change: its rounding error is relative to its own size, and the next step
    # corrects it.
    solution = last + _solve(A, rhs - A @ last)
    mu, t = problem.zeros()
    mu[zones.active] = solution[:n_n]
    t[rubbing] = solution[n_n:n]
    return Forces(mu, t, solution[n:])


def _impose_slip(
    A: Array,
    rhs: Array,
    now: Forces,
    zones: Zones,
    place: NDArray[np.int64],
    normal_place: NDArray[np.int64],
    friction: Friction,
    form: str,
) -> None:
    """Overwrite the displacement rows of slipping points by their linearised friction law.

    Each such row contains v = v0 - W l + C a as ``A x - rhs = -v``. The law of a point is ``own t -
    of_v v = bound * direction``; the bound is g or, for Coulomb's law, the unknown F mu.
    """
    points = np.flatnonzero(zones.slip)
    if points.size == 0:
        return
    dim_t = place.shape[1]
    q, g = zones.q[points], zones.g[points]
    length = np.linalg.norm(q, axis=1)
    b = q / length[:, None]
    identity = np.eye(dim_t)
    if form == "radial":
        P = (g / length)[:, None, None] * (identity - b[:, :, None] * b[:, None, :])
        own, of_v, direction = identity - P, P, b
    else:
        a = now.t[points] / np.maximum(g, np.linalg.norm(now.t[points], axis=1))[:, None]
        own = np.broadcast_to(identity, (points.size, dim_t, dim_t))
        of_v = (g / (length - g))[:, None, None] * (identity - a[:, :, None] * b[:, None, :])
        direction = a
    at = place[points]  # (p, dim_t), -1 for a prescribed tangent
    live = at >= 0
    safe = np.where(live, at, 0)
    v_rows = np.where(live[:, :, None], A[safe], 0.0)  # -v = A x - rhs
    v_rhs = np.where(live, rhs[safe], 0.0)
    if A.size and (dim_t > 1 or form != "radial"):
        new_rows = np.einsum("pij,pjn->pin", of_v, v_rows)
        new_rhs = np.einsum("pij,pj->pi", of_v, v_rhs)
    else:
        new_rows, new_rhs = np.zeros_like(v_rows), np.zeros_like(v_rhs)
    for i in range(dim_t):
        for j in range(dim_t):
            both = live[:, i] & live[:, j]
            new_rows[np.flatnonzero(both), i, at[both, j]] += own[both, i, j]
        if isinstance(friction, Coulomb):
            column = normal_place[points]
            new_rows[np.arange(points.size), i, column] -= (
                friction.coefficient[points] * direction[:, i]
            )
        else:
            new_rhs[:, i] += g * direction[:, i]
    A[at[live]] = new_rows[live]
    rhs[at[live]] = new_rhs[live]


def _solve(A: Array, rhs: Array) -> Array:
    if rhs.size == 0:
        return rhs
    _, _, x, info = lapack.dgesv(A, rhs, overwrite_a=True, overwrite_b=True)
    if info != 0 or not np.all(np.isfinite(x)):
        raise LinAlgError("singular Newton system")
    return x
