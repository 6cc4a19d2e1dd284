"""Compiled parts of `gpu.arrays.sparse_factor.UpLooking`: ``L D L'`` row by row.

The strict upper triangle of the permuted matrix is given by columns (Ap, Ai, Ax), L by columns (Lp,
Li, Lx), its pattern by rows (Rp, Ri) too. Import it inside functions only: it imports numba.
"""

from __future__ import annotations

import numpy as np

from skfem_adini.ground.jit import Array, Index, Real, loop


@loop
def counts(Ap: Array, Ai: Array, parent: Array, column: Array, row: Array, most: Index) -> bool:
    """Elimination tree and, added to what is given, the numbers of entries of the columns and rows
    of L; whether they are at most `most`, else they are not complete."""
    n, entries = parent.size, 0
    seen = np.full(n, -1, np.int32)
    for k in range(n):
        parent[k] = -1
        seen[k] = k
        for p in range(Ap[k], Ap[k + 1]):
            i = Ai[p]
            while seen[i] != k:
                if parent[i] < 0:
                    parent[i] = k
                column[i] += 1
                row[k] += 1
                seen[i] = k
                i = parent[i]
        entries += row[k]
        if entries > most:
            return False
    return True


@loop
def pattern(
    Ap: Array, Ai: Array, parent: Array, Lp: Array, Li: Array, Rp: Array, Ri: Array
) -> None:
    """The rows of L, each column behind those of its subtree, and the columns."""
    n = parent.size
    seen, path, end = np.full(n, -1, np.int32), np.empty(n, np.int32), Lp[:n].copy()
    for k in range(n):
        seen[k], top = k, Rp[k + 1]
        for p in range(Ap[k], Ap[k + 1]):
            i, length = Ai[p], 0
            while seen[i] != k:
                seen[i], path[length] = k, i
                length += 1
                i = parent[i]
            while length:
                length -= 1
                top -= 1
                Ri[top] = path[length]
        for s in range(Rp[k], Rp[k + 1]):
            i = Ri[s]
            Li[end[i]] = k
            end[i] += 1


@loop
def numeric(
    Ap: Array, Ai: Array, Ax: Array, diagonal: Array, Lp: Array, Li: Array, Lx: Array,
    Rp: Array, Ri: Array, D: Array, least: Real,
) -> Index:  # fmt: skip
    """L and 1 / D; a pivot keeps the sign of its diagonal entry and at least the part `least` of
    the terms that make it. Returns the row that is not finite, or -1."""
    n = D.size
    y, end = np.zeros(n), Lp[:n].copy()
    for k in range(n):
        for p in range(Ap[k], Ap[k + 1]):
            y[Ai[p]] = Ax[p]
        d = diagonal[k]
        size = abs(d)
        for s in range(Rp[k], Rp[k + 1]):
            i = Ri[s]
            v, stop = y[i], end[i]
            y[i] = 0.0
            for p in range(Lp[i], stop):
                y[Li[p]] -= Lx[p] * v
            entry = v * D[i]
            Lx[stop] = entry
            end[i] = stop + 1
            d -= entry * v
            size += abs(entry * v)
        if not 0.0 < size < np.inf:
            return k
        if diagonal[k] < 0.0:
            d = min(d, -least * size)
        else:
            d = max(d, least * size)
        D[k] = 1.0 / d
    return -1


@loop
def solution(order: Array, Lp: Array, Li: Array, Lx: Array, D: Array, b: Array, x: Array) -> None:
    """Solve ``L D L' P x = P b``."""
    n = D.size
    u = np.empty(n)
    for j in range(n):
        u[j] = b[order[j]]
    for j in range(n):
        v = u[j]
        for p in range(Lp[j], Lp[j + 1]):
            u[Li[p]] -= Lx[p] * v
    for j in range(n - 1, -1, -1):
        v = u[j] * D[j]
        for p in range(Lp[j], Lp[j + 1]):
            v -= Lx[p] * u[Li[p]]
        u[j] = v
        x[order[j]] = v
