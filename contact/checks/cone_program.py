"""Given friction in three dimensions as a second-order cone program, for Clarabel."""

from __future__ import annotations

import importlib
import time

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.checks.unit_program import UnitProgram
from contact.errors import MissingDependency

Array = NDArray[np.float64]

_TOLERANCES = (1e-13, 1e-12, 1e-11, 1e-10)  # tried in turn: rounding may prevent the first ones


def solve_cones(
    unit: UnitProgram, gap: Array, offset: Array, bound: Array, closed: Array
) -> tuple[Array, Array, Array, Array, float]:
    r"""Minimise ``z^T S z / 2 - f^T z + sum_i g_i |R_i z + o_i|`` with ``G z <= d``, ``E z = e``.

    Each friction term becomes a slack :math:`s_i \ge |R_i z + o_i|`, a second-order cone with one
    dimension more than the slip.

    Parameters
    ----------
    unit : UnitProgram
        S = P, f, and the rows G, R and E.
    gap : ndarray, shape (m,)
    offset : ndarray, shape (k, dim_t)
        Rows of R that belong to one point are consecutive.
    bound : ndarray, shape (k,)
    closed : ndarray, shape (l,)
        The values e.

    Returns
    -------
    z : ndarray, shape (n,)
    mu : ndarray, shape (m,)
    t : ndarray, shape (k, dim_t)
    r : ndarray, shape (l,)
        Multipliers, with ``S z + G^T mu + R^T t + E^T r = f``.
    seconds : float

    Raises
    ------
    MissingDependency
        Clarabel is not installed.

    Notes
    -----
    The last iterate is returned, converged or not: the caller checks its residuals.
    """
    try:
        clarabel = importlib.import_module("clarabel")
    except ImportError as error:
        raise MissingDependency("cones need Clarabel: pip install clarabel") from error
    S, f = unit.P, unit.f
    n, m, e, (k, dim_t) = f.size, gap.size, closed.size, offset.shape
    scale = float(abs(S).max()) or 1.0
    size = float(np.abs(f).max(initial=0.0)) / scale or float(np.abs(gap).max(initial=0.0)) or 1.0
    # Rows (s_i, R_i z + o_i) of each point one after the other, as b - A x in the cone.
    slack = sparse.coo_array(
        (-np.ones(k), ((1 + dim_t) * np.arange(k), np.arange(k))), shape=((1 + dim_t) * k, k)
    )
    spread = (1 + dim_t) * np.arange(k)[:, None] + 1 + np.arange(dim_t)
    place = sparse.coo_array(
        (-np.ones(k * dim_t), (spread.ravel(), np.arange(k * dim_t))),
        shape=((1 + dim_t) * k, k * dim_t),
    )
    A = sparse.block_array([[unit.E, None], [unit.G, None], [place @ unit.R, slack]], format="csc")
    b = np.concatenate((closed, gap, np.insert(offset, 0, 0.0, axis=1).ravel())) / size
    P = sparse.block_diag((S / scale, sparse.csc_array((k, k))), format="csc")
    q = np.concatenate((-f, bound)) / (scale * size)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    # Its default stops these at 1e-13, which leaves a dense program a hundred times above it.
    settings.iterative_refinement_reltol = settings.iterative_refinement_abstol = 1e-16
    settings.iterative_refinement_max_iter = 50
    cones = [clarabel.ZeroConeT(e)] if e else []
    cones += [clarabel.NonnegativeConeT(m)] if m else []
    cones += [clarabel.SecondOrderConeT(1 + dim_t)] * k
    begin = time.perf_counter()
    upper, rows = sparse.triu(sparse.csc_matrix(P), format="csc"), sparse.csc_matrix(A)
    for tol in _TOLERANCES:
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tol
        # If rounding stops it within 100 times the tolerance, that iterate is accepted.
        settings.reduced_tol_gap_abs = settings.reduced_tol_gap_rel = 100 * tol
        settings.reduced_tol_feas = 100 * tol
        solution = clarabel.DefaultSolver(upper, q, rows, b, cones, settings).solve()
        if str(solution.status) in ("Solved", "AlmostSolved"):
            break
    seconds = time.perf_counter() - begin
    y = scale * size * np.array(solution.z)
    t = -y[e + m :].reshape(k, 1 + dim_t)[:, 1:]
    return size * np.array(solution.x[:n]), y[e : e + m], t, y[:e], seconds
