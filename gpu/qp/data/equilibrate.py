r"""Scaling of a program to entries of size one, after Ruiz [1]_, and to sides of moderate size.

The variables become :math:`x = D\hat x`, the rows are multiplied by E and the objective by c,
all of them powers of two, so that nothing is rounded.

References
----------
.. [1] D. Ruiz, "A scaling algorithm to equilibrate both rows and columns norms in matrices",
   RAL-TR-2001-034 (2001).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from gpu.qp.data.standard_qp import Array, Matrix, StandardQP, is_sparse


class _Limits(NamedTuple):  # limits of the scaling
    rounds: int = 12  # square roots of all sizes: sixteen decades become 16 / 2^12
    even: float = 1.2  # between the sizes before a round: after it, less than powers of two see
    curvature: float = 1e-6  # relative to the largest: a smaller c gives x no length |q| / c
    moderate: float = 1e3  # lengths up to which iterates go without another unit
    apart: float = 1e11  # between lengths: the lesser ones may be rounding of the others
    digits: float = 1e20  # between lengths: beyond, the lesser ones are meant as they stand
    rounding: float = 1e-3  # of such a length: with a tol of 1e-9 it is known to 1e-12
    force: float = 1e-9  # of what such lengths make of P: smaller ones are rounding


LIMITS = _Limits()


@dataclass(frozen=True)
class Scaling:
    """Factors of variables, rows and objective."""

    variables: Array
    rows: Array
    objective: float

    def point(self, x: Array, y: Array) -> tuple[Array, Array]:
        """x and y of the problem from those of the scaled one."""
        return self.variables * x, self.rows * y / self.objective

    def scaled_point(self, x: Array, y: Array) -> tuple[Array, Array]:
        """x and y of the scaled problem from those of the problem."""
        return x / self.variables, y * self.objective / self.rows


def equilibrate(p: StandardQP) -> tuple[StandardQP, Scaling]:
    """The scaled program and its factors."""
    xp = p.xp
    D, E = xp.ones(p.q.size), xp.ones(p.row_low.size)
    sizes = _Sizes(p.P, xp), _Sizes(p.C, xp)
    for _ in range(LIMITS.rounds):
        column, row = sizes[1].both(E, D)
        column = xp.maximum(sizes[0].columns(D, D), column)
        column, row = (xp.where(size > 0, size, 1.0) for size in (column, row))
        D, E = D / xp.sqrt(column), E / xp.sqrt(row)
        both = xp.concatenate([column, row])
        if float(both.max()) <= LIMITS.even * float(both.min()):
            break
    # Entries keep their size when variables and sides change theirs.
    length = _length(p, D, E, sizes[0])
    D, E = xp.exp2(xp.round(xp.log2(D * length))), xp.exp2(xp.round(xp.log2(E / length)))
    P, q = _scale(p.P, D, D), D * p.q
    curvature = float(sizes[0].columns(D, D).mean()) if D.size else 0.0
    size = max(curvature, float(xp.abs(q).max()) if q.size else 0.0)
    c = float(np.exp2(-np.round(np.log2(size)))) if size > 0 else 1.0
    scaled = StandardQP(
        P * c, q * c, _scale(p.C, E, D), E * p.row_low, E * p.row_high, p.lb / D, p.ub / D
    )
    return scaled, Scaling(D, E, c)


def with_rounding(p: StandardQP, certain: bool = False) -> StandardQP | None:
    """The program with `StandardQP.near`, and without a q that is rounding beside it; None where
    sides and forces make lengths alike. It is relative to the largest where some are so much less
    that they may be its rounding; else at most absolute, as a side may be far away (and None if
    only what is `certain` counts)."""
    xp = p.xp
    scaled, scaling = equilibrate(p)
    one = xp.ones(p.q.size)
    lengths = (
        _forced(scaled.q, _Sizes(scaled.P, xp).columns(one, one)),
        *(scaled.row_low, scaled.row_high, scaled.lb, scaled.ub),
    )
    sizes = xp.abs(xp.concatenate(lengths))
    sizes = xp.sort(sizes[(sizes > 0.0) & xp.isfinite(sizes)])
    if not sizes.size:
        return None
    sizes = sizes[sizes <= LIMITS.digits * sizes[0]]
    near = LIMITS.rounding * float(sizes[-1])
    apart = bool((sizes[1:] > LIMITS.apart * sizes[:-1]).any())
    if not near > float(sizes[0]) or (certain and not apart):
        return None
    near = near * scaling.variables
    near = near if apart else xp.minimum(near, LIMITS.rounding)
    nothing = bool((xp.abs(p.q) <= LIMITS.force * (abs(p.P) @ near)).all())
    return replace(p, near=near, q=0.0 * p.q if nothing else p.q)


def _length(p: StandardQP, D: Array, E: Array, curvature: _Sizes) -> Any:
    """The unit of length; what is far below it would be lost in rounding of the first iterates."""
    xp = p.xp
    side = largest_side(E * p.row_low, E * p.row_high, p.lb / D, p.ub / D)
    forces = _forced(D * p.q, curvature.columns(D, D))
    force = float(forces.max()) if forces.size else 0.0
    if side == 0.0 and force > 1.0:  # no side confines what curvature makes
        return xp.asarray(max(force / LIMITS.moderate, 1.0))
    if side < 1.0:
        return xp.asarray(min(max(side, force), 1.0) or 1.0)
    # A side may be far from the solution: only what curvature makes as long is taken whole.
    whole = max(min(side, force) / LIMITS.moderate, 1.0)
    return xp.asarray(whole * np.sqrt(side / whole))


def _forced(q: Array, curvature: Array) -> Array:
    """The lengths that curvature makes of forces."""
    curved = curvature > LIMITS.curvature * (float(curvature.max()) if q.size else 0.0)
    lengths: Array = abs(q[curved]) / curvature[curved]
    return lengths


def largest_side(*sides: Array) -> float:
    """The largest finite side."""
    largest = 0.0
    for side in sides:
        if side.size:
            size = abs(side)
            size[~(size < float("inf"))] = 0.0
            largest = max(largest, float(size.max()))
    return largest


class _Sizes:
    """Largest entries of the rows and columns of a matrix under a scaling."""

    def __init__(self, M: Matrix, xp: Any) -> None:
        self.xp, self.work = xp, None
        self.M = abs(M)
        self.shape = M.shape
        if is_sparse(M):
            self.M = sparse.csr_array(self.M)
            self.kept = np.flatnonzero(np.diff(self.M.indptr))
            self.i = np.repeat(np.arange(M.shape[0]), np.diff(self.M.indptr))

    def both(self, E: Array, D: Array) -> tuple[Array, Array]:
        """Those of columns and of rows."""
        xp, (rows, columns) = self.xp, self.shape
        if is_sparse(self.M):
            size, row = np.zeros(columns), np.zeros(rows)
            entries = E[self.i] * self.M.data * D[self.M.indices]
            np.maximum.at(size, self.M.indices, entries)
            if self.kept.size:
                row[self.kept] = np.maximum.reduceat(entries, self.M.indptr[self.kept])
            return size, row
        if not self.M.size:
            return xp.zeros(columns), xp.zeros(rows)
        if self.work is None:  # memory that is there is faster than a new one
            self.work = xp.empty_like(self.M)
        scaled = xp.multiply(self.M, E[:, None], out=self.work)
        scaled *= D
        return scaled.max(axis=0), scaled.max(axis=1)

    def columns(self, E: Array, D: Array) -> Array:
        return self.both(E, D)[0]


def _scale(M: Matrix, E: Array, D: Array) -> Matrix:
    if not is_sparse(M):
        scaled = E[:, None] * M
        scaled *= D
        return scaled
    M = sparse.csr_array(M, copy=True)
    M.data = np.repeat(E, np.diff(M.indptr)) * M.data * D[M.indices]
    return M
