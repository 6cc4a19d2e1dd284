"""The normal part of a contact problem on a grid: all that frictionless contact needs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from contact.arrays.namespace import namespace
from contact.spectral.grid_problem import Grid, GridProblem
from contact.spectral.normal_filter import NormalFilter


@dataclass(frozen=True)
class NormalProblem:
    r"""Normal forces mu that press points back: through = driving + a - W mu.

    Attributes
    ----------
    W, S : callable
        Displacements of forces, and a preconditioner that is nearly the inverse.
    driving : array, shape (nx[, ny])
        By how far points would enter the obstacle without forces, zero where none is in reach.
    can_touch : array of bool, shape (nx[, ny])
    total : float
        Sum of the forces; NaN where a is zero instead.
    c : float
        Force per displacement of a point alone.
    filter : NormalFilter, optional
        The body, where it is known on coarser grids.
    """

    W: Callable[[Grid], Grid]
    S: Callable[[Grid], Grid]
    driving: Grid
    can_touch: Grid
    total: float
    c: float
    filter: NormalFilter | None

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
        """Whether the sum of the forces is given, and a free."""
        return not np.isnan(self.total)

    def coarser(self) -> NormalProblem | None:
        """The problem on every other point; None where the body has no coarser grid."""
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
        """Forces near mu with the given sum, and the points that they say are in contact."""
        inside, a = mu > 0, 0.0
        if self.given:
            mu = mu * (self.total / mu.sum())
        through = self.driving - self.W(mu)
        if self.given:
            a = (through * inside).sum() / inside.sum()
        return mu, self.can_touch & (mu + self.c * (through - a) > 0)
