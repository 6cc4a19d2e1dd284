"""Any convex quadratic program: presolve, scale, interior point, polish, certificates."""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from gpu.errors import Infeasible, NotConverged, Unbounded
from gpu.qp.data.budget import Budget
from gpu.qp.data.equilibrate import Scaling, equilibrate, largest_side, with_rounding
from gpu.qp.data.standard_qp import (
    ROUNDING,
    Array,
    Matrix,
    Residuals,
    StandardQP,
    is_sparse,
    largest,
    one_sided,
    residuals,
)
from gpu.qp.interior_point.interior_point import LIMITS as INTERIOR
from gpu.qp.interior_point.interior_point import interior_point
from gpu.qp.interior_point.kkt_system import SparseSystem, System, kkt_system, safe_system
from gpu.qp.interior_point.polish import PrimalDual, Sides, extended, polish, settle
from gpu.qp.interior_point.presolve import Presolved, contradiction, presolve


class _Proof(NamedTuple):  # tolerances of `farkas` and `ray`
    zero: float = 1e-12  # part of the terms of a sum: rounding of a few thousand reaches it
    margin: float = 1e-9  # of the inequality, over its terms: above what is taken for zero
    clear: float = 1e-3  # the same of multipliers on their way: what they prove is not doubtful
    term: float = 64 * float(np.finfo(float).eps)  # over the largest q: rounding
    farther: float = 1e4  # over the largest side: reach of points along what counts as zero
    ray: float = 1e-10  # violation of a row by a ray, over the terms
    entry: float = 1e-16  # the same over the largest entry, for terms that vanish
    negligible: tuple[float, ...] = (1e-12, 1e-9, 1e-7, 1e-5)  # entries taken for zero, tried
    vanishing: float = 1e-8  # components of C'y taken for zero if the largest y is one
    held: float = 1e-4  # relative size below which rows of a ray are taken for equalities
    projection: int = 4_000_000  # most entries of the dense block of a projection: 32 MB
    sparsely: int = 250_000  # of a sparse block: beyond, it stays sparse
    dependent: float = 1e-13  # singular values of that block, over the largest: rounding


PROOF = _Proof()


class _Limits(NamedTuple):  # residuals and sizes that decide what is tried
    # Whether x and multipliers step apart, and the size of the first ones (zero: from the data).
    attempts: tuple[tuple[bool, float], ...] = (
        (True, 0.0), (True, 1.0), (False, 1e3), (True, 1e6), (False, 1.0)
    )  # fmt: skip
    early: int = 4_000  # most unknowns and rows for which pivots by size are tried at once
    dropped: float = 1e-3  # forces over all: more of them off the sides are no rounding
    near_origin: float = 1e-6  # residual of x = 0, which may replace a point that tends to it
    target: float = 1e-14  # residual that the polish aims at: the accuracy of the arithmetic
    clean: float = 1e-12  # below, no other multipliers are tried: no digit would be gained
    plausible: float = 1e-7  # below, no proof is sought: other multipliers may help
    feasible: float = 1e-9  # residual of the point that shows that constraints can be met
    lost: float = 1e-13  # objective over the terms of x'Px: less is rounding of P
    drowned: float = 1e-12  # forces over those of the multipliers: three digits are left
    runaway: float = 1e20  # over the data: no condition number in double precision takes x so far
    extended: int = 100_000  # most unknowns and rows for which extended precision is worth it
    linear: float = 1e-4  # q beside P of one: below, it has lost four of sixteen digits
    unknowns: int = 500  # most for which all eigenvectors of P are computed
    eigenvalue: float = 4 * float(np.finfo(float).eps)  # over the largest, an unknown


LIMITS = _Limits()


logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Point:
    """x and the multipliers of rows and bounds, with residuals recomputed from the program."""

    x: Array
    y: Array
    z_box: Array
    residuals: Residuals
    iterations: int


def certified(p: StandardQP, x: Array, y: Array) -> Point:
    """The point next to (x, y) whose bounds and signs hold, and its residuals. Zero multipliers (if
    q = 0) and x = 0 (if feasible) are tried too: residuals relative to a sequence that converges to
    zero are never small, and of a ray of solutions with no objective x = 0 is the one to take."""
    point = _certified(p, x, y)
    if point.residuals.sharp <= LIMITS.clean and not (p.holds_at_origin and _cancels(p, point.x)):
        return point
    if not bool(p.q.any()):
        free = _certified(p, x, p.xp.zeros_like(y))
        return min(point, free, key=lambda found: found.residuals.worst)
    if p.holds_at_origin:
        origin = _certified(p, p.xp.zeros_like(x), p.sided(y))
        allowed = max(ROUNDING.sharp, point.residuals.worst)
        if origin.residuals.worst <= min(LIMITS.near_origin, allowed):
            return origin
    return point


def _cancels(p: StandardQP, x: Array) -> bool:
    """Whether the objective at x is rounding: along a ray of solutions x may be anywhere."""
    length = p.xp.abs(x)
    terms = float(p.xp.abs(p.q) @ length + length @ (p.moduli[0] @ length))
    return terms > 0.0 and abs(float(p.q @ x) + float(x @ (p.P @ x))) <= LIMITS.lost * terms


def _certified(p: StandardQP, x: Array, y: Array) -> Point:
    xp = p.xp
    x = xp.clip(x, p.lb, p.ub)
    y = one_sided(y, p.row_low, p.row_high)
    products = p.P @ x, p.C.T @ y
    force = one_sided(-(products[0] + p.q + products[1]), p.lb, p.ub)
    at_side = ((force > 0) & (x == p.ub)) | ((force < 0) & (x == p.lb))
    held = xp.where(at_side, force, 0.0)
    dropped, size = (
        largest(*(float(xp.abs(a).max()) for a in arrays if a.size))
        for arrays in ((force - held,), (*products, p.q))
    )
    if dropped > LIMITS.dropped * size and dropped > LIMITS.dropped * p.rounded_forces(x, y):
        return Point(x, y, force, residuals(p, x, y, force, products), 0)
    clean = Point(x, y, held, residuals(p, x, y, held, products), 0)
    if clean.residuals.sharp <= LIMITS.clean or not dropped:
        return clean
    full = Point(x, y, force, residuals(p, x, y, force, products), 0)
    return clean if clean.residuals.worst <= 2.0 * full.residuals.worst else full


@np.errstate(all="ignore")  # what overflows shows in the residuals
def minimise(
    p: StandardQP,
    tol: float,
    budget: Budget | None = None,
    proofs: bool = True,
    reduced: bool = True,
    auxiliary: bool = False,
) -> Point:
    """The solution, with residuals of at most `tol` and polished to the accuracy of the arithmetic,
    else raise `Infeasible`, `Unbounded` or `NotConverged`. Without `proofs` the best point is
    returned, whatever its residuals; unless `reduced`, presolve makes no reductions. The points of
    an `auxiliary` problem are not those of the budget."""
    budget = budget or Budget()
    again = functools.partial(minimise, p, tol, budget, proofs, False, auxiliary)
    if not bool(p.q.any()):
        nothing = certified(p, p.xp.zeros_like(p.q), p.xp.zeros_like(p.row_low))
        if nothing.residuals.worst <= (0.0 if p.near is None else tol):
            return nothing
    proof = contradiction(p, tol) if proofs else None
    if proof is not None:
        raise infeasible(proof)
    small = presolve(p, search=reduced)
    if not small.free.size:
        point = certified(p, *small.point(p.xp.zeros(0), p.xp.zeros(small.rows.size)))
        if point.residuals.worst <= tol:
            return _afloat(p, small, point, again)
        small = presolve(p, search=False)
        if not small.free.size:
            raise infeasible(_violated(p, point.x))
    scaled, scaling = equilibrate(small.program)
    rewritten = curvature_rows(scaled)

    def original(x: Array, y: Array) -> tuple[Array, Array]:
        point = (x, y) if rewritten is None else rewritten.point(x, y)
        return small.point(*scaling.point(*point))

    search = _Search(
        p, scaled if rewritten is None else rewritten.program, original, tol, proofs,
        budget, auxiliary or not proofs,
    )  # fmt: skip
    # Where q is rounding beside P, small residuals do not show that the objective is bounded.
    best, steps = search.run(unproved=rewritten is not None and not bool(p.bounded.all()))
    if proofs and _lost_in_rounding(p, best.x):
        _prove_unbounded(p, budget, best.x if float(p.q @ best.x) < 0.0 else -best.x)
        far = float(p.xp.abs(best.x[small.free] / scaling.variables).max())
        if far > LIMITS.runaway * max(1.0, _size(search.scaled)):
            raise NotConverged(
                f"the iterates run away to {far:.0e} times the size of the data, and no ray was "
                "found along which the objective falls for ever: bound the variables"
            )
    found = Point(best.x, best.y, best.z_box, best.residuals, steps)
    return _afloat(p, small, found, again)


def _afloat(p: StandardQP, small: Presolved, found: Point, again: Callable[[], Point]) -> Point:
    """The point found, or that of the program without reductions where multipliers have grown from
    one to the next until their rounding reaches the forces that they balance."""
    if not small.reductions:
        return found
    forces = p.xp.abs(p.q) + abs(p.P) @ p.xp.abs(found.x)
    pushed = abs(p.C).T @ p.xp.abs(found.y)
    if float(forces.max()) >= LIMITS.drowned * float(pushed.max()):
        return found
    try:
        return again()
    except NotConverged:
        return found


@dataclass(frozen=True)
class _Search:
    """Attempts on a scaled program, judged in the original one."""

    p: StandardQP
    scaled: StandardQP
    original: Callable[[Array, Array], tuple[Array, Array]]  # from the scaled one
    tol: float
    proofs: bool
    budget: Budget
    auxiliary: bool

    def run(self, unproved: bool) -> tuple[Point, int]:
        """The best point of all attempts, and their steps; raises what `minimise` raises.
        `unproved`: small residuals alone do not show that the objective is bounded.
        """
        p, tol, proofs = self.p, self.tol, self.proofs
        system = kkt_system(self.scaled)
        small_enough = p.q.size + p.row_low.size <= LIMITS.extended
        sharpen = proofs and p.xp is np and p.is_sparse and small_enough
        best, steps, changed = None, 0, False
        for attempt, safe in self._attempts():
            if safe and not changed:
                system, changed = safe_system(self.scaled) or system, True
            found, count = self._attempt(attempt, system, sharpen)
            if not found:
                continue
            steps += count
            # Where the active set is not unique, the polish may end worse than it began.
            best = min(found if best is None else [best, *found], key=self._rank)
            if sharpen and tol < best.residuals.worst <= INTERIOR.near:
                best = self._sharpened(best)
            if attempt == 0 and proofs and unproved and best.residuals.primal <= tol:
                _prove_unbounded(p, self.budget)
            if best.residuals.worst <= tol:
                break
            if attempt == 0 and proofs:
                _prove(p, best, self.budget)
                if p.near is None and with_rounding(p, certain=True) is not None:
                    break  # it is solved as that
        if best is None:
            raise NotConverged(
                "no system of the interior point can be factored: numbers of the problem overflow, "
                "or differ by too many orders; measure variables, rows or the objective in other "
                "units"
            )
        if proofs and not best.residuals.worst <= tol:
            if best.residuals.worst <= LIMITS.plausible:  # other multipliers did not help
                _prove(p, best, self.budget, plausible=0.0)
            raise NotConverged(
                f"{steps} interior-point steps end at {best.residuals}, above tol = {tol}, and "
                "neither a certificate of infeasibility nor a ray was found: rescale the problem, "
                "drop rows that are almost dependent, or accept a larger tol"
            )
        return best, steps

    def _attempts(self) -> list[tuple[int, bool]]:
        """Numbers of the attempts, and whether they take pivots by size: at once where these cost
        little, after all others where their factors fill."""
        count = len(LIMITS.attempts) if self.proofs else 2
        again = [(attempt, True) for attempt in range(1, count)]
        if self.p.q.size + self.p.row_low.size <= LIMITS.early or not self.p.is_sparse:
            return [(0, False), *again]
        return [*((attempt, False) for attempt in range(count)), *again]

    def _attempt(self, attempt: int, system: System, hurried: bool) -> tuple[list[Point], int]:
        """The points where the interior point and the polish end, and the steps. No points if even
        the first cannot be computed: another attempt has another system.
        """
        separate, spread = LIMITS.attempts[attempt]
        aim = (0.1 if attempt == 0 else 1e-3) * self.tol
        spend = self.budget.count if self.auxiliary else self.budget.step

        def measure(x: Array, y: Array) -> float:
            x, y = self.original(x, y)
            point = certified(self.p, x, y)
            if self.proofs and point.residuals.primal > LIMITS.plausible:
                _refute(self.p, y)
            spend(point, self.tol)
            return point.residuals.worst

        def sharp(x: Array, y: Array) -> float:
            return self.whole(x, y).residuals.sharp

        end: list[Point] = []

        def finish(x: Array, y: Array, sides: Any) -> bool:
            least = np.inf
            for point in settle(self.scaled, system, Sides(*sides), x, y):
                found = self.whole(*point)
                error = found.residuals.sharp
                if error <= LIMITS.clean and error < least:
                    end[:] = [found]
                if not LIMITS.target < error < 0.5 * least:
                    break
                least = error
            return bool(end)

        try:
            x, y, sides, count = interior_point(
                self.scaled, system, measure, aim, separate, spread, hurried, finish,
                self.budget.limited,
            )  # fmt: skip
        except np.linalg.LinAlgError:
            return [], 0
        found = end or [self.whole(x, y)]
        if not end:
            x, y, _ = polish(self.scaled, system, Sides(*sides), x, y, sharp, LIMITS.target)
            found.append(self.whole(x, y))
        logger.debug(
            "attempt %d: %d steps, %s, polished %s",
            attempt, count, found[0].residuals, found[-1].residuals,
        )  # fmt: skip
        return found, count

    def whole(self, x: Array, y: Array) -> Point:
        """The point of the original program."""
        return certified(self.p, *self.original(x, y))

    def _sharpened(self, best: Point) -> Point:
        """The solution of the same active set in extended precision, if its residuals are less."""
        for solution in extended(self.p, PrimalDual(best.x, best.y, best.z_box)):
            sharper = Point(*solution, residuals(self.p, *solution), 0)
            best = min([best, sharper], key=self._rank)
            if best.residuals.worst <= self.tol:
                break
        return best

    def _rank(self, point: Point) -> tuple[bool, float]:
        return point.residuals.worst > self.tol, point.residuals.sharp


def polished(p: StandardQP, sides: Sides, x: Array, y: Array) -> Point | None:
    """The point that active-set steps reach from a start near the solution."""
    small = presolve(p)
    if not small.free.size:
        return None
    scaled, scaling = equilibrate(small.program)

    def whole(x: Array, y: Array) -> Point:
        return certified(p, *small.point(*scaling.point(x, y)))

    def sharp(x: Array, y: Array) -> float:
        return whole(x, y).residuals.sharp

    begin = scaling.scaled_point(x[small.free], y[small.rows])
    at = (x == small.tight.ub).astype(np.int8) - (x == small.tight.lb).astype(np.int8)
    bounds = p.xp.where(sides.bounds == 0, at, sides.bounds)
    part = Sides(bounds[small.free], sides.rows[small.rows])
    try:
        x, y, _ = polish(scaled, kkt_system(scaled), part, *begin, sharp, LIMITS.target)
    except np.linalg.LinAlgError:
        return None
    return whole(x, y)


def _prove(p: StandardQP, best: Point, budget: Budget, plausible: float = LIMITS.plausible) -> None:
    """Raise with a certificate if there is one."""
    # Both are sought: beside iterates that diverge even contradictory rows have small residuals.
    if best.residuals.worst <= plausible:
        return
    small, scaling = equilibrate(p)
    likely = (_no_point, _no_bound)
    for seek in likely if best.residuals.primal > LIMITS.plausible else likely[::-1]:
        seek(small, scaling, budget)


def _refute(p: StandardQP, y: Array) -> None:
    """Raise where multipliers of an iteration, which grow if there is no point, prove so."""
    xp, size = p.xp, float(p.xp.abs(y).max()) if y.size else 0.0
    if not 0.0 < size < np.inf:
        return
    y = _one_sided(p, -y / size)
    proof, c = _verified(p, y, PROOF.clear), p.C.T @ y
    beyond = xp.where(c > 0, xp.isinf(p.ub), xp.isinf(p.lb)) * xp.abs(c)
    if proof is None and 0.0 < float(beyond.max()) <= PROOF.vanishing * float(xp.abs(c).max()):
        proof = _supported(p, y, PROOF.clear)
    if proof is not None:
        raise infeasible(proof)


def _lost_in_rounding(p: StandardQP, x: Array) -> bool:
    """Whether the objective at x is rounding beside the terms of ``x'Px``. Iterates that run away
    along a ray reach any size, beside which every residual is small.
    """
    length = p.xp.abs(x)
    terms = float(length @ (abs(p.P) @ length))
    value = abs(float(p.q @ x)) + abs(float(x @ (p.P @ x)))
    return terms > 0.0 and not value > LIMITS.lost * terms


def _size(p: StandardQP) -> float:
    """The largest side and the largest force of a program whose matrices are equilibrated."""
    sides = largest_side(p.row_low, p.row_high, p.lb, p.ub)
    return max(sides, float(p.xp.abs(p.q).max()))


def _prove_unbounded(p: StandardQP, budget: Budget, towards: Array | None = None) -> None:
    """Raise with a ray if there is one."""
    _no_bound(*equilibrate(p), budget, towards)


def _solution(budget: Budget, program: StandardQP) -> Array:
    return minimise(program, 1e-10, budget, proofs=False).x


def _no_point(small: StandardQP, scaling: Scaling, budget: Budget) -> None:
    y = farkas(small, functools.partial(_solution, budget))
    if y is not None:
        raise infeasible(scaling.rows * y)


def _no_bound(
    small: StandardQP, scaling: Scaling, budget: Budget, towards: Array | None = None
) -> None:
    towards = None if towards is None else towards / scaling.variables
    direction = ray(small, functools.partial(_solution, budget), towards)
    if direction is None:
        return
    # Without a feasible point a ray says nothing: the one nearest to zero is sought.
    one = small.xp.ones_like(small.q)
    P = sparse.diags_array(one, format="csr") if small.is_sparse else small.xp.diag(one)
    try:
        minimise(replace(small, P=P, q=0.0 * one), LIMITS.feasible, budget, auxiliary=True)
    except Infeasible as error:
        raise infeasible(scaling.rows * error.certificate) from None
    raise Unbounded(
        "the objective falls for ever along a feasible direction, see `ray`",
        scaling.variables * direction,
    )


def infeasible(certificate: Array) -> Infeasible:
    """The error with a verified proof."""
    return Infeasible("no point of the box satisfies the rows", certificate)


def _violated(p: StandardQP, x: Array) -> Array:
    """A proof if every variable is fixed: the row that is violated most."""
    xp = p.xp
    Cx = p.C @ x
    outside = xp.maximum(p.row_low - Cx, Cx - p.row_high)
    i = int(xp.argmax(outside))
    y = xp.zeros_like(Cx)
    y[i] = 1.0 if float(Cx[i]) < float(p.row_low[i]) else -1.0
    return y


class CurvatureRows:
    r"""A program whose linear term is small beside its curvature, with both of size one, in (x, w).

    .. math:: \min_{x, w} \tfrac12 |w|^2 + \tfrac1s q^Tx \quad\text{subject to}\quad
              Mx - \sqrt s\,w = 0

    and the given rows and bounds; :math:`P = M^TM`, :math:`s = \max|q|`. Where P is singular, a
    small q still decides in directions without curvature, but proximal terms and rounding drown it.
    """

    def __init__(self, p: StandardQP, size: float) -> None:
        n, self.m, self.size = p.q.size, p.row_low.size, size
        P = p.P.toarray() if p.is_sparse else p.P
        values, vectors = np.linalg.eigh(P)
        kept = values > n * LIMITS.eigenvalue * values[-1]
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
    if p.xp is not np or not 0 < p.q.size <= LIMITS.unknowns:
        return None
    size = float(np.abs(p.q).max())
    return CurvatureRows(p, size) if 0.0 < size < LIMITS.linear else None


Solve = Callable[[StandardQP], Array]


def farkas(p: StandardQP, solve: Solve) -> Array | None:
    r"""A verified Farkas vector y of the rows, if there is one: with :math:`c = C^Ty`,

    .. math:: \max_{l \le x \le u} c^Tx < \sum_i \min_{r_l \le r \le r_u} y_ir,

    so that no x of the box can have its rows within their sides. It is sought as the nearest point
    of a cone to a given vector, a strictly convex problem; that is zero where there is no proof."""
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
    size = float(xp.abs(y).max()) if m else 0.0
    if not size or not np.isfinite(size):
        return None
    return _supported(p, -y / size)


def _supported(p: StandardQP, y: Array, clear: float = PROOF.margin) -> Array | None:
    """A Farkas vector next to y, whose largest entry is one, some small entries taken for zero."""
    for small in PROOF.negligible:
        support = p.xp.where(p.xp.abs(y) <= small, 0.0, y)
        for candidate in (support, _projected(p, support)):
            proof = _verified(p, candidate, clear)
            if proof is not None:
                return proof
    return None


def _projected(p: StandardQP, y: Array) -> Array:
    """The nearest y with the same zeros whose ``C'y`` vanishes on the free variables."""
    xp = p.xp
    rows = xp.flatnonzero(y)
    columns = xp.flatnonzero(xp.isinf(p.lb) | xp.isinf(p.ub))
    block = _block(p.C, rows, columns)
    if block is None:
        return y
    c = p.C.T @ y
    loose = xp.isinf(p.lb[columns]) & xp.isinf(p.ub[columns])
    # A column with one side only must vanish where it points to the other, or nearly does so.
    small = PROOF.vanishing
    wrong = xp.where(xp.isinf(p.ub[columns]), c[columns] > -small, c[columns] < small)
    keep = loose | wrong
    y = y.copy()
    y[rows] = _orthogonal(block[:, keep].T, y[rows], xp)
    return y


def _block(C: Matrix, rows: Array, columns: Array) -> Matrix | None:
    """A part of C, dense where it is small; None where it is empty, or dense and too large."""
    size = rows.size * columns.size
    if not size or (size > PROOF.projection and not is_sparse(C)):
        return None
    block = C[rows][:, columns]
    return block.toarray() if is_sparse(C) and size <= PROOF.sparsely else block


def _orthogonal(M: Matrix, y: Array, xp: Any) -> Array:
    """The y next to the given one with ``M y = 0``, or y itself where that cannot be computed."""
    if not M.shape[0]:
        return y
    if not is_sparse(M):
        return y - xp.linalg.lstsq(M, M @ y, rcond=PROOF.dependent)[0]
    # Beside y, so that small entries change little; each pass leaves `dependent` of the error.
    weighted = M @ sparse.diags_array(np.abs(y))
    unit = 1.0 / np.maximum(abs(weighted).max(axis=1).toarray(), np.finfo(float).tiny)
    weighted = sparse.csr_array(sparse.diags_array(unit) @ weighted)
    k, n = weighted.shape
    one, nothing = np.ones(n), np.zeros(n)
    square = sparse.csr_array((n, n))
    system = SparseSystem(StandardQP(square, nothing, weighted, unit, unit, nothing, nothing))
    try:
        system.factor(one, np.full(k, PROOF.dependent))
    except np.linalg.LinAlgError:
        return y
    for _ in range(2):
        y = y + np.abs(y) * system.solve(nothing, -unit * (M @ y))[0]
    return y


def _one_sided(p: StandardQP, y: Array) -> Array:
    return one_sided(y, -p.row_high, -p.row_low)


def _verified(p: StandardQP, y: Array, clear: float = PROOF.margin) -> Array | None:
    """The y without what points to no side, if it is a Farkas vector by `clear` of the terms."""
    xp, y = p.xp, _one_sided(p, y)
    c = p.C.T @ y
    corner = xp.where(c > 0, p.ub, xp.where(c < 0, p.lb, 0.0))
    rounded = xp.isinf(corner) & (xp.abs(c) <= PROOF.zero * (p.moduli[1].T @ xp.abs(y)))
    rest = float(xp.abs(c[rounded]).sum())
    c, corner = xp.where(rounded, 0.0, c), xp.where(rounded, 0.0, corner)
    row = xp.where(y > 0, p.row_low, xp.where(y < 0, p.row_high, 0.0))
    most, least = float(c @ corner), float(y @ row)
    terms = float(xp.abs(c) @ xp.abs(corner)) + float(xp.abs(y) @ xp.abs(row))
    margin = least - most
    if not margin > clear * terms:
        return None
    size = largest_side(p.row_low, p.row_high, p.lb, p.ub)
    if clear > PROOF.margin:  # what is not doubtful is no rounding of the largest sides either
        parts = float(xp.abs(c).sum() + xp.abs(y).sum())
        if not margin > PROOF.margin * size * parts:
            return None
    # What was rounded off leaves points far away: they must be farther than any of the data.
    return y if margin > PROOF.farther * max(size, 1.0) * rest else None


def proven(p: StandardQP, y: Array) -> Array | None:
    """A Farkas vector of the rows that a method found, if it is one."""
    small, scaling = equilibrate(p)
    y = y / scaling.rows
    proof = _verified(small, y / (float(abs(y).max(initial=0.0)) or 1.0))
    return None if proof is None else scaling.rows * proof


def ray(p: StandardQP, solve: Solve, towards: Array | None = None) -> Array | None:
    r"""A verified ray along which the objective falls without bound, or None. The direction of
    `towards`, shape (n,), to which iterates ran away, is tried as well.

    A ray d has :math:`Pd = 0`, :math:`q^Td < 0`, and follows rows and bounds for ever. It is sought
    like `farkas`.
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
        length = float(xp.abs(d).max())
        if not length or not np.isfinite(length):
            continue
        for small in PROOF.negligible:
            v = xp.clip(xp.where(xp.abs(d) <= small * length, 0.0, d / length), cone.lb, cone.ub)
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
    straight = bool((outside <= PROOF.ray * terms + PROOF.entry * size * float(length.max())).all())
    inside = bool(((cone.lb <= v) & (v <= cone.ub)).all())
    # What entries of q fall by that are rounding beside its others proves nothing.
    least = PROOF.margin * float(xp.abs(p.q) @ length)
    least += PROOF.term * float(xp.abs(p.q).max()) * float(length.max())
    return bool(straight and inside and float(p.q @ v) < -least)


def _straightened(cone: StandardQP, v: Array) -> Array:
    """The nearest direction with the same zeros along which rows that nearly vanish do vanish."""
    xp = cone.xp
    terms = abs(cone.C) @ xp.abs(v)
    near = (cone.row_low > -xp.inf) | (cone.row_high < xp.inf)
    rows = xp.flatnonzero(near & (xp.abs(cone.C @ v) <= PROOF.held * terms) & (terms > 0.0))
    columns = xp.flatnonzero(v)
    block = _block(cone.C, rows, columns)
    if block is None:
        return v
    v = v.copy()
    v[columns] = _orthogonal(block, v[columns], xp)
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
