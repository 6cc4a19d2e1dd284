r"""The least multipliers of a solution.

Where active rows depend on each other, the multipliers of a solution x are a polyhedron, and an
interior point may end far out in it. Of its points

.. math:: \min \tfrac12 |y|^2 + \tfrac12 |z_\mathrm{box}|^2 \quad\text{subject to}\quad
          C^Ty + z_\mathrm{box} = -(Px + q)

with the signs that the sides allow, y of active rows and :math:`z_\mathrm{box}` of held variables
only, is the one whose rounding does the least to :math:`Px + q + C^Ty + z_\mathrm{box}`.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from gpu.errors import GpuError
from gpu.qp.data.standard_qp import Array, StandardQP
from gpu.qp.interior_point.minimise import NoBound, NoPoint, minimise

# Of the terms of a row: what a row may miss its side by and still be called active.
SIDE_ROUNDING = 1e-12


def least_multipliers(p: StandardQP, x: Array, y: Array, tol: float) -> tuple[Array, Array] | None:
    """Multipliers of rows and bounds at the solution x, or None where they are not found."""
    n, Cx = x.size, p.C @ x
    slack = SIDE_ROUNDING * (abs(p.C) @ np.abs(x))
    high = p.equality | (np.abs(p.row_high - Cx) <= slack) | (y > 0.0)
    low = p.equality | (np.abs(Cx - p.row_low) <= slack) | (y < 0.0)
    rows, held = np.flatnonzero(high | low), np.flatnonzero((x == p.lb) | (x == p.ub))
    columns = sparse.csr_array(
        (np.ones(held.size), (held, np.arange(held.size))), shape=(n, held.size)
    )
    force = -(p.P @ x + p.q)
    size = rows.size + held.size
    above = np.concatenate([high[rows], x[held] == p.ub[held]])
    below = np.concatenate([low[rows], x[held] == p.lb[held]])
    least = StandardQP(
        sparse.csr_array(sparse.eye_array(size)),
        np.zeros(size),
        sparse.csr_array(sparse.hstack([p.C[rows].T, columns])),
        force,
        force,
        np.where(below, -np.inf, 0.0),
        np.where(above, np.inf, 0.0),
    )
    try:
        found = minimise(least, tol, proofs=False)
    except (NoPoint, NoBound, GpuError):
        return None
    if not found.residuals.worst <= tol:
        return None
    multipliers, forces = np.zeros_like(y), np.zeros(n)
    multipliers[rows], forces[held] = found.x[: rows.size], found.x[rows.size :]
    return multipliers, forces
