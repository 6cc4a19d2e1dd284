r"""A program whose linear term is small beside its curvature, in a form that has both of size one.

Where P is singular the linear term decides in the directions without curvature, however small it
is; proximal terms and rounding of products with P drown it there. With :math:`P = M^TM`, of rank r,
and :math:`s = \max|q|`,

.. math:: \min_{x, w} \tfrac12 |w|^2 + \tfrac1s q^Tx \quad\text{subject to}\quad
          Mx - \sqrt s\,w = 0

and the rows and bounds of the program: the smaller s is, the closer it comes to the linear program
on the face of least curvature. Multipliers of the other rows are those of the program over s.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from gpu.qp.data.standard_qp import Array, StandardQP

# In an equilibrated program P has entries near one: beside products with it a linear term below
# this has lost four of its sixteen digits.
SMALL_LINEAR_TERM = 1e-4
# All eigenvectors of P are computed and M is dense: programs with more unknowns stay as they are.
MOST_UNKNOWNS = 500
# Of the largest eigenvalue of P and for each unknown: less is rounding of its entries.
EIGENVALUE_ROUNDING = 4 * np.finfo(float).eps


class CurvatureRows:
    """The program in (x, w), and the way back."""

    def __init__(self, p: StandardQP, size: float) -> None:
        n, self.m, self.size = p.q.size, p.row_low.size, size
        P = p.P.toarray() if p.is_sparse else p.P
        values, vectors = np.linalg.eigh(P)
        kept = values > n * EIGENVALUE_ROUNDING * values[-1]
        M = (vectors[:, kept] * np.sqrt(values[kept])).T
        self.n, r = n, len(M)
        nothing, free = np.zeros(r), np.full(r, np.inf)
        rows = [[p.C, np.zeros((self.m, r))], [M, -np.sqrt(size) * np.eye(r)]]
        square = np.diag(np.concatenate([np.zeros(n), np.ones(r)]))
        C = sparse.csr_array(sparse.bmat(rows)) if p.is_sparse else np.block(rows)
        self.program = StandardQP(
            sparse.csr_array(square) if p.is_sparse else square,
            np.concatenate([p.q / size, nothing]),
            C,
            np.concatenate([p.row_low, nothing]),
            np.concatenate([p.row_high, nothing]),
            np.concatenate([p.lb, -free]),
            np.concatenate([p.ub, free]),
        )

    def point(self, x: Array, y: Array) -> tuple[Array, Array]:
        """x and y of the program."""
        return x[: self.n], self.size * y[: self.m]


def curvature_rows(p: StandardQP) -> CurvatureRows | None:
    """The program in (x, w), of an equilibrated one on the host; None where q is not small."""
    if p.xp is not np or not 0 < p.q.size <= MOST_UNKNOWNS:
        return None
    size = float(np.abs(p.q).max())
    return CurvatureRows(p, size) if 0.0 < size < SMALL_LINEAR_TERM else None
