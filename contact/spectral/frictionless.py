"""Frictionless contact on a grid: primal-dual active sets, conjugate gradients on each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from contact.errors import Infeasible, NotConverged
from contact.laws.iteration import Iteration, Report
from contact.spectral.grid_problem import Grid, GridProblem
from contact.spectral.normal_filter import NormalFilter
from skfem_adini.ground.arrays import host, namespace


def frictionless(
    problem: GridProblem,
    start: Grid | None = None,
    *,
    tol: float = 1e-12,
    report: Report = lambda iteration: None,
) -> tuple[Grid, float]:
    r"""Normal forces and the free normal motion of frictionless contact, from an initial guess.

    On the active set, where :math:`\mu + c (u_n - d) > 0` at the last iterate, the forces solve
    :math:`W \mu = v_0 - d + a`, by conjugate gradients preconditioned by the inverse symbol,
    restricted to the set. They stop at a hundredth of the last set's error (forcing terms). Under a
    given force the iterates keep its sum (projection), and a is the mean residual. The first set is
    that of the problem on every other point, if the body has such a coarse grid.

    M. Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13 (2002) 865, active sets; I. A. Polonsky,
    L. M. Keer, Wear 231 (1999) 206, transforms; N. I. M. Gould, M. E. Hribar, J. Nocedal, SIAM J.
    Sci. Comput. 23 (2001) 1376, projection; S. C. Eisenstat, H. F. Walker, SIAM J. Sci. Comput. 17
    (1996) 16, forcing.
    """
    return _solved(NormalProblem.of(problem), start, tol, report)


def _solved(
    problem: NormalProblem, start: Grid | None, tol: float, report: Report
) -> tuple[Grid, float]:
    xp, c, driving, can_touch = problem.xp, problem.c, problem.driving, problem.can_touch
    if not bool(can_touch.any()):
        return xp.zeros_like(driving), 0.0
    driven = bool((driving > 0)[can_touch].any())
    if problem.total == 0.0 or not (problem.given or driven):
        highest = driving[can_touch].max()
        return xp.zeros_like(driving), -float(highest) if problem.given else 0.0
    drifts = not problem.given and _drifts(problem)
    mu, active = _first_set(problem, start)
    loosest = 1e-2  # accuracy of conjugate gradients on the first sets
    accuracy, best = loosest, np.inf
    for step in range(1, 61):
        if drifts and bool(active.all()):
            raise Infeasible(
                "obstacle: it is displaced beyond full contact, where nothing holds the mean "
                "displacement of the surface; drive it by a force, Rigid(obstacle, force=...)"
            )
        mu, a, u = _on_set(problem, active, mu, accuracy)
        trial = xp.where(can_touch, mu + c * (driving + a - u), -np.inf)
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
        solved = settled or step >= 30  # from then on solve fully on every set
        accuracy = 0.5 * tol if solved else max(0.5 * tol, min(loosest, 1e-2 * size))
        if not bool(found.any()):
            raise NotConverged("frictionless contact: no point is left in contact")
        active = found
    if size > 1e2 * tol:
        raise NotConverged(f"frictionless contact: residual {size:.1e} after {step} active sets")
    return xp.maximum(mu, 0.0), a


def _drifts(problem: NormalProblem) -> bool:
    """Whether the mean displacement of the surface is free."""
    whole = problem.W(problem.xp.ones_like(problem.driving))
    return bool(problem.c * float(problem.xp.abs(whole).max()) < 1e-9)  # zero up to rounding


def _first_set(problem: NormalProblem, start: Grid | None) -> tuple[Grid, Grid]:
    """Initial forces and points in contact."""
    if start is None and (coarser := problem.coarser()) is not None and problem.filter is not None:
        try:
            mu, _ = _solved(coarser, None, 0.1, lambda iteration: None)
            start = problem.filter.refined(mu)
        except (Infeasible, NotConverged):
            start = None
    if start is not None and bool((start > 0).any()):
        mu, active = problem.predicted(start)
        if bool(active.any()):
            return mu, active
    # Not all points need to be in contact under a given displacement.
    active = problem.can_touch if problem.given else problem.can_touch & (problem.driving > 0)
    return problem.xp.zeros_like(problem.driving), active


def _on_set(
    problem: NormalProblem, active: Grid, start: Grid, accuracy: float
) -> tuple[Grid, float, Grid]:
    """Forces on the active set, the free motion, displacements of all points. Scalars of the
    iteration stay on the device; the host reads them once per product.
    """
    xp, given = problem.xp, problem.given
    at, field = xp.flatnonzero(active), xp.zeros_like(problem.driving)
    driving = problem.driving.ravel()[at]

    def spread(values: Grid) -> Grid:
        field.reshape(-1)[at] = values
        return field

    def centred(values: Grid) -> tuple[Grid, Grid]:
        """Subtract the mean, which the free motion absorbs, to avoid cancellation."""
        mean = values.mean() if given else 0.0
        return values - mean, mean

    x = start.ravel()[at]
    if given:
        whole = float(x.sum())
        x = x * (problem.total / whole) if whole > 0 else xp.full_like(x, problem.total / x.size)
    u = problem.W(spread(x))
    r, mean = centred(driving - u.ravel()[at])
    z, _ = centred(problem.S(spread(r)).ravel()[at])
    p, rz, a, curvature = z, xp.vdot(r, z), -mean, xp.ones(())
    best, since = (np.inf, 0, x, a), 0
    for step in range(400):
        known = xp.stack((xp.abs(r).max(), xp.abs(x).max(), rz, curvature))
        left, largest, slope, curved = map(float, host(known))
        if not curved > 0:
            break
        left *= problem.c
        since = 0 if left < 0.5 * best[0] else since + 1
        if left < best[0]:
            best = (left, step, x, a)
        # A residual not halved by this many products is rounding.
        if left <= accuracy * largest or slope <= 0 or since > 25:
            break
        w = problem.W(spread(p))
        inside = w.ravel()[at]
        curvature = xp.vdot(p, inside)
        with np.errstate(divide="ignore", invalid="ignore"):  # `curved` excludes such steps
            along = rz / curvature
            x, u = x + along * p, u + along * w
            r, mean = centred(r - along * inside)
        a = a - mean
        z, _ = centred(problem.S(spread(r)).ravel()[at])
        rz, before = xp.vdot(r, z), rz
        with np.errstate(divide="ignore", invalid="ignore"):
            p = z + rz / before * p
    _, reached, x, a = best
    mu = spread(x).copy()
    return mu, float(a), u if reached == step else problem.W(mu)


@dataclass(frozen=True)
class NormalProblem:
    """Normal forces mu that reduce the penetration: through = driving + a - W mu."""

    W: Callable[[Grid], Grid]  # compliance
    S: Callable[[Grid], Grid]  # approximate inverse of W
    driving: Grid  # penetration without forces, zero where contact is impossible
    can_touch: Grid
    total: float  # sum of the forces; NaN if a is zero instead
    c: float  # force per displacement of a single point
    filter: NormalFilter | None  # the body, if it has coarser grids

    @classmethod
    def of(cls, problem: GridProblem) -> NormalProblem:
        """The normal part of a problem."""
        can_touch = problem.can_touch
        driving = problem.xp.where(can_touch, problem.v0[0] - problem.gap, 0.0)
        return cls(
            problem.W_normal, problem.S_normal, driving, can_touch, float(problem.force[0]),
            problem.scale_normal, getattr(problem.compliance, "normal_filter", None),
        )  # fmt: skip

    @property
    def xp(self) -> Any:
        """NumPy or CuPy."""
        return namespace(self.driving)

    @property
    def given(self) -> bool:
        """Whether the sum of the forces is given and the motion a is free."""
        return not np.isnan(self.total)

    def coarser(self) -> NormalProblem | None:
        """The problem on every other point; None if the body has no coarser grid."""
        body = None if self.filter is None else self.filter.coarser
        if body is None:
            return None
        xp, every = self.xp, (slice(None, None, 2),) * self.driving.ndim
        driving, can_touch = (
            xp.ascontiguousarray(v[every]) for v in (self.driving, self.can_touch)
        )
        alone = xp.zeros_like(driving)
        middle = tuple(m // 2 for m in alone.shape)
        alone[middle] = 1.0
        c = 1.0 / float(body.apply_normal(alone)[middle])
        return NormalProblem(
            body.apply_normal, body.precondition_normal, driving, can_touch, self.total, c, body
        )

    def predicted(self, mu: Grid) -> tuple[Grid, Grid]:
        """Forces near mu with the given sum, and the resulting points in contact."""
        inside, a = mu > 0, 0.0
        if self.given:
            mu = mu * (self.total / mu.sum())
        through = self.driving - self.W(mu)
        if self.given:
            a = (through * inside).sum() / inside.sum()
        return mu, self.can_touch & (mu + self.c * (through - a) > 0)
