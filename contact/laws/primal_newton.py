"""Semismooth Newton methods on a body whose contact rows are unknowns of it.

The linearised laws are those of `contact.laws.semismooth_newton`. Rows of points in contact, and
those of sticking ones, are prescribed; the equations of slipping ones are replaced by their law,
in which the forces are the residual of the stiffness, ``l = (f - K x)_c``. The rest is solved by
conjugate gradients or, with slip, by GMRES, both with multigrid of the symmetric part; forces and
displacements of a step therefore belong to each other, and no compliance is needed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import sparse

from contact.condensation.boundary_problem import Array, Forces
from contact.condensation.primal import PrimalForces, PrimalProblem
from contact.errors import InputError, NotConverged
from contact.laws.friction import Coulomb, Friction, Tresca
from contact.laws.iteration import Iteration, Report
from contact.laws.load_balance import check_held
from contact.laws.options import Options
from contact.laws.progress import NEAR, Progress
from contact.laws.residual import residual
from contact.laws.zones import Zones
from skfem_adini.distributed import Alteration

_LINEAR = 1e-13  # residual of the linear systems, relative to their largest right side
_STIFFEST = 1e-8  # of |q|: a point whose friction is nearer to its bound all but sticks
_GIVEN = 4  # solutions for the friction bound of the last one, before Newton's method starts anew


def primal_newton(
    problem: PrimalProblem,
    friction: Friction | None,
    options: Options,
    start: Forces | None,
    report: Report,
) -> PrimalForces:
    """Solve for contact with friction; see `contact.laws.methods.solve_boundary`.

    Parameters
    ----------
    problem : PrimalProblem
    friction : Friction or None
        In the problem's scale.
    options : Options
        Its method must be "newton".
    start : Forces or None
        If None, all points within reach of the obstacle stick to it at first.
    report : callable
        Receives each `Iteration`.

    Raises
    ------
    InputError
        Another method, or compliant surfaces.
    NotConverged
        Newton's method does not converge.
    """
    if options.method != "newton" or problem.compliance is not None:
        raise InputError(
            f"method={options.method!r}: without condensation only 'newton' is offered, on hard "
            "surfaces; take DistributedBody(..., backend='mumps')"
        )
    check_held(problem, friction)
    law = Tresca(np.zeros(problem.gap.size)) if friction is None else friction
    tol = max(0.1 * options.tol, 1e-11)  # that of the linear systems is 1e-13
    now = _stuck(problem, law, report) if start is None else _given(problem, start)
    failure: Exception | None = None
    for _ in range(2):
        try:
            return _newton(problem, now, law, tol, options.max_iterations, "newton", report)
        except NotConverged as error:
            failure = error
        if isinstance(law, Tresca):
            break
        for _ in range(_GIVEN):
            given = Tresca(law.bound(now.mu))
            now = _newton(problem, now, given, 1e-3, options.max_iterations, "tresca step", report)
    raise NotConverged(f"{failure}; try a smaller friction coefficient, or backend='mumps'")


def _newton(
    problem: PrimalProblem,
    now: PrimalForces,
    friction: Friction,
    tol: float,
    limit: int,
    phase: str,
    report: Report,
) -> PrimalForces:
    progress, size = Progress(tol), np.inf
    zones = _zones_of(problem, now, friction)
    for step in range(1, limit + 1):
        kind = "radial" if size < NEAR else "damped"
        now = _step(problem, now, zones, friction, kind)
        here = _at(problem, now)
        size = residual(here, now.mu, now.t, now.a, friction.bound(now.mu))
        active, stick, slip = (int(m.sum()) for m in (zones.active, zones.stick, zones.slip))
        report(Iteration(step, phase, active, stick, slip, size))
        if progress.ended(here, now, size):
            break
        zones = Zones.of(here, now, friction)
    found = progress.best_of(problem, phase)
    assert isinstance(found, PrimalForces)
    return found


def _at(problem: PrimalProblem, now: PrimalForces) -> PrimalProblem:
    """The problem at a state."""
    return replace(problem, v=problem.v0 + problem.system.of_chosen(now.x))


def _zones_of(problem: PrimalProblem, now: PrimalForces, friction: Friction) -> Zones:
    """Zones at a state, or those that its forces show if it has no displacements."""
    if now.x is not None:
        return Zones.of(_at(problem, now), now, friction)
    touches = problem.can_touch & ((now.mu > 0) | problem.ties)
    g = problem.bound(friction.bound(now.mu))
    rubs = (g > 0) & np.any(problem.tangent >= 0, axis=1) & touches
    # A force within a thousandth of its bound counts as slip.
    slip = rubs & (np.linalg.norm(now.t, axis=1) >= 0.999 * g)
    q = np.where(slip[:, None], 1.5 * now.t, now.t)
    none = np.zeros(now.mu.size)
    return Zones(touches, rubs & ~slip, slip, q, g, none, none, np.ones(g.size))


def _stuck(problem: PrimalProblem, friction: Friction, report: Report) -> PrimalForces:
    """All points within reach are in contact, and stick if there is friction."""
    mu, t = problem.zeros()
    none, touch = np.zeros(mu.size), problem.can_touch
    rubs = friction.bound(np.ones(mu.size)) > 0
    rubs = (rubs | problem.ties) & np.any(problem.tangent >= 0, axis=1)
    if isinstance(friction, Coulomb):
        rubs &= touch
    zones = Zones(touch, rubs, np.zeros_like(touch), t, none, none, none, np.ones(none.size))
    own = np.zeros(problem.load.size)
    return _step(problem, PrimalForces(mu, t, np.zeros(problem.s.size), own), zones, friction, "")


def _given(problem: PrimalProblem, start: Forces) -> PrimalForces:
    return PrimalForces(start.mu, start.t, np.zeros(problem.s.size), getattr(start, "x", None))


def _step(
    problem: PrimalProblem, now: PrimalForces, zones: Zones, friction: Friction, form: str
) -> PrimalForces:
    """Solve the linearised laws."""
    system, tangent = problem.system, problem.tangent
    rubbing = (zones.stick | zones.slip)[:, None] & (tangent >= 0)
    held = np.zeros(problem.v0.size, dtype=bool)
    value = -problem.v0
    at_n = problem.normal[zones.active]
    held[at_n] = True
    value[at_n] += problem.gap[zones.active]
    held[tangent[zones.stick[:, None] & (tangent >= 0)]] = True
    load = system.of_chosen(problem.load)
    alteration, right = Alteration.none(held), load
    if zones.slip.any():
        alteration, right = _slipping(problem, now, zones, friction, form, held, load)
    begin = np.zeros(problem.load.size) if now.x is None else now.x
    x, product = system.solve(
        alteration, problem.load, np.where(held, value, right), begin, _LINEAR
    )
    forces = load - system.of_chosen(product)
    mu, t = problem.zeros()
    mu[zones.active] = forces[at_n]
    t[rubbing] = forces[tangent[rubbing]]
    return PrimalForces(mu, t, now.a, x)


def _slipping(
    problem: PrimalProblem,
    now: PrimalForces,
    zones: Zones,
    friction: Friction,
    form: str,
    held: np.ndarray,
    load: Array,
) -> tuple[Alteration, Array]:
    """The linearised law of slipping points.

    It is ``t = of_v u_t + g a`` with ``of_v = g / (|q| - g) (I - a b^T)``, where a = b in radial
    return: this is the law of `semismooth_newton` times the inverse of what stands before t.
    """
    points = np.flatnonzero(zones.slip)
    q, g, t = zones.q[points], zones.g[points], now.t[points]
    length = np.linalg.norm(q, axis=1)
    b = q / length[:, None]
    a = b if form == "radial" else t / np.maximum(g, np.linalg.norm(t, axis=1))[:, None]
    factor = g / np.maximum(length - g, _STIFFEST * length)
    of_v = (zones.c[points] * factor)[:, None, None] * (
        np.eye(q.shape[1]) - a[:, :, None] * b[:, None, :]
    )
    n, at = held.size, problem.tangent[points]
    row, column, entry = [], [], []
    normal: list[list[Array]] = [[], [], []]
    right = load.copy()
    for i in range(at.shape[1]):
        live = at[:, i] >= 0
        for j in range(at.shape[1]):
            both = live & (at[:, j] >= 0)
            row.append(at[both, i])
            column.append(at[both, j])
            entry.append(of_v[both, i, j])
            right[at[both, i]] -= of_v[both, i, j] * problem.v0[at[both, j]]
        if isinstance(friction, Coulomb):
            # The bound is F mu, where mu = f_n - K_n x.
            touches = live & zones.active[points] & (problem.normal[points] >= 0)
            r, c = at[touches, i], problem.normal[points[touches]]
            share = friction.coefficient[points[touches]] * a[touches, i]
            for part, of in zip(normal, (r, c, -share), strict=True):
                part.append(of)
            right[r] -= share * load[c]
        else:
            right[at[live, i]] -= g[live] * a[live, i]
    with_x = _sparse(entry, row, column, n)
    of_rows = sparse.diags_array((~held).astype(float))
    if normal[0]:
        of_rows = of_rows + _sparse(normal[2], normal[0], normal[1], n)
    return Alteration(held, sparse.csr_array(of_rows), with_x), right


def _sparse(data: list[Array], row: list[Array], column: list[Array], n: int) -> sparse.csr_array:
    where = np.concatenate(row), np.concatenate(column)
    return sparse.csr_array((np.concatenate(data), where), shape=(n, n))
