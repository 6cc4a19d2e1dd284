r"""Identification of a velocity by regularised nonlinear least squares.

The estimate minimises :math:`\sum ((H u(p) - y) / \sigma)^2 + \alpha |c(p)|^2` over the parameters
p within their bounds, with the derivatives of the discrete scheme.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError, NotConverged
from cip.formulas.spline_velocity import SplineVelocity
from cip.grid import Array
from cip.inverse.identifiability import (
    Identifiability,
    IdentifiabilityWarning,
    identifiability,
)
from cip.inverse.identified import IdentifiedVelocity, MisfitWarning
from cip.inverse.problem import Problem, bounds_of, linearised, problem_of, rule_of
from cip.solver.solver import Solver
from skfem_adini.ground.arguments import real_number
from skfem_adini.ground.errors import warn


class _Limits(NamedTuple):
    settled: float = 1.1  # factor within which the weight counts as converged, far below its error
    evaluations: int = 6  # iterations of the optimiser between two choices of the weight
    choices: int = 40  # choices of the weight, at most
    fall: float = 100.0  # largest decrease at once, as linearisation is inaccurate far away
    step: float = 1e-8  # the optimiser stops at smaller relative changes of the parameters,
    change: float = 1e-3  # or of chi-square (1 is one deviation)
    unlikely: float = 3.0  # excess of chi-square, in deviations, that noise does not explain


LIMITS = _Limits()


def identify_velocity(
    solver: Solver,
    start: Any,
    data: Any,
    *,
    dt: float,
    noise: Any = None,
    bounds: Any = None,
    regularization: str | None = "auto",
    weight: str | float | None = None,
    max_runs: int = 500,
) -> IdentifiedVelocity:
    r"""Identify the velocity whose solution fits observations, with its deviations.

    The named parameters of the solver's velocity are the unknowns, the coefficients of a
    `SplineVelocity` among them. Nonlinear least squares with bounds (Branch, Coleman and Li 1999,
    SciPy's ``trf``) with the exact derivatives of the scheme; a seminorm of the velocity keeps
    splines smooth, with a weight that the data choose.

    Parameters
    ----------
    solver : Solver
        One that `Solver.tangent` can differentiate; its velocity has parameters, whose values are
        the first guess.
    start : State
        The known first state.
    data : mapping, Sensors or Observations
        Arrays of nodal values by times, ``{0.1: u1, 0.2: u2}``; masked entries are missing. Or
        point sensors, which bring their deviations, or any object with ``times``, ``values`` and
        ``operators`` (matrices applied to ``state.data.ravel()``).
    dt : float
        Length of the steps.
    noise : float or sequence of float, optional
        Standard deviation of the errors of the data, one for all or one for each time, in the unit
        of the field. None: unknown, and estimated from the misfit. 0: the misfit is the error of
        the scheme, which does not average out; deviations assume that all of it pushes one way.
    bounds : (low, high) or mapping, optional
        For all parameters, or such pairs by names. For splines of components the velocity then
        lies between them too.
    regularization : {"auto", "H1", "H2"} or None
        The seminorm: of the gradient of the velocity or of its second derivatives; "auto" is "H2"
        for `SplineVelocity` and None for formulas.
    weight : {"discrepancy", "l-curve"} or float, optional
        How the weight of the seminorm is chosen, or its value; the default is the discrepancy
        principle where the noise is known, else the L-curve (`cip.inverse.problem`).
    max_runs : int
        Most runs of the model.

    Returns
    -------
    IdentifiedVelocity

    Warns
    -----
    IdentifiabilityWarning
        The data do not determine a part of the velocity.
    MisfitWarning
        The misfit is larger than the noise explains.

    Raises
    ------
    InputError
        A velocity without parameters, data of another shape or before the start, bounds without
        the first guess, noise below 0.
    NotConverged
        The optimiser has not converged after `max_runs` runs.

    References
    ----------
    M. A. Branch, T. F. Coleman and Y. Li, A subspace, interior, and conjugate gradient method for
    large-scale bound-constrained minimization problems, SIAM J. Sci. Comput. 21 (1999), 1-23.
    A. Tarantola, Inverse Problem Theory, SIAM 2005, chapter 3.

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Grid, Solver, Velocity, identify_velocity
    >>> speed = Velocity.from_expression("a + b*sin(2*pi*x1)", parameters={"a": 1.0, "b": 0.0})
    >>> solver = Solver(Grid((0, 1), 64, periodic=True), speed)
    >>> start = solver.state("cos(2*pi*x1)")
    >>> truth = Solver(solver.grid, speed.with_parameters(a=1.2, b=0.3))
    >>> seen = truth.run(start, 0.2, dt=0.02).final["u"]
    >>> found = identify_velocity(solver, start, {0.2: seen}, dt=0.02, noise=1e-3)
    >>> {name: round(value, 4) for name, value in found.parameters.items()}
    {'a': 1.2, 'b': 0.3}
    """
    problem = problem_of(solver, start, data, dt, noise, regularization)
    low, high = bounds_of(bounds, problem)
    choice = rule_of(weight, problem)
    runs = real_number("max_runs", max_runs)
    if not 1.0 <= runs < np.inf:
        raise InputError(f"max_runs: expected a positive number, got {max_runs!r}")
    estimate = _iterated(problem, (low, high), choice, int(runs))
    return _result(problem, estimate)


@dataclass(frozen=True)
class _Estimate:
    p: Array
    weight: float
    free: NDArray[np.bool_]


def _iterated(
    problem: Problem, bounds: tuple[Array, Array], choice: Any, max_runs: int
) -> _Estimate:
    """Minimise and choose the weight in turn, from a strong one, until both have settled."""
    values = problem.solver.velocity.parameters
    p, free = np.array([values[name] for name in problem.names]), np.ones(len(values), dtype=bool)
    first = linearised(problem, p, free)
    if not first.depends:
        raise InputError(
            "start: the data do not change with the velocity at all; take a field that varies in "
            "space"
        )
    if callable(choice) and not first.L.any():
        raise InputError(
            f"regularization: the parameters do not change the {problem.kind} seminorm of the "
            "velocity; pass None"
        )
    if not callable(choice):
        p, free, done = _minimised(problem, p, bounds, choice, max_runs)
        if done:
            return _Estimate(p, choice, free)
    else:
        weight, evaluations = first.scale, LIMITS.evaluations
        for _ in range(LIMITS.choices):
            p, free, done = _minimised(problem, p, bounds, weight, evaluations)
            left = max_runs - problem.prediction.runs
            if left <= 0:
                break
            chosen = max(choice(linearised(problem, p, free)), weight / LIMITS.fall)
            settled = weight / LIMITS.settled <= chosen <= weight * LIMITS.settled
            if settled and done:
                return _Estimate(p, weight, free)
            weight, evaluations = (weight, left) if settled else (chosen, LIMITS.evaluations)
    raise NotConverged(
        f"max_runs: the estimate has not settled after {problem.prediction.runs} runs of the "
        "model; start nearer, give bounds, more data or a fixed weight"
    )


def _minimised(
    problem: Problem, p: Array, bounds: tuple[Array, Array], weight: float, evaluations: int
) -> tuple[Array, NDArray[np.bool_], bool]:
    """The minimiser at a given weight, which parameters are off their bounds, and convergence."""
    from scipy.optimize import least_squares

    root, prediction, roughness = np.sqrt(weight), problem.prediction, problem.roughness

    def rows(p: Array) -> Array:
        return np.append(prediction.misfit(p), root * roughness.rows(prediction.velocity(p)))

    def slopes(p: Array) -> Array:
        rough = roughness.slopes(prediction.velocity(p))
        return np.vstack([prediction.misfit_slope(p), root * rough])

    found = least_squares(
        rows, p, slopes, bounds, x_scale="jac", max_nfev=evaluations,
        xtol=LIMITS.step, ftol=LIMITS.change / problem.data.size, gtol=None,
    )  # fmt: skip
    return np.asarray(found.x), np.asarray(found.active_mask == 0), found.status > 0


def _result(problem: Problem, estimate: _Estimate) -> IdentifiedVelocity:
    p, names, grid = estimate.p, problem.names, problem.solver.grid
    velocity = problem.prediction.velocity(p)
    J, r = problem.prediction.misfit_slope(p), problem.prediction.misfit(p)
    L = problem.roughness.slopes(velocity)
    taken = linearised(problem, p, estimate.free).at(estimate.weight)[2]
    square, left = float(r @ r), max(len(r) - taken, 1.0)
    variance = max(1.0, square / left) if problem.data.known else square / left
    if problem.data.exact:
        # Errors of the scheme vary slowly and do not average out: assume equal signs.
        variance = square
    speed, slopes = problem.velocity(p)
    size = problem.speed(speed)
    seen = identifiability(
        J, slopes.reshape(len(names), len(speed), *grid.nodes),
        size, variance, grid, () if isinstance(velocity, SplineVelocity) else names,
    )  # fmt: skip
    excess = square / left - 1.0
    explained = not problem.data.known or excess <= LIMITS.unlikely * np.sqrt(2.0 / left)
    found = IdentifiedVelocity(
        velocity=velocity,
        grid=grid,
        t=problem.middle,
        covariance=_covariance(np.vstack([J, np.sqrt(estimate.weight) * L]), variance, seen, size),
        misfit=r / problem.data.weights,
        reduced_chi_square=square / left if problem.data.known else None,
        explained=bool(explained),
        weight=estimate.weight,
        regularization=problem.kind,
        at_bounds=tuple(n for n, free in zip(names, estimate.free, strict=True) if not free),
        degrees_of_freedom=taken,
        runs=problem.prediction.runs,
        identifiability=seen,
        feet_on_edges=problem.prediction.feet_on_edges(p),
    )
    if seen.unseen:
        warn(seen.message(), IdentifiabilityWarning)
    if not explained:
        warn(found.misfit_message(), MisfitWarning)
    return found


def _covariance(stacked: Array, variance: float, seen: Identifiability, speed: float) -> Array:
    """Inverse of the normal matrix times the variance. Along a direction that the data do not
    determine, the seminorm's weight has no meaning: there the deviation is that from the data
    alone, at least the speed; directions where it is infinite are left out."""
    size = np.linalg.norm(stacked, axis=0)
    size[size == 0.0] = 1.0
    _, s, Vt = np.linalg.svd(stacked / size, full_matrices=False)
    kept = s > np.finfo(float).eps * len(stacked) * s[0]
    V: Array = Vt[kept].T / s[kept] / size[:, None]
    found = np.asarray(variance * V @ V.T)
    for q in np.flatnonzero(~seen.seen & ~seen.lost):
        change = max(seen.deviations[q], 1.0) * speed * seen.vectors[q]
        found += np.outer(change, change)
    return found
