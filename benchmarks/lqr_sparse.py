"""Rows of `lqr.py`: sparse generalised problems with a low-rank weight, beside pyMOR's RADI.

The heated plate of `examples/heat_skfem.py`, and one that is cooled like the steel profile of the
Oberwolfach collection (rail_1357 and its kind). Both gains are compared with one of a hundredth of
the tolerance.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from gpu.riccati.methods.reduced import solve
from gpu.riccati.problem.lqr_problem import check_lqr

EXAMPLES = Path(__file__).parents[1] / "examples"


def model(refine: int) -> tuple[Any, ...]:
    """E, A, B, C of the example."""
    sys.path.insert(0, str(EXAMPLES))
    import heat_skfem  # type: ignore[import-not-found]

    E, A, B, C = heat_skfem.heat_model(refine)[1:]
    return E, A, B, 10.0 * C


def rail(nodes: int) -> tuple[Any, ...]:
    """E, A, B, C of bilinear elements on a square of `nodes` x `nodes`: seven parts of its rim are
    cooled, six differences of temperatures are seen."""
    h = 1.0 / (nodes - 1)
    ends = np.ones(nodes)
    ends[[0, -1]] = 0.5
    line = sparse.eye_array(nodes, k=1) + sparse.eye_array(nodes, k=-1)
    K = (sparse.diags_array(2 * ends) - line) / h
    M = (sparse.diags_array(4 * ends) + line) * h / 6
    E = sparse.csr_array(sparse.kron(M, M))
    grid = np.arange(nodes**2).reshape(nodes, nodes)
    rim = np.concatenate([grid[0], grid[1:, -1], grid[-1, -2::-1], grid[-2:0:-1, 0]])
    cooled = np.zeros(nodes**2)
    cooled[rim] = h
    B = np.zeros((nodes**2, 7))
    for j, part in enumerate(np.array_split(rim, 7)):
        B[part, j] = h
    A = -0.05 * (sparse.kron(K, M) + sparse.kron(M, K) + sparse.diags_array(cooled))
    C = np.zeros((6, nodes**2))
    for row, (i, j) in zip(C, np.random.default_rng(0).integers(0, nodes**2, (6, 2)), strict=True):
        row[i], row[j] = 10.0, -10.0
    return E, sparse.csr_array(A), B, C


def by_pymor(E: Any, A: Any, B: Any, C: Any, tol: float) -> tuple[np.ndarray, int]:
    """The gain by the low-rank ADI method for Riccati equations, and its rank."""
    from pymor.core.logger import set_log_levels
    from pymor.solvers.matrix_equations.equations import RiccatiEquation
    from pymor.solvers.matrix_equations.radi import RADIRiccatiSolver

    set_log_levels({"pymor": "ERROR"})
    A, E = sparse.csc_matrix(A), sparse.csc_matrix(E)
    equation = RiccatiEquation.from_matrices(A, E, B, C, trans=True)
    Z = RADIRiccatiSolver(radi_tol=tol).solve(equation).to_numpy()
    Z = Z if Z.shape[0] == A.shape[0] else Z.T
    return (B.T @ Z) @ (E.T @ Z).T, Z.shape[1]


def sparse_row(E: Any, A: Any, B: Any, C: Any, tol: float = 1e-8) -> dict[str, Any]:
    """Seconds, rank, and residual of both."""
    problem = check_lqr(A, B, C, np.eye(B.shape[1]), E=E, factored=True)
    begin, used = time.perf_counter(), time.process_time()
    found = solve(problem, tol=tol)
    spent, used = time.perf_counter() - begin, time.process_time() - used
    row = {
        "states": A.shape[0],
        "seconds": spent,
        "processor seconds": used,
        "rank": found.info["rank"],
        "residual": found.info["residual"],
    }
    tight = solve(problem, tol=1e-10).gain
    size = np.linalg.norm(tight)
    row["gain error"] = np.linalg.norm(found.gain - tight) / size
    if importlib.util.find_spec("pymor"):
        begin, theirs = time.perf_counter(), time.process_time()
        gain, rank = by_pymor(E, A, B, C, tol)
        theirs = time.process_time() - theirs
        row["pymor"] = {
            "version": importlib.metadata.version("pymor"),
            "seconds": time.perf_counter() - begin,
            "processor seconds": theirs,
            "rank": rank,
            "gain error": np.linalg.norm(gain - tight) / size,
        }
        row["ratio of processor seconds"] = used / theirs
    return row
