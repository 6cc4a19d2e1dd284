r"""Proofs that a program has no feasible point, or no lower bound.

A Farkas vector y of the rows has, with :math:`c = C^Ty`,

.. math:: \max_{l \le x \le u} c^Tx < \sum_i \min_{r_l \le r \le r_u} y_ir,

so that no x of the box can have its rows within their sides. A ray d has :math:`Pd = 0`,
:math:`q^Td < 0`, and follows rows and bounds for ever. Both are sought as the nearest point of
a cone to a given vector, a strictly convex problem that always has a solution; it is zero where
there is no proof. What is found is verified before it counts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import sparse

from gpu.qp.data.standard_qp import Array, Matrix, StandardQP, is_sparse
from gpu.qp.interior_point.equilibrate import largest_side

# A sum below this part of its terms is zero: rounding of a few thousand terms reaches it.
ZERO_SUM = 1e-12
# Relative to its terms: margin of the inequality of a proof, above what was taken for zero.
PROOF_MARGIN = 1e-9
# Relative to the largest entry of q: rounding of other entries that are differences.
TERM_ROUNDING = 64 * np.finfo(float).eps
# A proof in which a component of C'y at an infinite bound is taken for zero excludes only points
# nearer than this many times the largest side of the program.
FARTHER = 1e4
# Largest violation of a row by a ray: relative to the terms, as a projection leaves as much, and to
# the largest entry of the row, for terms that vanish.
RAY_ROUNDING, ENTRY_ROUNDING = 1e-10, 1e-16
# Relative size of entries set to zero; the first value that gives a proof counts. A solution to
# 1e-10 has entries of about 1e-5 where a sharp proof has a zero.
NEGLIGIBLE = (1e-12, 1e-9, 1e-7, 1e-5)
# Before the projection: components of C'y taken for zero if the largest y is one, and relative size
# of rows of a ray taken for equalities.
VANISHING, NEARLY_HELD = 1e-8, 1e-4
# Most entries of the dense block of a projection: 32 MB.
LARGEST_PROJECTION = 4_000_000
# Singular values of that block below this, over the largest, are rounding.
DEPENDENT = 1e-13
Solve = Callable[[StandardQP], Array]


def farkas(p: StandardQP, solve: Solve) -> Array | None:
    """A verified Farkas vector of the rows, if there is one."""
    xp, m = p.xp, p.row_low.size
    equal = p.equality
    up = xp.flatnonzero(~equal & xp.isfinite(p.row_high))
    down = xp.flatnonzero(~equal & xp.isfinite(p.row_low))
    at_ub, at_lb = xp.flatnonzero(xp.isfinite(p.ub)), xp.flatnonzero(xp.isfinite(p.lb))
    eq = xp.flatnonzero(equal)
    Ct = _transposed(p.C)
    unit = _identity(p.P, p.q.size, xp)
    blocks = [Ct[:, eq], Ct[:, up], -Ct[:, down], unit[:, at_ub], -unit[:, at_lb]]
    cost = xp.concatenate(
        [p.row_low[eq], p.row_high[up], -p.row_low[down], p.ub[at_ub], -p.lb[at_lb]]
    )
    N = cost.size
    size = float(xp.abs(cost).max()) if N else 0.0
    if not size:
        return None
    low = xp.zeros(N)
    low[: eq.size] = -xp.inf
    nothing = xp.zeros(p.q.size)
    nearest = StandardQP(
        _identity(p.P, N, xp), cost / size, _stack(blocks, p.P, xp),
        nothing, nothing, low, xp.full(N, xp.inf),
    )  # fmt: skip
    v = solve(nearest)
    y = xp.zeros(m)
    first, second = eq.size, eq.size + up.size
    y[eq] = v[:first]
    y[up] += v[first:second]
    y[down] -= v[second : second + down.size]
    largest = float(xp.abs(y).max()) if m else 0.0
    if not largest or not np.isfinite(largest):
        return None
    for small in NEGLIGIBLE:
        support = xp.where(xp.abs(y) <= small * largest, 0.0, -y / largest)
        for candidate in (support, _projected(p, support)):
            proof = _verified(p, candidate)
            if proof is not None:
                return proof
    return None


def _projected(p: StandardQP, y: Array) -> Array:
    """The nearest y with the same zeros whose ``C'y`` vanishes on the free variables."""
    xp = p.xp
    rows = xp.flatnonzero(y)
    columns = xp.flatnonzero(xp.isinf(p.lb) | xp.isinf(p.ub))
    if not rows.size or not columns.size or rows.size * columns.size > LARGEST_PROJECTION:
        return y
    block = p.C[rows][:, columns]
    block = block.toarray() if is_sparse(block) else block
    c = p.C.T @ y
    loose = xp.isinf(p.lb[columns]) & xp.isinf(p.ub[columns])
    # A column with one side only must vanish where it points to the other, or nearly does so.
    wrong = xp.where(xp.isinf(p.ub[columns]), c[columns] > -VANISHING, c[columns] < VANISHING)
    keep = loose | wrong
    y = y.copy()
    y[rows] -= xp.linalg.lstsq(block[:, keep].T, c[columns][keep], rcond=DEPENDENT)[0]
    return y


def _verified(p: StandardQP, y: Array) -> Array | None:
    xp = p.xp
    y = xp.where((y > 0) & xp.isinf(p.row_low), 0.0, y)
    y = xp.where((y < 0) & xp.isinf(p.row_high), 0.0, y)
    c = p.C.T @ y
    corner = xp.where(c > 0, p.ub, xp.where(c < 0, p.lb, 0.0))
    rounded = xp.isinf(corner) & (xp.abs(c) <= ZERO_SUM * (abs(p.C).T @ xp.abs(y)))
    rest = float(xp.abs(c[rounded]).sum())
    c, corner = xp.where(rounded, 0.0, c), xp.where(rounded, 0.0, corner)
    row = xp.where(y > 0, p.row_low, xp.where(y < 0, p.row_high, 0.0))
    most, least = float(c @ corner), float(y @ row)
    terms = float(xp.abs(c) @ xp.abs(corner)) + float(xp.abs(y) @ xp.abs(row))
    margin = least - most
    if not margin > PROOF_MARGIN * terms:
        return None
    # What was rounded off leaves points far away: they must be farther than any of the data.
    size = largest_side(p.row_low, p.row_high, p.lb, p.ub)
    return y if margin > FARTHER * max(size, 1.0) * rest else None


def ray(p: StandardQP, solve: Solve, towards: Array | None = None) -> Array | None:
    """A verified ray along which the objective falls without bound, or None. The direction of
    `towards`, shape (n,), to which iterates ran away, is tried as well.
    """
    xp, n = p.xp, p.q.size
    size = float(xp.abs(p.q).max()) if n else 0.0
    if not size:
        return None
    rows = _rows([p.P, p.C], xp)
    flat = xp.zeros(n)
    low = xp.concatenate([flat, xp.where(xp.isfinite(p.row_low), 0.0, -xp.inf)])
    high = xp.concatenate([flat, xp.where(xp.isfinite(p.row_high), 0.0, xp.inf)])
    cone = StandardQP(
        _identity(p.P, n, xp), p.q / size, rows, low, high,
        xp.where(xp.isfinite(p.lb), 0.0, -xp.inf), xp.where(xp.isfinite(p.ub), 0.0, xp.inf),
    )  # fmt: skip
    for d in (solve(cone), *(() if towards is None else (towards,))):
        largest = float(xp.abs(d).max())
        if not largest or not np.isfinite(largest):
            continue
        for small in NEGLIGIBLE:
            v = xp.clip(xp.where(xp.abs(d) <= small * largest, 0.0, d / largest), cone.lb, cone.ub)
            for candidate in (_straightened(cone, v), v):
                if _falls(p, cone, candidate):
                    return candidate
    return None


def _falls(p: StandardQP, cone: StandardQP, v: Array) -> bool:
    xp, length = p.xp, p.xp.abs(v)
    along, terms = cone.C @ v, abs(cone.C) @ length
    outside = xp.maximum(cone.row_low - along, along - cone.row_high)
    # Each row against itself: one that is small beside the others is a row all the same.
    size = abs(cone.C).max(axis=1)
    size = size.toarray() if is_sparse(size) else size
    straight = bool(
        (outside <= RAY_ROUNDING * terms + ENTRY_ROUNDING * size * float(length.max())).all()
    )
    inside = bool(((cone.lb <= v) & (v <= cone.ub)).all())
    # What entries of q fall by that are rounding beside its others proves nothing.
    least = PROOF_MARGIN * float(xp.abs(p.q) @ length)
    least += TERM_ROUNDING * float(xp.abs(p.q).max()) * float(length.max())
    return bool(straight and inside and float(p.q @ v) < -least)


def _straightened(cone: StandardQP, v: Array) -> Array:
    """The nearest direction with the same zeros along which rows that nearly vanish do vanish."""
    xp = cone.xp
    terms = abs(cone.C) @ xp.abs(v)
    near = (cone.row_low > -xp.inf) | (cone.row_high < xp.inf)
    rows = xp.flatnonzero(near & (xp.abs(cone.C @ v) <= NEARLY_HELD * terms) & (terms > 0.0))
    columns = xp.flatnonzero(v)
    if not rows.size or not columns.size or rows.size * columns.size > LARGEST_PROJECTION:
        return v
    block = cone.C[rows][:, columns]
    block = block.toarray() if is_sparse(block) else block
    v = v.copy()
    v[columns] -= xp.linalg.lstsq(block, block @ v[columns], rcond=DEPENDENT)[0]
    return v


def _transposed(C: Matrix) -> Matrix:
    return sparse.csc_array(C.T) if is_sparse(C) else C.T


def _identity(like: Matrix, n: int, xp: Any) -> Matrix:
    return sparse.eye_array(n, format="csc") if is_sparse(like) else xp.eye(n)


def _stack(blocks: list[Matrix], like: Matrix, xp: Any) -> Matrix:
    if is_sparse(like):
        return sparse.hstack(blocks, format="csr")
    return xp.concatenate(blocks, axis=1)


def _rows(blocks: list[Matrix], xp: Any) -> Matrix:
    if is_sparse(blocks[0]):
        return sparse.csr_array(sparse.vstack(blocks, format="csr"))
    return xp.concatenate(blocks, axis=0)
