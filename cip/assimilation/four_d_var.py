r"""Four-dimensional variational assimilation in incremental, preconditioned form.

With independent control numbers v of variance 1, start :math:`x_0 = x_b + S v_0`, parameters
:math:`p = p_b + \sigma_p v_p` and model errors :math:`x_k = M_k(x_{k-1}, p) + S_k v_k`, the cost is
:math:`\frac12 |v|^2 + \frac12 |R^{-1/2} (y - H x)|^2`. Each outer iteration linearises the model
and solves the quadratic problem for v.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cip.assimilation.analysis import Analysis
from cip.assimilation.assimilation_window import AssimilationWindow, Path
from cip.assimilation.covariance import Covariance
from cip.assimilation.data_combinations import Combined, combined_analysis
from cip.assimilation.sensors import Sensors
from cip.errors import InputError, LeftDomain, NotConverged, NotFinite
from cip.solver.solver import Solver
from cip.stages.state import State
from skfem_adini.ground.arguments import real_number

Array = NDArray[np.float64]
_log = logging.getLogger(__name__)
# The quadratic problem is solved this much more accurately than the whole.
_INNER = 0.1
# Sufficient decrease and most halvings of a step (Nocedal and Wright 2006, section 3.1).
_DECREASE, _HALVINGS = 1e-4, 30
# A cost that changes by less than this fraction does so by rounding.
_ROUNDING = 1e-13


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
    most, outer, least = _counts(max_iterations, max_outer, vectors)
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
        found = combined_analysis(A, right, _INNER * accuracy, most, least, _progress)
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
    for _ in range(_HALVINGS):
        new = control + length * direction
        try:
            there = window.path(new)
        except (InputError, LeftDomain, NotConverged, NotFinite):  # far from any sensible velocity
            length *= 0.5
            continue
        if _cost(new, there) <= before + _DECREASE * length * slope + _ROUNDING * before:
            return new, there
        length *= 0.5
    raise NotConverged(
        "parameters: no step towards the solution of the linearised problem lowers the cost; begin "
        "closer to the solution, or give the parameters smaller prior deviations"
    )


def _counts(max_iterations: int, max_outer: int, vectors: int) -> tuple[int, int, int]:
    given = {"max_iterations": max_iterations, "max_outer": max_outer, "vectors": vectors}
    for name, value in given.items():
        least = 0 if name == "vectors" else 1
        whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
        if not whole or value < least:
            raise InputError(f"{name}: expected a whole number >= {least}, got {value!r}")
    return int(max_iterations), int(max_outer), int(vectors)


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
