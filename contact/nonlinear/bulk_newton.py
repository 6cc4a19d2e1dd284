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
from dataclasses import dataclass
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
from contact.errors import NotConverged
from contact.laws.condensed_newton import Condensed
from contact.laws.friction import Coulomb, Tresca
from contact.laws.iteration import Iteration
from contact.laws.law import ContactLaw, State
from contact.laws.newton import LIMITS, newton
from contact.nonlinear.touching import Touch

Array = NDArray[np.float64]
Csr = sparse.csr_array
Index = NDArray[np.int64]
ROUNDING = 50 * float(np.finfo(float).eps)  # of sums of some hundred terms
REACH = 0.05  # gaps beyond this part of the body are taken up once they close
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
    least_volume: Callable[[Array], float]  # smallest det F

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
        live = (
            norms(touch.T @ self.P).reshape(t.T.shape).T
            > 1e-9 * norms(touch.T).reshape(t.T.shape).T
        )
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
            before = max(step.residuals(now, linear.scale).values())
            sizes.append(before)
            du, mu, t, counts = linear.solved(tol)
            now, size = _shortened(step, now, (du, mu, t), linear.scale, max(sizes[-3:]), k == 1)
            lines.append(Iteration(k, "newton", *counts, size))
            report(lines[-1])
            if size <= tol:
                return now, linear.scale
    raise NotConverged(f"large strain: residual {size:.1e} after {most} iterations", tuple(lines))


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
    (du, mu, t), best = change, None
    volume = step.least_volume(now.u)
    for halvings in range(8):
        a = 0.5**halvings
        u = now.u + a * du
        if not step.least_volume(u) > 0.1 * min(volume, 1.0):
            continue
        trial = step.trial(u, now.mu + a * (mu - now.mu), now.t + a * (t - now.t), now.touch)
        points = scale if scale.size == trial.mu.size else np.full(trial.mu.size, scale.mean())
        size = max(step.residuals(trial, points).values())
        if np.isfinite(size) and (best is None or size < best[1]):
            best = trial, size
        if size <= bound or (first and np.isfinite(size)) or (halvings > 3 and best):
            break
    if best is None:
        raise NotConverged(
            "large strain: every step inverts a cell (det F <= 0); take smaller steps, or a mesh "
            "without such distortion"
        )
    return best


class BoundaryFactor:
    """The factors of a matrix with some unknowns last, and the Schur complement S of these.

    The trailing block of L U is S; a shift keeps its pivots from zero, dense factors with row
    exchanges solve for S itself. All others are eliminated without row exchanges."""

    def __init__(self, A: Csr, order: Index, last: Index) -> None:
        n, nb = A.shape[0], last.size
        self._last, inner = last, np.ones(n, dtype=bool)
        inner[last] = False
        self._order = np.concatenate((order[inner[order]], last))
        shift = sparse.diags_array(np.where(inner, 0.0, 1.0))
        permuted = sparse.csc_array(A + shift)[self._order][:, self._order]
        if nb and sparse.csgraph.connected_components(permuted, directed=False)[0] > 1:
            permuted = _linked(permuted, n - nb)
        try:
            self._lu = splu(permuted, "NATURAL", diag_pivot_thresh=0.0)
        except RuntimeError:  # a pivot is zero
            raise _singular() from None
        tail = np.arange(n - nb, n)
        moved = [self._lu.perm_c[tail], self._lu.perm_r[tail]]
        if not all(np.array_equal(one, tail) for one in moved):
            raise NotConverged("large strain: SuperLU moved the contact points; report the mesh")
        U = self._lu.U
        inside = U.diagonal()[: n - nb]
        if inside.size and not np.abs(inside).min() >= SINGULAR:
            raise _singular()
        if not nb:
            return
        self._shifted = (self._lu.L[:, n - nb :][n - nb :] @ U[:, n - nb :][n - nb :]).toarray()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LinAlgWarning)  # singular: the pivots tell
            self._dense = lu_factor(self._shifted - np.eye(nb), check_finite=False)
        if not np.abs(np.diag(self._dense[0])).min() >= SINGULAR:
            raise _singular()

    def compliance(self, loads: Array) -> Array:
        """Solutions at the last unknowns for loads there, both of shape (nb, k)."""
        if not self._last.size:
            return loads
        return np.asarray(lu_solve(self._dense, loads, check_finite=False))

    def solve(self, load: Array) -> Array:
        """The solution for one load, shape (n,)."""
        own, nb = load[self._order], self._last.size
        if nb:
            start, mine = load.size - nb, own[load.size - nb :].copy()
            carried = np.zeros(nb)
            if np.any(own[:start]):
                own[start:] = 0.0
                carried = -self._shifted @ self._lu.solve(own)[start:]
            own[start:] = self._shifted @ self.compliance(mine - carried) + carried
        found = np.empty_like(load)
        found[self._order] = self._lu.solve(own)
        return found


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
        K = Csr(step.tangent(now.u) + touch.force)
        A = Csr(step.P.T @ K @ step.P)
        size = np.sqrt(np.abs(A.diagonal()))
        unit = sparse.diags_array(1.0 / np.where(size > 0, size, 1.0))
        self._P = Csr(step.P @ unit)  # the tangent has the diagonal one
        scaled = Csr(unit @ A @ unit)
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
        self._factor = BoundaryFactor(scaled, step.order, np.flatnonzero(used))
        self._B, (B, E) = B, (part[:, used].toarray() for part in (B, B + E))
        self._free = self._P @ self._factor.solve(right) + now.support
        self._W = E @ self._factor.compliance(B.T)
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
        free = self._free
        u_n = (touch.G + touch.tilted) @ free
        u_t = touch.slip + ((touch.T + touch.turned) @ free).reshape(touch.slip.shape)
        v0 = self._points.stacked(u_n, u_t) / self._of_rows
        if not v0.size:  # supports hold all contact points
            return free, np.zeros(scale.size), np.zeros(u_t.shape), (0, 0, 0)
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
        du = free - self._P @ self._factor.solve(self._B.T @ l)
        held = Condensed(problem, Coulomb(touch.friction))
        zones = held.law.zones(held.state(forces))
        active, stick, slip = (int(z.sum()) for z in (zones.active, zones.stick, zones.slip))
        return du, forces.mu / scale, forces.t / scale[:, None], (active, stick, slip)


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
