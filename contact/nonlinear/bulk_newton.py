r"""Newton's method for the bodies and their contact together.

At an iterate u with contact forces l = (mu, t), rows B, the tangent K of the bodies and the
derivatives E of the rows and C of the contact forces, an iteration solves

.. math:: (K + C)\, \delta + B^T l^+ = f - F(u), \qquad v = v(u) + (B + E)\, \delta ,

with the law between v and the new forces l+: condensed onto the contact points, that is a
`BoundaryProblem`, solved by `contact.laws`. Steps that invert a cell or enlarge the residual are
shortened.

P. Wriggers, Computational Contact Mechanics, 2nd ed., Springer 2006, chapter 10."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import LinAlgError, LinAlgWarning, lu_factor, lu_solve
from scipy.sparse.linalg import splu

from contact.body.supports import norms
from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.condensation.condensed_contact import PointRows
from contact.errors import InputError, NotConverged
from contact.laws.condensed_newton import Condensed
from contact.laws.friction import Coulomb, Tresca
from contact.laws.iteration import Iteration
from contact.laws.law import ContactLaw, State
from contact.laws.newton import LIMITS, newton
from contact.nonlinear.touching import Touch
from skfem_adini.ground.pardiso import GENERAL, Pardiso, SolverError, has_pardiso

Array = NDArray[np.float64]
Csr = sparse.csr_array
Index = NDArray[np.int64]
ROUNDING = 50 * float(np.finfo(float).eps)  # of sums of some hundred terms
REACH = 0.05  # gaps beyond this part of the body are taken up once they close
NOTHING = 1e-150  # in place of zeros, which sparse products drop, so that the pattern stays
FIRST_DAMPING = 1e-2  # over the diagonal of the tangent: some ten cells follow a support
AT_REST = 1e-6  # residual of a body that has come to rest
MOST_MOVES = 100  # steps of time of an overdamped motion
SINGULAR = 1e-13  # pivots of a matrix with a diagonal of one that are rounding errors


class Trial(NamedTuple):
    """An iterate: displacement, contact forces, and what is computed from them."""

    u: Array
    mu: Array
    t: Array
    touch: Touch
    internal: Array  # internal forces on all dofs
    load: Array  # applied forces on all dofs
    support: Array  # prescribed minus present displacement, zero on free dofs


@dataclass(frozen=True)
class StepProblem:
    """One step of the bodies: its loads and supports, and functions of the displacement."""

    load: Callable[[Array], Array]
    P: Csr  # u = P z + u0
    u0: Array
    picked: Csr  # z = picked^T (u - u0)
    lengths: Array  # lengths of the free unknowns, see `dof_lengths`
    extent: float
    stiffness: float  # largest of the undeformed bodies, a force per length, for rounding errors
    internal: Callable[[Array], Array]
    tangent: Callable[[Array], Csr]  # of internal minus applied forces
    touch: Callable[[Array, Array, Array], Touch]
    order: Index  # free unknowns in an order of little fill
    kept: Index  # free unknowns that are eliminated last, with row exchanges
    analysis: list[Any]  # see `BoundaryFactor`
    least_volume: Callable[[Array], float]  # smallest det F

    @cached_property
    def _free(self) -> Index | None:
        """The dofs that are the unknowns themselves; None if supports couple dofs."""
        P = self.P.tocsc()
        alone = P.nnz == P.shape[1] and bool(np.all(np.diff(P.indptr) == 1) and np.all(P.data == 1))
        return np.asarray(P.indices, dtype=np.int64) if alone else None

    def restricted(self, K: Csr) -> Csr:
        """P^T K P."""
        free = self._free
        return Csr(self.P.T @ K @ self.P) if free is None else Csr(K[free][:, free])

    def trial(self, u: Array, mu: Array, t: Array, like: Touch | None = None) -> Trial:
        """Evaluate an iterate; forces of other points than those at u are of the touch `like`."""
        touch = self.touch(u, mu, t)
        if touch.gap.size != mu.size:
            mu, t = carried(touch, like, mu, t)
            touch = self.touch(u, mu, t)
        held = self.P @ (self.picked.T @ (u - self.u0)) + self.u0
        return Trial(u, mu, t, touch, self.internal(u), self.load(u), held - u)

    def residuals(self, now: Trial, scale: Array) -> dict[str, float]:
        """Relative residuals beyond rounding errors: balance, contact and friction, supports.
        `scale` (m,) is physical over scaled displacement of each point, see `CondensedContact`."""
        contact = now.touch.G.T @ now.mu + now.touch.T.T @ now.t.ravel()
        terms = (now.internal, now.load, contact)
        size = max(float(np.abs(self.P.T @ part / self.lengths).max(initial=0.0)) for part in terms)
        # Forces of supports measure a body that supports alone deform.
        size = max(size, float(np.abs(now.internal).max(initial=0.0)))
        left = now.load - now.internal - contact
        off = float(np.abs(self.P.T @ left / self.lengths).max(initial=0.0))
        off -= ROUNDING * self.stiffness * float(np.abs(now.u).max(initial=0.0))
        support = float(np.abs(now.support).max(initial=0.0)) / self.extent
        return {
            "balance": max(off, 0.0) / (size or 1.0),
            "contact": self._violation(now, scale),
            "support": support,
        }

    def _violation(self, now: Trial, scale: Array) -> float:
        """Largest violation of the contact and friction laws over the largest contact force."""
        touch, mu, t = now.touch, now.mu * scale, now.t.T * scale
        if not mu.size:
            return 0.0
        through = -touch.gap / scale
        live = norms(touch.T @ self.P) > 1e-9 * norms(touch.T)
        live = live.reshape(now.t.shape).T
        law = ContactLaw(Coulomb(touch.friction), (1.0, 1.0), live, touch.bonded)
        state = State(None, mu, t, through, touch.slip.T / scale)
        size = max(float(np.abs(part).max(initial=0.0)) for part in (mu, t, np.maximum(through, 0)))
        off = law.violation(state) - ROUNDING * self.extent / float(scale.min())
        # However large the forces are, bodies do not penetrate.
        inside = -float(touch.gap[~touch.bonded].min(initial=0.0)) / self.extent
        return max(max(off, 0.0) / (size or 1.0), inside - ROUNDING)


def solve_step(
    step: StepProblem,
    start: tuple[Array, Array, Array, Touch | None],
    tol: float,
    most: int = 20,
    report: Callable[[Iteration], None] = lambda line: None,
) -> tuple[Trial, Array]:
    """The solution of a step, and the scale of its points; `start` is (u, mu, t) and their touch.
    Raises NotConverged, whose history holds the iterations."""
    with np.errstate(all="ignore"):
        now = step.trial(*start)
        lines, sizes = list[Iteration](), list[float]()
        for k in range(1, most + 1):
            linear = Linearised(step, now)
            left = step.residuals(now, linear.scale)
            sizes.append(max(left.values()))
            du, mu, t, counts = linear.solved(tol)
            now, size = _shortened(step, now, (du, mu, t), linear.scale, max(sizes[-3:]), k == 1)
            lines.append(Iteration(k, "newton", *counts, size))
            report(lines[-1])
            if size <= tol:
                return now, of_points(linear.scale, now)
    raise NotConverged(
        f"large strain: residual {size:.1e} after {most} iterations, most of it of "
        f"{max(left, key=lambda name: left[name])}",
        tuple(lines),
    )


def settle(
    step: StepProblem,
    start: tuple[Array, Array, Array, Touch | None],
    tol: float,
    moves: int,
    report: Callable[[Iteration], None] = lambda line: None,
) -> tuple[Trial, Array]:
    """As `solve_step`, by an overdamped motion from the start to its rest, where no equilibrium is
    near: a body snaps, or a grip of friction parts. Steps of time are implicit and as long as they
    can be; C. T. Kelley and D. E. Keyes, SIAM J. Numer. Anal. 35 (1998), 508-523."""
    drag, damping = np.abs(step.tangent(start[0]).diagonal()), FIRST_DAMPING
    failure: NotConverged | None = None

    def damped(line: Iteration) -> None:
        report(replace(line, phase="damped"))

    for _ in range(moves):
        slow = slowed(step, start[0], damping * drag)
        try:
            now, scale = solve_step(slow, start, max(tol, AT_REST), 10, damped)
            start, damping = (now.u, now.mu, now.t, now.touch), 0.5 * damping
            left = max(step.residuals(step.trial(*start), scale).values())
            if left <= AT_REST and damping <= FIRST_DAMPING:
                return solve_step(step, start, tol, report=report)
        except NotConverged as error:
            damping, failure = 5.0 * damping, error
    raise NotConverged(f"large strain: an overdamped motion does not come to rest; {failure}")


def of_points(scale: Array, now: Trial) -> Array:
    """The scale of the points of an iterate, which are others than those before at times."""
    return scale if scale.size == now.mu.size else np.full(now.mu.size, scale.mean())


def slowed(step: StepProblem, u: Array, drag: Array) -> StepProblem:
    """A step with drag forces (ndofs,) on the motion from u."""
    return replace(
        step,
        internal=lambda x: step.internal(x) + drag * (x - u),
        tangent=lambda x: Csr(step.tangent(x) + sparse.diags_array(drag)),
    )


def _shortened(
    step: StepProblem,
    now: Trial,
    change: tuple[Array, Array, Array],
    scale: Array,
    bound: float,
    first: bool,
) -> tuple[Trial, float]:
    """The next iterate with the longest of the steps 1, 1/2, ... that inverts no cell and whose
    residual does not exceed `bound`; or with the least residual. The first step moves supports."""
    (du, mu, t), best, parted = change, None, None
    volume = step.least_volume(now.u)
    for halvings in range(8):
        a = 0.5**halvings
        u = now.u + a * du
        if not step.least_volume(u) > 0.1 * min(volume, 1.0):
            continue
        try:
            trial = step.trial(u, now.mu + a * (mu - now.mu), now.t + a * (t - now.t), now.touch)
        except InputError as error:  # bodies that an iterate throws past each other
            parted = error
            continue
        size = max(step.residuals(trial, of_points(scale, trial)).values())
        if np.isfinite(size) and (best is None or size < best[1]):
            best = trial, size
        if size <= bound or (first and np.isfinite(size)) or (halvings > 3 and best):
            break
    if best is None and parted is not None:
        raise NotConverged(f"large strain: in every step {parted}") from parted
    if best is None:
        raise NotConverged(
            "large strain: every step inverts a cell (det F <= 0); take smaller steps, or a mesh "
            "without such distortion"
        )
    return best


class SuperLUParts:
    """SuperLU without row exchanges, with some unknowns last: the trailing block of L U is S."""

    def __init__(self, A: Csr, order: Index, last: Index) -> None:
        n, nb = A.shape[0], last.size
        inner = np.ones(n, dtype=bool)
        inner[last] = False
        self._order, self._start = np.concatenate((order[inner[order]], last)), n - nb
        permuted = sparse.csc_array(A)[self._order][:, self._order]
        if sparse.csgraph.connected_components(permuted, directed=False)[0] > 1:
            permuted = _linked(permuted, n - nb)
        try:
            self._lu = splu(permuted, "NATURAL", diag_pivot_thresh=0.0)
        except RuntimeError:  # a pivot is zero
            raise _singular() from None
        tail = np.arange(n - nb, n)
        moved = [self._lu.perm_c[tail], self._lu.perm_r[tail]]
        if not all(np.array_equal(one, tail) for one in moved):
            raise NotConverged("large strain: SuperLU moved the contact points; report the mesh")
        U, L = self._lu.U, self._lu.L
        if not np.abs(U.diagonal()[: n - nb]).min(initial=1.0) >= SINGULAR:
            raise _singular()
        self.schur = L[:, n - nb :][n - nb :].toarray() @ U[:, n - nb :][n - nb :].toarray()

    def forward(self, load: Array) -> tuple[Array, Array]:
        """What is left of a load on the last unknowns, and what `backward` needs."""
        own, start = load[self._order], self._start
        mine = own[start:].copy()
        own[start:] = 0.0
        carried = -self.schur @ self._lu.solve(own)[start:] if np.any(own) else np.zeros(mine.size)
        own[start:] = carried
        return mine - carried, own

    def backward(self, own: Array, last: Array) -> Array:
        """All unknowns, shape (n,), from the last ones."""
        own[self._start :] += self.schur @ last
        found = np.empty_like(own)
        found[self._order] = self._lu.solve(own)
        found[self._order[self._start :]] = last
        return found


class PardisoParts:
    """PARDISO's partial factorisation of a general matrix, whose analysis serves several."""

    def __init__(self, A: Csr, last: Index) -> None:
        self.pattern, self.last = (A.indptr, A.indices), last
        # As `PardisoSchur`; without scaling and matching, which a Schur complement excludes.
        parameters = {1: 3, 9: 13, 23: 1, 24: 1, 35: 2}
        self._pardiso = Pardiso(A, GENERAL, parameters, chosen=last)
        self._pardiso(11)
        self.refactor(A)

    def fits(self, A: Csr, last: Index) -> bool:
        """Whether a matrix has the pattern and the last unknowns of this one."""
        same = zip(self.pattern, (A.indptr, A.indices), strict=True)
        return np.array_equal(last, self.last) and all(np.array_equal(*pair) for pair in same)

    def refactor(self, A: Csr) -> None:
        """Factor other values of the same pattern."""
        self._pardiso.values[:] = A.data
        self.schur = np.zeros((self.last.size, self.last.size))
        try:
            self._pardiso(22, x=self.schur)
        except SolverError as error:
            if error.pivot:
                raise _singular() from error
            raise
        if self._pardiso.perturbed:
            raise _singular()

    def forward(self, load: Array) -> tuple[Array, Array]:
        """What is left of a load on the last unknowns, and what `backward` needs."""
        halfway = np.zeros_like(load)
        self._pardiso(331, np.ascontiguousarray(load), halfway)
        return halfway[self.last], halfway

    def backward(self, halfway: Array, last: Array) -> Array:
        """All unknowns, shape (n,), from the last ones."""
        halfway[self.last] = last
        found = np.zeros_like(halfway)
        self._pardiso(333, halfway, found)
        found[self.last] = last
        return found


class BoundaryFactor:
    """The factors of a matrix with some unknowns last, and their Schur complement S.

    A shift of its diagonal keeps pivots there from zero; dense factors with row exchanges solve for
    S itself. `analysis` is a list that keeps PARDISO's for matrices of the same pattern."""

    def __init__(self, A: Csr, order: Index, last: Index, analysis: list[Any]) -> None:
        last = last if last.size else np.sort(order[-1:])
        if analysis and np.isin(last, analysis[0].last).all():
            last = analysis[0].last
        self.last = last
        shift = np.zeros(A.shape[0])
        shift[last] = 1.0
        shifted = Csr(A + sparse.diags_array(shift))
        shifted.sort_indices()
        if has_pardiso() and last.size < A.shape[0]:
            if analysis and analysis[0].fits(shifted, last):
                analysis[0].refactor(shifted)
            else:
                analysis[:] = [PardisoParts(shifted, last)]
            self._parts: Any = analysis[0]
        else:
            self._parts = SuperLUParts(shifted, order, last)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LinAlgWarning)  # singular: the pivots tell
            S = self._parts.schur - np.eye(last.size)
            self._dense = lu_factor(S, check_finite=False)
        if not np.abs(np.diag(self._dense[0])).min(initial=1.0) >= SINGULAR:
            raise _singular()

    def compliance(self, loads: Array) -> Array:
        """Solutions at the last unknowns for loads there, both of shape (nb, k)."""
        return np.asarray(lu_solve(self._dense, loads, check_finite=False))

    def forward(self, load: Array) -> tuple[Array, Array]:
        """The last unknowns under a load, and what `backward` needs."""
        left, halfway = self._parts.forward(load)
        return self.compliance(left), halfway

    def backward(self, halfway: Array, last: Array) -> Array:
        """All unknowns, shape (n,), from the last ones."""
        return np.asarray(self._parts.backward(halfway, last))


def _linked(A: Any, first: int) -> Any:
    """A matrix of several parts with zeros that link all unknowns to number `first`, so that
    SuperLU's order by elimination trees leaves the last unknowns last."""
    n = A.shape[0]
    others, at = np.delete(np.arange(n), first), np.full(n - 1, first)
    place = np.concatenate((others, at)), np.concatenate((at, others))
    A = A.tocoo()
    rows, columns = np.concatenate((A.row, place[0])), np.concatenate((A.col, place[1]))
    data = np.concatenate((A.data, np.zeros(2 * n - 2)))
    return sparse.csc_array((data, (rows, columns)), shape=A.shape)


class Linearised:
    """The linear equations of an iterate, condensed onto the contact points."""

    def __init__(self, step: StepProblem, now: Trial) -> None:
        self._step, self._now, touch = step, now, now.touch
        K = step.tangent(now.u)
        K.data[K.data == 0.0] = NOTHING
        K = Csr(K + touch.force)
        A = step.restricted(K)
        size = np.sqrt(np.abs(A.diagonal()))
        unit = 1.0 / np.where(size > 0, size, 1.0)
        self._P = Csr(step.P @ sparse.diags_array(unit))  # the tangent has the diagonal one
        A.data *= np.repeat(unit, np.diff(A.indptr)) * unit[A.indices]
        G, T = touch.G @ self._P, touch.T @ self._P
        near = now.mu > 0
        near |= touch.bonded | (touch.gap <= REACH * step.extent + 2 * np.abs(now.support).max())
        rubs = np.repeat(near & ((touch.friction > 0) | touch.bonded), touch.slip.shape[1])
        live_n = near & (norms(Csr(G)) > 1e-9 * norms(touch.G))
        live_t = rubs & (norms(Csr(T)) > 1e-9 * norms(touch.T))
        m = touch.gap.size
        normal = np.where(live_n, np.cumsum(live_n) - 1, -1)
        tangent = np.where(live_t, live_n.sum() + np.cumsum(live_t) - 1, -1)
        self._points = PointRows(normal, tangent.reshape(m, -1))
        B = sparse.vstack([G[live_n], T[live_t]], format="csr")
        E = sparse.vstack([touch.tilted[live_n], touch.turned[live_t]], format="csr") @ self._P
        right = self._P.T @ (now.load - now.internal - K @ now.support)
        used = np.zeros(A.shape[0], dtype=bool)
        used[np.concatenate((B.indices, E.indices, step.kept))] = True
        self._factor = BoundaryFactor(A, step.order, np.flatnonzero(used), step.analysis)
        last = self._factor.last
        B, E = (part[:, last].toarray() for part in (B, B + E))
        self._free, self._halfway = self._factor.forward(right)
        self._response = self._factor.compliance(B.T)
        self._W = E @ self._response
        if not (np.all(np.isfinite(self._W)) and np.all(np.isfinite(self._free))):
            raise NotConverged("large strain: the tangent holds values that are not finite")
        diagonal = np.maximum(np.diag(self._W), 0.0)
        self._of_rows = self._points.lengths(diagonal) if diagonal.size else diagonal
        self._near, self.scale = near, np.ones(m)
        if diagonal.size:
            self.scale = self._points.of_points(self._of_rows)
            self.scale[~live_n] = self.scale[live_n].mean() if live_n.any() else self.scale.mean()

    def solved(self, tol: float) -> tuple[Array, Array, Array, tuple[int, int, int]]:
        """Change of u, new mu and t, and the numbers of active, sticking and slipping points."""
        touch, scale, now = self._now.touch, self.scale, self._now
        alone = np.zeros(self._P.shape[1])
        alone[self._factor.last] = self._free  # all that the rows of live points see
        free = self._P @ alone + now.support
        u_n = (touch.G + touch.tilted) @ free
        u_t = touch.slip + ((touch.T + touch.turned) @ free).reshape(touch.slip.shape)
        v0 = self._points.stacked(u_n, u_t) / self._of_rows
        if not v0.size:  # supports hold all contact points
            return self._moved(self._free), np.zeros(scale.size), np.zeros(u_t.shape), (0, 0, 0)
        problem = BoundaryProblem(
            W=self._W / self._of_rows / self._of_rows[:, None],
            v0=v0,
            C=np.zeros((v0.size, 0)),
            s=np.zeros(0),
            gap=np.where(self._near, touch.gap, np.inf) / scale,
            normal=self._points.normal,
            tangent=self._points.tangent,
            prescribed_slip=u_t / scale[:, None],
            bonded=touch.bonded if touch.bonded.any() else None,
        )
        start = Forces(now.mu * scale, now.t * scale[:, None], np.zeros(0))
        forces = boundary_forces(problem, touch.friction, start, tol)
        l = problem.forces(forces.mu, forces.t) / self._of_rows
        du = self._moved(self._free - self._response @ l)
        held = Condensed(problem, Coulomb(touch.friction))
        zones = held.law.zones(held.state(forces))
        active, stick, slip = (int(z.sum()) for z in (zones.active, zones.stick, zones.slip))
        return du, forces.mu / scale, forces.t / scale[:, None], (active, stick, slip)

    def _moved(self, last: Array) -> Array:
        """Change of u from that of the last unknowns."""
        return self._P @ self._factor.backward(self._halfway, last) + self._now.support


def _singular() -> NotConverged:
    return NotConverged(
        "large strain: the tangent is singular; the body is not held (contact alone does not hold "
        "it), or it buckles: add a support, or take smaller steps"
    )


def carried(touch: Touch, like: Touch | None, mu: Array, t: Array) -> tuple[Array, Array]:
    """Forces on the points of a touch, by the tractions of the nearest points of another one."""
    if like is None or not mu.size or like.gap.size != mu.size:
        return np.zeros(touch.gap.size), np.zeros(touch.slip.shape)
    near = scipy.spatial.KDTree(like.x.T).query(touch.x.T)[1]
    ratio = touch.area / like.area[near]
    return mu[near] * ratio, t[near] * ratio[:, None]


def boundary_forces(
    problem: BoundaryProblem, coefficient: Array, start: Forces, tol: float
) -> Forces:
    """Contact forces of a condensed problem by Newton's method; by its first step where it cycles,
    as if bodies and contact were iterated simultaneously."""
    rubs = bool(np.any(coefficient > 0))
    laws = Condensed(problem, Coulomb(coefficient) if rubs else Tresca(np.zeros(coefficient.size)))
    try:
        return newton(laws, start, tol=LIMITS.inner * tol)
    except (NotConverged, LinAlgError):
        state = laws.state(start)
    try:
        return laws.step(state, laws.law.zones(state), "radial", laws.residual(state))
    except LinAlgError as error:
        raise NotConverged(
            f"large strain: the contact of an iterate is singular; {error}"
        ) from error
