"""Newton's method for friction on a grid, with GMRES inside (`contact.laws.newton`)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from contact.arrays.krylov import gmres
from contact.laws.friction import Friction, lengths
from contact.laws.law import ContactLaw, SlipLaw, State, Zones
from contact.laws.surface_law import SurfaceLaw
from contact.spectral.grid_problem import Grid, GridProblem
from skfem_adini.ground.arrays import host


@dataclass(frozen=True)
class Waves:
    """A problem on a grid, with forces (dim, nx[, ny]) and motions, for
    `contact.laws.newton.newton`.
    """

    problem: GridProblem
    friction: Friction
    surface: SurfaceLaw | None = None

    @property
    def patience(self) -> int:
        """Steps without progress; where adhesion peels, points part one after the other."""
        return 60 if self.surface is not None and self.surface.softens else 12

    @cached_property
    def law(self) -> ContactLaw:
        """The law of all points."""
        scale, swept = self.problem.scale, self.problem.swept
        return ContactLaw(self.friction, scale, swept=swept, surface=self.surface)

    def state(self, forces: tuple[Grid, Any]) -> State:
        """Forces and the displacements that they cause."""
        (l, a), p = forces, self.problem
        v = p.displacements(l, a)
        through = p.xp.where(p.can_touch, v[0] - p.gap, -np.inf)
        return State(forces, l[0], l[1:], through, v[1:])

    def residual(self, state: State) -> float:
        """Largest violation of the laws and the load balance, over the largest force."""
        p, (l, _) = self.problem, state.forces
        off = (p.sums(l) - p.force)[p.free] / max(1.0, p.gap.size**0.5)
        return max(self.law.violation(state), np.abs(off).max(initial=0.0)) / p.size(l)

    def rounding(self, state: State) -> float:
        """Return zero: the rounding error is unknown."""
        return 0.0

    def softened(self, forces: tuple[Grid, Any], delta: float) -> Waves:
        """The problem with springs at the points, stress-free at `forces`."""
        return replace(self, problem=Softened.near(self.problem, forces[0], delta))

    def step(self, state: State, zones: Zones, form: str, size: float) -> tuple[Grid, Any]:
        """Solve the linearised laws for the change of the forces and of the free motions."""
        problem, xp, free, (l, a) = self.problem, self.problem.xp, self.problem.free, state.forces
        if zones.given is not None:
            turn, known = zones.pulls(form, problem.scale[0] * state.through)
            zones = replace(zones, turn=turn, known=known)
        system = _System.of(problem, zones, self.law.slip(zones, state.t, form))
        kept, slip = xp.where(system.live, l, 0.0), system.slip
        # Changes to zero force also change the displacements of the other points.
        off = -system.rows(kept, problem.displacements(kept, a))
        c, gap = problem.scale[0], xp.where(problem.can_touch, problem.gap, 0.0)
        off[0] -= xp.where(zones.active & ~system.given, c * gap + zones.opening, 0.0)
        if system.given.any():
            off[0] += xp.where(system.given, zones.known - zones.turn * c * gap, 0.0)
        off[1:] += xp.where(zones.slip, slip.a * slip.weight * slip.bound, 0.0)
        balance = (problem.force - problem.sums(kept))[free]
        right = system.packed(off, balance * system.unit)
        # S. C. Eisenstat and H. F. Walker, SIAM J. Sci. Comput. 17 (1996) 16.
        forcing = min(1e-3, 0.01 * size)
        change, _ = gmres(system.product, right, system.precondition, forcing, most=300)
        step, motions = system.unpacked(change)
        moved = a.copy()
        moved[free] += motions
        l = kept + step
        if self.surface is not None and self.surface.capped and 0 in free:
            moved[0] += self._balancing(l, moved)
        return l, moved

    def _balancing(self, l: Grid, a: Any) -> float:
        """The approach at which the forces of the next sets have the given sum: without it, all
        points of a yielding surface may be capped, and none of them determines the approach."""
        problem, xp = self.problem, self.problem.xp
        c, v = problem.scale[0], problem.displacements(l, a)
        slip = lengths(v[1:])

        def excess(approach: float) -> float:
            through = xp.where(problem.can_touch, v[0] - problem.gap + approach, -np.inf)
            mu = self.surface.at(l[0], c * through, slip).mu  # type: ignore[union-attr]
            return float(mu.sum()) - float(problem.force[0])

        far = 2 * float(xp.abs(xp.where(problem.can_touch, v[0] - problem.gap, 0.0)).max())
        far += float(xp.abs(l[0]).max()) / c
        if excess(-far) >= 0 or excess(far) <= 0:
            return 0.0
        return float(scipy.optimize.brentq(excess, -far, far, xtol=1e-14 * far))


@dataclass(frozen=True)
class Softened(GridProblem):
    """A problem with springs at its points, except at components fixed by a side."""

    springs: tuple[float, float]  # normal and tangential compliance

    @classmethod
    def near(cls, problem: GridProblem, forces: Grid, delta: float) -> Softened:
        """The problem whose springs are stress-free at the given forces."""
        normal, along = (delta / c for c in problem.scale)
        step = cls(problem.compliance, problem.v0, problem.gap, problem.force, (normal, along))
        return replace(step, v0=problem.v0 + step._shortened(forces))

    def W(self, forces: Grid) -> Grid:
        """Compliance of the body and of the springs times forces."""
        return super().W(forces) + self._shortened(forces)

    def _shortened(self, forces: Grid) -> Grid:
        """Displacement of the springs, zero for components fixed by a side."""
        normal, along = self.springs
        u = self.xp.concatenate((normal * forces[:1], along * forces[1:]))
        return u if self.fixed is None else self.xp.where(self.fixed, 0.0, u)


@dataclass(frozen=True)
class _System:
    """Linearised laws and balance of free motions. Vectors consist of the live components of
    points, usually few, and the free motions.
    """

    problem: GridProblem
    live: Grid
    at: Grid  # numbers of the live components
    held: Grid
    zones: Zones
    slip: SlipLaw
    of_normal: Grid  # coefficient of mu: the bound F mu is an unknown
    given: Grid  # points whose normal force is given, as a function of the gap
    unit: float
    columns: list[Grid]
    gram: Any

    @classmethod
    def of(cls, problem: GridProblem, zones: Zones, slip: SlipLaw) -> _System:
        """Make the linearised laws and the preconditioner of the free motions."""
        xp, along = problem.xp, len(problem.v0) - 1
        live = xp.stack([zones.active, *[zones.stick | zones.slip] * along])
        # For small slip, rows are nearly those of stick and are preconditioned alike.
        begun = zones.stick | (zones.slip & (slip.ratio > 0.5))
        given = xp.zeros_like(zones.active) if zones.given is None else zones.given
        held = xp.stack([zones.active & ~given, *[begun] * along])
        of_normal, unit = slip.weight * slip.coefficient, 1.0 / problem.gap.size**0.5
        at, columns = xp.flatnonzero(live), []
        system = cls(problem, live, at, held, zones, slip, of_normal, given, unit, [], None)
        for i in problem.free:
            rows = xp.zeros_like(problem.v0)
            rows[i] = 1.0
            columns.append(system._forces(system.rows(xp.zeros_like(rows), rows)))
        gram = np.array([[float(z[i].sum()) for z in columns] for i in problem.free])
        return replace(system, columns=columns, gram=gram)

    def rows(self, x: Grid, v: Grid) -> Grid:
        """The laws at forces x and displacements v, without the gap and Tresca's bound."""
        c, zones, slip, xp = self.problem.scale, self.zones, self.slip, self.problem.xp
        out = xp.zeros_like(x)
        out[0] = xp.where(zones.active, zones.slope * x[0] - c[0] * v[0], 0.0)
        if zones.given is not None:
            out[0] = xp.where(self.given, x[0] - zones.turn * c[0] * v[0], out[0])
        sliding = slip.left(x[1:], slip.c * v[1:]) - slip.a * self.of_normal * x[0]
        out[1:] = xp.where(zones.stick, -c[1] * v[1:], xp.where(zones.slip, sliding, 0.0))
        return out

    def packed(self, values: Grid, motions: Any) -> Any:
        """Pack grid values and free motions into a vector."""
        return self.problem.xp.concatenate(
            (values.ravel()[self.at], self.problem.xp.asarray(motions))
        )

    def unpacked(self, vector: Any) -> tuple[Grid, Any]:
        """Unpack grid values, zero where not live, and free motions (on the host)."""
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
        """Approximate forces for given rows."""
        problem, xp, slip, zones = self.problem, self.problem.xp, self.slip, self.zones
        held = xp.where(self.held, y, 0.0)
        held[0] /= problem.scale[0]
        held[1:] /= problem.scale[1]
        if zones.given is not None:
            held[0] /= 1.0 + zones.slope
        x = xp.where(self.held, problem.S(held), 0.0)
        x[0] += xp.where(self.given, y[0], 0.0)
        if problem.fixed is not None:  # forces there cause no displacement but balance a motion
            x = xp.where(self.held & problem.fixed, y, x)
        if len(y) == 1:
            return x
        rest = zones.slip & ~self.held[1]
        weight = xp.where(rest, slip.weight, 1.0)
        x[1:] += xp.where(rest, (y[1:] + slip.a * self.of_normal * x[0]) / weight, 0.0)
        return x

    def precondition(self, vector: Any) -> Any:
        """Approximate inverse: forces from displacement rows, then motions that balance them."""
        problem, (y, wanted) = self.problem, self.unpacked(vector)
        x = self._forces(y)
        if not problem.free:
            return self.packed(x, wanted)
        off = problem.sums(x)[problem.free] - wanted / self.unit
        a = np.linalg.lstsq(self.gram, off, rcond=1e-12)[0]
        for z, part in zip(self.columns, a, strict=True):
            x = x - float(part) * z
        return self.packed(x, a)
