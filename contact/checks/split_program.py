"""Given friction in two dimensions as a quadratic program, for the solvers of qpsolvers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.checks.unit_program import UnitProgram
from contact.laws.qp_peers import solve_with

Array = NDArray[np.float64]


def solve_split(
    solver: str, unit: UnitProgram, gap: Array, offset: Array, g: Array, closed: Array
) -> tuple[Array | None, Array, Array, Array, float]:
    """Solve a QP with a slack for the modulus of each slip.

    Returns w, the forces of the rows G, R and E, and seconds.
    """
    n, k = unit.f.size, g.size
    if sparse.issparse(unit.P):
        one: Any = sparse.eye_array(k, format="csr")
        none: Any = sparse.csr_array((n, k))
        S: Any = unit.P
        P: Any = sparse.vstack((sparse.hstack((S, none)), sparse.csr_array((k, n + k))))
        A: Any = sparse.hstack((unit.E, sparse.csr_array((closed.size, k))))
        H: Any = sparse.block_array(
            [[unit.G, sparse.csr_array((gap.size, k))], [unit.R, -one], [-unit.R, -one]]
        )
    else:
        one, none = np.eye(k), np.zeros((n, k))
        P = np.block([[unit.P, none], [none.T, 0.0 * one]])
        A = np.zeros((0, n + k))  # equations are eliminated
        H = np.block([[unit.G, np.zeros((gap.size, k))], [unit.R, -one], [-unit.R, -one]])
    h = np.concatenate((gap, -offset, offset))
    equal = (A, closed) if closed.size else (None, None)
    solution, seconds = solve_with(solver, P, np.r_[-unit.f, g], H, h, *equal)
    if solution.x is None or solution.z is None:
        mu, t, r = (np.full(size, np.nan) for size in (gap.size, k, closed.size))
        return None, mu, t, r, seconds
    pushed = solution.z[gap.size : gap.size + k] - solution.z[gap.size + k :]
    pulled = np.asarray(solution.y) if closed.size else np.zeros(0)
    return solution.x[:n], solution.z[: gap.size], pushed, pulled, seconds
