"""`solve_qp` under the name "pdas" in qpsolvers."""

from __future__ import annotations

from typing import Any

from gpu.errors import Infeasible, InputError, NotConverged, Unbounded
from gpu.qp.solve_qp import solve_qp
from skfem_adini.ground.errors import optional


def pdas_solve_problem(
    problem: Any, initvals: Any = None, verbose: bool = False, **options: Any
) -> Any:
    """Solve a `qpsolvers.Problem` with `options` of `solve_qp`. Where `solve_qp` raises, the
    `qpsolvers.Solution` is marked as not found, and the error is in ``extras["error"]``; x is then
    the best point where `time_limit` or `max_steps` ended the search, else None.
    """
    import qpsolvers

    known = "h_low", "host_below", "start", "tol", "polish", "time_limit", "max_steps"
    unknown = options.keys() - known
    if unknown:
        raise InputError(
            f"{min(unknown)}: the solver 'pdas' knows {', '.join(known)}; leave out the options "
            "of other solvers"
        )

    solution = qpsolvers.Solution(problem)
    start = options.pop("start", initvals)
    P, q, G, h, A, b, lb, ub = problem.unpack()
    try:
        result = solve_qp(P, q, G, h, A, b, lb, ub, start=start, **options)
    except (Infeasible, Unbounded, NotConverged) as error:
        solution.found = False
        solution.extras["error"] = error
        solution.x = getattr(error, "x", None)
        return solution
    solution.found = True
    solution.x, solution.y, solution.z = result.x, result.y, result.z
    solution.z_box = result.z_box
    solution.obj = 0.5 * float(result.x @ (P @ result.x)) + float(q @ result.x)
    solution.extras = {"kkt": result.kkt, "path": result.path, "iterations": result.iterations}
    return solution


def register_qpsolvers() -> None:
    """Make ``qpsolvers.solve_problem(problem, "pdas")`` call `solve_qp`.

    Raises
    ------
    MissingDependency
        qpsolvers is not installed.

    Examples
    --------
    >>> import numpy as np, qpsolvers
    >>> from gpu import register_qpsolvers
    >>> register_qpsolvers()
    >>> problem = qpsolvers.Problem(np.eye(2), np.array([-1.0, 1.0]), lb=np.zeros(2))
    >>> qpsolvers.solve_problem(problem, "pdas").x
    array([1., 0.])
    """
    needed = "qpsolvers is not installed: pip install qpsolvers"
    solvers = optional("qpsolvers", needed).solvers
    for table in (solvers.solve_function, getattr(solvers, "available_function", None)):
        if table is not None:
            table["pdas"] = pdas_solve_problem
    for names in (solvers.available_solvers, solvers.dense_solvers, solvers.sparse_solvers):
        if "pdas" not in names:
            names.append("pdas")
