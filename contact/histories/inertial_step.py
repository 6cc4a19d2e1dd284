r"""One implicit step of bodies with inertia, as a static contact problem on their boundary.

Over a step h from (u, v), with the half increment w of the displacement, the midpoint rule is

.. math::
    K (u + w) + C \frac{2 w}{h} + M \frac{v' - v}{h} + G^T \mu + T^T t = f, \qquad
    u' = u + 2 w, \quad v' = \frac{4 w}{h} - v,

with f and the forces during the step, and the laws of contact for u' at its end: in w a static
problem with the matrix :math:`A = K + 2 C / h + 4 M / h^2`, the load :math:`f - K u + 2 M v / h`
and half of the gap that is left. The step: C. Kane, E. A. Repetto, M. Ortiz and J. E. Marsden,
Comput. Methods Appl. Mech. Engrg. 180 (1999), 1-26; "stabilised": P. Deuflhard, R. Krause and S.
Ertel, Int. J. Numer. Meth. Engng 73 (2008), 1274-1290."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.sparse_rows import SparseRows
from contact.body.inertia import StepBody
from contact.condensation.condensed_contact import CondensedContact
from contact.errors import NotConverged
from contact.laws.options import Options
from contact.portable import Portable
from contact.problem.large_motion import check_motion
from contact.problem.solve_system import solve_system
from contact.result.contact_result import ContactResult
from contact.result.contact_system import ContactSystem

if TYPE_CHECKING:
    from contact.histories.load_program import LoadProgram
    from contact.problem.contact_problem import ContactProblem
    from contact.rows.contact_rows import ContactRows

Array = NDArray[np.float64]


class Moved(NamedTuple):
    """Displacement and velocity, with momentum M v and internal forces K u, (ndofs,)."""

    u: Array
    v: Array
    Mv: Array
    Ku: Array


class Ledger(NamedTuple):
    """Energies at the end of a step, and what was done and lost during it."""

    kinetic: float
    elastic: float
    potential: float
    work: float = 0.0
    friction: float = 0.0
    damping: float = 0.0
    impact: float = 0.0
    residual: float = 0.0

    @property
    def total(self) -> float:
        """Kinetic, elastic and potential energy."""
        return self.kinetic + self.elastic + self.potential


class Masses:
    """The masses of all bodies, from matrices of their scalar functions, on vectors of all dofs."""

    def __init__(self, bodies: Any, matrices: Sequence[sparse.csr_array]) -> None:
        unit = sparse.eye_array(bodies.dim)
        self.matrices = [sparse.csr_array(sparse.kron(M, unit, "csr")) for M in matrices]
        self._rows = SparseRows(sparse.csr_array(sparse.block_diag(self.matrices, "csr")))
        self.massless: NDArray[np.bool_] = self._rows.diagonal() == 0.0

    def __matmul__(self, v: Array) -> Array:
        return np.asarray(self._rows @ v)

    def moduli(self, v: Array) -> Array:
        """``|M| |v|``."""
        return np.asarray(self._rows.moduli(v))

    def bodies_with(self, bodies: Any, of_mass: float, of_stiffness: float) -> Any:
        """The bodies with ``of_mass M + of_stiffness K`` as stiffness."""
        found = []
        for M, body in zip(self.matrices, bodies.bodies, strict=True):
            A = of_mass * M + of_stiffness * body.stiffness if of_stiffness else of_mass * M
            found.append(StepBody.of(body, sparse.csr_array(A)))
        return bodies._of(found) if len(found) > 1 else found[0]


@dataclass(frozen=True, repr=False)
class StepSystem(ContactSystem):
    """The static problem of a step, certified by the equations with stiffness, mass and damping."""

    physical: _Middle | None = None
    _last: list[Any] = field(default_factory=list)

    def at_middle(self, u: Array, mu: Array, t: Array, w: Array | None) -> ContactResult:
        """The state in the middle of the step for a half increment u."""
        if not self._last or self._last[0] is not u or self._last[1] is not mu:
            assert self.physical is not None
            self._last[:] = u, mu, *self.physical(u, mu, t, w)
        found: ContactResult = self._last[2]
        return found if found.t is t else replace(found, t=t)

    @property
    def at_end(self) -> Moved:
        """The bodies at the end of the step of the last `at_middle`."""
        moved: Moved = self._last[3]
        return moved

    def balance(self, u: Any, mu: Array, t: Array) -> float:
        """Zero: with inertia no forces cancel that a step of refinement would have to balance."""
        return 0.0

    def kkt(self, u: Array, mu: Array, t: Array, w: Array | None = None) -> dict[str, float]:
        """Relative residuals of the state in the middle of the step."""
        now = self.at_middle(u, mu, t, w)
        return now.system.kkt(now.u, mu, t, now.motion)


@dataclass(frozen=True, eq=False)
class Moment:
    """Bodies and obstacles at the end of a step: `end` holds u, the motion, gaps and slips."""

    time: float
    bodies: Moved
    end: ContactResult
    energy: Ledger
    middle: ContactResult | None = None  # of the step before

    @property
    def u(self) -> Array:
        """Displacement of all dofs."""
        return self.bodies.u

    @property
    def v(self) -> Array:
        """Velocity of all dofs."""
        return self.bodies.v

    @property
    def motion(self) -> Array:
        """Motions of rigid obstacles, (k,)."""
        return np.zeros(0) if self.end.motion is None else self.end.motion


@dataclass(frozen=True)
class _Impact:
    """The change that keeps a predicted displacement outside of the obstacle, and its forces."""

    du: Array
    nu: Array
    forces: Array  # G^T nu


class Integrator(Portable):
    """Steps of one length of a problem; `damping` (a, b) is ``C = a M + b K``."""

    _ANEW = ("condensed", "projection")

    def __init__(
        self,
        problem: ContactProblem,
        masses: Masses,
        damping: tuple[float, float],
        dt: float,
        stabilised: bool,
        options: Options,
    ) -> None:
        self.problem, self.M, self.damping, self.dt = problem, masses, damping, dt
        self.stabilised, self.options = stabilised, options
        self._rest = problem.body.snapshot()

    @cached_property
    def condensed(self) -> CondensedContact:
        """The condensation of A, factored once."""
        (a, b), h, problem = self.damping, self.dt, self.problem
        body = self.M.bodies_with(problem.body, 2 * a / h + 4 / h**2, 1 + 2 * b / h)
        return CondensedContact(body, problem.rows, problem.solver)

    @cached_property
    def projection(self) -> CondensedContact:
        """The condensation of the mass, for impacts of the scheme "stabilised"."""
        body = self.M.bodies_with(self.problem.body, 1.0, 0.0)
        return CondensedContact(body, _free(self.problem.rows), self.problem.solver)

    def moved(self, u: Array, v: Array) -> Moved:
        """The bodies with this displacement and velocity."""
        return Moved(u, v, self.M @ v, np.asarray(self.problem.body.internal(u)))

    def moment(
        self, time: float, bodies: Moved, system: ContactSystem, motion: Array | None
    ) -> Moment:
        """The bodies at a time, with their energies."""
        (u, v, Mv, Ku), f = bodies, self.problem.body.f
        m, slips = system.rows.gap.size, system.body.dim - 1
        end = ContactResult(system, u, np.zeros(m), np.zeros((m, slips)), "", (), motion)
        energy = Ledger(0.5 * float(v @ Mv), 0.5 * float(u @ Ku), -float(f @ u))
        return Moment(time, bodies, end, energy)

    def system_at(self, program: LoadProgram, now: Moment, time: float) -> ContactSystem:
        """Gaps, slips, supports and obstacles at the end of a step."""
        moving = program._moving(now.time, time) or {"since": self.problem.opposite}
        return self.problem.system_of(program._body_at(time), now.end, **moving)

    def step(self, program: LoadProgram, now: Moment, time: float) -> Moment:
        """Advance to a time; the ledger is closed and every law certified, or NotConverged."""
        h, end = self.dt, self.system_at(program, now, time)
        around = program._body_at(now.time + 0.5 * h)
        same = end.motion is None and now.end.system.motion is None
        u_n, u_t = now.end._relative if same else end.relative(now.u, now.motion)
        impact = self._impact(now, end, u_n) if self.stabilised else None
        load = around.f - now.bodies.Ku + (2.0 / h) * now.bodies.Mv
        if impact is not None:
            load = load - (2.0 / h**2) * impact.forces
        u0 = 0.5 * (end.body.constraint[1] - now.end.system.body.constraint[1])
        motion = end.motion if end.motion is not None and end.motion.prescribed.size else None
        if motion is not None:
            half = 0.5 * (motion.prescribed - now.motion)
            motion = replace(motion, prescribed=half, travel=None)
        condensed = self.condensed.under(self.condensed.body.under(load, u0))
        assert end.slip_from is not None
        system = StepSystem(
            condensed.body,
            replace(end.rows, gap=0.5 * (end.rows.gap - u_n)),
            load,
            end.law,
            end.friction,
            0.5 * (end.slip_from - u_t),
            motion,
            physical=_Middle(self, program, now, end, around, (u_n, u_t), impact),
        )
        found = solve_system(system, condensed, self.options, now.middle)
        middle = system.at_middle(found.u, found.mu, found.t, found.motion)
        middle = replace(middle, history=found.history, slack=found.slack)
        check_motion(middle, self.problem.boundaries, end.obstacle)
        after = None
        if end.motion is not None and found.motion is not None:
            moved = now.motion + 2.0 * found.motion
            after = np.where(end.motion.free, moved, end.motion.prescribed)
        then = replace(self.moment(time, system.at_end, end, after), middle=middle)
        return replace(then, energy=self._ledger(now, then, found, around.f, impact))

    def velocity(self, now: Moment, w: Array, impact: _Impact | None) -> Array:
        """Velocity at the end of the step; that of the middle at massless nodes."""
        v = (4.0 / self.dt) * w - now.v
        if impact is not None:
            v = v - (2.0 / self.dt) * impact.du
        return np.where(self.M.massless, (2.0 / self.dt) * w, v)

    def _impact(self, now: Moment, end: ContactSystem, u_n: Array) -> _Impact | None:
        """The least change in the norm of the mass that keeps u + h v outside of the obstacle."""
        ahead = end.body.at_points(end.rows.G, self.dt * now.v)
        if end.motion is not None and end.motion.prescribed.size:
            ahead = ahead - end.motion.normal @ (end.motion.prescribed - now.motion)
        left = end.rows.gap - u_n - ahead
        left[end.rows.ties] = np.inf
        if not np.any(left < 0.0):
            return None
        nothing = np.zeros(now.v.size)
        condensed = self.projection.under(self.projection.body.under(nothing, nothing))
        rows = replace(_free(end.rows), gap=left)
        system = ContactSystem(condensed.body, rows, nothing, None, np.zeros(left.size))
        options = Options.checked(None, end.body.dim, "newton", self.options.tol, None, None)
        found = solve_system(system, condensed, options, None)
        return _Impact(found.u, found.mu, found.contact_forces)

    def _ledger(
        self, now: Moment, then: Moment, found: ContactResult, f: Array, impact: _Impact | None
    ) -> Ledger:
        """The balance of energy of a step; `NotConverged` unless it closes."""
        step, system, middle = 2.0 * found.u, found.system, then.middle
        assert middle is not None
        assert system.slip_from is not None
        mu, t, pressed = found.mu, found.t, found.mu != 0.0
        left, before = (np.where(pressed, gap, 0.0) for gap in (2.0 * system.rows.gap, now.end.gap))
        pushed, dragged = left - before, 2.0 * system.slip_from
        if system.motion is not None and found.motion is not None:
            w_n, w_t = system.motion.displacement(found.motion)
            pushed, dragged = pushed + 2.0 * w_n, dragged + 2.0 * w_t
        forces = middle.contact_forces + middle.tie_forces
        body, internal = self.problem.body, 0.5 * (now.bodies.Ku + then.bodies.Ku)
        residual = internal + forces - middle.system.load
        parts = {
            "loads": float((f - body.f) @ step),
            "supports": float(np.asarray(body.at_supports(residual)) @ step),
            "obstacles": -float(mu @ pushed) - float(np.sum(t * dragged)),
        }
        friction = 2.0 * float(np.sum(t * found.slip_increment))
        lost, damping = float(mu @ before), float(self.resistance(found.u) @ step)
        if impact is not None:
            change = step - self.dt * now.v - impact.du
            lost -= (2.0 / self.dt**2) * float(impact.forces @ change)
        work, e = sum(parts.values()), then.energy
        off = e.total - now.energy.total - work + friction + damping + lost
        terms = (*e[:3], *now.energy[:3], *parts.values(), friction, damping, lost)
        size = sum(map(abs, terms))
        if not abs(off) <= self.options.tol * size:
            raise NotConverged(
                f"the ledger of energy does not close: {off:.1e} is missing of {size:.1e} in the "
                f"step to t = {then.time:.6g}; check the units, or take a larger dt",
                found.history,
            )
        return Ledger(*e[:3], work, friction, damping, lost, off)

    def resistance(self, w: Array) -> Array:
        """Forces of damping for a half increment w."""
        (a, b), rate = self.damping, 2.0 / self.dt
        forces = np.zeros(w.size)
        if a:
            forces = (a * rate) * (self.M @ w)
        if b:
            forces = forces + (b * rate) * np.asarray(self.problem.body.internal(w))
        return forces


@dataclass(frozen=True)
class _Middle:
    """The state in the middle of a step as a static one whose loads include inertia and damping."""

    of: Integrator
    program: Any
    now: Moment
    end: ContactSystem
    around: Any  # bodies under the loads in the middle
    before: tuple[Array, Array]  # u_n and u_t at the start, relative to obstacles at the end
    impact: _Impact | None

    def __call__(
        self, w: Array, mu: Array, t: Array, motion: Array | None
    ) -> tuple[ContactResult, Moved]:
        """The result for a half increment w of displacement and `motion` of obstacles, and the
        bodies at the end of the step."""
        of, now, end, f = self.of, self.now, self.end, self.around.f
        h, v = of.dt, of.velocity(now, w, self.impact)
        moved, resistance = of.moved(now.u + 2.0 * w, v), of.resistance(w)
        load = f - (moved.Mv - now.bodies.Mv) / h - resistance
        moduli = np.abs(f) + np.abs(resistance) + of.M.moduli(np.abs(v) + np.abs(now.v)) / h
        body, program = of._rest, self.program
        if program._motions or program._heats:
            u0 = 0.5 * (end.body.constraint[1] + now.end.system.body.constraint[1])
            body = self.around.under(f, u0)
            for new, old in zip(body.bodies, self.around.bodies, strict=True):
                new.thermal = old.thermal
        then = end.motion
        if then is not None:
            then = replace(then, prescribed=0.5 * (then.prescribed + now.motion))
            given = now.motion if motion is None else now.motion + motion
            motion = np.where(then.free, given, then.prescribed)
        u_n, u_t = self.before
        assert end.slip_from is not None
        system = replace(
            end,
            body=body,
            rows=replace(end.rows, gap=0.5 * (end.rows.gap + u_n)),
            load=load,
            slip_from=0.5 * (end.slip_from + u_t),
            motion=then,
            moduli=moduli,
        )
        options, u = of.options, now.u + w
        body.know(u, 0.5 * (now.bodies.Ku + moved.Ku))  # linear in u
        found = ContactResult(system, u, mu, t, options.method, (), motion, options.tol)
        return found, moved


def _free(rows: ContactRows) -> ContactRows:
    """Contact rows whose ties cannot be touched."""
    nothing = np.zeros(0, dtype=bool)
    return replace(rows, bonded=nothing, gap=np.where(rows.ties, np.inf, rows.gap))
