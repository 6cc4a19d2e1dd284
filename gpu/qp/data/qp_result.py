"""What `solve_qp` returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gpu.arrays.dense import symmetric_product
from gpu.errors import InputError
from gpu.qp.data.derivatives import Gradients, gradients
from gpu.qp.data.equilibrate import with_rounding
from gpu.qp.data.qp_problem import FactoredMatrix, QPProblem, Rows, check_problem
from gpu.qp.data.standard_qp import (
    ROUNDING,
    Residuals,
    StandardQP,
    is_sparse,
    largest,
    one_sided,
    residuals,
)
from skfem_adini.ground.arrays import namespace, to_host


class Status(Enum):
    r"""What is known about an answer, and what to do about it.

    Failures are raised, except in a batch, which reports them in place by the last three.

    =============  =====================================================================
    `OPTIMAL`      every recomputed residual is below `tol`
    `DEGENERATE`   the same, but the active set is not the only one that leads to x
    `NEARLY`       the same, but P has negative eigenvalues, by less than 3e-5 of its
                   diagonal: x is stationary, and no other point at a distance d lies
                   lower by more than :math:`|\lambda_{min}| d^2 / 2`
    `INFEASIBLE`   in a batch: no point satisfies the constraints, see `QPBatch.errors`
    `UNBOUNDED`    in a batch: the objective has no lower bound
    `FAILED`       in a batch: the residuals stay above `tol`
    =============  =====================================================================

    Attributes
    ----------
    OPTIMAL, DEGENERATE, NEARLY, INFEASIBLE, UNBOUNDED, FAILED : Status

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
    INFEASIBLE = "no point satisfies the constraints: the certificate names rows to loosen"
    UNBOUNDED = "the objective has no lower bound: bound the variables of the ray"
    FAILED = "the residuals stay above tol: rescale this problem, or accept a larger tol"


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
    _history: Any  # steps, or rows of what they hold
    active_rows: Any = field(default_factory=lambda: np.zeros(0, dtype=np.int8))
    path: str = "active set"
    _problem: Any = field(default=None, repr=False)

    @property
    def history(self) -> tuple[Step, ...]:
        """The steps, see above."""
        return tuple(Step(int(active), int(violated)) for active, violated in self._history)

    def __repr__(self) -> str:
        return (
            f"QPResult({self.status.name}, {self.x.size} variables, "
            f"{np.count_nonzero(self.active)} at a bound, {self.path} in {self.iterations} steps, "
            f"{self.kkt})"
        )

    def residuals(
        self,
        P: ArrayLike | FactoredMatrix,
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
        return residuals_of(problem, self.x, self.y, self.z, self.z_box)

    def vjp(
        self,
        dx: ArrayLike | None = None,
        dz: ArrayLike | None = None,
        dy: ArrayLike | None = None,
        dz_box: ArrayLike | None = None,
    ) -> Gradients:
        """Gradients of a function of the solution by all data of the problem.

        Parameters
        ----------
        dx, dz, dy, dz_box : (n,), (l,), (m,), (n,) array_like, optional
            Derivatives of the function by `x`, `z`, `y` and `z_box`; zero where left out.

        Returns
        -------
        Gradients
            By `P` (symmetric), `q`, `G`, `h`, `h_low`, `A`, `b`, `lb`, `ub`; its flag `degenerate`
            tells where derivatives are one-sided.

        Raises
        ------
        InputError
            For cotangents of another shape, and where the arrays of the problem no longer fit the
            solution: large problems keep the caller's arrays, which must not be changed.
        NotConverged
            If the solution, or a multiplier whose cotangent is not zero, is not unique; for sparse
            problems also if active rows depend on each other.

        Notes
        -----
        One linear system with the active rows, by the implicit function theorem (B. Amos, J. Z.
        Kolter, OptNet, ICML 2017). Where P, G or A is sparse, all are stored sparsely, and only
        entries that are stored have derivatives.

        Examples
        --------
        How the distance from a target changes with the side of a row:

        >>> import numpy as np
        >>> from gpu import solve_qp
        >>> result = solve_qp(np.eye(2), [-1.0, -1.0], [[1.0, 1.0]], [1.0])
        >>> result.x.tolist(), result.vjp(dx=result.x - 1.0).h.round(12).tolist()
        ([0.5, 0.5], [-0.5])
        """
        if self._problem is None:
            raise InputError("this result does not know its problem: solve it again")
        rows = self._problem if isinstance(self._problem, Rows) else self._problem.rows
        xp = namespace(self.x)
        move = to_host if xp is np else xp.asarray
        data = *(part if is_sparse(part) else move(part) for part in rows[:5]), rows.equal
        y = xp.concatenate([self.y, self.z])
        return gradients(data, self.x, y, self.z_box, (dx, dz, dy, dz_box))

    def moved(self, move: Callable[[Any], Any]) -> QPResult:
        """The same result with every array moved, to a device or to the host."""
        names = ("x", "y", "z", "z_box", "active", "active_rows")
        return replace(self, **{name: move(getattr(self, name)) for name in names})


class Step(NamedTuple):
    """One active-set step: how many variables were held, how many were found violated.

    Parameters
    ----------
    active : int
        Variables and rows that are held at a bound.
    violated : int
        Variables and rows that pass a bound, or whose multiplier has the wrong sign.

    Examples
    --------
    The last step of a solution violates nothing:

    >>> import numpy as np
    >>> from gpu import solve_qp
    >>> solve_qp(np.eye(2), [1.0, -1.0], lb=0.0).history[-1]
    Step(active=1, violated=0)
    """

    active: int
    violated: int


@dataclass(frozen=True)
class KKT:
    r"""Relative residuals of the optimality conditions, all zero at an exact solution.

    Each is the largest error of one condition over the size of the terms that are added up in it,
    so that rounding leaves about 1e-16 whatever the units of the problem are. The formulas below
    hold for strictly convex problems on the host with bounds and equality rows only, in the
    variables :math:`D^{-1}x`, :math:`D = \mathrm{diag}(P)^{-1/2}`. For all other problems
    `stationarity` (there `dual`), `primal`, `complementarity` and `gap` are those of
    `gpu.qp.data.standard_qp.Residuals`.

    Attributes
    ----------
    stationarity : float
        :math:`|D(Px + q + A^Ty + z_\mathrm{box})|_\infty` over the size of the terms that cancel,
        :math:`\phi = |D(|P||x| + |q| + |A|^T|y|)|_\infty`.
    primal : float
        Largest violation of a row over :math:`|a_i||x| + |b_i|`, or of a bound over the largest
        entry of :math:`D^{-1}x`. In rows, :math:`64\epsilon|a_i|D\phi` is not counted: so much
        the rounding of the forces moves x.
    sign : float
        Largest multiplier that points to an infinite bound, over :math:`\phi`.
    complementarity : float
        Largest of ``min(multiplier, distance to its bound)``, the multiplier over :math:`\phi`,
        the distance over the largest entry of :math:`D^{-1}x`.
    gap : float
        Difference of primal and dual objective,
        :math:`|x^T(Px + q) + y^Tb + z_\mathrm{box}^Ts|`, s the bounds that the multipliers point
        to, over :math:`|x|^T(|P||x| + |q| + |A|^T|y|) + |y|^T|b| + |z_\mathrm{box}|^T|s|`; what is
        not counted in rows is not counted here, times :math:`|y|`.

    Examples
    --------
    >>> import numpy as np
    >>> from gpu import solve_qp
    >>> kkt = solve_qp(np.eye(2), [1.0, -1.0], lb=0.0).kkt
    >>> kkt.worst < 1e-15
    True
    """

    stationarity: float
    primal: float
    sign: float
    complementarity: float
    gap: float = 0.0

    @property
    def worst(self) -> float:
        """The largest of them; infinite where one is not a number."""
        values = (self.stationarity, self.primal, self.sign, self.complementarity, self.gap)
        return max(values) if all(map(isfinite, values)) else np.inf


def residuals_of(
    problem: QPProblem,
    x: Any,
    y: Any,
    z: Any,
    z_box: Any,
    program: StandardQP | None = None,
    known: Residuals | None = None,
) -> KKT:
    """Residuals by the formulas that hold for the problem, see `KKT`."""
    if problem.boxes_only:
        return kkt_residuals(problem, x, y, z_box)
    return general_residuals(problem, x, y, z, z_box, program, known)


@np.errstate(all="ignore")
def general_residuals(
    problem: QPProblem,
    x: Any,
    y: Any,
    z: Any,
    z_box: Any,
    program: StandardQP | None = None,
    known: Residuals | None = None,
) -> KKT:
    """Residuals with the rows ``low <= G x <= high`` as well, of either storage and namespace."""
    p = program or problem.program
    xp, multiplier = p.xp, namespace(x).concatenate([y, z])
    r = known or residuals(p, x, multiplier, z_box)
    coarse = with_rounding(p) if known is None and r.worst > ROUNDING.certain else None
    if coarse is not None:
        r = min(r, residuals(coarse, x, multiplier, z_box), key=lambda found: found.worst)
    outside = float(xp.maximum(xp.maximum(p.lb - x, x - p.ub), 0.0).max())
    wrong = 0.0
    for value, low, high in ((multiplier, p.row_low, p.row_high), (z_box, p.lb, p.ub)):
        if value.size:
            wrong = largest(wrong, float(xp.abs(value - one_sided(value, low, high)).max()))
    if wrong:
        terms = (p.q, p.P @ x, p.C.T @ multiplier, z_box)
        wrong /= largest(*(float(xp.abs(a).max()) for a in terms))
    return KKT(
        stationarity=r.dual,
        primal=largest(r.primal, outside / float(xp.abs(x).max()) if outside else 0.0),
        sign=wrong,
        complementarity=r.complementarity,
        gap=r.gap if not wrong else 0.0,
    )


@np.errstate(all="ignore")  # what overflows is not a number, or infinite, in the end
def kkt_residuals(problem: QPProblem, x: np.ndarray, y: np.ndarray, z_box: np.ndarray) -> KKT:
    """Residuals of ``Px + q + A'y + z_box = 0``, ``Ax = b``, ``lb <= x <= ub`` and of the signs."""
    factor, q, A, b, lb, ub, *_ = problem
    P, root = factor.P, np.sqrt(factor.P.diagonal())
    length = root * np.abs(x)
    used = np.flatnonzero(x)
    terms = np.abs(x[used]) @ np.abs(P[used]) + np.abs(q) + np.abs(A.T) @ np.abs(y)
    phi = np.max(terms / root)
    Px = symmetric_product(P, x)
    gradient = Px + q + A.T @ y

    rounding = 64 * np.finfo(float).eps * (np.abs(A) @ (1.0 / root)) * phi
    residual = np.maximum(np.abs(A @ x - b) - rounding, 0.0)
    rows = _relative(residual, np.abs(A) @ np.abs(x) + np.abs(b))
    outside = root * np.maximum(np.maximum(lb - x, x - ub), 0.0)
    bounds = _relative(outside, largest(length.max(), outside.max()))

    pushed = np.flatnonzero(z_box)
    distance = root[pushed] * np.maximum(np.where(z_box < 0.0, x - lb, ub - x)[pushed], 0.0)
    force = _relative((np.abs(z_box) / root)[pushed], phi)
    side = np.where(z_box < 0.0, lb, ub)[pushed]
    held = np.isfinite(side)
    at, side = pushed[held], side[held]
    parts = np.concatenate([x * (Px + q), y * b, z_box[at] * side])
    size = np.abs(x) @ terms + np.abs(parts[x.size :]).sum()
    unseen = np.abs(y) @ rounding  # the same shift of x, in the objective
    distance = distance[held]
    distance = _relative(distance, largest(length.max(), distance.max(initial=0.0)))
    return KKT(
        stationarity=float(_relative(np.abs(gradient + z_box) / root, phi).max()),
        primal=largest(rows.max(initial=0.0), bounds.max()),
        sign=float(force[~held].max(initial=0.0)),
        complementarity=float(np.minimum(force[held], distance).max(initial=0.0)),
        gap=float(_relative(np.maximum(np.abs(parts.sum(keepdims=True)) - unseen, 0.0), size)[0]),
    )


def _relative(value: np.ndarray, size: np.ndarray | float) -> np.ndarray:
    """``value / size``, zero where both are; not a number where nothing has a finite size."""
    nothing = (value == 0.0) & (np.asarray(size) == 0.0)
    ratio = np.divide(value, size, out=np.zeros_like(value), where=~nothing)
    return np.where(np.isfinite(size), ratio, np.nan)
