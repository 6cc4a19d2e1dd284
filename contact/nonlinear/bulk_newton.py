r"""Newton's method for the bodies and their contact together.

At an iterate u with contact forces l = (mu, t), rows B, the tangent K of the bodies and the
derivatives E of the rows and C of the contact forces, an iteration solves

.. math:: (K + C)\, \delta + B^T l^+ = f - F(u), \qquad v = v(u) + (B + E)\, \delta ,

with the law between v and the new forces l+: condensed onto the contact points, that is a
`BoundaryProblem`, solved by `contact.laws`. Steps that invert a cell or enlarge the residual are
shortened.

P. Wriggers, Computational Contact Mechanics, 2nd ed., Springer 2006, chapter 10."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import LinAlgError
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
    support: Array  # prescribed minus present displacement, zero on free dofs


@dataclass(frozen=True)
class StepProblem:
    """One step of the bodies: its loads and supports, and functions of the displacement."""

    load: Array
    P: Csr  # u = P z + u0
    u0: Array
    picked: Csr  # z = picked^T (u - u0)
    lengths: Array  # lengths of the free unknowns, see `dof_lengths`
    extent: float
    stiffness: float  # largest of the undeformed bodies, a force per length, for rounding errors
    internal: Callable[[Array], Array]
    tangent: Callable[[Array], Csr]
    touch: Callable[[Array, Array, Array], Touch]
    least_volume: Callable[[Array], float]  # smallest det F

    def trial(self, u: Array, mu: Array, t: Array, like: Touch | None = None) -> Trial:
        """Evaluate an iterate; forces of other points than those at u are of the touch `like`."""
        touch = self.touch(u, mu, t)
        if touch.gap.size != mu.size:
            mu, t = carried(touch, like, mu, t)
            touch = self.touch(u, mu, t)
        held = self.P @ (self.picked.T @ (u - self.u0)) + self.u0
        return Trial(u, mu, t, touch, self.internal(u), held - u)

    def residuals(self, now: Trial, scale: Array) -> dict[str, float]:
        """Relative residuals beyond rounding errors: balance, contact and friction, supports.
        `scale` (m,) is physical over scaled displacement of each point, see `CondensedContact`."""
        contact = now.touch.G.T @ now.mu + now.touch.T.T @ now.t.ravel()
        terms = (now.internal, self.load, contact)
        size = max(float(np.abs(self.P.T @ part / self.lengths).max(initial=0.0)) for part in terms)
        # Forces of supports measure a body that supports alone deform.
        size = max(size, float(np.abs(now.internal).max(initial=0.0)))
        left = self.load - now.internal - contact
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
        return max(off, 0.0) / (size or 1.0)


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


class Linearised:
    """The linear equations of an iterate, condensed onto the contact points."""

    def __init__(self, step: StepProblem, now: Trial) -> None:
        self._step, self._now, touch = step, now, now.touch
        K = Csr(step.tangent(now.u) + touch.force)
        A = Csr(step.P.T @ K @ step.P)
        size = np.sqrt(np.abs(A.diagonal()))
        unit = sparse.diags_array(1.0 / np.where(size > 0, size, 1.0))
        self._P = Csr(step.P @ unit)  # the tangent has the diagonal one
        scaled = sparse.csc_array(unit @ A @ unit)
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
        right = self._P.T @ (step.load - now.internal - K @ now.support)
        try:
            factor = splu(scaled)
        except RuntimeError:  # a pivot is zero
            raise _singular() from None
        if A.shape[0] and np.abs(factor.U.diagonal()).min() < SINGULAR:
            raise _singular()
        found = factor.solve(np.column_stack((right, B.T.toarray())))
        if not np.all(np.isfinite(found)):
            raise NotConverged("large strain: the tangent holds values that are not finite")
        self._response = found
        self._W = (B + E) @ found[:, 1:]
        diagonal = np.maximum(np.diag(self._W), 0.0)
        self._of_rows = self._points.lengths(diagonal) if diagonal.size else diagonal
        self._near, self.scale = near, np.ones(m)
        if diagonal.size:
            self.scale = self._points.of_points(self._of_rows)
            self.scale[~live_n] = self.scale[live_n].mean() if live_n.any() else self.scale.mean()

    def solved(self, tol: float) -> tuple[Array, Array, Array, tuple[int, int, int]]:
        """Change of u, new mu and t, and the numbers of active, sticking and slipping points."""
        touch, scale, now = self._now.touch, self.scale, self._now
        free = self._P @ self._response[:, 0] + now.support
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
        du = free - self._P @ (self._response[:, 1:] @ l)
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
