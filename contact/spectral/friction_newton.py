r"""Semismooth Newton methods for friction on a grid, with GMRES inside.

The laws and their linearisations are those of `contact.laws.semismooth_newton`: with the trial
force q = t + c v_t and the bound g, points with |q| <= g stick and the others slip, by radial
return or by the damped form. Rows of slip are multiplied by (|q| - g) / |q| in the damped form, so
that no coefficient is large where slip begins.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from contact.arrays.krylov import gmres
from contact.errors import NotConverged
from contact.laws.iteration import Iteration, Report
from contact.spectral.grid_problem import Grid, GridProblem, project
from skfem_adini.ground.arrays import host

_NEAR = 0.1  # residual below which radial return is used, as in `contact.laws.progress`
_FORCING = 1e-3
_PATIENCE = 12  # steps without a new least residual


@dataclass(frozen=True)
class GridFriction:
    """A friction law: the coefficient of Coulomb's, or Tresca's bound of each point.

    Attributes
    ----------
    value : array, shape (nx[, ny])
    coulomb : bool
    """

    value: Grid
    coulomb: bool

    def bound(self, pressing: Grid) -> Grid:
        """g for normal forces that are not negative."""
        return self.value * pressing if self.coulomb else self.value


def residual(problem: GridProblem, friction: GridFriction, l: Grid, a: Any, v: Grid) -> float:
    """Largest violation of the laws and of the balance, relative to the largest force."""
    xp, c = problem.xp, problem.scale
    trial = xp.where(problem.can_touch, l[0] + c[0] * (v[0] - problem.gap), -np.inf)
    contact = xp.abs(l[0] - xp.maximum(trial, 0.0)).max()
    rub = xp.abs(l[1:] - project(l[1:] + c[1] * v[1:], friction.bound(xp.maximum(l[0], 0.0)))).max()
    off = (problem.sums(l) - problem.force)[problem.free] / max(1.0, problem.gap.size**0.5)
    return max(float(contact), float(rub), np.abs(off).max(initial=0.0)) / problem.size(l)


def friction_newton(
    problem: GridProblem,
    friction: GridFriction,
    start: tuple[Grid, Any],
    *,
    tol: float = 1e-12,
    max_iterations: int = 60,
    phase: str = "newton",
    report: Report = lambda iteration: None,
) -> tuple[Grid, Any]:
    """Forces and free motions of contact with friction.

    Parameters
    ----------
    problem : GridProblem
    friction : GridFriction
    start : tuple
        Forces (dim, nx[, ny]) and motions (dim,).
    tol : float
        On `residual`.
    max_iterations : int
    phase : str
        Label in the history.
    report : callable
        Receives each `Iteration`.

    Returns
    -------
    l : array, shape (dim, nx[, ny])
    a : ndarray, shape (dim,)

    Raises
    ------
    NotConverged
        The limit of iterations is reached, or the residual no longer falls.

    References
    ----------
    S. Hueeber, G. Stadler and B. Wohlmuth, SIAM J. Sci. Comput. 30 (2008) 572. S. C. Eisenstat and
    H. F. Walker, SIAM J. Sci. Comput. 17 (1996) 16, for forcing terms.
    """
    l, a = start
    v = problem.displacements(l, a)
    size = residual(problem, friction, l, a, v)
    best, since, radial = (size, l, a), 0, size < _NEAR
    for step in range(1, max_iterations + 1):
        zones = _Zones.of(problem, friction, l, v)
        l, a = _step(problem, friction, zones, l, a, v, radial, min(_FORCING, 0.01 * size))
        v = problem.displacements(l, a)
        before, size = size, residual(problem, friction, l, a, v)
        counts = [int(z.sum()) for z in (zones.active, zones.stick, zones.slip)]
        report(Iteration(step, phase, counts[0], counts[1], counts[2], size))
        since = 0 if size < best[0] else since + 1
        if size < best[0]:
            best = (size, l, a)
        near = best[0] <= 1e2 * tol
        if size <= tol or (near and size > 0.5 * before) or since >= _PATIENCE:
            break
        # Radial return that does not get nearer cycles: the damped form leads out.
        radial = size < _NEAR and not (radial and size > 0.9 * before)
    if best[0] > 1e2 * tol:
        raise NotConverged(f"{phase}: residual {best[0]:.1e} at best, tolerance {tol:.1e}")
    return best[1], best[2]


@dataclass(frozen=True)
class _Zones:
    """Sets of points, the trial force q = t + c v of friction with its c, and its bound."""

    active: Grid
    stick: Grid
    slip: Grid
    c: Any
    q: Grid
    g: Grid

    @classmethod
    def of(cls, problem: GridProblem, friction: GridFriction, l: Grid, v: Grid) -> _Zones:
        xp, c = problem.xp, problem.scale
        trial = xp.where(problem.can_touch, l[0] + c[0] * (v[0] - problem.gap), -np.inf)
        active = trial > 0
        g = friction.bound(xp.where(active, trial, 0.0))
        along = c[1]
        if problem.swept is not None:  # they slip from the first step on, by another c if need be
            size, moves = (xp.sqrt((w[1:] ** 2).sum(axis=0)) for w in (l, v))
            length = xp.sqrt(((l[1:] + along * v[1:]) ** 2).sum(axis=0))
            more = 4.0 * (g + size) / xp.where(problem.swept, moves, 1.0)
            along = c[1] + xp.where(problem.swept & (length <= g), more, 0.0)
        q = l[1:] + along * v[1:]
        length = xp.sqrt((q * q).sum(axis=0))
        return cls(active, (g > 0) & (length <= g), (g > 0) & (length > g), along, q, g)


def _step(
    problem: GridProblem,
    friction: GridFriction,
    zones: _Zones,
    l: Grid,
    a: Any,
    v: Grid,
    radial: bool,
    forcing: float,
) -> tuple[Grid, Any]:
    """Solve the linearised laws for the change of the forces and of the free motions."""
    xp, free = problem.xp, problem.free
    system = _System.of(problem, friction, zones, l, radial)
    kept = xp.where(system.live, l, 0.0)
    # Forces that vanish act on the others' displacements, too.
    now = v + problem.W(l - kept)
    off = -system.rows(kept, now)
    off[0] -= xp.where(zones.active, problem.scale[0] * problem.gap, 0.0)
    if not friction.coulomb:
        off[1:] += xp.where(zones.slip, system.along * system.own * friction.value, 0.0)
    balance = (problem.force - problem.sums(kept))[free]
    right = system.packed(off, balance * system.unit)
    change, _ = gmres(system.product, right, system.precondition, forcing, most=300)
    step, motions = system.unpacked(change)
    moved = a.copy()
    moved[free] += motions
    return kept + step, moved


@dataclass(frozen=True)
class _System:
    """The linearised laws: rows of contact, stick and slip, and the balance of free motions.

    Vectors hold the live components of points alone, as a rule few, and the free motions after.
    """

    problem: GridProblem
    live: Grid
    at: Grid  # numbers of the live components
    held: Grid
    zones: _Zones
    own: Grid  # per slipping point the share of t itself, times the identity or I - b b^T
    ratio: Grid
    b: Grid
    along: Grid
    of_normal: Grid
    radial: bool
    unit: float
    columns: list[Grid]
    gram: Any

    @classmethod
    def of(
        cls, problem: GridProblem, friction: GridFriction, zones: _Zones, l: Grid, radial: bool
    ) -> _System:
        xp = problem.xp
        length = xp.sqrt((zones.q**2).sum(axis=0))
        safe = xp.where(zones.slip, length, 1.0)
        b, ratio = zones.q / safe, xp.where(zones.slip, zones.g / safe, 0.0)
        if radial:
            own, along = xp.ones_like(ratio), b
        else:
            t = l[1:]
            size = xp.maximum(zones.g, xp.sqrt((t * t).sum(axis=0)))
            own, along = 1.0 - ratio, t / xp.where(zones.slip, size, 1.0)
        weight = xp.where(zones.slip, own, 0.0)
        # The bound F mu is an unknown, Tresca's is known.
        of_normal = weight * (friction.value if friction.coulomb else 0.0)
        rubs = zones.stick | zones.slip
        live = xp.stack([zones.active, *[rubs] * (len(l) - 1)])
        # Where slip has only begun, rows are nearly those of stick, and preconditioned alike.
        held = xp.stack(
            [zones.active, *[zones.stick | (zones.slip & (ratio > 0.5))] * (len(l) - 1)]
        )
        unit = 1.0 / problem.gap.size**0.5
        system = cls(
            problem, live, xp.flatnonzero(live), held, zones, own, ratio, b, along, of_normal,
            radial, unit, [], None,
        )  # fmt: skip
        columns = []
        for i in problem.free:
            rows = xp.zeros_like(l)
            rows[i] = 1.0
            columns.append(system._forces(system._of_motion(rows)))
        gram = np.array([[float(z[i].sum()) for z in columns] for i in problem.free])
        object.__setattr__(system, "columns", columns)
        object.__setattr__(system, "gram", gram)
        return system

    def rows(self, x: Grid, v: Grid) -> Grid:
        """The laws at forces x and displacements v, without the gap and Tresca's bound."""
        c, zones, xp = self.problem.scale, self.zones, self.problem.xp
        out = xp.zeros_like(x)
        out[0] = xp.where(zones.active, -c[0] * v[0], 0.0)
        out[1:] = xp.where(zones.stick, -c[1] * v[1:], 0.0) + self._slip(x, zones.c * v[1:])
        return out

    def _slip(self, x: Grid, cv: Grid) -> Grid:
        """own t - of_v c v - direction F mu on slipping points."""
        zones, xp = self.zones, self.problem.xp
        t = x[1:]
        if self.radial:
            across = t + cv - self.b * (self.b * (t + cv)).sum(axis=0)
            law = t - self.ratio * across
        else:
            turned = cv - self.along * (self.b * cv).sum(axis=0)
            law = self.own * t - self.ratio * turned
        return xp.where(zones.slip, law - self.along * self.of_normal * x[0], 0.0)

    def _of_motion(self, a: Grid) -> Grid:
        """What motions a add to the rows."""
        return self.rows(self.problem.xp.zeros_like(a), a)

    def packed(self, values: Grid, motions: Any) -> Any:
        """A vector of values on the grid and of numbers of the free motions."""
        return self.problem.xp.concatenate(
            (values.ravel()[self.at], self.problem.xp.asarray(motions))
        )

    def unpacked(self, vector: Any) -> tuple[Grid, Any]:
        """Values on the grid, zero where nothing is live, and those of the motions on the host."""
        values, n = self.problem.xp.zeros(self.live.shape), self.at.size
        values.reshape(-1)[self.at] = vector[:n]
        return values, host(vector[n:])

    def product(self, vector: Any) -> Any:
        """The matrix times (forces, free motions)."""
        problem, (x, motions) = self.problem, self.unpacked(vector)
        a = np.zeros(len(x))
        a[problem.free] = motions
        v = problem.moved(a) - problem.W(x)
        return self.packed(self.rows(x, v), problem.sums(x)[problem.free] * self.unit)

    def _forces(self, y: Grid) -> Grid:
        """Approximate forces of given rows."""
        problem, xp = self.problem, self.problem.xp
        held = xp.where(self.held, y, 0.0)
        held[0] /= problem.scale[0]
        held[1:] /= problem.scale[1]
        x = xp.where(self.held, problem.S(held), 0.0)
        if problem.fixed is not None:  # forces there move nothing; they balance those of a motion
            x = xp.where(self.held & problem.fixed, y, x)
        rest = self.zones.slip & ~self.held[1]
        own = xp.where(rest, self.own, 1.0)
        x[1:] += xp.where(rest, (y[1:] + self.along * self.of_normal * x[0]) / own, 0.0)
        return x

    def precondition(self, vector: Any) -> Any:
        """Roughly the inverse: forces of displacement rows, then motions that balance them."""
        problem, (y, wanted) = self.problem, self.unpacked(vector)
        x = self._forces(y)
        if not problem.free:
            return self.packed(x, wanted)
        off = problem.sums(x)[problem.free] - wanted / self.unit
        a = np.linalg.lstsq(self.gram, off, rcond=1e-12)[0]
        for z, part in zip(self.columns, a, strict=True):
            x = x - float(part) * z
        return self.packed(x, a)
