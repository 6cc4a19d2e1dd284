"""Quadratic programs handed to other packages' solvers through qpsolvers."""

from __future__ import annotations

import time
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.errors import InputError, MissingDependency, NotConverged

Array = NDArray[np.float64]

# What each solver calls its tolerances; the rest of qpsolvers' solvers keep their defaults.
_OPTIONS: dict[str, dict[str, Any]] = {
    "osqp": {"eps_abs": 1e-9, "eps_rel": 1e-9, "polishing": True, "max_iter": 200_000},
    "proxqp": {"eps_abs": 1e-11, "eps_rel": 0.0, "backend": "sparse"},
    "piqp": {"eps_abs": 1e-11, "eps_rel": 1e-11},
    "clarabel": {"tol_gap_abs": 1e-10, "tol_gap_rel": 1e-10, "tol_feas": 1e-10},
}


def solve_with(
    solver: str,
    P: Any,
    q: Array,
    G: Any = None,
    h: Array | None = None,
    A: Any = None,
    b: Array | None = None,
    lb: Array | None = None,
    ub: Array | None = None,
) -> tuple[Any, float]:
    """Solve ``min x'Px/2 + q'x, Gx <= h, Ax = b, lb <= x <= ub`` with a solver of qpsolvers.

    Data are scaled to unit size first (SI units would otherwise sit below absolute tolerances):
    the objective by the largest entry of P, and nothing else, so multipliers scale along.

    Returns
    -------
    solution : qpsolvers.Solution
        In the units of the call.
    seconds : float

    Raises
    ------
    InputError
        qpsolvers knows no such solver.
    MissingDependency
        It does but the solver's package is not installed.
    NotConverged
        The solver gave up.
    """
    import qpsolvers

    if solver not in qpsolvers.available_solvers:
        if solver in _OPTIONS:
            package = {"proxqp": "proxsuite"}.get(solver, solver)
            raise MissingDependency(f"solver {solver!r} needs its package: pip install {package}")
        raise InputError(
            f"solver={solver!r}: qpsolvers offers {sorted(qpsolvers.available_solvers)}"
        )
    as_sparse = sparse.issparse(P)

    def convert(matrix: Any) -> Any:
        if matrix is None or not as_sparse:
            return matrix
        return sparse.csc_matrix(matrix)

    options = dict(_OPTIONS.get(solver, {}))
    if solver == "proxqp" and not as_sparse:
        options["backend"] = "dense"
    scale = float(abs(P).max())
    problem = qpsolvers.Problem(convert(P / scale), q / scale, convert(G), h, convert(A), b, lb, ub)
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # remarks on matrix formats
        solution = qpsolvers.solve_problem(problem, solver, **options)
    seconds = time.perf_counter() - begin
    if not solution.found or solution.x is None:
        raise NotConverged(f"{solver} found no solution of the contact QP")
    for name in ("y", "z", "z_box"):
        value = getattr(solution, name)
        if value is not None:
            setattr(solution, name, value * scale)
    return solution, seconds


def solve_box_with(
    solver: str, P: Array, q: Array, A: Array | None, b: Array | None, lb: Array, ub: Array
) -> tuple[Array, Array]:
    """Solve the box QP of the contact forces; returns (x, y)."""
    solution, _ = solve_with(solver, P, q, None, None, A, b, lb, ub)
    y = solution.y if solution.y is not None else np.zeros(0)
    return np.asarray(solution.x), np.asarray(y)
