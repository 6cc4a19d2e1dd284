r"""Four-dimensional variational assimilation in incremental, preconditioned form.

With independent control numbers v of variance 1, start :math:`x_0 = x_b + S v_0`, parameters
:math:`p = p_b + \sigma_p v_p` and model errors :math:`x_k = M_k(x_{k-1}, p) + S_k v_k`, the cost is
:math:`\frac12 |v|^2 + \frac12 |R^{-1/2} (y - H x)|^2`. Each outer iteration linearises the model
and solves the quadratic problem for v.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import lstsq, svd
from scipy.sparse.linalg import LinearOperator

from cip.assimilation.analysis import Analysis
from cip.assimilation.assimilation_window import AssimilationWindow, Path
from cip.assimilation.covariance import Covariance
from cip.assimilation.sensors import Sensors
from cip.errors import InputError, LeftDomain, NotConverged, NotFinite
from cip.grid import Array
from cip.solver.solver import Solver
from cip.stages.state import State
from skfem_adini.ground.arguments import integer, real_number

_log = logging.getLogger(__name__)


class _Limits(NamedTuple):
    inner: float = 0.1  # accuracy of the quadratic problem, relative to that of the whole
    decrease: float = 1e-4  # for Armijo's condition (Nocedal and Wright 2006, section 3.1)
    halvings: int = 30  # of a step, at most
    rounding: float = 1e-13  # relative: smaller changes of the cost are rounding
    dependent: float = 1e-13  # relative distance from a span at which a vector counts as in it
    each: int = 50  # steps with a test of the residual after each; later after every tenth


LIMITS = _Limits()


def four_d_var(
    solver: Solver,
    background: State,
    covariance: Covariance,
    sensors: Sensors,
    *,
    dt: float,
    parameters: Mapping[str, float] | None = None,
    model_error: Covariance | Sequence[Covariance | None] | None = None,
    tol: float = 1e-8,
    max_iterations: int = 500,
    max_outer: int = 20,
    vectors: int = 0,
) -> Analysis:
    r"""States of a window from a background and reports of sensors: strong and weak 4D-Var.

    The window begins at the background's time and ends at the last time of the sensors. With a
    model error, added at each time of the sensors before they are read, the constraint by the model
    is weak. Without parameters the problem is linear, and the analysis is the best linear unbiased
    estimate: the states at the end are those of the Kalman filter, the others those of its
    smoother.

    Parameters
    ----------
    solver : Solver
        With a profile that `Solver.tangent` knows.
    background : State
        Of the solver; the prior mean at the start.
    covariance : Covariance
        Of the error of the background.
    sensors : Sensors
        Their times from the start of the window on.
    dt : float
        Length of the steps; the last one before each time of the sensors may be shorter.
    parameters : dict, optional
        Prior standard deviations by names of the solver's parameters that are unknown; their
        prior means are the values in ``solver.parameters``.
    model_error : Covariance or sequence of Covariance or None, optional
        Of the error of each interval between times of the sensors, independent of the others; a
        sequence has one for each interval, None where the model is exact there. Times at which no
        report arrived (all NaN) divide intervals too.
    tol : float
        For the gradient of the cost, relative to that at the background.
    max_iterations : int
        Most combinations of reports in one outer iteration.
    max_outer : int
        Most outer iterations (Gauss-Newton).
    vectors : int
        Least number of combinations of reports from which deviations are computed; the number of
        reports makes them exact.

    Returns
    -------
    Analysis

    Raises
    ------
    NotConverged
        The gradient does not fall below `tol`; the message says which iteration to allow more of.
    InputError
        Arguments that do not belong together.
    NotSupported
        A scheme without derivatives.

    References
    ----------
    P. Courtier, J.-N. Thepaut and A. Hollingsworth, A strategy for operational implementation of
    4D-Var, using an incremental approach, Q. J. R. Meteorol. Soc. 120 (1994), 1367-1387; Y.
    Tremolet, Accounting for an imperfect model in 4D-Var, ibid. 132 (2006), 2483-2504.

    Examples
    --------
    A wave at an unknown speed, seen by three sensors:

    >>> import numpy as np
    >>> from cip import Covariance, Grid, Sensors, Solver, Velocity, four_d_var
    >>> grid = Grid((0, 1), 32, periodic=True)
    >>> solver = Solver(grid, Velocity.from_expression("a", parameters={"a": 0.8}))
    >>> plan = Sensors([0.1, 0.45, 0.8], np.linspace(0, 1, 11), deviations=0.01)
    >>> x, t = plan.points, plan.times[:, None]
    >>> sensors = plan.with_values(np.sin(2 * np.pi * (x - t))).perturbed(seed=1)
    >>> B = Covariance.diffusion(grid, "cubic", deviation=1.0, length=0.15)
    >>> found = four_d_var(solver, solver.state(0.0), B, sensors, dt=0.05, parameters={"a": 0.3})
    >>> error, spread = found.parameters["a"] - 1.0, found.parameter_deviations["a"]
    >>> bool(abs(error) < 3 * spread), bool(spread < 0.01)
    (True, True)
    """
    window = AssimilationWindow(
        solver, background, covariance, sensors, dt, parameters, model_error
    )
    most, outer = integer("max_iterations", max_iterations, 1), integer("max_outer", max_outer, 1)
    least = integer("vectors", vectors, 0)
    accuracy = real_number("tol", tol)
    if not 0.0 < accuracy < 1.0:
        raise InputError(f"tol: expected a number in (0, 1), got {tol!r}")
    if not window.reports.values or not sum(v.size for v in window.reports.values):
        raise InputError("sensors: no report has arrived")
    control = np.zeros(window.layout.size)
    path, first, found = window.path(control), 0.0, None
    for iteration in range(outer + 1):
        linear = window.linearised(path)
        A = linear.operator()
        pull = A.rmatvec(path.residuals)
        gradient = float(np.linalg.norm(control - pull))
        first = first or gradient
        relative = gradient / first if first else 0.0
        _log.info("outer %d: cost %.6g, gradient %.2e", iteration, _cost(control, path), relative)
        if found is not None and relative <= accuracy:
            return _analysis(window, control, path, found, relative, iteration)
        if iteration == outer:
            break
        right = path.residuals + A.matvec(control)
        found = combined_analysis(A, right, LIMITS.inner * accuracy, most, least, _progress)
        if found.residual > accuracy:
            raise NotConverged(
                f"max_iterations: after {most} combinations of reports the residual of the "
                f"quadratic problem is {found.residual:.1e}; allow more, or a larger tol"
            )
        slope = float((control - pull) @ (found.solution - control))
        control, path = _step(window, control, path, found.solution, slope)
    raise NotConverged(
        f"max_outer: after {outer} outer iterations the gradient is {relative:.1e} of the first, "
        f"tol is {accuracy:.1e}; allow more, or begin closer to the solution"
    )


def _cost(control: Array, path: Path) -> float:
    return 0.5 * float(control @ control + path.residuals @ path.residuals)


def _progress(step: int, residual: float) -> None:
    _log.debug("combination %d: residual %.2e", step, residual)


def _step(
    window: AssimilationWindow, control: Array, path: Path, solution: Array, slope: float
) -> tuple[Array, Path]:
    """A step towards the minimiser of the quadratic problem that lowers the cost itself."""
    if window.linear:
        return solution, window.path(solution)
    before, direction, length = _cost(control, path), solution - control, 1.0
    for _ in range(LIMITS.halvings):
        new = control + length * direction
        try:
            there = window.path(new)
        except (InputError, LeftDomain, NotConverged, NotFinite):  # far from any sensible velocity
            length *= 0.5
            continue
        if (
            _cost(new, there)
            <= before + LIMITS.decrease * length * slope + LIMITS.rounding * before
        ):
            return new, there
        length *= 0.5
    raise NotConverged(
        "parameters: no step towards the solution of the linearised problem lowers the cost; begin "
        "closer to the solution, or give the parameters smaller prior deviations"
    )


def _analysis(
    window: AssimilationWindow,
    control: Array,
    path: Path,
    found: Combined,
    gradient: float,
    iterations: int,
) -> Analysis:
    layout, root = window.layout, window.covariance.root
    spread = np.sqrt(found.variances(np.ones(layout.size), found.directions))
    prior = window.covariance.deviations.ravel() ** 2
    moved = np.zeros((len(found.directions), prior.size))
    for row, direction in zip(moved, found.directions, strict=True):
        row[:] = root.matvec(direction[layout.background])[: prior.size]
    own = window.spreads * spread[layout.parameters]
    return Analysis(
        states=path.states,
        deviations=np.sqrt(found.variances(prior, moved)).reshape(window.solver.grid.nodes),
        velocity=path.solver.velocity,
        parameters=window.parameters(control),
        parameter_deviations=dict(zip(window.names, own.tolist(), strict=True)),
        amplitudes=tuple(control[part] for part in layout.errors),
        amplitude_deviations=tuple(spread[part] for part in layout.errors),
        singular_values=found.singular_values,
        cost=_cost(control, path),
        reports=path.residuals.size,
        gradient=gradient,
        outer_iterations=iterations,
        complete=found.complete,
    )


@dataclass(frozen=True)
class Combined:
    """The mean, and the directions that the data have determined."""

    solution: Array  # shape (r,)
    directions: Array  # (k, r): orthonormal rows, by decreasing singular values
    singular_values: Array  # (k,): change of the data, in deviations, per unit
    residual: float  # estimate of |A^T (b - A w) - w| / |A^T b|
    complete: bool  # the directions span all that the data can determine

    def variances(self, prior: Array, moved: Array) -> Array:
        """Prior variances, shape (n,), less what the data determine along the directions. `moved`,
        shape (k, n), holds each direction times a square root of the prior covariance."""
        left = 1.0 / (1.0 + self.singular_values**2)
        if len(self.directions) == self.directions.shape[1]:  # a sum of what is left: no difference
            return np.asarray(left @ moved**2)
        share = self.singular_values**2 * left
        return np.asarray(np.maximum(prior - share @ moved**2, 0.0))


class _Basis:
    """Orthonormal vectors; a new one is made orthogonal to all by two passes of Gram-Schmidt."""

    def __init__(self, size: int) -> None:
        self._rows, self.count = np.empty((8, size)), 0

    @property
    def rows(self) -> Array:
        return self._rows[: self.count]

    def orthogonal(self, vector: Array) -> tuple[Array | None, float]:
        """The normalised part orthogonal to the basis and its norm; None where nothing is left."""
        before = float(np.linalg.norm(vector))
        for _ in range(2):
            vector = vector - self.rows.T @ (self.rows @ vector)
        norm = float(np.linalg.norm(vector))
        if norm <= LIMITS.dependent * before:
            return None, 0.0
        return vector / norm, norm

    def append(self, vector: Array) -> None:
        """Add a vector that `orthogonal` has returned."""
        if self.count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        self._rows[self.count] = vector
        self.count += 1


class _Search:
    """The two bases, and C: the coefficients of A^T u in V, a row for each u."""

    def __init__(self, A: LinearOperator, b: Array) -> None:
        self.A, self.b = A, b
        self.U, self.V = _Basis(A.shape[0]), _Basis(A.shape[1])
        self._rows: list[Array] = []
        self._random = np.random.default_rng(0)
        self._next, _ = self.U.orthogonal(b)
        self._left = 0.0  # norm of the part of A v outside U, for the last v
        self._largest = 0.0
        self._rest_is_blind = False
        self.running = self._next is not None

    @property
    def exhausted(self) -> bool:
        """Whether the data can determine nothing more: U spans the range of A. A V lies in the span
        of U and the next combination, so V of full rank is not enough while there is a next one."""
        full = self.V.count == self.A.shape[1] and self._next is None
        return self.U.count == self.A.shape[0] or full or self._rest_is_blind

    def step(self) -> None:
        """Another combination of the data; a random one when those from b are exhausted."""
        u, drawn = self._next, self._next is None
        if u is None:
            u, _ = self.U.orthogonal(self._random.standard_normal(self.A.shape[0]))
            assert u is not None  # not exhausted, so random data have a part outside U
        self.U.append(u)
        back = np.asarray(self.A.rmatvec(u), dtype=float)
        self._largest = max(self._largest, float(np.linalg.norm(back)))
        row = self.V.rows @ back
        v, alpha = self.V.orthogonal(back)
        self._next, self._left = None, 0.0
        if v is not None and alpha > LIMITS.dependent * self._largest:
            row = np.append(row, alpha)
            self.V.append(v)
            self._next, self._left = self.U.orthogonal(np.asarray(self.A.matvec(v), dtype=float))
        elif drawn:  # A^T is 0 at random data outside U, so at all of them
            self._rest_is_blind = True
        self._rows.append(row)
        self.running = self.running and self._next is not None

    def coefficients(self) -> Array:
        """C, shape (u, v)."""
        C = np.zeros((self.U.count, self.V.count))
        for target, row in zip(C, self._rows, strict=True):
            target[: row.size] = row
        return C

    def solution(self) -> tuple[Array, float]:
        """Coefficients of w in V, and the residual: all of it comes from the last v."""
        C, right = self.coefficients(), self.U.rows @ self.b
        # C^T (1 + C C^T)^-1 U^T b as a least-squares problem, whose condition is not squared.
        rows = np.concatenate([C, np.eye(C.shape[1])])
        data = np.append(right, np.zeros(C.shape[1]))
        y = lstsq(rows, data, lapack_driver="gelsy", check_finite=False)[0]
        scale = float(np.linalg.norm(self.b)) * float(np.linalg.norm(C[0]))
        if not self.running or scale == 0.0:
            return y, 0.0
        return y, abs(float(y[-1])) * self._left * self._largest / scale


def combined_analysis(
    A: LinearOperator,
    b: Array,
    tol: float,
    most: int,
    vectors: int,
    progress: Callable[[int, float], Any],
) -> Combined:
    r"""The analysis of a linear Gaussian problem from the combinations of data that matter most.

    With prior w ~ N(0, 1) and data b = A w + e, e ~ N(0, 1), the data are projected on orthonormal
    combinations U, those of Golub and Kahan's bidiagonalisation from b (Paige and Saunders, ACM
    Trans. Math. Softw. 8, 1982, 43-71; in the space of data as in Gratton and Tshimanga, Q. J. R.
    Meteorol. Soc. 135, 2009, 1573-1585). With :math:`A^T U = V C^T`, V orthonormal, mean and
    covariance given the data :math:`U^T b` are

    .. math::
        w = V C^T (1 + C C^T)^{-1} U^T b , \qquad 1 - V C^T (1 + C C^T)^{-1} C V^T .

    More data never increase a covariance: it bounds that of all data, which it equals once U spans
    the range of A. At most `most` steps for the mean, until its `Combined.residual` is below `tol`,
    and at least `vectors` directions, if the data determine as many. Calls ``progress(step,
    residual)``.
    """
    search = _Search(A, np.asarray(b, dtype=float))
    y, residual = np.zeros(0), np.inf if search.running else 0.0
    while residual > tol and search.U.count < most and not search.exhausted:
        search.step()
        k = search.U.count
        if k <= LIMITS.each or k % 10 == 0 or search.exhausted or k == most:
            y, residual = search.solution()
            progress(k, residual)
    if search.exhausted:
        residual = 0.0
    while search.U.count < vectors and not search.exhausted:
        search.step()
    if search.U.count == 0:
        return Combined(np.zeros(A.shape[1]), np.zeros((0, A.shape[1])), np.zeros(0), 0.0, False)
    y, _ = search.solution()
    _, singular, right = svd(search.coefficients(), full_matrices=False)
    V = search.V.rows
    return Combined(y @ V, right @ V, singular, residual, search.exhausted)
