"""Which method solves a linear-quadratic problem, and what takes its place where it fails."""

from __future__ import annotations

import importlib
import inspect
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from gpu.arguments import choice
from gpu.arrays.namespace import to_host
from gpu.errors import GpuError, InputError, NotConverged, NotSupported, RiccatiError
from gpu.riccati.lqr_result import LQRResult, certified, in_given_units
from gpu.riccati.methods.reduced import reduced
from gpu.riccati.problem.candidate import Found
from gpu.riccati.problem.lqr_problem import NOT_SEMIDEFINITE, LQRProblem, semidefinite
from gpu.riccati.problem.state_matrix import EPS
from gpu.riccati.problem.units import in_moderate_units
from gpu.riccati.proof.closed_loop import ALL_POLES
from gpu.riccati.proof.unmovable_modes import explain, named

# Modules with a function ``solve(problem, **options) -> Found``.
METHODS = {
    "doubling": "gpu.riccati.methods.doubling",
    "newton": "gpu.riccati.methods.newton_kleinman",
    "hamiltonian": "gpu.riccati.methods.hamiltonian",
    "reduced": "gpu.riccati.methods.reduced.reduced",
}
# These promise a solution of the equation; the others a gain.
EXACT = {"doubling", "newton"}
QUICK = 400  # up to this order a dense solver is quicker than Newton steps with shifted solves
TOLD = 200  # up to this order the dense method names the mode that stands in the way


def automatic(problem: LQRProblem, may_store: bool) -> tuple[LQRProblem, str]:
    """The method that ``method="auto"`` stands for, and the problem in the form that it takes:
    doubling if dense, else a projection, unless a projection alone does not find the gain and the
    entries are few enough to be stored (`may_store`)."""
    if problem.dense:
        return problem, "doubling"
    if may_store and problem.n <= QUICK and reduced.takes_newton(problem):
        return problem.entries(), "doubling"
    return problem, "reduced"


def solve_problem(
    problem: LQRProblem, method: str, unstable: str, options: dict[str, Any], *, indefinite: bool
) -> LQRResult:
    """Choose the method, solve, certify; ``indefinite`` weights may make the cost negative."""
    method = choice("method", method, ("auto", *METHODS))
    moderate = in_moderate_units(problem)
    if moderate is problem:
        return _solved(problem, method, unstable, options, indefinite=indefinite)
    if problem.squares_fit:
        try:
            return _solved(problem, method, unstable, options, indefinite=indefinite)
        except (GpuError, ValueError):  # perhaps in these units only
            pass
    result = _solved(moderate, method, unstable, options, indefinite=indefinite)
    return in_given_units(result, problem)


def _solved(
    problem: LQRProblem, method: str, unstable: str, options: dict[str, Any], *, indefinite: bool
) -> LQRResult:
    # Whether the dense problem is at hand should the method of our choice fail.
    chosen = method == "auto" and not problem.dense and problem.n <= ALL_POLES and not options
    if method == "auto":
        problem, method = automatic(problem, chosen)
    solve = _solver(method, options)
    if not indefinite and not problem.dense:
        semidefinite(problem, always=True)
    try:
        found = solve(problem, **options)
    except (NotConverged, NotSupported, np.linalg.LinAlgError) as error:
        if chosen:
            return _by_entries(problem, unstable, indefinite)
        if isinstance(error, NotSupported):
            raise
        if not isinstance(error, NotConverged | RiccatiError):
            error = NotConverged(str(error))
        raise _explained(problem, error, indefinite) from None
    result = certified(problem, found, method)
    if method in EXACT:
        _check_solution(problem, found, result, indefinite)
        return result
    # As far as a double root on the axis is split by rounding.
    if not found.proved and not result.abscissa < -(EPS**0.5) * problem.state.size():
        # No other method finds a better gain than one that leaves a pole no feedback moves.
        inherent = named(problem)
        if inherent is not None:
            if chosen and problem.n <= TOLD:
                return _by_entries(problem, unstable, indefinite)
            raise inherent
    if not result.stable and chosen:
        # Modes that neither Q sees nor a projection, and that have to be moved all the same.
        return _by_entries(problem, unstable, indefinite)
    if not result.stable and unstable != "ignore":
        message = (
            f"the gain of method {method!r} does not stabilise: a pole has the real part "
            f"{problem.rate(result.abscissa):.3g}; {_remedy(problem)}"
        )
        if unstable == "raise":
            raise NotConverged(message)
        warnings.warn(message, RuntimeWarning, stacklevel=5)
    return result


def _solver(method: str, options: dict[str, Any]) -> Callable[..., Found]:
    """The function of the method, which knows all the options."""
    solve: Callable[..., Found] = importlib.import_module(METHODS[method]).solve
    known = list(inspect.signature(solve).parameters)[1:]
    for name in options:
        if name not in known:
            raise InputError(f"{name}: method {method!r} knows {', '.join(known) or 'no options'}")
    return solve


def _check_solution(problem: LQRProblem, found: Found, result: LQRResult, indefinite: bool) -> None:
    """Raise if the equation is not solved, or has a stabilising solution only by rounding."""
    if not result.converged:
        raise _explained(
            problem,
            NotConverged(
                f"the Riccati solution is not certified: residual {result.residual:.1e}, "
                f"abscissa {problem.rate(result.abscissa):.1e}"
            ),
            indefinite,
        )
    if found.verdict is not None and found.verdict.loop.is_sensitive():
        inherent = explain(problem)
        if inherent is not None:
            raise inherent
    if not indefinite:
        _check_cost(problem, result.S)


def _remedy(problem: LQRProblem) -> str:
    if problem.dense or problem.n <= ALL_POLES:
        return "use result.refined(), or method='newton'"
    return "give its mode an input and a weight, or use method='doubling' with all entries"


def _by_entries(problem: LQRProblem, unstable: str, indefinite: bool) -> LQRResult:
    """The answer with all entries stored, where no projection finds it and memory allows."""
    inherent = named(problem) if problem.n > TOLD else None
    if inherent is not None:
        raise inherent
    return solve_problem(problem.entries(), "doubling", unstable, {}, indefinite=indefinite)


def _check_cost(problem: LQRProblem, S: Any) -> None:
    if problem.n > ALL_POLES or not isinstance(S, problem.xp.ndarray):
        return
    values = np.linalg.eigvalsh(to_host(S))
    if values[0] < -1e-9 * np.abs(values).max():
        if semidefinite(problem):
            raise NotConverged(
                "the Riccati solution is not certified: round-off makes the cost of some states "
                f"negative ({values[0]:.1e} of {values[-1]:.1e}); the weights are too far apart"
            )
        raise InputError(
            f"{NOT_SEMIDEFINITE}, and the optimal cost is negative for some states; gpu.care finds "
            "the stabilising solution of its equation"
        )


def _explained(problem: LQRProblem, error: Exception, indefinite: bool) -> Exception:
    if isinstance(error, RiccatiError) and error.cause:
        return error
    if not indefinite and not semidefinite(problem):
        return InputError(
            f"{NOT_SEMIDEFINITE}, and no stabilising feedback was found that is optimal"
        )
    return explain(problem) or error
