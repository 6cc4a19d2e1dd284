"""Which algorithm a method name means for which law."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from contact.arrays.dense_arrays import DeviceMatrix
from contact.condensation.boundary_problem import BoundaryProblem, Forces, Friction
from contact.errors import ContactError, InputError, NotConverged, numbers
from contact.laws.active_set import signorini
from contact.laws.coarse_start import CoarseProblem
from contact.laws.device_newton import plane_newton
from contact.laws.load_balance import check_held
from contact.laws.proximal_point import proximal_point
from contact.laws.semismooth_newton import Iteration, Report, semismooth_newton
from contact.laws.tresca_loop import fixed_point, progress, tresca_loop
from gpu import GpuError, Infeasible

Array = NDArray[np.float64]

_OFFERED: dict[str | None, tuple[str, ...]] = {
    None: ("newton", "pdas"),
    "tresca": ("newton", "pdas", "fixed_point"),
    "coulomb": ("newton", "pdas", "fixed_point", "tresca_loop"),
}
Given = Callable[[Array, Forces], Forces]
# The boundary problem is solved further than the certificate asks, which sees it through the body.
INNER = 1e-2


@dataclass(frozen=True)
class Options:
    """What a caller of `ContactProblem.solve` may choose, checked."""

    method: str
    tol: float
    max_iterations: int
    eps: float | None

    @classmethod
    def checked(
        cls,
        law: str | None,
        dim: int,
        method: str,
        tol: float | None,
        max_iterations: int | None,
        eps: float | None,
    ) -> Self:
        """Fill in defaults.

        Raises
        ------
        InputError
            An unknown method, one that the law does not take, or a number out of range.
        """
        peer = isinstance(method, str) and method.startswith("qp:")
        if not (isinstance(method, str) and method in _OFFERED[law]) and not peer:
            raise InputError(
                f"method={method!r}: a {law or 'frictionless'} problem takes "
                f"{', '.join(map(repr, _OFFERED[law]))} or 'qp:<solver>'"
            )
        if peer and law is not None and dim == 3:
            raise InputError(f"method={method!r}: friction in 3-D is no QP; use 'newton' or 'pdas'")
        if tol is None:
            tol = default_tolerance(method)
        for name, value in (("tol", tol), ("max_iterations", max_iterations), ("eps", eps)):
            if value is not None and numbers(name, value).shape != ():
                raise InputError(f"{name}={value!r}: expected one number")
        if not 0 < tol < 1:
            raise InputError(f"tol={tol!r}: expected a number between 0 and 1")
        if max_iterations is None:
            max_iterations = 2000 if method == "fixed_point" else 100
        if not 1 <= max_iterations < np.inf or max_iterations != int(max_iterations):
            raise InputError(f"max_iterations={max_iterations!r}: expected a whole number from 1")
        if eps is not None and (method != "fixed_point" or not 0 < eps < np.inf):
            raise InputError(f"eps={eps!r}: a positive number, for method 'fixed_point' only")
        return cls(method, float(tol), int(max_iterations), eps)


def default_tolerance(method: str) -> float:
    """What a method's certificate is held to unless the caller chooses."""
    return 1e-6 if method == "fixed_point" else 1e-7 if method.startswith("qp:") else 1e-10


def solve_boundary(
    problem: BoundaryProblem,
    law: Friction | None,
    options: Options,
    start: Forces | None,
    scale: Array,
    report: Report,
) -> tuple[Forces, float]:
    """Solve the condensed problem by the method named in the options.

    Where its matrix lies on a device, Newton's method for plane contact runs there; should it
    stall, and for all else, the host takes what it needs of the matrix.

    Parameters
    ----------
    problem : BoundaryProblem
    law : Friction or None
        In the problem's scale.
    options : Options
    start : Forces or None
    scale : ndarray, shape (m,)
        Physical displacement = scaled displacement * scale.
    report : callable

    Returns
    -------
    forces : Forces
    slack : float
        By how much the method misses the friction law by design, relative to the largest force.
    """
    check_held(problem, law)
    tol = options.tol * INNER
    method = options.method
    if isinstance(problem.W, DeviceMatrix) and method == "newton" and problem.tangent.shape[1] == 1:
        limit, arrays = options.max_iterations, problem.W.arrays
        with suppress(NotConverged, LinAlgError):
            forces = plane_newton(
                problem, arrays, law, start, tol=tol, max_iterations=limit, report=report
            )
            return forces, 0.0
    peer = method[3:] if method.startswith("qp:") else None
    if start is None and method == "newton":
        start = _from_coarse(problem, law, options, report)
        if start is not None and law is not None and law.coulomb:
            with suppress(NotConverged, LinAlgError):
                return semismooth_newton(problem, start, law, tol=tol, report=report), 0.0
            start = None
    if law is None:
        return signorini(problem, start=start, tol=tol, peer=peer, report=report), 0.0

    three_d = problem.tangent.shape[1] > 1
    if start is None:
        start = _frictionless(problem, tol, report)
    form = "damped" if method == "pdas" else "switched"

    def given(bound: Array, near: Forces, note: Report = lambda iteration: None) -> Forces:
        """Solve with given friction; where that cannot hold the loads, Coulomb's still may."""
        try:
            return of_given(bound, near, note)
        except Infeasible as error:
            if law is None or not law.coulomb:
                raise
            raise NotConverged("the friction of the last step cannot hold the loads") from error

    def of_given(bound: Array, near: Forces, note: Report) -> Forces:
        if three_d or method == "pdas":
            return _given_friction(problem, bound, near, form, tol, note)
        return signorini(problem, bound=bound, start=near, tol=tol, peer=peer, report=note)

    if method == "fixed_point":
        eps = options.eps
        if eps is None:
            eps = 1e-5 * _largest_displacement(problem, start, scale)
        forces = fixed_point(
            problem,
            start,
            eps=eps / scale,
            friction=law,
            tol=options.tol,
            max_iterations=options.max_iterations,
            report=report,
        )
        slip = eps / _largest_displacement(problem, forces, scale)
        return forces, 10 * options.tol + 10 * slip
    if not law.coulomb:
        return given(law.value, start, report), 0.0
    if method == "newton":
        return _coulomb(problem, law, start, given, tol, options.max_iterations, report), 0.0
    forces = tresca_loop(
        problem,
        law,
        start,
        given,
        tol=tol if peer is None else options.tol,
        max_iterations=options.max_iterations,
        report=report,
    )
    return forces, 0.0


def _from_coarse(
    problem: BoundaryProblem, law: Friction | None, options: Options, report: Report
) -> Forces | None:
    """Solve with fewer points first, in turn from fewer still; None where that does not help."""
    coarse = CoarseProblem.of(problem, law)
    if coarse is None:
        return None

    def note(line: Iteration) -> None:
        phase = line.phase if line.phase.startswith("coarse") else f"coarse {line.phase}"
        report(replace(line, phase=phase))

    ones = np.ones(coarse.problem.gap.size)
    with suppress(ContactError, GpuError, LinAlgError):
        return coarse.refined(
            solve_boundary(coarse.problem, coarse.law, options, None, ones, note)[0]
        )
    return None


def _largest_displacement(problem: BoundaryProblem, forces: Forces, scale: Array) -> float:
    """Of the contact points, in the units of the body."""
    u_n, u_t = problem.displacements(forces.mu, forces.t, forces.a)
    return float(max(np.abs(u_n * scale).max(), np.abs(u_t * scale[:, None]).max()))


def _frictionless(problem: BoundaryProblem, tol: float, report: Report) -> Forces:
    """Start of every friction method; free rigid motions hang on springs, friction holds later."""
    if not np.any(problem.can_touch):
        mu, t = problem.zeros()
        return Forces(mu, t, np.zeros(problem.s.size))
    springs = 1e-2 * float(np.abs(problem.C).max()) ** 2 if problem.s.size else 0.0
    return signorini(problem, tol=tol, springs=springs, phase="frictionless", report=report)


def _given_friction(
    problem: BoundaryProblem, bound: Array, start: Forces, form: str, tol: float, report: Report
) -> Forces:
    """Newton for given friction; should it stall, damped from rest (4.16), then proximal points."""
    friction = Friction(bound, coulomb=False)
    rest = Forces(*problem.zeros(), np.zeros(problem.s.size))
    for near, kind in ((start, form), (rest, "damped")):
        with suppress(NotConverged, LinAlgError):
            return semismooth_newton(
                problem, near, friction, form=kind, tol=tol, phase=f"{kind} newton", report=report
            )
    return proximal_point(problem, friction, start, tol=tol, report=report)


def _coulomb(
    problem: BoundaryProblem,
    friction: Friction,
    start: Forces,
    given: Given,
    tol: float,
    max_iterations: int,
    report: Report,
) -> Forces:
    """Monolithic Newton; should it stall, proximal points, then steps with the bound frozen."""
    failure: Exception | None = None
    for attempt in range(4):
        try:
            return semismooth_newton(
                problem, start, friction, tol=tol, max_iterations=max_iterations, report=report
            )
        except (NotConverged, LinAlgError) as error:
            failure = error
        if attempt == 0:
            with suppress(NotConverged):
                return proximal_point(problem, friction, start, tol=tol, report=report)
        for step in range(1, 5 * (attempt + 1) + 1):
            start = given(friction.bound(start.mu), start)
            report(progress(problem, step, "tresca step", start, friction.bound(start.mu)))
    raise NotConverged(f"{failure}; try method='tresca_loop' or a smaller friction coefficient")
