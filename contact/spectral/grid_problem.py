"""A contact problem on a grid: normal and tangential rows, scales, residuals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from contact.errors import InputError
from contact.laws.friction import lengths, project
from contact.laws.surface_law import SurfaceLaw
from contact.spectral.grid_compliance import GridCompliance
from skfem_adini.ground.arrays import namespace

Grid = Any  # an array of NumPy or CuPy
_UNMOVED = 1e-14  # relative to the largest displacement, below which a motion is rounding


@dataclass(frozen=True)
class GridProblem:
    """Displacements ``v = v0 - W l + a`` of grid points relative to the obstacle under forces l =
    (mu, t). A component of a is free if its total force is given.
    """

    compliance: GridCompliance
    v0: Grid  # (dim, nx[, ny]): normal, then tangential components
    gap: Grid  # infinite where contact is impossible
    force: Any  # (dim,), NaN where a is zero

    @property
    def xp(self) -> Any:
        """NumPy or CuPy."""
        return namespace(self.v0)

    @cached_property
    def order(self) -> tuple[list[int], float]:
        """Coordinate axes of the components, and the sign of the normal."""
        normal = np.asarray(self.compliance.normal)
        axis = int(np.argmax(np.abs(normal)))
        return [axis, *(i for i in range(normal.size) if i != axis)], float(normal[axis])

    @cached_property
    def free(self) -> list[int]:
        """Components whose a is free."""
        return [int(i) for i in np.flatnonzero(~np.isnan(self.force))]

    def turned(self, values: Grid) -> Grid:
        """Coordinate components as normal and tangential ones."""
        order, sign = self.order
        local = values[order]
        local[0] *= sign
        return local

    def turned_back(self, local: Grid) -> Grid:
        """Normal and tangential components as coordinate ones."""
        order, sign = self.order
        values = self.xp.empty_like(local)
        values[order] = local
        values[order[0]] *= sign
        return values

    def W(self, forces: Grid) -> Grid:
        """Compliance times forces, (dim, nx[, ny])."""
        return self.turned(self.compliance.apply(self.turned_back(forces)))

    def S(self, displacements: Grid) -> Grid:
        """The preconditioner, an approximate inverse of W."""
        return self.turned(self.compliance.precondition(self.turned_back(displacements)))

    def W_normal(self, mu: Grid) -> Grid:
        """Normal displacements under normal forces."""
        return self._normal("apply_normal", self.compliance.apply, mu)

    def S_normal(self, u: Grid) -> Grid:
        """Approximate normal forces that cause normal displacements."""
        return self._normal("precondition_normal", self.compliance.precondition, u)

    def _normal(self, name: str, product: Any, values: Grid) -> Grid:
        """A product of normal components, by the body's method of that name if it exists."""
        if hasattr(self.compliance, name):
            return getattr(self.compliance, name)(values)
        local = self.xp.zeros((len(self.order[0]), *self.gap.shape))
        local[0] = values
        return self.turned(product(self.turned_back(local)))[0]

    @property
    def scale(self) -> tuple[float, float]:
        """Forces per displacement of a single point, normal and tangential: c = 1 / diag(W)."""
        return self.scale_normal, self.scale_along

    @cached_property
    def scale_normal(self) -> float:
        """Normal force per displacement of a single point."""
        alone, middle = self.xp.zeros_like(self.gap), self._middle
        alone[middle] = 1.0
        return 1.0 / float(self.W_normal(alone)[middle])

    @cached_property
    def scale_along(self) -> float:
        """Tangential force per displacement of a single point, the mean over free directions."""
        own, middle = [], self._middle
        for i in range(1, len(self.v0)):
            if self.fixed is not None and bool(self.fixed[(i, *middle)]):
                continue
            alone = self.xp.zeros_like(self.v0)
            alone[(i, *middle)] = 1.0
            own.append(float(self.W(alone)[(i, *middle)]))
        return 1.0 / float(np.mean(own)) if own else self.scale_normal

    @property
    def _middle(self) -> tuple[int, ...]:
        """The middle point, which represents all inner points."""
        return tuple(m // 2 for m in self.gap.shape)

    @cached_property
    def can_touch(self) -> Grid:
        """Points with a finite gap whose normal displacement is not fixed by a side."""
        near = self.xp.isfinite(self.gap)
        return near if self.fixed is None else near & ~self.fixed[0]

    @cached_property
    def fixed(self) -> Grid | None:
        """Components of points that a side fixes, (dim, nx[, ny]), None without such sides."""
        fixed = getattr(self.compliance, "fixed", None)
        return None if fixed is None or not np.any(fixed) else self.xp.asarray(fixed[self.order[0]])

    @cached_property
    def swept(self) -> Grid | None:
        """Points fixed by a side along which the obstacle is moved: they cannot stick."""
        xp, given = self.xp, [i for i in range(1, len(self.v0)) if i not in self.free]
        if self.fixed is None or not given:
            return None
        moves = xp.where(self.fixed[given], xp.abs(self.v0[given]), 0.0).max(axis=0)
        points = moves > _UNMOVED * float(xp.abs(self.v0).max())
        return points if bool(points.any()) else None

    @cached_property
    def at_rest(self) -> Grid | None:
        """Tangential components fixed by a side without obstacle motion, or None: friction there
        cannot be distinguished from the reactions of the side.
        """
        if self.fixed is None:
            return None
        given = self.xp.asarray([i not in self.free for i in range(1, len(self.v0))])
        still = self.xp.abs(self.v0[1:]) <= _UNMOVED * float(self.xp.abs(self.v0).max())
        return still & self.fixed[1:] & given.reshape((-1,) + (1,) * self.gap.ndim)

    def moved(self, a: Any) -> Grid:
        """a as an array that adds to displacements, (dim, 1[, 1])."""
        return self.xp.asarray(a).reshape((-1,) + (1,) * self.gap.ndim)

    def displacements(self, forces: Grid, a: Any) -> Grid:
        """v of every point, (dim, nx[, ny])."""
        return self.v0 - self.W(forces) + self.moved(a)

    def size(self, forces: Grid) -> float:
        """Scale of residuals: the largest force, at least 1e-12 of the forces due to the data."""
        overlap = self.xp.where(self.can_touch, self.v0[0] - self.gap, -np.inf).max()
        along = float(self.xp.abs(self.v0[1:]).max()) if len(self.v0) > 1 else 0.0
        causes = (self.scale_normal * float(overlap), self.scale_along * along if along else 0.0)
        given = np.abs(self.force[self.free]).max(initial=0.0) / self.gap.size
        largest = float(self.xp.abs(forces).max())
        return max(largest, 1e-12 * max(*causes, given), float(np.finfo(float).tiny))

    def sums(self, forces: Grid) -> Any:
        """Sum of the forces of each component, (dim,), on the host."""
        return np.array([float(part.sum()) for part in forces])


@dataclass(frozen=True)
class NormalRows(GridProblem):
    """The normal components of a problem alone: forces and displacements (1, nx[, ny])."""

    @classmethod
    def of(cls, problem: GridProblem) -> NormalRows:
        """The normal part of a problem without friction."""
        return cls(problem.compliance, problem.v0[:1], problem.gap, problem.force[:1])

    @cached_property
    def fixed(self) -> Grid | None:
        """Normal components of points that a side fixes, (1, nx[, ny])."""
        fixed = super().fixed
        return None if fixed is None else fixed[:1]

    def W(self, forces: Grid) -> Grid:
        """Compliance times normal forces."""
        return self.W_normal(forces[0])[None]

    def S(self, displacements: Grid) -> Grid:
        """The preconditioner, an approximate inverse of W."""
        return self.S_normal(displacements[0])[None]


def residuals(
    problem: GridProblem, l: Grid, v: Grid, bound: Grid, surface: SurfaceLaw | None = None
) -> dict[str, float]:
    """Relative residuals of the laws and the balance, with the names of `ContactResult.kkt`."""
    xp, size = problem.xp, problem.size(l)
    length = max(float(xp.abs(v).max()), size / problem.scale_normal)
    through = xp.where(problem.can_touch, v[0] - problem.gap, -np.inf)
    t = l[1:]
    returned = t - project(t + size / length * v[1:], bound)
    excess = xp.sqrt((t * t).sum(axis=0)) - bound
    least = xp.minimum(xp.abs(l[0]) / size, xp.abs(through) / length)
    worst = {
        "penetration": xp.maximum(through, 0.0).max() / length,
        "sign": xp.maximum(-l[0], 0.0).max() / size,
        "complementarity": least.max(),
        "cone": xp.maximum(excess, 0.0).max() / size,
        "slip": xp.abs(returned).max() / size,
    }
    if surface is not None:
        off = surface.at(l[0], problem.scale_normal * through, lengths(v[1:])).mu - l[0]
        worst["penetration"] = xp.maximum(off, 0.0).max() / size
        worst["complementarity"] = xp.maximum(-off, 0.0).max() / size
        if surface.softens:
            del worst["sign"]
    kkt = {name: float(value) for name, value in worst.items()}
    if problem.free:
        off = (problem.sums(l) - problem.force)[problem.free]
        whole = float(xp.abs(l).sum()) + float(np.abs(problem.force[problem.free]).max())
        kkt["obstacle"] = float(np.abs(off).max()) / (whole or 1.0)
    if not all(np.isfinite(value) for value in kkt.values()):
        raise InputError("kkt: forces or displacements are not finite")
    return kkt
