"""Which algorithm a method name means for which law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from contact.active_set import signorini
from contact.boundary import BoundaryProblem, residual
from contact.errors import InputError, NotConverged
from contact.loops import fixed_point, tresca_loop
from contact.newton import Forces, Iteration, Report, semismooth_newton

Array = NDArray[np.float64]

_OFFERED: dict[str | None, tuple[str, ...]] = {
    None: ("newton", "pdas"),
    "tresca": ("newton", "pdas", "fixed_point"),
    "coulomb": ("newton", "pdas", "fixed_point", "tresca_loop"),
}
# The boundary problem is solved further than the certificate asks, which sees it through the body.
_INNER = 1e-2


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
        if method not in _OFFERED[law] and not peer:
            raise InputError(
                f"method={method!r}: a {law or 'frictionless'} problem takes "
                f"{', '.join(map(repr, _OFFERED[law]))} or 'qp:<solver>'"
            )
        if peer and law is not None and dim == 3:
            raise InputError(f"method={method!r}: friction in 3-D is no QP; use 'newton' or 'pdas'")
        if tol is None:
            tol = 1e-6 if method == "fixed_point" else 1e-7 if peer else 1e-10
        if not (np.isfinite(tol) and tol > 0):
            raise InputError(f"tol={tol!r}: expected a positive number")
        if max_iterations is None:
            max_iterations = 500 if method == "fixed_point" else 100
        if max_iterations < 1:
            raise InputError(f"max_iterations={max_iterations!r}: expected at least 1")
        if eps is not None and (method != "fixed_point" or not eps > 0):
            raise InputError(f"eps={eps!r}: a positive number, for method 'fixed_point' only")
        return cls(method, float(tol), int(max_iterations), eps)


def solve_boundary(
    problem: BoundaryProblem,
    law: str | None,
    friction: Array,
    options: Options,
    start: Forces | None,
    scale: Array,
    report: Report,
) -> tuple[Forces, float]:
    """Solve the condensed problem by the method named in the options.

    Parameters
    ----------
    problem : BoundaryProblem
    law : {None, "tresca", "coulomb"}
    friction : ndarray, shape (m,)
        Coefficient (Coulomb) or bound in the problem's scale (Tresca).
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
    tol = options.tol * _INNER
    method = options.method
    peer = method[3:] if method.startswith("qp:") else None
    if law is None:
        return signorini(problem, start=start, tol=tol, peer=peer, report=report), 0.0

    three_d = problem.tangent.shape[1] > 1
    if start is None:
        start = _frictionless(problem, law, tol, report)
    form = "damped" if method == "pdas" else "radial"

    def given(bound: Array, near: Forces, note: Report = lambda iteration: None) -> Forces:
        """Solve with given friction."""
        if three_d or method == "pdas":
            return semismooth_newton(
                problem, near, bound=bound, form=form, tol=tol, phase=f"{form} newton", report=note
            )
        return signorini(problem, bound=bound, start=near, tol=tol, peer=peer, report=note)

    if method == "fixed_point":
        u_n, u_t = problem.displacements(start.mu, start.t, start.a)
        largest = max(np.abs(u_n * scale).max(), np.abs(u_t * scale[:, None]).max())
        eps = options.eps if options.eps is not None else 1e-6 * float(largest)
        forces = fixed_point(
            problem,
            start,
            eps=eps / scale,
            coefficient=friction if law == "coulomb" else None,
            bound=friction if law == "tresca" else None,
            tol=options.tol,
            max_iterations=options.max_iterations,
            report=report,
        )
        return forces, 10 * options.tol + 10 * eps / float(largest)
    if law == "tresca":
        return given(friction, start, report), 0.0
    if method == "newton":
        return _coulomb(problem, friction, start, given, tol, options, report), 0.0
    forces = tresca_loop(
        problem,
        friction,
        start,
        given,
        tol=tol if peer is None else options.tol,
        max_iterations=options.max_iterations,
        report=report,
    )
    return forces, 0.0


def _frictionless(
    problem: BoundaryProblem, law: str, tol: float, report: Report
) -> Forces:
    """Start of every friction method; free rigid motions hang on springs, friction holds later."""
    if not np.any(problem.can_touch):
        mu, t = problem.zeros()
        return Forces(mu, t, np.zeros(problem.s.size))
    springs = 1e-2 * float(np.abs(problem.C).max()) ** 2 if problem.s.size else 0.0
    return signorini(problem, tol=tol, springs=springs, phase="frictionless", report=report)


def _coulomb(problem, friction, start, given, tol, options, report) -> Forces:  # type: ignore[no-untyped-def]
    """Monolithic Newton; where its active sets cycle, Tresca steps lead to a better start."""
    failure: Exception | None = None
    cap = options.max_iterations
    for attempt in range(4):
        try:
            return semismooth_newton(
                problem, start, coefficient=friction, tol=tol, max_iterations=min(cap, 60), report=report
            )
        except (NotConverged, LinAlgError) as error:
            failure = error
        for step in range(5 * (attempt + 1)):
            start = given(friction * np.maximum(start.mu, 0.0), start)
            size = residual(problem, start.mu, start.t, start.a, friction * start.mu)
            report(Iteration(step + 1, "tresca step", int((start.mu > 0).sum()), 0, 0, size))
    raise NotConverged(f"{failure}; try method='tresca_loop' or a smaller friction coefficient")
