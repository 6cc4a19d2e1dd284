"""Choice of the algorithm from the name of the method and the friction law."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import LinAlgError

from contact.arrays.dense_arrays import DeviceMatrix, arrays_of
from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.condensation.factor_compliance import FactorCompliance
from contact.condensation.primal import PrimalProblem
from contact.errors import ContactError, Infeasible, InputError, NotConverged
from contact.laws.condensed_newton import Condensed, is_stable, outer_step
from contact.laws.friction import Coulomb, Friction, Tresca
from contact.laws.iteration import Iteration, Report
from contact.laws.load_balance import check_held
from contact.laws.newton import LIMITS, at_rounding, followed, newton, proximal_point
from contact.laws.options import Options
from contact.laws.primal_newton import primal_newton
from contact.laws.qp_peers import solve_box_with
from gpu import QPFactor, QPResult, solve_qp

Array = NDArray[np.float64]

# Spring stiffness of free motions in the frictionless start, over the square of max |C|; the
# stiffness of contact is one.
SPRINGS = 1e-2


def solve_boundary(
    problem: BoundaryProblem,
    friction: Friction | None,
    options: Options,
    start: Forces | None,
    scale: Array,
    report: Report,
) -> tuple[Forces, float]:
    """Forces by the method of the options, and the violation of the friction law due to its
    regularisation, over the largest force; `scale` is physical over scaled displacement.
    """
    if isinstance(problem, PrimalProblem):
        return primal_newton(problem, friction, options, start, report), 0.0
    _refuse(problem, options)
    tol, limit = options.tol * LIMITS.inner, options.max_iterations
    if problem.compliance is not None and problem.compliance.softens:
        return _adhesive(problem, friction, start, tol, limit, report), 0.0
    check_held(problem, friction)
    monolithic = options.method == "newton"
    if isinstance(problem.W, FactorCompliance):
        with suppress(NotConverged, LinAlgError):
            return device_newton(
                problem, friction, start, tol=tol, max_iterations=limit, report=report
            ), 0.0
        laws = Condensed(problem, friction or Tresca(np.zeros(problem.gap.size)))
        return proximal_point(laws, start or _rest(problem), tol=tol, report=report), 0.0
    if monolithic and isinstance(problem.W, DeviceMatrix) and problem.compliance is None:
        coarse = _from_coarse(problem, friction, options, report) if start is None else None
        for first in (start,) if coarse is None else (coarse, None):
            with suppress(NotConverged, LinAlgError):
                return device_newton(
                    problem, friction, first, tol=tol, max_iterations=limit, report=report
                ), 0.0
    if monolithic and start is None:
        start = _from_coarse(problem, friction, options, report)
        if start is not None and isinstance(friction, Coulomb):
            with suppress(NotConverged, LinAlgError):
                return newton(Condensed(problem, friction), start, tol=tol, report=report), 0.0
            start = None
    if friction is None and problem.compliance is not None:
        return _compliant(problem, start, tol, report), 0.0
    if friction is None and monolithic and start is not None and not problem.s.size:
        laws = Condensed(problem, Tresca(np.zeros(problem.gap.size)))
        with suppress(NotConverged, LinAlgError):
            return newton(laws, start, tol=tol, phase="active set", report=report), 0.0
    if friction is None:
        return signorini(problem, start=start, tol=tol, peer=options.peer, report=report), 0.0
    if start is None:
        start = _frictionless(problem, tol, report)
    if options.method == "fixed_point":
        return _regularised(problem, friction, options, start, scale, report)
    given = GivenFriction(problem, options.method == "pdas", tol, options.peer)
    if isinstance(friction, Tresca):
        return given(friction.given, start, report), 0.0
    if monolithic:
        return _coulomb(problem, friction, start, given, tol, limit, report), 0.0
    forces = tresca_loop(
        problem,
        friction,
        start,
        given.of_last_step,
        tol=tol if options.peer is None else options.tol,
        max_iterations=limit,
        report=report,
    )
    return forces, 0.0


def _rest(problem: BoundaryProblem) -> Forces:
    """Zero forces and motions."""
    return Forces(*problem.zeros(), np.zeros(problem.s.size))


def _refuse(problem: BoundaryProblem, options: Options) -> None:
    """Raise an `InputError` for a method that cannot solve the problem."""
    if isinstance(problem.W, FactorCompliance) and options.method != "newton":
        raise InputError(
            f"method={options.method!r}: the compliance of {problem.v0.size} contact rows is "
            "applied by the factor of the body, which 'newton' alone takes"
        )
    use = "use 'newton', 'pdas' or 'tresca_loop'"
    if options.method == "fixed_point" and problem.ties.any():
        raise InputError(
            f"method='fixed_point': it regularises friction, but bonded points do not slip; {use}"
        )
    if problem.compliance is not None and (options.method == "fixed_point" or options.peer):
        raise InputError(f"method={options.method!r}: it takes no compliant surfaces; {use}")


def _adhesive(
    problem: BoundaryProblem,
    friction: Friction | None,
    start: Forces | None,
    tol: float,
    limit: int,
    report: Report,
) -> Forces:
    """Newton's method from the last equilibrium, or from contact without adhesion; no other start,
    which would lead to other branches."""
    none = Condensed(problem, Tresca(np.zeros(problem.gap.size)))
    for laws in (none, None if friction is None else Condensed(problem, friction)):
        if laws is not None and (start is None or laws is not none or friction is None):
            first = start
            if first is None:
                first = _rest(problem) if problem.s.size else _frictionless(problem, tol, report)
            start = followed(laws, first, is_stable, tol=tol, max_iterations=limit, report=report)
    assert start is not None
    return start


def _compliant(
    problem: BoundaryProblem, start: Forces | None, tol: float, report: Report
) -> Forces:
    """Frictionless contact of compliant surfaces, a convex problem: Newton, or proximal points."""
    if start is None:
        start = _frictionless(problem, tol, report)
    laws = Condensed(problem, Tresca(np.zeros(problem.gap.size)))
    with suppress(NotConverged, LinAlgError):
        found = newton(laws, start, tol=tol, report=report)
        # Weak springs of Newton's method act on changes of free motions: at the solution they carry
        # no force.
        return newton(laws, found, tol=tol) if problem.s.size else found
    try:
        return proximal_point(laws, start, tol=tol, report=report)
    except NotConverged as error:
        if problem.compliance is None or not problem.compliance.capped:
            raise
        raise NotConverged(
            f"{error}; the load may be beyond what the hardness carries on the contact boundary"
        ) from error


def _from_coarse(
    problem: BoundaryProblem, friction: Friction | None, options: Options, report: Report
) -> Forces | None:
    """Recursive solution with fewer points; None if there is no coarse problem or no solution."""
    coarse = CoarseProblem.of(problem, friction)
    if coarse is None:
        return None

    def note(line: Iteration) -> None:
        phase = line.phase if line.phase.startswith("coarse") else f"coarse {line.phase}"
        report(replace(line, phase=phase))

    ones = np.ones(coarse.problem.gap.size)
    with suppress(ContactError, LinAlgError):
        return coarse.refined(
            solve_boundary(coarse.problem, coarse.friction, options, None, ones, note)[0]
        )
    return None


def _largest_displacement(problem: BoundaryProblem, forces: Forces, scale: Array) -> float:
    """Largest displacement of a contact point, in the units of the body."""
    u_n, u_t = problem.displacements(forces.mu, forces.t, forces.a)
    return float(max(np.abs(u_n * scale).max(), np.abs(u_t * scale[:, None]).max()))


def _frictionless(problem: BoundaryProblem, tol: float, report: Report) -> Forces:
    """Initial guess of the friction methods: frictionless hard contact, with springs on free
    motions, softened if they keep the body from reaching the obstacle.
    """
    problem = replace(problem, compliance=None)
    if not np.any(problem.can_touch):
        return _rest(problem)
    if not problem.s.size:
        return signorini(problem, tol=tol, phase="frictionless", report=report)
    springs = SPRINGS * float(np.abs(problem.C).max()) ** 2
    found = signorini(problem, tol=tol, springs=springs, phase="frictionless", report=report)
    for _ in range(5):
        if _carries(problem, found):
            break
        springs *= SPRINGS
        with suppress(ContactError):
            found = signorini(
                problem, tol=tol, springs=springs, phase="frictionless", report=report
            )
    return found


def _carries(problem: BoundaryProblem, forces: Forces) -> bool:
    """Whether contact carries at least half of the pressing loads, and springs the rest."""
    C = problem.C[problem.normal[problem.can_touch]]
    left = problem.s - C.T @ forces.mu[problem.can_touch]
    return bool(np.abs(C @ left).max() <= 0.5 * np.abs(C @ problem.s).max())


def _regularised(
    problem: BoundaryProblem,
    friction: Friction,
    options: Options,
    start: Forces,
    scale: Array,
    report: Report,
) -> tuple[Forces, float]:
    """Forces of the fixed point (4.12), and the violation of the friction law due to eps."""
    eps = options.eps
    if eps is None:
        eps = 1e-5 * _largest_displacement(problem, start, scale)
    forces = fixed_point(
        problem,
        start,
        eps=eps / scale,
        friction=friction,
        tol=options.tol,
        max_iterations=options.max_iterations,
        report=report,
    )
    slip = eps / _largest_displacement(problem, forces, scale)
    # The certificate scales slip differently: the residual may be larger there.
    return forces, 10.0 * options.tol + 10.0 * slip


def _coulomb(
    problem: BoundaryProblem,
    friction: Coulomb,
    start: Forces,
    given: GivenFriction,
    tol: float,
    max_iterations: int,
    report: Report,
) -> Forces:
    """Monolithic Newton; if it stalls, proximal points, then Newton after fixed-bound steps."""
    laws, failure = Condensed(problem, friction), None
    for attempt in range(4):
        try:
            return newton(laws, start, tol=tol, max_iterations=max_iterations, report=report)
        except (NotConverged, LinAlgError) as error:
            failure = error
        if attempt == 0:
            with suppress(NotConverged):
                return proximal_point(laws, start, tol=tol, report=report)
        for step in range(1, 5 * (attempt + 1) + 1):
            start = given.of_last_step(friction.bound(start.mu), start)
            report(outer_step(problem, step, "tresca step", start, friction.bound(start.mu)))
    raise NotConverged(f"{failure}; try method='tresca_loop' or a smaller friction coefficient")


def device_newton(
    problem: BoundaryProblem,
    friction: Friction | None,
    start: Forces | None,
    *,
    tol: float,
    max_iterations: int,
    report: Report = lambda iteration: None,
) -> Forces:
    """Newton's method on the device of W; without a start, frictionless steps with springs on free
    motions come first.
    """
    none = Condensed(problem, Tresca(np.zeros(problem.gap.size)))
    laws = none if friction is None else Condensed(problem, friction)
    now = start or _rest(problem)
    if start is None and friction is not None:
        now = _without_friction(replace(none, weak=SPRINGS, anchored=False), now, report)
    phase = "active set" if friction is None else "newton"
    return newton(laws, now, tol=tol, max_iterations=max_iterations, phase=phase, report=report)


def _without_friction(laws: Condensed, now: Forces, report: Report) -> Forces:
    """Active-set steps until the set of active points repeats."""
    before: NDArray[np.bool_] | None = None
    for step in range(1, 16):
        state = laws.state(now)
        zones = laws.law.zones(state)
        if before is not None and np.array_equal(before, zones.active):
            break
        before = zones.active
        now = laws.step(state, zones, "radial")
        report(Iteration(step, "frictionless", int(zones.active.sum()), 0, 0, np.nan))
    return now


def fixed_point(
    problem: BoundaryProblem,
    start: Forces,
    *,
    eps: Array,
    friction: Friction,
    tol: float,
    max_iterations: int,
    report: Report,
) -> Forces:
    r"""Lagged secant stiffness for the regularised friction law: (4.12), Algorithm 3.

    Each step solves Signorini's problem with springs ``t = w u_t``, ``w = g / max(eps, |u_t|)`` at
    the last iterate: the box QP with 1 / w on the tangential diagonal. With a fixed bound the
    energy :math:`J_\epsilon = \tfrac12 a(u,u) - f(u) + \sum g \psi_\epsilon(|u_t|)` decreases in
    every step. It converges linearly, and ends where displacements change by at most `tol` and the
    regularised law holds up to `tol`.
    """
    now = start
    before: Array | None = None
    for step in range(1, max_iterations + 1):
        g = friction.bound(now.mu)
        _, u_t = problem.displacements(now.mu, now.t, now.a)
        slip = np.maximum(eps, np.linalg.norm(u_t, axis=1))
        with np.errstate(divide="ignore"):
            softness = np.where(g > 0, slip / g, np.inf)
        now = signorini(problem, bound=g, softness=softness, start=now, tol=1e-12)
        u_n, u_t = problem.displacements(now.mu, now.t, now.a)
        moved = np.concatenate((u_n, u_t.ravel()))
        slip = np.maximum(eps, np.linalg.norm(u_t, axis=1))
        g = friction.bound(now.mu)
        missed = np.where(problem.tangent >= 0, now.t - (g / slip)[:, None] * u_t, 0.0)
        violation = float(np.abs(missed).max()) / problem.residual_size(now.mu, now.t)
        change = np.inf if before is None else _largest(moved - before) / _largest(moved)
        before = moved
        energy = np.nan
        if isinstance(friction, Tresca):
            psi = _psi(np.linalg.norm(u_t, axis=1), eps)
            # l^T W l / 2 - s^T a is the energy of body and contact forces only.
            energy = problem.energy(now.mu, now.t, now.a) + float(g @ psi)
        line = outer_step(problem, step, "fixed point", now, g, violation)
        report(replace(line, energy=energy, change=change))
        if max(change, violation) <= tol:
            return now
    raise NotConverged(
        f"fixed point: relative change {change:.1e}, residual {violation:.1e} after {step} steps, "
        f"tolerance {tol:.1e}; it converges linearly: raise max_iterations or eps, or use "
        "method='newton'"
    )


def _psi(slip: Array, eps: Array) -> Array:
    """C1 regularisation of the modulus, equation (4.11) of the dissertation."""
    return np.where(slip >= eps, slip, 0.5 * slip**2 / eps + 0.5 * eps)


def _largest(x: Array) -> float:
    return max(float(np.abs(x).max(initial=0.0)), np.finfo(float).tiny)


@dataclass(frozen=True)
class GivenFriction:
    """Solver for given friction: the box QP, by `peer` if given, or Newton's method, only in the
    damped form ((4.16) of the dissertation) if `damped`.
    """

    problem: BoundaryProblem
    damped: bool
    tol: float
    peer: str | None = None

    def __call__(
        self, bound: Array, start: Forces, report: Report = lambda iteration: None
    ) -> Forces:
        """Forces for the bound g; raises `NotConverged` if all methods stall, `gpu.Infeasible` if
        no forces within the bound balance the loads.
        """
        if not self.box:
            return self._by_newton(Tresca(bound), start, report)
        return signorini(
            self.problem, bound=bound, start=start, tol=self.tol, peer=self.peer, report=report
        )

    def of_last_step(self, bound: Array, start: Forces) -> Forces:
        """Forces for the bound of the last step of an iteration for Coulomb's law, or a multiple of
        it if its pressure is too low to balance the loads.
        """
        for times in (1, 2, 4, 8, 16):
            with suppress(Infeasible):
                if self.problem.s.size and not self.box:  # Newton's method would stall
                    check_held(self.problem, Tresca(times * bound))
                return self(times * bound, start)
        raise NotConverged("the friction of the last step cannot hold the loads")

    @property
    def box(self) -> bool:
        """Whether the problem is a box QP, solved as such."""
        box = self.problem.tangent.shape[1] == 1 and self.problem.compliance is None
        return box and not self.damped

    def _by_newton(self, friction: Tresca, start: Forces, report: Report) -> Forces:
        """Newton's method; if it stalls, its damped form from other starts, then proximal
        points."""
        problem, tol, laws = self.problem, self.tol, Condensed(self.problem, friction)
        rest = _rest(problem)
        form = "damped" if self.damped else "switched"
        for near, kind in ((start, form), (rest, "damped")):
            with suppress(NotConverged, LinAlgError):
                phase = f"{kind} newton"
                return newton(laws, near, form=kind, tol=tol, phase=phase, report=report)
        if problem.tangent.shape[1] == 1:
            with suppress(ContactError, LinAlgError):  # solution for hard surfaces
                hard = replace(problem, compliance=None)
                near = signorini(hard, bound=friction.given, start=start, tol=tol, report=report)
                return newton(laws, near, tol=tol, report=report)
        return proximal_point(laws, start, tol=tol, report=report)


@dataclass(frozen=True)
class CoarseProblem:
    """A problem with equal scaled forces in groups of neighbouring points: l = P L, P^T W P. Its
    zones differ from those of the fine problem at few points.
    """

    problem: BoundaryProblem  # the coarse one
    friction: Friction | None
    fine: BoundaryProblem
    row: NDArray[np.int64]  # coarse row of each fine row; -1 where contact is impossible
    share: NDArray[np.float64]  # ratio of scaled forces of a fine row and its coarse row

    @classmethod
    def of(cls, fine: BoundaryProblem, friction: Friction | None) -> CoarseProblem | None:
        """Group points, numbered along the boundary; None in 3-D, for fewer than a hundred points,
        with bonded points or compliant surfaces.
        """
        m = fine.gap.size
        if fine.tangent.shape[1] != 1 or m < 100 or fine.ties.any() or fine.compliance:
            return None
        group = np.arange(m) // 4  # merge four neighbours
        count = int(group[-1]) + 1
        bears = np.column_stack((fine.can_touch, fine.tangent[:, 0] >= 0))
        there = np.stack([np.bincount(group, bears[:, j], count) > 0 for j in (0, 1)], axis=1)
        number = np.where(there.T, np.cumsum(there.T).reshape(2, count) - 1, -1).T
        of_point = np.column_stack((fine.normal, fine.tangent[:, 0]))
        row = np.full(fine.v0.size, -1)
        row[of_point[bears]] = number[group][bears]

        used = np.argsort(row, kind="stable")[np.count_nonzero(row < 0) :]
        first = np.flatnonzero(np.diff(row[used], prepend=-1))
        arrays = arrays_of(fine.W)
        ones = np.ones(used.size), (row[used], used)
        sums = sparse.csr_array(ones, shape=(first.size, row.size))
        W = arrays.congruent(sums, arrays.values(fine.W))
        compliance = np.where(there, arrays.get(W.diagonal())[number], 0.0).sum(axis=1)
        scale = np.sqrt(compliance / np.maximum(there.sum(axis=1), 1))  # one value per coarse point
        scale = np.where(scale > 0, scale, 1.0)
        share = np.empty(first.size)
        share[number[there]] = 1.0 / np.broadcast_to(scale[:, None], there.shape)[there]
        W = W * arrays.put(share) * arrays.put(share)[:, None]
        gap = np.bincount(group, np.where(fine.can_touch, fine.gap, 0.0), count) / scale
        # With few rows, the call overhead of a device dominates: use the host.
        problem = BoundaryProblem(
            W=arrays.get(W) if first.size <= 400 else arrays.matrix(W),
            v0=np.add.reduceat(fine.v0[used], first) * share,
            C=np.add.reduceat(fine.C[used], first, axis=0) * share[:, None],
            s=fine.s,
            gap=np.where(there[:, 0], gap, np.inf),
            normal=number[:, 0],
            tangent=number[:, 1:],
            prescribed_slip=(np.bincount(group, fine.prescribed_slip[:, 0], count) / scale)[
                :, None
            ],
        )
        if isinstance(friction, Coulomb):
            friction = Coulomb(_means(group, friction.coefficient))
        elif friction is not None:
            friction = Tresca(_means(group, friction.given) * scale)
        return cls(problem, friction, fine, row, share)

    def refined(self, forces: Forces) -> Forces:
        """Forces of the fine problem from those of the coarse one."""
        coarse = self.share * self.problem.forces(forces.mu, forces.t)
        stacked = np.where(self.row >= 0, coarse[self.row], 0.0)
        mu, t = self.fine.zeros()
        normal, tangent = self.fine.normal >= 0, self.fine.tangent >= 0
        mu[normal] = stacked[self.fine.normal[normal]]
        t[tangent] = stacked[self.fine.tangent[tangent]]
        return Forces(mu, t, forces.a)


def _means(group: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean of the values of each group."""
    return np.asarray(np.bincount(group, values) / np.bincount(group))


def signorini(
    problem: BoundaryProblem,
    *,
    bound: Array | None = None,
    softness: Array | None = None,
    start: Forces | None = None,
    tol: float = 1e-12,
    springs: float = 0.0,
    peer: str | None = None,
    phase: str = "active set",
    report: Report = lambda iteration: None,
) -> Forces:
    r"""Minimise the complementary energy over the forces by the primal-dual active set method.

    .. math::
        \min \tfrac12 l^T W l - l^T (v_0 - d) \quad
        \text{s.t.} \quad \mu \ge 0, \; |t| \le g, \; C^T l = s

    is the dual of Signorini's problem with gap d and friction bound g (infinite: t is free); forces
    of bonded points are free. In two dimensions it is a box QP, solved by `gpu.solve_qp` or by
    `peer`, a solver of qpsolvers. `softness` adds ``softness |t|^2 / 2``, the regularised law t =
    u_t / softness; positive `springs` on free motions replace the load balance.
    """
    g = problem.bound(np.zeros(problem.gap.size) if bound is None else bound)
    if bound is not None and problem.tangent.shape[1] > 1 and softness is None:
        raise InputError("given friction in 3-D is no box QP; use method 'newton' or 'pdas'")
    can_touch = problem.can_touch
    live_t = (problem.tangent >= 0) & (g[:, None] > 0)
    if problem.bonded is not None:  # a component fixed by supports needs no tie force
        live_t &= (problem.W.diagonal()[problem.tangent] > 0) | ~problem.bonded[:, None]
    used = np.concatenate((problem.normal[can_touch], problem.tangent[live_t]))
    count = int(can_touch.sum())
    point_t = np.nonzero(live_t)[0]

    P = problem.W[np.ix_(used, used)]
    q = -problem.v0[used]
    q[:count] += problem.gap[can_touch]
    C = problem.C[used]
    lb, ub = np.zeros(used.size), np.full(used.size, np.inf)
    lb[:count][problem.ties[can_touch]] = -np.inf
    lb[count:], ub[count:] = -g[point_t], g[point_t]
    if softness is not None:
        P = P.copy()
        P[np.arange(count, used.size), np.arange(count, used.size)] += softness[point_t]
        lb[count:], ub[count:] = -np.inf, np.inf
    A, b = (C.T, problem.s) if C.shape[1] and not springs else (None, None)
    if springs:
        P = P + C @ C.T / springs
        q = q - C @ problem.s / springs

    mu, t = problem.zeros()
    if used.size == 0:
        return Forces(mu, t, np.zeros(problem.s.size))
    if peer is not None:
        x, y = solve_box_with(peer, P, q, A, b, lb, ub)
    else:
        guess = None if start is None else problem.forces(start.mu, start.t)[used]
        result = _box_qp(P, q, A, b, lb, ub, guess, tol)
        x, y = result.x, result.y
        for step, line in enumerate(result.history, 1):
            report(Iteration(step, phase, used.size - line.active, 0, 0, np.nan))
    mu[can_touch] = x[:count]
    t[live_t] = x[count:]
    return Forces(mu, t, (problem.s - C.T @ x) / springs if springs else -y)


def _box_qp(
    P: Array,
    q: Array,
    A: Array | None,
    b: Array | None,
    lb: Array,
    ub: Array,
    guess: Array | None,
    tol: float,
) -> QPResult:
    r"""Minimise :math:`\tfrac12 x^T P x + q^T x`; P may be singular.

    Linearly dependent rows leave the forces undetermined, but not the displacements. The proximal
    point method (Rockafellar 1976) then selects one solution: a step solves with :math:`P + \delta
    I` and :math:`q - \delta x_k`, and violates the conditions by at most :math:`\delta |x_{k+1} -
    x_k|`.
    """
    factor = _factored(P)
    if factor.definite:
        try:
            return solve_qp(factor, q, A=A, b=b, lb=lb, ub=ub, start=guess, tol=tol)
        except NotConverged:  # nearly singular
            pass
    added = 1e-9  # compliance added to each row's own of about one
    factor = _factored(P + added * np.eye(q.size))
    x = np.zeros(q.size) if guess is None else guess
    start: Array | QPResult | None = guess
    least, best = np.inf, None
    for _ in range(30):
        result = solve_qp(factor, q - added * x, A=A, b=b, lb=lb, ub=ub, start=start, tol=tol)
        x, before, start = result.x, x, result
        missed = added * float(np.abs(x - before).max())
        largest, driving = float(np.abs(x).max()), float(np.abs(q).max())
        # Forces are this large only if conditions of dependent rows contradict each other.
        if largest > 1e-2 / added * driving:
            least = np.inf
            break
        # Forces below 1e-12 of the displacements are rounding.
        size = max(largest, 1e-12 * driving, np.finfo(float).tiny)
        if missed / size < least:
            least, best = missed / size, result
        if least <= tol:
            break
    if best is None or least > LIMITS.round_off * tol:
        raise NotConverged(
            f"dependent contact rows: residual {least:.1e} at best, tolerance {tol:.1e}; they may "
            "ask for displacements that exclude each other: open the gap, choose another "
            "functional, or refine"
        )
    return best


def _factored(P: Array) -> QPFactor:
    try:
        return QPFactor(P)
    except InputError as error:
        raise InputError(
            f"functional: the compliance of its rows is not positive semidefinite ({error}); "
            "choose another functional, or refine"
        ) from error


TrescaSolver = Callable[[Array, Forces], Forces]


def tresca_loop(
    problem: BoundaryProblem,
    friction: Coulomb,
    start: Forces,
    solve: TrescaSolver,
    *,
    tol: float,
    max_iterations: int,
    report: Report,
) -> Forces:
    """Coulomb friction as a fixed point of given friction, g <- F mu: Algorithm 1 of the
    dissertation. Raises `NotConverged` if the map is not a contraction (large friction).
    """
    now, best, least, laws = start, start, np.inf, Condensed(problem, friction)
    for step in range(1, max_iterations + 1):
        now = solve(friction.bound(now.mu), now)
        line = outer_step(problem, step, "outer", now, friction.bound(now.mu))
        report(line)
        if line.residual <= tol:
            return now
        if line.residual < least:
            best, least = now, line.residual
        elif at_rounding(laws, laws.state(best), least):
            return best
    if least <= LIMITS.round_off * tol or at_rounding(laws, laws.state(best), least):
        return best
    raise NotConverged(
        f"tresca loop: residual {line.residual:.1e} after {step} outer steps, tolerance {tol:.1e}; "
        "use method='newton' or raise max_iterations"
    )
