"""Presolve: reductions of a quadratic program that do not change its solution.

Fixed variables become constants; rows without finite sides or without entries are removed. On the
host further reductions are sought [1]_:

* a row that the bounds imply is removed;
* a row with a single entry becomes a bound of its variable;
* rows that are multiples of each other become one row with two sides;
* a forcing row, which the bounds allow to hold in one way only, fixes all of its variables. The set
  of multipliers of such a row is unbounded, and the iterates of an interior-point method would
  diverge along it.

The multipliers of removed rows follow from stationarity, the last reduction first.

References
----------
.. [1] A. L. Brearley, G. Mitra, H. P. Williams, "Analysis of mathematical programming problems
   prior to applying the simplex algorithm", Math. Program. 8 (1975) 54-83.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from gpu.qp.data.equilibrate import largest_side
from gpu.qp.data.standard_qp import Array, Matrix, StandardQP, is_sparse


class _Presolve(NamedTuple):  # limits of the search
    rounds: int = 10  # most passes over all rows; they end after a few
    activity: float = 1e-14  # of a row's terms: with less room it is a forcing row
    parallel: float = 1e-10  # between weighted sums of rows: nearer ones are compared
    entries: int = 4_000_000  # most of a dense matrix that is searched (32 MB): few are zero


PRESOLVE = _Presolve()


@dataclass(frozen=True)
class Presolved:
    """A smaller program, and what is needed to recover the solution of the whole one."""

    program: StandardQP  # the smaller one
    free: Array  # its variables, as indices into those of `whole`
    rows: Array  # its rows, as indices into those of `whole`
    fixed_x: Array  # values of the fixed variables, 0 at the others
    whole: StandardQP  # as given
    tight: StandardQP  # the whole with the bounds and sides that were found
    reductions: tuple[Reduction, ...] = ()  # in the order in which they were made

    def point(self, x: Array, y: Array) -> tuple[Array, Array]:
        """x and y of the whole program."""
        xp = self.program.xp
        point, multipliers = self.fixed_x.copy(), xp.zeros(self.whole.row_low.size)
        point[self.free] = x
        multipliers[self.rows] = y
        if self.reductions:
            force = -self.whole.gradient(point, multipliers)
            for reduction in reversed(self.reductions):
                reduction.restore(multipliers, force, point)
        return point, multipliers


@dataclass(frozen=True)
class Parallel:
    """Rows `rows` are `factors` times rows `kept`, whose upper or lower side they determine."""

    rows: Array
    kept: Array
    factors: Array
    gives_high: Array
    gives_low: Array

    def restore(self, y: Array, force: Array, x: Array) -> None:
        """Move the multiplier of a side to the row that determines this side."""
        whole = y[self.kept]
        mine = ((whole > 0) & self.gives_high) | ((whole < 0) & self.gives_low)
        y[self.rows[mine]] = whole[mine] / self.factors[mine]
        y[self.kept[mine]] = 0.0


@dataclass(frozen=True)
class Single:
    """Rows `rows` with a single entry, `entries` in `columns`, which determine a bound of it."""

    C: sparse.csr_array
    rows: Array
    columns: Array
    entries: Array
    gives_high: Array
    gives_low: Array
    high: Array
    low: Array

    def restore(self, y: Array, force: Array, x: Array) -> None:
        """Give the force on a variable at a bound to the row that determines this bound. The force
        is minus the gradient of the Lagrangian.
        """
        push, value = force[self.columns], x[self.columns]
        distance = np.where(push > 0, self.high - value, value - self.low)
        # The force on a variable away from its bound is rounding and makes no multiplier.
        near = abs(push) * abs(x).max() >= distance * abs(force).max()
        mine = near & (((push > 0) & self.gives_high) | ((push < 0) & self.gives_low))
        if mine.any():
            rows = self.rows[mine]
            y[rows] = push[mine] / self.entries[mine]
            force -= self.C[rows].T @ y[rows]


@dataclass(frozen=True)
class Forcing:
    """A row that holds only with all its variables at bounds."""

    C: sparse.csr_array
    row: int
    columns: Array
    entries: Array
    sign: int  # 1: its least value is its upper side; -1: its largest is its lower side

    def restore(self, y: Array, force: Array, x: Array) -> None:
        """Set the smallest multiplier that gives the forces on its variables the right signs."""
        needed = self.sign * float((self.sign * force[self.columns] / self.entries).max())
        if self.sign * needed > 0.0:
            y[self.row] = needed
            part = slice(self.C.indptr[self.row], self.C.indptr[self.row + 1])
            force[self.C.indices[part]] -= needed * self.C.data[part]


Reduction = Parallel | Single | Forcing


def presolve(p: StandardQP, search: bool = True) -> Presolved:
    """Remove fixed variables and empty rows; if `search`, on the host, make all reductions."""
    small = p.xp is np and (p.is_sparse or p.C.size <= PRESOLVE.entries)
    if search and small and not _irreducible(p):
        tight, dropped, reductions = _Search(p).run()
    else:
        tight, dropped, reductions = p, p.xp.zeros(p.row_low.size, dtype=bool), ()
    xp = p.xp
    fixed = tight.lb == tight.ub
    free = xp.flatnonzero(~fixed)
    x = xp.where(fixed, tight.lb, 0.0)
    C = _columns(p.C, free) if free.size < p.q.size else p.C
    says = (xp.isfinite(tight.row_low) | xp.isfinite(tight.row_high)) & ~dropped
    kept = xp.flatnonzero(says & nonempty(C))
    if free.size == p.q.size and kept.size == p.row_low.size:
        return Presolved(tight, free, kept, x, p, tight, reductions)
    shift = p.C @ x
    program = StandardQP(
        _columns(p.P[free], free),
        (p.q + p.P @ x)[free],
        C[kept],
        (tight.row_low - shift)[kept],
        (tight.row_high - shift)[kept],
        tight.lb[free],
        tight.ub[free],
    )
    return Presolved(program, free, kept, x, p, tight, reductions)


def _irreducible(p: StandardQP) -> bool:
    """Whether a glance at a dense matrix without zeros shows that nothing can be reduced."""
    loose = np.isinf(p.lb) & np.isinf(p.ub)
    if p.is_sparse or not loose.any() or p.q.size < 2 or not p.C.all():
        return False
    weights = np.random.default_rng(0).random(p.q.size)
    sums = np.sort((p.C @ weights) / p.C[:, 0])
    # Rows that are multiples of each other have the same sum but for rounding.
    near = np.diff(sums) <= PRESOLVE.parallel * np.abs(sums[1:])
    return not (near.any() or (p.lb == p.ub).any())


def contradiction(p: StandardQP, tol: float) -> Array | None:
    """A Farkas vector of a single row that is violated by more than `tol` times its terms, though
    all its variables are fixed, or None. A residual of all rows together would miss it beside
    larger numbers."""
    xp = p.xp
    fixed = p.lb == p.ub
    if not bool(fixed.any()) or not p.row_low.size:
        return None
    x = xp.where(fixed, p.lb, 0.0)
    Cx = p.C @ x
    side = xp.clip(Cx, p.row_low, p.row_high)
    # A side may consist of rounding errors, if it was computed as a difference.
    rounding = PRESOLVE.activity * largest_side(p.row_low, p.row_high, p.lb, p.ub)
    rows = xp.flatnonzero(xp.abs(Cx - side) > xp.maximum(tol * xp.abs(side), rounding))
    if not rows.size:
        return None
    C, Cx, side = p.C[rows], Cx[rows], side[rows]
    constant = ~nonempty(_columns(C, xp.flatnonzero(~fixed)))
    wrong = constant & (xp.abs(Cx - side) > tol * (abs(C) @ xp.abs(x) + xp.abs(side)))
    if not bool(wrong.any()):
        return None
    y, i = xp.zeros(p.row_low.size), wrong.argmax()
    y[rows[i]] = xp.sign(side[i] - Cx[i])
    return y


class _Search:
    """The search for reductions: bounds and sides found so far, and the reductions made."""

    def __init__(self, p: StandardQP) -> None:
        self.p = p
        self.C = sparse.csr_array(p.C, copy=True)  # zeros go from it in place
        self.C.eliminate_zeros()
        self.C.sort_indices()
        self.lb, self.ub = p.lb.copy(), p.ub.copy()
        self.low, self.high = p.row_low.copy(), p.row_high.copy()
        self.dropped = np.zeros(self.low.size, dtype=bool)
        self.found: list[Reduction] = []

    def run(self) -> tuple[StandardQP, Array, tuple[Reduction, ...]]:
        self._parallel()
        for _ in range(PRESOLVE.rounds):
            before = len(self.found), int(self.dropped.sum())
            self._rows()
            if (len(self.found), int(self.dropped.sum())) == before:
                break
        tight = replace(self.p, lb=self.lb, ub=self.ub, row_low=self.low, row_high=self.high)
        return tight, self.dropped, tuple(self.found)

    def _parallel(self) -> None:
        """Merge rows that are exact multiples of each other."""
        C = self.C
        count = np.diff(C.indptr)
        used = np.flatnonzero(count)
        if used.size < 2:
            return
        first = np.ones(len(count))
        first[used] = C.data[C.indptr[used]]
        data = C.data / np.repeat(first, count)
        # Rows that are multiples have equal sums with any weights, added in one order.
        weights = np.random.default_rng(0).random(C.shape[1])
        sums = sparse.csr_array((data, C.indices, C.indptr), shape=C.shape) @ weights
        _, place, often = np.unique(sums, return_inverse=True, return_counts=True)
        group: dict[bytes, int] = {}
        rows, kept = [], []
        for i in used[often[place[used]] > 1]:
            part = slice(C.indptr[i], C.indptr[i + 1])
            key = C.indices[part].tobytes() + data[part].tobytes()
            k = group.setdefault(key, int(i))
            if k != i:
                rows.append(i)
                kept.append(k)
        for i, k in zip(rows, kept, strict=True):
            s = first[i] / first[k]
            low, high = self.p.row_low[i] / s, self.p.row_high[i] / s
            if s < 0.0:
                low, high = high, low
            if max(low, self.low[k]) > min(high, self.high[k]):
                continue
            gives_low, gives_high = low > self.low[k], high < self.high[k]
            self.low[k], self.high[k] = max(low, self.low[k]), min(high, self.high[k])
            self.dropped[i] = True
            if gives_low or gives_high:
                self.found.append(
                    Parallel(*(np.array([v]) for v in (i, k, s, gives_high, gives_low)))
                )

    def _rows(self) -> None:
        """One pass over all remaining rows, with the fixed variables moved to the sides."""
        fixed, free = self.lb == self.ub, self.C
        low, high, rounding = self.low, self.high, np.zeros(self.low.size)
        if fixed.any():
            x = np.where(fixed, self.lb, 0.0)
            free = sparse.csr_array(self.C @ sparse.diags_array((~fixed).astype(float)))
            free.eliminate_zeros()
            shift = self.C @ x
            low, high = self.low - shift, self.high - shift
            rounding = PRESOLVE.activity * (abs(self.C) @ abs(x))
        count = np.diff(free.indptr)
        self.dropped |= (count == 0) | (np.isinf(low) & np.isinf(high))
        self._singles(np.flatnonzero((count == 1) & ~self.dropped), free, low, high)
        self._activities(np.flatnonzero((count > 1) & ~self.dropped), free, low, high, rounding)

    def _singles(self, rows: Array, free: Any, low: Array, high: Array) -> None:
        if not rows.size:
            return
        j, a = free.indices[free.indptr[rows]], free.data[free.indptr[rows]]
        below, above = low[rows] / a, high[rows] / a
        below, above = np.where(a > 0, below, above), np.where(a > 0, above, below)
        lb, ub = self.lb.copy(), self.ub.copy()
        np.maximum.at(lb, j, below)
        np.minimum.at(ub, j, above)
        good = lb[j] <= ub[j]
        rows, j, a, below, above = (v[good] for v in (rows, j, a, below, above))
        gives_low, gives_high = (below == lb[j]), (above == ub[j])
        gives_low &= below > self.lb[j]
        gives_high &= above < self.ub[j]
        # If several rows give the same bound, one of them gets its multiplier.
        for gives in (gives_low, gives_high):
            chosen = np.flatnonzero(gives)
            _, once = np.unique(j[chosen], return_index=True)
            gives[:] = False
            gives[chosen[once]] = True
        self.lb[j], self.ub[j] = lb[j], ub[j]
        self.dropped[rows] = True
        some = gives_low | gives_high
        if some.any():
            parts = (rows, j, a, gives_high, gives_low, self.ub[j], self.lb[j])
            self.found.append(Single(self.C, *(part[some] for part in parts)))

    def _activities(self, rows: Array, free: Any, low: Array, high: Array, rounding: Array) -> None:
        if not rows.size:
            return
        part = free[rows] if rows.size < len(low) else free
        a, first = part.data, part.indptr[:-1]
        at_lb, at_ub = a * self.lb[part.indices], a * self.ub[part.indices]
        bottom = np.add.reduceat(np.where(a > 0.0, at_lb, at_ub), first)
        top = np.add.reduceat(np.where(a > 0.0, at_ub, at_lb), first)
        sizes = (np.where(np.isfinite(side), abs(side), 0.0) for side in (at_lb, at_ub))
        size = np.maximum(*(np.add.reduceat(side, first) for side in sizes))
        slack = PRESOLVE.activity * size + rounding[rows]
        self.dropped[rows[(bottom >= low[rows]) & (top <= high[rows])]] = True
        forced = (abs(bottom - high[rows]) <= slack) & np.isfinite(bottom)
        self._force(rows[forced], free, 1)
        forced = (abs(top - low[rows]) <= slack) & np.isfinite(top)
        self._force(rows[forced], free, -1)

    def _force(self, rows: Array, free: Any, sign: int) -> None:
        """Fix the variables of forcing rows; `sign` as in `Forcing`."""
        for i in rows:
            part = slice(free.indptr[i], free.indptr[i + 1])
            j, a = free.indices[part], free.data[part]
            open_ = self.lb[j] < self.ub[j]
            j, a = j[open_], a[open_]
            if self.dropped[i]:
                continue
            self.dropped[i] = True
            if j.size:
                at = np.where(sign * a > 0, self.lb[j], self.ub[j])
                self.lb[j] = self.ub[j] = at
                self.found.append(Forcing(self.C, int(i), j, a, sign))


def _columns(M: Matrix, keep: Array) -> Matrix:
    return sparse.csr_array(sparse.csc_array(M)[:, keep]) if is_sparse(M) else M[:, keep]


def nonempty(C: Matrix) -> Array:
    """Which rows have an entry other than zero."""
    if is_sparse(C):
        if C.format == "csr" and C.data.all():
            return np.diff(C.indptr) > 0
        entries = C.tocoo()
        return np.bincount(entries.row[entries.data != 0.0], minlength=C.shape[0]) > 0
    return (C != 0).any(axis=1)
