"""What `solve_qp` returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gpu.qp.data.kkt import KKT, general_residuals, kkt_residuals
from gpu.qp.data.qp_problem import QPFactor, QPProblem, check_problem
from gpu.qp.data.step import Step


class Status(Enum):
    r"""What is known about an answer, and what to do about it.

    Failures are raised; a result exists only with one of these.

    =============  =====================================================================
    `OPTIMAL`      every recomputed residual is below `tol`
    `DEGENERATE`   the same, but the active set is not the only one that leads to x
    `NEARLY`       the same, but P has negative eigenvalues, by less than 3e-5 of its
                   diagonal: x is stationary, and no other point at a distance d lies
                   lower by more than :math:`|\lambda_{min}| d^2 / 2`
    =============  =====================================================================

    Attributes
    ----------
    OPTIMAL, DEGENERATE, NEARLY : Status

    Examples
    --------
    >>> from gpu import Status, solve_qp
    >>> solve_qp([[1.0]], [-1.0]).status is Status.OPTIMAL
    True
    """

    OPTIMAL = "optimal: every recomputed residual is below tol, nothing is left to do"
    DEGENERATE = (
        "optimal, but some held variables carry no multiplier: compare x and the multipliers of "
        "two runs, not their active sets"
    )
    NEARLY = (
        "every recomputed residual is below tol, but P is convex to a few digits only: round its "
        "negative eigenvalues up to zero, or compare the objective from several starts"
    )


@dataclass(frozen=True, eq=False)
class QPResult:
    """Solution of a quadratic program, with its proof.

    Attributes
    ----------
    x : (n,) numpy.ndarray
        The minimiser; a held variable is exactly at its bound.
    y : (m,) numpy.ndarray
        Multipliers of the equality rows.
    z : (l,) numpy.ndarray
        Multipliers of the rows of G, not negative where the upper side holds and not positive
        where the lower one does.
    z_box : (n,) numpy.ndarray
        Multipliers of the bounds, not positive at a lower, not negative at an upper one:
        ``P x + q + A'y + G'z + z_box = 0``.
    status : Status
        Whether the active set is unique and P convex, see `Status`.
    active : (n,) numpy.ndarray of int8
        -1 held at the lower bound, 0 free, +1 held at the upper bound; for a fixed variable the
        side its multiplier points to.
    kkt : KKT
        Relative residuals, recomputed from the problem.
    iterations : int
        Number of active-set steps.
    history : tuple of Step
        Number of held and of violated variables and rows in each active-set step; none where an
        interior point was the way.
    active_rows : (l,) numpy.ndarray of int8
        The same as `active` for the rows of G.
    path : str
        "active set" or "interior point".

    Examples
    --------
    The first variable is held at its lower bound 0 with the multiplier -1:

    >>> import numpy as np
    >>> from gpu import solve_qp
    >>> result = solve_qp(np.eye(2), [1.0, -1.0], lb=0.0)
    >>> result.x.tolist(), result.active.tolist(), result.z_box.tolist()
    ([0.0, 1.0], [-1, 0], [-1.0, 0.0])
    """

    x: Any
    y: Any
    z: Any
    z_box: Any
    status: Status
    active: Any
    kkt: KKT
    iterations: int
    history: tuple[Step, ...]
    active_rows: Any = field(default_factory=lambda: np.zeros(0, dtype=np.int8))
    path: str = "active set"

    def __repr__(self) -> str:
        return (
            f"QPResult({self.status.name}, {self.x.size} variables, "
            f"{np.count_nonzero(self.active)} at a bound, {self.path} in {self.iterations} steps, "
            f"{self.kkt})"
        )

    def residuals(
        self,
        P: ArrayLike | QPFactor,
        q: ArrayLike,
        G: ArrayLike | None = None,
        h: ArrayLike | None = None,
        A: ArrayLike | None = None,
        b: ArrayLike | None = None,
        lb: ArrayLike | None = None,
        ub: ArrayLike | None = None,
        *,
        h_low: ArrayLike | None = None,
    ) -> KKT:
        """Residuals of this answer in a problem given like in `solve_qp`."""
        problem = check_problem(P, q, G, h, A, b, lb, ub, h_low)
        if boxes_only(problem):
            return kkt_residuals(problem, self.x, self.y, self.z_box)
        return general_residuals(problem, self.x, self.y, self.z, self.z_box)

    def moved(self, move: Callable[[Any], Any]) -> QPResult:
        """The same result with every array moved, to a device or to the host."""
        names = ("x", "y", "z", "z_box", "active", "active_rows")
        return replace(self, **{name: move(getattr(self, name)) for name in names})


def boxes_only(problem: QPProblem) -> bool:
    """Whether it is strictly convex, on the host, with bounds and few equality rows."""
    return (
        not problem.row_low.size
        and problem.b.size <= problem.q.size
        and problem.factor.definite
        and isinstance(problem.q, np.ndarray)
    )
