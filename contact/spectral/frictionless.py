"""Frictionless contact on a grid: primal-dual active sets, conjugate gradients on each."""

from __future__ import annotations

import numpy as np

from contact.errors import Infeasible, NotConverged
from contact.laws.iteration import Iteration, Report
from contact.spectral.grid_problem import Grid, GridProblem
from contact.spectral.transforms import host

_FIRST = 1e-2  # accuracy of conjugate gradients while the set still changes
_SETS = 60
_PRODUCTS = 400  # of one set
_DRIFTS = 1e-9  # mean compliance over that of a point: zero but for rounding
_STALLED = 25  # products that do not halve what is left: rounding


def frictionless(
    problem: GridProblem,
    start: Grid | None = None,
    *,
    tol: float = 1e-12,
    report: Report = lambda iteration: None,
) -> tuple[Grid, float]:
    r"""Normal forces and the free normal motion of frictionless contact.

    On the active set, where :math:`\mu + c (u_n - d) > 0` at the last iterate, the forces solve
    :math:`W \mu = v_0 - d + a`, by conjugate gradients preconditioned by the inverse symbol, whose
    result is cut off outside the set. Under a given force the iterates keep its sum (projected
    conjugate gradients), and a is the mean of what is left.

    Parameters
    ----------
    problem : GridProblem
    start : array, shape (nx[, ny]), optional
        Forces of a similar problem.
    tol : float
        On the largest violation relative to the largest force.
    report : callable
        Receives each `Iteration`.

    Returns
    -------
    mu : array, shape (nx[, ny])
    a : float

    Raises
    ------
    Infeasible
        Full contact by a given displacement of a surface whose mean nothing holds.
    NotConverged
        The sets do not settle.

    References
    ----------
    M. Hintermueller, K. Ito and K. Kunisch, The primal-dual active set strategy as a semismooth
    Newton method, SIAM J. Optim. 13 (2002) 865. I. A. Polonsky and L. M. Keer, Wear 231 (1999)
    206, for conjugate gradients with transforms. N. I. M. Gould, M. E. Hribar and J. Nocedal, SIAM
    J. Sci. Comput. 23 (2001) 1376, for the projection.
    """
    xp, c = problem.xp, problem.scale[0]
    driving = xp.where(problem.can_touch, problem.v0[0] - problem.gap, 0.0)
    total = float(problem.force[0])
    if total == 0.0 or (np.isnan(total) and not bool((driving > 0)[problem.can_touch].any())):
        highest = driving[problem.can_touch].max()
        return xp.zeros_like(problem.gap), 0.0 if np.isnan(total) else -float(highest)
    whole = xp.ones_like(problem.gap)
    drifts = np.isnan(total) and c * float(xp.abs(problem.W_normal(whole)).max()) < _DRIFTS
    mu = xp.zeros_like(problem.gap) if start is None else start
    if start is not None:
        active = start > 0
    else:  # a given displacement may not hold all points at once
        active = problem.can_touch & (driving > 0) if np.isnan(total) else problem.can_touch
    accuracy, best = _FIRST, np.inf
    for step in range(1, _SETS + 1):
        if drifts and bool(active.all()):
            raise Infeasible(
                "obstacle: it is displaced beyond full contact, where nothing holds the mean "
                "displacement of the surface; drive it by a force, Rigid(obstacle, force=...)"
            )
        mu, a = _on_set(problem, active, driving, mu, total, accuracy)
        through = driving + a - problem.W_normal(mu)
        trial = xp.where(problem.can_touch, mu + c * through, -np.inf)
        found = trial > 0
        size = float(xp.abs(mu - xp.maximum(trial, 0.0)).max()) / max(
            float(xp.abs(mu).max()), 1e-300
        )
        report(Iteration(step, "active set", int(active.sum()), 0, 0, size))
        settled = bool((found == active).all())
        if size <= tol or (settled and size >= 0.5 * best):
            break
        if settled:
            best = size
        if settled or int((found ^ active).sum()) <= 1e-3 * found.size:
            accuracy = 0.5 * tol
        if not bool(found.any()):
            raise NotConverged("frictionless contact: no point is left in contact")
        active = found
    if size > 1e2 * tol:
        raise NotConverged(f"frictionless contact: residual {size:.1e} after {step} active sets")
    return xp.maximum(mu, 0.0), a


def _on_set(
    problem: GridProblem, active: Grid, driving: Grid, start: Grid, total: float, accuracy: float
) -> tuple[Grid, float]:
    """Solve on the active set, from forces that are cut off outside it.

    Numbers that steps need stay where the arrays are; the host asks for them once a product.
    """
    xp, given = problem.xp, not np.isnan(total)
    inside, count = active.astype(float), active.sum()
    mu = inside * start
    ones = inside * problem.S_normal(inside) if given else mu
    weight = ones.sum()
    if given and not float(weight) > 0:
        ones, weight = inside / count, 1.0
    if given:
        mu = mu + (total - mu.sum()) / weight * ones

    def centred(z: Grid) -> Grid:
        return z - z.sum() / weight * ones if given else z

    def levelled(r: Grid) -> tuple[Grid, Grid]:
        """Without its mean on the set, which the free motion takes up: no digits are lost to it."""
        mean = r.sum() / count if given else 0.0
        return (r - mean) * inside if given else r, mean

    r, mean = levelled(inside * (driving - problem.W_normal(mu)))
    z = centred(inside * problem.S_normal(r))
    p, rz, a, curvature = z, xp.vdot(r, z), -mean, xp.ones(())
    best, since = (np.inf, mu, a), 0
    for _ in range(_PRODUCTS):
        known = xp.stack((xp.abs(r).max(), xp.abs(mu).max(), rz, curvature))
        left, largest, slope, curved = map(float, host(known))
        if not curved > 0:
            break
        left *= problem.scale[0]
        since = 0 if left < 0.5 * best[0] else since + 1
        if left < best[0]:
            best = (left, mu, a)
        if left <= accuracy * largest or slope <= 0 or since > _STALLED:
            break
        w = inside * problem.W_normal(p)
        curvature = xp.vdot(p, w)
        with np.errstate(divide="ignore", invalid="ignore"):  # seen, and dropped, by `curved`
            step = rz / curvature
            mu = mu + step * p
            r, mean = levelled(r - step * w)
        a = a - mean
        z = centred(inside * problem.S_normal(r))
        rz, before = xp.vdot(r, z), rz
        with np.errstate(divide="ignore", invalid="ignore"):
            p = z + rz / before * p
    return best[1], float(best[2])
