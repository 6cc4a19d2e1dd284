"""The data of a contact problem on a grid: a compliance, and host arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.laws.friction import UNMOVED, Coulomb, Friction, Tresca
from contact.laws.surface_law import SurfaceLaw, SurfaceState
from contact.portable import carried
from contact.spectral.grid_compliance import GridCompliance
from contact.spectral.grid_problem import GridProblem
from skfem_adini.ground.arrays import host

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GridCase:
    """A step of contact on a grid, from which its `GridProblem` follows."""

    compliance: GridCompliance
    gap: Array  # before the obstacle moves
    friction: Array  # Coulomb's coefficient, or Tresca's bound, a traction
    law: str
    motion: Array
    force: Array  # force on the obstacle; NaN where `motion` is given, and vice versa
    slip_from: Array | None  # slip of the last step, from which friction counts
    travel: Array | None = None  # path of the obstacle's own shape along the surface
    obstacle: Any = None  # obstacle from which the gap was computed, if known
    surface: SurfaceState | None = None  # the gap is without what it has lost

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"obstacle": carried(self.obstacle)}

    @property
    def areas(self) -> Any:
        """Area of each point, a scalar or an array of the grid's shape."""
        return float(np.prod(self.compliance.spacing)) * getattr(self.compliance, "weights", 1.0)

    @property
    def coulomb(self) -> bool:
        """Whether friction follows Coulomb's law."""
        return self.law == "coulomb"

    def problem(self) -> GridProblem:
        """The problem in normal and tangential components, on the compliance's device."""
        initial, motion, force = self.compliance.initial, self.motion, self.force
        travel = np.zeros(motion.size) if self.travel is None else self.travel
        wears = self.surface is not None and self.surface.wear is not None
        if not np.any(self.friction > 0):  # without friction, tangential forces are not balanced
            across = np.asarray(self.compliance.normal) == 0
            force = np.where(across, np.nan, force)
            if not wears:
                motion, travel = np.where(across, 0.0, motion), np.zeros(motion.size)
        problem = GridProblem(self.compliance, initial, initial[0], force)
        xp = problem.xp
        order, sign = problem.order
        turn = np.array([sign] + [1.0] * (len(order) - 1))
        moved = problem.moved(turn * (np.nan_to_num(motion) + travel)[order])
        v0 = problem.turned(initial) - moved
        if self.slip_from is not None:
            since = xp.asarray(self.slip_from)
            v0[1:] -= since
            if problem.fixed is not None:  # rounding of a large motion is not slip
                size = max(float(xp.abs(part).max()) for part in (since, moved))
                still = problem.fixed[1:] & (xp.abs(v0[1:]) <= UNMOVED * size)
                v0[1:] = xp.where(still, 0.0, v0[1:])
        gap = self.gap if self.surface is None else self.gap + self.surface.lost
        return GridProblem(self.compliance, v0, xp.asarray(gap), -turn * force[order])

    def surface_law(self, problem: GridProblem) -> SurfaceLaw | None:
        """The normal law of the points, if another than Signorini's."""
        if self.surface is None:
            return None
        one = problem.xp.ones_like(problem.gap)
        area, unit = problem.xp.asarray(self.areas) * one, one / problem.scale_normal
        return SurfaceLaw(area, unit, one, self.surface.ramped(area * unit))

    def friction_law(self, xp: Any) -> Friction:
        """The law for forces on points, with arrays of NumPy or CuPy."""
        if self.coulomb:
            return Coulomb(xp.asarray(self.friction))
        return Tresca(xp.asarray(self.friction * host(self.areas)))
