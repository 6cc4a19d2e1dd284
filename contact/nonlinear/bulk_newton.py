r"""Newton's method for the bodies and their contact together.

At an iterate u with contact forces l = (mu, t), rows B, the tangent K of the bodies and the
derivatives E of the rows and C of the contact forces, an iteration solves

.. math:: (K + C)\, \delta + B^T l^+ = f - F(u), \qquad v = v(u) + (B + E)\, \delta ,

with the law between v and the new forces l+: condensed onto the contact points, that is a
`BoundaryProblem`, solved by `contact.laws`. Steps that invert a cell or enlarge the residual are
shortened; K + C of an earlier iterate serves where `contact.nonlinear.chord` expects less work.

P. Wriggers, Computational Contact Mechanics, 2nd ed., Springer 2006, chapter 10."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import LinAlgError

from contact.arrays.blas_threads import one_blas_thread
from contact.body.supports import norms
from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.condensation.condensed_contact import PointRows
from contact.errors import InputError, NotConverged
from contact.laws.condensed_newton import Condensed
from contact.laws.friction import Coulomb, Tresca
from contact.laws.iteration import Iteration
from contact.laws.law import ContactLaw, State
from contact.laws.newton import LIMITS, newton
from contact.nonlinear.boundary_factor import BoundaryFactor
from contact.nonlinear.chord import Chord, Tangent
from contact.nonlinear.free_unknowns import (
    FreeUnknowns,
    Matrix,
    added,
    on_host,
)
from contact.nonlinear.touching import Touch
from skfem_adini.ground.arrays import host

Array = NDArray[np.float64]
Csr = sparse.csr_array
Index = NDArray[np.int64]
ROUNDING = 50 * float(np.finfo(float).eps)  # of sums of some hundred terms
REACH = 0.05  # gaps beyond this part of the body are taken up once they close
ON_HOST = 400  # order up to which dense algebra on a device takes longer
FIRST_DAMPING = 1e-2  # over the diagonal of the tangent: some ten cells follow a support
AT_REST = 1e-6  # residual of a body that has come to rest
MOST_MOVES = 100  # steps of time of an overdamped motion


class Trial(NamedTuple):
    """An iterate: displacement, contact forces, and what is computed from them."""

    u: Array
    mu: Array
    t: Array
    touch: Touch
    internal: Array  # internal forces on all dofs
    load: Array  # applied forces on all dofs
    support: Array  # prescribed minus present displacement, zero on free dofs
    contact: Array  # forces of the contact points on all dofs


@dataclass(frozen=True)
class StepProblem:
    """One step of the bodies: its loads and supports, and functions of the displacement."""

    load: Callable[[Array], Array]
    free: FreeUnknowns  # z in u = P z + u0
    u0: Array
    picked: Csr  # z = picked^T (u - u0)
    lengths: Array  # lengths of the free unknowns, see `dof_lengths`
    extent: float
    stiffness: float  # largest of the undeformed bodies, a force per length, for rounding errors
    of_cells: float  # the largest times the size of a cell, for those of F = 1 + grad u
    internal: Callable[[Array], Array]
    tangent: Callable[[Array], Matrix]  # of internal minus applied forces
    touch: Callable[[Array, Array, Array], Touch]
    order: Index  # free unknowns in an order of little fill
    kept: Index  # free unknowns that are eliminated last, with row exchanges
    analysis: list[Any]  # see `BoundaryFactor`
    least_volume: Callable[[Array], float]  # smallest det F
    chord: Chord

    def trial(self, u: Array, mu: Array, t: Array, like: Touch | None = None) -> Trial:
        """Evaluate an iterate; forces of other points than those at u are of the touch `like`."""
        touch = self.touch(u, mu, t)
        if touch.gap.size != mu.size:
            mu, t = carried(touch, like, mu, t)
            touch = self.touch(u, mu, t)
        held = self.free.displacement(self.picked.T @ (u - self.u0)) + self.u0
        contact = touch.G.T @ mu + touch.T.T @ t.ravel()
        return Trial(u, mu, t, touch, self.internal(u), self.load(u), held - u, contact)

    def residuals(self, now: Trial, scale: Array) -> dict[str, float]:
        """Relative residuals beyond rounding errors: balance, contact and friction, supports.
        `scale` (m,) is physical over scaled displacement of each point, see `CondensedContact`."""
        terms = (now.internal, now.load, now.contact)
        size = max(self._largest(part) for part in terms)
        # Forces of supports measure a body that supports alone deform.
        size = max(size, float(np.abs(now.internal).max(initial=0.0)))
        off = self._largest(now.load - now.internal - now.contact)
        off -= ROUNDING * self.stiffness * float(np.abs(now.u).max(initial=0.0))
        off -= 4 * float(np.finfo(float).eps) * self.of_cells  # at most .9 eps was measured
        support = float(np.abs(now.support).max(initial=0.0)) / self.extent
        return {
            "balance": max(off, 0.0) / (size or 1.0),
            "contact": self._violation(now, scale),
            "support": support,
        }

    def _largest(self, f: Array) -> float:
        """Largest of the forces on free unknowns, over their lengths."""
        return float(np.abs(self.free.forces(f) / self.lengths).max(initial=0.0))

    def _violation(self, now: Trial, scale: Array) -> float:
        """Largest violation of the contact and friction laws over the largest contact force."""
        touch, mu, t = now.touch, now.mu * scale, now.t.T * scale
        if not mu.size:
            return 0.0
        through = -touch.gap / scale
        live = norms(self.free.rows(touch.T)) > 1e-9 * norms(touch.T)
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
    with np.errstate(all="ignore"), one_blas_thread(now.mu.size + now.t.size):
        lines, sizes = list[Iteration](), list[float]()
        tangent, k, factored = step.chord.first(now.u), 0, 0
        while factored < most:
            k += 1
            linear = Linearised(step, now, tangent)
            left = step.residuals(now, linear.scale)
            sizes.append(max(left.values()))
            du, mu, t, counts = linear.solved(tol)
            now, size = _shortened(step, now, (du, mu, t), linear.scale, max(sizes[-3:]), k == 1)
            newton = linear.tangent is not tangent
            factored += newton
            lines.append(Iteration(k, "newton" if newton else "chord", *counts, size))
            report(lines[-1])
            if size <= tol:
                step.chord.end(linear.tangent, now.u)
                return now, of_points(linear.scale, now)
            tangent = step.chord.next(linear.tangent, newton, sizes[-1], size, tol)
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
    drag, damping = np.abs(on_host(step.tangent(start[0])).diagonal()), FIRST_DAMPING
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
        tangent=lambda x: added(step.tangent(x), Csr(sparse.diags_array(drag))),
        chord=Chord(),
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
        # Bodies that an iterate throws past each other, or a stress that cannot be computed.
        except (InputError, LinAlgError, ArithmeticError) as error:
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


class Linearised:
    """The linear equations of an iterate, condensed onto the contact points; with the tangent of
    another one if it is given and serves."""

    def __init__(self, step: StepProblem, now: Trial, tangent: Tangent | None = None) -> None:
        self._step, self._now, touch = step, now, now.touch
        G, T, tilted, turned = (
            step.free.rows(part) for part in (touch.G, touch.T, touch.tilted, touch.turned)
        )
        near = now.mu > 0
        near |= touch.bonded | (touch.gap <= REACH * step.extent + 2 * np.abs(now.support).max())
        rubs = np.repeat(near & ((touch.friction > 0) | touch.bonded), touch.slip.shape[1])
        live_n = near & (norms(G) > 1e-9 * norms(touch.G))
        live_t = rubs & (norms(T) > 1e-9 * norms(touch.T))
        m = touch.gap.size
        normal = np.where(live_n, np.cumsum(live_n) - 1, -1)
        slips = np.where(live_t, live_n.sum() + np.cumsum(live_t) - 1, -1)
        self._points = PointRows(normal, slips.reshape(m, -1))
        rows = (G[live_n], T[live_t]), (tilted[live_n], turned[live_t])
        used = np.zeros(step.lengths.size, dtype=bool)
        used[np.concatenate([step.kept, *(part.indices for pair in rows for part in pair)])] = True
        last = np.flatnonzero(used)
        if tangent is None or not tangent.factor.serves(last):
            K = added(step.tangent(now.u), touch.force)
            A, unit = step.free.matrix(K)
            used[self._next(near, G, T).indices] = True
            factor = BoundaryFactor(A, step.order, last, step.analysis, np.flatnonzero(used))
            tangent = Tangent(K, unit, factor)
        self.tangent, self._factor = tangent, tangent.factor
        moved = tangent.K @ now.support if now.support.any() else 0.0
        right = tangent.unit * step.free.forces(now.load - now.internal - moved)
        last = self._factor.last
        place = np.zeros(used.size, dtype=np.int64)
        place[last] = np.arange(last.size)
        arrays = self._arrays = self._factor.arrays
        B, E = (
            arrays.xp.asarray(tangent.unit[last])
            * arrays.xp.concatenate(
                [
                    arrays.dense(Csr((p.data, place[p.indices], p.indptr), (p.shape[0], last.size)))
                    for p in pair
                ]
            )
            for pair in rows
        )
        self._free, self._halfway = self._factor.forward(right)
        self._response = self._factor.compliance(B.T)
        self._W = (B + E) @ self._response
        if not (arrays.xp.isfinite(self._W).all() and np.all(np.isfinite(self._free))):
            raise NotConverged("large strain: the tangent holds values that are not finite")
        diagonal = np.maximum(host(self._W.diagonal()), 0.0)
        self._of_rows = self._points.lengths(diagonal) if diagonal.size else diagonal
        self._near, self.scale = near, np.ones(m)
        if diagonal.size:
            self.scale = self._points.of_points(self._of_rows)
            self.scale[~live_n] = self.scale[live_n].mean() if live_n.any() else self.scale.mean()

    def solved(self, tol: float) -> tuple[Array, Array, Array, tuple[int, int, int]]:
        """Change of u, new mu and t, and the numbers of active, sticking and slipping points."""
        touch, scale, now = self._now.touch, self.scale, self._now
        alone = np.zeros(self.tangent.unit.size)
        alone[self._factor.last] = self._free  # all that the rows of live points see
        free = self._displacement(alone) + now.support
        u_n = touch.G @ free + touch.tilted @ free
        u_t = touch.slip + (touch.T @ free + touch.turned @ free).reshape(touch.slip.shape)
        v0 = self._points.stacked(u_n, u_t) / self._of_rows
        if not v0.size:  # supports hold all contact points
            return self._moved(self._free), np.zeros(scale.size), np.zeros(u_t.shape), (0, 0, 0)
        by = self._arrays.xp.asarray(self._of_rows)
        W = self._W / by / by[:, None]
        problem = BoundaryProblem(
            W=self._arrays.matrix(W) if by.size > ON_HOST else host(W),
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
        du = self._moved(self._free - host(self._response @ self._arrays.xp.asarray(l)))
        held = Condensed(problem, Coulomb(touch.friction))
        zones = held.law.zones(held.state(forces))
        active, stick, slip = (int(z.sum()) for z in (zones.active, zones.stick, zones.slip))
        return du, forces.mu / scale, forces.t / scale[:, None], (active, stick, slip)

    def _moved(self, last: Array) -> Array:
        """Change of u from that of the last unknowns."""
        return self._displacement(self._factor.backward(self._halfway, last)) + self._now.support

    def _next(self, near: NDArray[np.bool_], G: Csr, T: Csr) -> Csr:
        """Rows of the points that are likely to come near next, a third as many as are."""
        touch, m = self._now.touch, near.sum()
        soon = np.argsort(np.where(near, np.inf, touch.gap))[: min(m // 3 + 1, near.size - m)]
        rubs = soon[touch.friction[soon] > 0]
        slips = touch.slip.shape[1]
        rows = (rubs[:, None] * slips + np.arange(slips)).ravel()
        return Csr(sparse.vstack([G[soon], T[rows]], format="csr"))

    def _displacement(self, z: Array) -> Array:
        """Displacement of all dofs by scaled unknowns."""
        return self._step.free.displacement(self.tangent.unit * z)


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
