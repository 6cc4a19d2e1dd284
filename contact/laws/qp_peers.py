"""Quadratic programs solved by other packages, through qpsolvers."""

from __future__ import annotations

import time
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.errors import InputError, MissingDependency, NotConverged

Array = NDArray[np.float64]

# The tightest tolerances tried; other solvers of qpsolvers keep their defaults.
_TOLERANCES: dict[str, dict[str, float]] = {
    "osqp": {"eps_abs": 1e-9, "eps_rel": 1e-9},
    "proxqp": {"eps_abs": 1e-11, "eps_rel": 0.0},
    "piqp": {"eps_abs": 1e-12, "eps_rel": 1e-12},
    "clarabel": {"tol_gap_abs": 1e-13, "tol_gap_rel": 1e-13, "tol_feas": 1e-13},
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
    """Solve ``min x'Px/2 + q'x, Gx <= h, Ax = b, lb <= x <= ub`` by qpsolvers, scaled to unit size
    because tolerances are absolute. Returns its solution, x None where it fails, and the seconds.
    """
    import qpsolvers

    if solver not in qpsolvers.available_solvers:
        if solver in _TOLERANCES:
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

    options: dict[str, Any] = {}
    if solver == "osqp":  # it prints if there is nothing to polish
        polishing = any(rows is not None and rows.shape[0] > 0 for rows in (G, A, lb, ub))
        options = {"polishing": polishing, "max_iter": 20_000}
    if solver == "proxqp":
        options = {"backend": "sparse" if as_sparse else "dense"}
    scale = float(abs(P).max()) or 1.0
    size = _largest(q) / scale or _largest(h, b, lb, ub) or 1.0

    def of_unit(bound: Array | None) -> Array | None:
        return None if bound is None else bound / size

    problem = qpsolvers.Problem(
        convert(P / scale),
        q / (scale * size),
        convert(G),
        of_unit(h),
        convert(A),
        of_unit(b),
        of_unit(lb),
        of_unit(ub),
    )
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about matrix formats
        # With a tolerance below its rounding error, an interior point method ends in failed steps
        # far from its best iterate; OSQP does so just above it if rows are nearly dependent.
        for factor in (1.0, 1e1, 1e2, 1e4):
            tolerances = {k: factor * tol for k, tol in _TOLERANCES.get(solver, {}).items()}
            try:
                solution = qpsolvers.solve_problem(problem, solver, **options, **tolerances)
            except qpsolvers.exceptions.QPError:
                solution = qpsolvers.Solution(problem)
            if solution.found or not tolerances:
                break
    seconds = time.perf_counter() - begin
    if solution.x is not None:
        solution.x = solution.x * size
    for name in ("y", "z", "z_box"):
        value = getattr(solution, name)
        if value is not None:
            setattr(solution, name, value * (scale * size))
    return solution, seconds


def _largest(*vectors: Array | None) -> float:
    """Largest finite absolute entry."""
    moduli = [np.abs(v[np.isfinite(v)]).max(initial=0.0) for v in vectors if v is not None]
    return float(max(moduli, default=0.0))


def solve_box_with(
    solver: str, P: Array, q: Array, A: Array | None, b: Array | None, lb: Array, ub: Array
) -> tuple[Array, Array]:
    """x and the multipliers y of ``A x = b`` of the box QP of contact, or `NotConverged`. Forces
    are set to the bound where a gradient step, scaled by the diagonal of P, would pass it.
    """
    solution, _ = solve_with(solver, P, q, None, None, A, b, lb, ub)
    if not solution.found or solution.x is None:
        raise NotConverged(f"{solver} found no solution of the contact QP")
    x, y = np.asarray(solution.x), np.zeros(0)
    slope = P @ x + q
    if A is not None:
        y = np.asarray(solution.y)
        slope = slope + A.T @ y
    step = slope / np.where(P.diagonal() > 0, P.diagonal(), 1.0)
    x = np.where(x - step <= lb, lb, np.where(x - step >= ub, ub, x))
    return x, y
