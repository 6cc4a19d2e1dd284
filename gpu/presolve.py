"""What can be taken out of a program before it is solved, without changing the answer.

Fixed variables become constants, rows without finite sides and rows without entries disappear;
multipliers of what was taken out follow from stationarity.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from gpu.program import Array, Matrix, Program, is_sparse


@dataclass(frozen=True)
class Presolved:
    """A smaller program, and the way back."""

    program: Program
    free: Array
    rows: Array
    fixed_x: Array
    row_count: int

    def point(self, x: Array, y: Array) -> tuple[Array, Array]:
        """x and y of the whole program."""
        xp = self.program.xp
        whole, multipliers = self.fixed_x.copy(), xp.zeros(self.row_count)
        whole[self.free] = x
        multipliers[self.rows] = y
        return whole, multipliers


def presolve(p: Program) -> Presolved:
    """Take out fixed variables and rows that say nothing about the others."""
    xp = p.xp
    fixed = p.lb == p.ub
    free = xp.flatnonzero(~fixed)
    x = xp.where(fixed, p.lb, 0.0)
    C = _columns(p.C, free)
    kept = xp.flatnonzero((xp.isfinite(p.row_low) | xp.isfinite(p.row_high)) & _nonempty(C, xp))
    if free.size == p.q.size and kept.size == p.row_low.size:
        return Presolved(p, free, kept, x, p.row_low.size)
    shift = p.C @ x
    program = Program(
        _columns(p.P[free], free),
        (p.q + p.P @ x)[free],
        C[kept],
        (p.row_low - shift)[kept],
        (p.row_high - shift)[kept],
        p.lb[free],
        p.ub[free],
    )
    return Presolved(program, free, kept, x, p.row_low.size)


def _columns(M: Matrix, keep: Array) -> Matrix:
    return sparse.csr_array(sparse.csc_array(M)[:, keep]) if is_sparse(M) else M[:, keep]


def _nonempty(C: Matrix, xp: Any) -> Array:
    if is_sparse(C):
        nonzero = sparse.csr_array(C)
        nonzero.eliminate_zeros()
        return np.diff(nonzero.indptr) > 0
    return (C != 0).any(axis=1)
