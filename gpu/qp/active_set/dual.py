r"""A dual active set for small dense, strictly convex problems, compiled.

The method of Goldfarb and Idnani [1]_ begins at the free minimum and adds the most violated row or
bound until none is violated; each point on the way is the minimum under the rows held so far. With
:math:`DPD = LL^T`, D a diagonal of powers of two that makes units of variables alike,
:math:`J = L^{-1}` by rows and the held rows N (normals a of :math:`a^Tz \ge b`, in
:math:`z = D^{-1}x`),

.. math:: JN^T = \begin{pmatrix} R \\ 0 \end{pmatrix}, \quad d = Ja, \quad
          z' = J_2^Td_2, \quad r = R^{-1}d_1:

along z' a new row is approached, and the multipliers of the others change by -r. R is kept by
columns. A row enters by one reflection of :math:`J_2`, for which z' is known already, and leaves by
rotations. Rows with two sides and bounds are one constraint each; dependent rows are recognised by
:math:`d_2 = 0` and never enter R. From a given set one begins at its minimum without what pulls,
which is a point of the same kind, so that any guess is safe. Violations are measured against the
rounding of their terms, with x not less than the free minimum: nothing depends on units.

At the end x and the multipliers are refined by residuals of the problem as given, and certified.

References
----------
.. [1] D. Goldfarb, A. Idnani, "A numerically stable dual method for solving strictly convex
   quadratic programs", Math. Program. 27 (1983) 1-33.
"""

from __future__ import annotations

import logging
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from gpu.qp.data.qp_problem import UNDECIDED, QPProblem, Rows
from gpu.qp.data.qp_result import KKT, QPResult, Status
from gpu.qp.data.standard_qp import ROUNDING
from skfem_adini.ground.jit import later, plain_function


class _Limits(NamedTuple):  # where the method is tried
    unknowns: int = 250  # more: the full exchange or the interior point takes less time
    boxes: int = 120  # the same where there are only bounds: that exchange has few steps
    steps: int = 4  # most steps over rows and unknowns
    interpreted: int = 3000  # entries of a problem that plain Python may solve: 50 ms


LIMITS = _Limits()

logger = logging.getLogger(__name__)


def plain_rows(P: Any, q: Any, G: Any, h: Any, A: Any, b: Any, lb: Any, ub: Any, h_low: Any) -> Any:
    """The arguments of `solve_qp` as `Rows` where they are plain arrays of a small problem, else
    None: whatever needs a second look is left to `check_problem`."""
    if not _matrix(P) or P.shape[0] != P.shape[1] or not 0 < len(P) <= LIMITS.unknowns:
        return None
    n = len(P)
    if (A is None) != (b is None) or (G is None) != (h is None and h_low is None):
        return None
    if not all(M is None or (_matrix(M) and M.shape[1] == n) for M in (A, G)):
        return None
    m, l = 0 if A is None else len(A), 0 if G is None else len(G)
    if not l and n > LIMITS.boxes:
        return None
    pair = plain_sides(n, m, l, h, b, lb, ub, h_low)
    if pair is None or type(q) is not np.ndarray or q.dtype != float or q.shape != (n,):
        return None
    if not q.flags.carray:
        return None
    # Copies: results keep them for derivatives.
    parts = [M for M in (A, G) if M is not None]
    C = np.concatenate(parts) if parts else np.zeros((0, n))
    return Rows(P.copy(), C, q.copy(), pair[0], pair[1], m, l)


def plain_sides(n: int, m: int, l: int, h: Any, b: Any, lb: Any, ub: Any, h_low: Any) -> Any:
    """Lower and upper sides of m equality rows, l other rows and n bounds; None as `plain_rows`."""
    low, high, end = np.empty(m + l + n), np.empty(m + l + n), m + l
    low.fill(-np.inf)
    high.fill(np.inf)
    given = (
        (b, 0, m, low), (b, 0, m, high), (h, m, end, high), (h_low, m, end, low),
        (lb, end, end + n, low), (ub, end, end + n, high),
    )  # fmt: skip
    for value, first, last, side in given:
        if value is None:
            continue
        if type(value) is np.ndarray:
            if value.dtype != float or value.shape != (last - first,):
                return None
        elif type(value) is not float or value is b:
            return None
        side[first:last] = value
    return low, high


def plain_array(value: Any) -> Any:
    """A list or an array of numbers as doubles; anything else as it is."""
    kind = type(value)
    if kind is int:
        return float(value)
    if kind in (list, tuple) or (kind is np.ndarray and value.dtype != float):
        try:
            array = np.asarray(value)
        except ValueError:
            return value
        return array.astype(float) if array.dtype.kind in "iuf" else value
    return value


def _matrix(M: Any) -> bool:
    """Whether M is a dense matrix of plain doubles, row by row. One that is read-only or stored in
    another order would be compiled for anew."""
    return type(M) is np.ndarray and M.ndim == 2 and M.dtype == float and M.flags.carray


def rows_of(problem: QPProblem) -> Rows | None:
    """The same of a checked problem; None where the method does not fit."""
    P, q = problem.factor.P, problem.q
    if type(P) is not np.ndarray or type(q) is not np.ndarray or not problem.factor.definite:
        return None
    if q.size > (LIMITS.boxes if problem.boxes_only else LIMITS.unknowns):
        return None
    rows = problem.rows
    return rows._replace(P=stored(P), C=stored(rows.C), q=stored(q.copy()))


def stored(array: np.ndarray) -> np.ndarray:
    """The array as it is compiled for: in order, aligned and writeable."""
    return np.require(array, requirements=("C", "A", "W"))


class Found(NamedTuple):
    """What the compiled method returns."""

    code: int
    idle: bool  # whether something held carries no multiplier
    x: np.ndarray
    y: np.ndarray
    z_box: np.ndarray
    active: np.ndarray  # signed states of rows, then of bounds
    kkt: np.ndarray
    steps: np.ndarray


@cache
def _kernels() -> Any:
    """The compiled functions; numba is loaded when they are needed."""
    from gpu.qp.active_set import dual_kernels

    return dual_kernels


@cache
def _solve_one() -> Any:
    """`dual_kernels.solve_one`; the first small problems need no compiler."""
    plain = plain_function(_kernels(), "solve_one")
    return later(plain, lambda: _kernels().solve_one, LIMITS.interpreted)


def dual_active_set(rows: Rows, state: np.ndarray | None = None) -> Found:
    """Solve a problem, from signed states of rows and bounds if they are given."""
    if state is None or not state.any():
        P, C, q, low, high, equal, general = rows
        boxes = not general and equal <= q.size
        return Found(*_solve_one()(P, C, q, low, high, boxes, LIMITS.steps * low.size))
    kept = Kept(rows.P, rows.C)
    kept.begin(rows, state)
    return kept.run(rows)


class Kept:
    """What is made of a matrix and rows, with the factored active set of the last problem."""

    def __init__(self, P: np.ndarray, C: np.ndarray) -> None:
        m, n = C.shape
        self.D, self.J, self.R = np.empty(n), np.empty((n, n)), np.empty((n, n))
        self.S, self.size = np.empty((m, n)), np.empty(m)
        self.act, self.side, self.k = np.empty(n, np.int64), np.empty(n), 0
        self.good = _kernels().factor(P, self.D, self.J)
        self.good &= _kernels().scale_rows(C, self.D, self.S, self.size)
        self.first = self.J.copy()

    def begin(self, rows: Rows, state: np.ndarray) -> None:
        """Hold equalities and what has a state."""
        if self.good:
            parts = self.J, self.R, self.S, rows.low, rows.high
            self.k = _kernels().begin(*parts, state, self.act, self.side)

    def solve(self, rows: Rows) -> Found:
        """Solve a problem from the set held last."""
        if self.k:
            found = self.run(rows)
            if not found.code and found.kkt.max() <= ROUNDING.sharp:
                return found
        self.J[:] = self.first  # used up by many rotations, or the set never fitted
        self.begin(rows, np.zeros(rows.low.size, np.int8))
        return self.run(rows)

    def run(self, rows: Rows) -> Found:
        """The same, whatever comes of it."""
        m, n = rows.C.shape
        x, y, box, active, kkt = room(m, n)
        steps = np.empty((LIMITS.steps * (m + n), 2), np.int64)
        code, count, idle = UNDECIDED, 0, False
        if self.good and _kernels().plain(rows.q, rows.low, rows.high):
            code, self.k, count, idle = _kernels().solve(
                *rows[:5], self.D, self.J, self.S, self.size, self.R, self.act, self.side, self.k,
                rows.boxes_only, x, y, box, active, steps, kkt,
            )  # fmt: skip
        return Found(code, idle, x, y, box, active, kkt, steps[:count])


def room(m: int, n: int, *front: int) -> tuple[np.ndarray, ...]:
    """Arrays for x, multipliers of m rows and n bounds, states, residuals."""
    x, y, box = (np.empty((*front, size)) for size in (n, m, n))
    return x, y, box, np.empty((*front, m + n), np.int8), np.full((*front, 5), np.inf)


def result_of(rows: Rows, found: Found, kkt: KKT | None = None) -> QPResult | None:
    """The answer if its residuals are those of rounding, else None."""
    code, idle, x, y, z_box, active, plain, steps = found
    kkt = kkt or KKT(*plain.tolist())
    if code or not kkt.worst <= ROUNDING.sharp:
        return None
    m, end = rows.equal, rows.equal + rows.general
    return QPResult(
        x, y[:m], y[m:], z_box, Status.DEGENERATE if idle else Status.OPTIMAL, active[end:], kkt,
        len(steps), steps, active[m:end], "active set", rows,
    )  # fmt: skip
