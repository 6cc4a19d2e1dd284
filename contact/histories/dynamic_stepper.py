"""Bodies with inertia in contact: implicit steps of one length."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.body.inertia import Mass
from contact.errors import InputError
from contact.histories.dynamic_history import DynamicHistory, DynamicStep, arrays_of, stored_steps
from contact.histories.history_folder import HistoryFolder, same_values
from contact.histories.inertial_step import Integrator, Masses, Moment
from contact.histories.load_program import LoadProgram, value_at
from contact.histories.step_history import as_path, reporter
from contact.laws.options import Options
from contact.obstacles.rigid import ObstacleMotion
from contact.result.contact_result import ContactResult
from contact.settled import settled
from skfem_adini.ground.arguments import (
    choice,
    finite_number,
    finite_numbers,
    integer,
    positive_number,
)

if TYPE_CHECKING:
    from contact.problem.contact_problem import ContactProblem

Array = NDArray[np.float64]
Initial = ArrayLike | Callable[[Array], ArrayLike] | Sequence[Any] | ContactResult | None
Progress = Callable[[DynamicStep], None]
SCHEMES = ("midpoint", "stabilised")


class _Limits(NamedTuple):
    steps: int = 10**8  # of a run: the table of more does not fit into memory
    dt: float = 1e140  # its square, or that of its inverse, would overflow
    lost: float = 1e-6  # of dt, by which rounding may change a step


LIMITS = _Limits()
logger = logging.getLogger(__name__)


@settled("make a new DynamicStepper", "problem", "dt", "scheme", "keep")
class DynamicStepper(LoadProgram):
    r"""Implicit steps in time of elastic bodies with inertia, contact and friction.

    .. math::
        M \ddot u + C \dot u + K u + G^T \mu + T^T t = f

    by the midpoint rule, with the laws of contact for the displacement at the end of each step.
    ``K + 2 C / dt + 4 M / dt**2`` is factored once; each step is a static problem on the contact
    boundary, certified by residuals recomputed from K, M and C and by its ledger of energy. Without
    loads, supports and obstacles that vary the energy never grows, whatever dt.

    Take dt between half and the whole time that a wave needs through a cell where impact excites
    waves; a hundredth of the contact's duration where it is smooth. A larger dt is stable, and
    filters waves.

    Displacements are small against the body, except translations along flat obstacles. Loads and
    supports of the body stay; `load`, `move`, `obstacle`, ... add what varies in time, loads and
    temperatures by their values in the middle of a step, the others by those at its end.

    Parameters
    ----------
    problem : ContactProblem
        Of `ElasticBody`, one or several, and hard contact.
    density : float, array of shape (ncells,), or a list of these, one a body
        Mass per volume.
    dt : float
        Length of a step.
    scheme : {"midpoint", "stabilised"}
        "midpoint": contact nodes have no mass, which the rest of the body carries with the same
        total mass and moments; the pressure is then quiet. "stabilised": contact-stabilised
        Newmark's method with the true mass and a second problem on the boundary at each impact,
        which loses the kinetic energy of the contact nodes; for layers one element thick.
    mass : {"consistent", "lumped"}
        "lumped" for elements of first order only; "consistent" reproduces waves better.
    damping : (float, float)
        Rayleigh's a and b, ``C = a M + b K``.
    displacement, velocity : optional
        At the start: a vector (dim,), an array (ndofs,), a function x -> array of shape (dim, ...),
        or a list of these, one a body. `displacement` may be the `ContactResult` of the static
        problem. Default: zero.
    start : float
        The initial time.
    keep : int
        The fields of each keep-th step are kept; energies and forces of all.
    method, tol, max_iterations
        Of each step, as for `ContactProblem.solve`; tol also bounds what is missing in the ledger.

    Attributes
    ----------
    history : DynamicHistory
        The finished steps, also after an interruption: `run` goes on from there.

    Raises
    ------
    InputError
        An argument out of range; bodies without a mesh; compliant surfaces; a layer one element
        thick.

    References
    ----------
    H. B. Khenous, P. Laborde and Y. Renard, Eur. J. Mech. A/Solids 27 (2008), 918-932: massless
    contact nodes. C. Kane, E. A. Repetto, M. Ortiz and J. E. Marsden, Comput. Methods Appl. Mech.
    Engrg. 180 (1999), 1-26: the step. P. Deuflhard, R. Krause and S. Ertel, Int. J. Numer. Meth.
    Engng 73 (2008), 1274-1290: "stabilised".

    Examples
    --------
    A bar thrown at a wall leaves it after a wave has run to its end and back:

    >>> import numpy as np
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> mesh = MeshQuad.init_tensor(np.linspace(0, 1, 41), np.linspace(0, 0.1, 3)).with_defaults()
    >>> body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.0)
    >>> problem = ContactProblem(body, "left", 0.0)
    >>> stepper = DynamicStepper(problem, density=1.0, dt=0.02, velocity=(-0.01, 0.0))
    >>> history = stepper.run(120)
    >>> touching = history.times[history.force[:, 0] > 0]
    >>> print(round(touching[-1], 1))
    2.0
    """

    _SAME = f"density, damping, dt, initial state, {LoadProgram._SAME}"

    def __init__(
        self,
        problem: ContactProblem,
        density: ArrayLike | Sequence[ArrayLike],
        dt: float,
        *,
        scheme: str = "midpoint",
        mass: str = "consistent",
        damping: Sequence[float] = (0.0, 0.0),
        displacement: Initial = None,
        velocity: Initial = None,
        start: float = 0.0,
        keep: int = 1,
        method: str = "newton",
        tol: float | None = None,
        max_iterations: int | None = None,
    ) -> None:
        from contact.problem.contact_problem import ContactProblem

        if not isinstance(problem, ContactProblem):
            raise InputError(f"problem: expected a ContactProblem, got {type(problem).__name__}")
        if problem.overclosure:
            raise InputError("overclosure: dynamics takes hard contact; set it to None")
        if problem.surface is not None:
            raise InputError("problem: dynamics takes no adhesion, hardness or wear")
        super().__init__(problem)
        self.dt, self.scheme = positive_number("dt", dt), choice("scheme", scheme, SCHEMES)
        if not 1.0 / LIMITS.dt < self.dt < LIMITS.dt:
            raise InputError(f"dt={dt!r}: its square is beyond the range of numbers; change units")
        self.keep = integer("keep", keep, 1)
        choice("mass", mass, ("consistent", "lumped"))
        a, b = finite_numbers("damping", damping, (2,))
        if min(a, b) < 0.0:
            raise InputError(f"damping={damping!r}: expected two numbers that are not negative")
        self._start = finite_number("start", start)
        self._check_time(self._start)
        body = problem.body
        options = Options.checked(problem.law, body.dim, method, tol, max_iterations, None)
        bare = touched_dofs(problem) if scheme == SCHEMES[0] else np.zeros(body.ndofs, dtype=bool)
        each = [
            Mass(one, rho, mass, bare[own])
            for one, own, rho in zip(
                body.bodies, body.slices, of_each("density", density, body), strict=True
            )
        ]
        self._u = initial("displacement", displacement, body, each)
        self._v = initial("velocity", velocity, body, each)
        masses = Masses(body, [one.matrix for one in each])
        stabilised = scheme == SCHEMES[1]
        self._of = Integrator(problem, masses, (float(a), float(b)), self.dt, stabilised, options)
        self._settings = np.array([self.dt, a, b, self._start, stabilised, self.keep])
        self._known = self._conditions()
        self._now: Moment | None = None
        self._rows: list[Array] = []
        self._kept: list[DynamicStep] = []

    def __repr__(self) -> str:
        done = max(len(self._rows) - 1, 0)
        return f"DynamicStepper({self.problem!r}; dt={self.dt:.6g}, {self.scheme}; {done} steps)"

    def _check_time(self, t: float) -> None:
        if np.spacing(abs(t)) > LIMITS.lost * self.dt:
            raise InputError(
                f"start, dt: steps of {self.dt:.6g} are lost in the rounding of the time {t:.6g}"
            )

    def _conditions(self) -> tuple[Any, ...]:
        body = self.problem.body
        return (len(body._supports), len(body._couplings), *body.materials)

    @property
    def history(self) -> DynamicHistory:
        """The finished steps."""
        self._begin()
        times = self._start + self.dt * np.arange(float(len(self._rows)))
        return DynamicHistory(self.dt, times, np.array(self._rows), tuple(self._kept))

    def step(self) -> DynamicStep:
        """Solve one step, the next of the history.

        Returns
        -------
        DynamicStep

        Raises
        ------
        InputError
            The initial state penetrates the obstacle or contradicts the supports; the body was
            changed after the stepper was made.
        NotConverged
            The certificate or the ledger of the step fails; the history holds what was finished.
        """
        return self._step(False)

    def _step(self, last: bool) -> DynamicStep:
        begin = time.perf_counter()
        now = self._begin()
        number = len(self._rows)
        then = self._of.step(self, now, self._start + number * self.dt)
        assert then.middle is not None
        self._now = then
        self._rows.append(np.concatenate((then.energy, then.middle.resultant)))
        seconds = time.perf_counter() - begin
        step = DynamicStep(number, then.time, then.u, then.v, then.middle, seconds)
        if last or number % self.keep == 0:
            self._kept.append(step)
        return step

    def _begin(self) -> Moment:
        """The state from which the next step starts."""
        if not all(a is b for a, b in zip(self._conditions(), self._known, strict=True)):
            raise InputError(
                "body: its supports or its material were changed after the DynamicStepper was "
                "made; make a new one"
            )
        if self._now is None:
            self._now = self._initial()
            nothing = np.zeros(self.problem.body.dim)
            self._rows = [np.concatenate((self._now.energy, nothing))]
        return self._now

    def _initial(self) -> Moment:
        problem, t, h = self.problem, self._start, self.dt
        bodies = [self._body_at(t + k * h) for k in range(3)]
        now = {"obstacle": self._obstacle_at(t)} if self._obstacle else {}
        system, u, v = problem.system_of(bodies[0], **now), self._u, self._v
        size = problem.body.extent
        off = bodies[0].support_error(u)
        if off > 1e-9 * max(size, bodies[0].largest_displacement(u)):
            raise InputError(
                f"displacement: it misses the supports by {off:.3g} at t = {t:.6g}; start from "
                "the ContactResult of the static problem"
            )
        motion = None if system.motion is None else np.nan_to_num(system.motion.prescribed)
        if self._of.stabilised and system.motion is not None and np.any(system.motion.free):
            raise InputError("obstacle: one driven by a force or moment needs scheme='midpoint'")
        through = system.relative(u, motion)[0] - system.rows.gap
        deepest = float(np.where(system.rows.ties, -np.inf, through).max(initial=-np.inf))
        if deepest > 1e-9 * size:
            raise InputError(
                f"displacement: at the start the body is in the obstacle by {deepest:.3g}, which "
                "would feed energy; start from the ContactResult of the static problem, or move "
                "the obstacle away"
            )
        # Second-order differences: an error would alternate from step to step.
        u0, u1, u2 = (body.constraint[1] for body in bodies)
        given = (-1.5 * u0 + 2.0 * u1 - 0.5 * u2) / h
        v = v + bodies[0].at_supports(given - v)
        return self._of.moment(t, self._of.moved(u, v), system, motion)

    def run(
        self,
        steps: int,
        *,
        path: str | Path | None = None,
        progress: bool = False,
        callback: Progress | None = None,
    ) -> DynamicHistory:
        """Solve a number of steps.

        Parameters
        ----------
        steps : int
        path : str or Path, optional
            A folder that gets a file for each kept step and the last one, for `resume` and
            `DynamicHistory.load`; new, or empty. Only for the first run of a stepper.
        progress : bool
            Print a line for each step.
        callback : callable, optional
            Receives each `DynamicStep`.

        Returns
        -------
        DynamicHistory
            Of all steps.

        Raises
        ------
        InputError
            A folder that holds another history, or steps that were finished before; see `step`.
        NotConverged
            See `step`.
        OSError
            A step could not be written. Steps written before it stay readable.
        """
        integer("steps", steps, 1, LIMITS.steps)
        report = reporter(progress, callback)
        self._begin()
        done = len(self._rows) - 1
        self._check_time(self._start + self.dt * (done + steps))
        if path is None:
            return self._run(done + steps, None, report)
        if done:
            raise InputError("path: only the first run of a stepper writes; make a new one")
        numbers = np.append(np.arange(self.keep, steps, self.keep), steps)
        times = self._start + self.dt * numbers
        system = self.problem.system
        folder = HistoryFolder.created(as_path(path), times, system, self._fingerprint())
        with folder.locked():
            folder.prepare(0, system)
            return self._run(steps, folder, report)

    def resume(
        self, path: str | Path, *, progress: bool = False, callback: Progress | None = None
    ) -> DynamicHistory:
        """Take over the finished steps of an interrupted `run` and solve the others.

        The stepper must be built as it was then: same problem, masses, loads, motions. The steps
        are the same, bit for bit, as without the interruption.

        Parameters
        ----------
        path : str or Path
            The folder that was given to `run`.
        progress, callback
            As for `run`.

        Returns
        -------
        DynamicHistory
            Of all steps.

        Raises
        ------
        InputError
            The folder holds no dynamic history, or that of another problem; a step belongs to
            another run or was changed; another process is writing to the folder.
        """
        report = reporter(progress, callback)
        folder = self._opened(path)
        steps = round((float(folder.times[-1]) - self._start) / self.dt)
        with folder.locked():
            self._now, self._kept = None, []
            self._begin()
            for step, arrays in stored_steps(folder, self.problem.system):
                if not self._take(step, arrays):
                    raise self._another(path)  # another function of time
            folder.prepare(len(self._kept), self.problem.system)
            logger.info("resuming after %d of %d steps", len(self._rows) - 1, steps)
            return self._run(steps, folder, report)

    def _take(self, step: DynamicStep, arrays: dict[str, Array]) -> bool:
        """Continue from a stored step; whether loads, motions, obstacles and energies agree."""
        t, middle = step.time, step.result.system.motion
        now = {"obstacle": self._obstacle_at(t)} if self._obstacle else {}
        system = self.problem.system_of(self._body_at(t), **now)
        if middle is not None and middle.travel is not None:
            motion = ObstacleMotion.with_travel(system.motion, middle.travel)
            system = replace(system, motion=motion)
        then = self._of.moment(t, self._of.moved(step.u, step.v), system, arrays["motion"])
        energy, known = np.array(then.energy[:3]), arrays["table"][-1][:3]
        pairs = [(energy, known), (system.rows.gap, arrays["gap"])]
        if not all(same_values(a, b) for a, b in [*pairs, (self._varied(t), arrays["varied"])]):
            return False
        self._rows += list(arrays["table"][0 if self._kept else 1 :])
        self._kept.append(step)
        self._now = replace(then, middle=step.result)
        return True

    def _varied(self, t: float) -> Array:
        """Factors of loads and temperatures in the middle of the step that ends at t, and of moving
        supports at its end."""
        middle = [factor for _, factor in self._loads] + [factor for *_, factor in self._heats]
        found = [value_at(factor, t - 0.5 * self.dt) for factor in middle]
        return np.array(found + [value_at(factor, t) for _, factor in self._motions])

    def _vectors(self) -> list[Array]:
        masses = [np.asarray(M.data) for M in self._of.M.matrices]
        return [*super()._vectors(), self._settings, self._u, self._v, *masses]

    def _run(self, steps: int, folder: HistoryFolder | None, report: Progress) -> DynamicHistory:
        for number in range(len(self._rows), steps + 1):
            kept = len(self._kept)
            step = self._step(number == steps)
            if folder is not None and len(self._kept) > kept:
                since = self._kept[kept - 1].number + 1 if kept else 0
                assert self._now is not None
                gap, rows = self._now.end.system.rows.gap, np.array(self._rows[since:])
                values = (step.u, step.v, self._now.motion, gap, self._varied(step.time))
                folder.write(kept, step.result, arrays_of((*values, rows, np.array(self.dt))))
            report(step)
        return self.history


def touched_dofs(problem: ContactProblem) -> NDArray[np.bool_]:
    """Dofs that enter the rows of contact, without those of ties only, shape (ndofs,)."""
    rows, found = problem.rows, np.zeros(problem.body.ndofs, dtype=bool)
    free = ~rows.ties
    for matrix, live in ((rows.G, free), (rows.T, np.repeat(free, problem.body.dim - 1))):
        found[matrix[np.flatnonzero(live)].indices] = True
    return found


def of_each(name: str, given: Any, bodies: Any) -> list[Any]:
    """What is given for each of several bodies, or for all of them."""
    count = len(bodies.bodies)
    several = count > 1 and isinstance(given, list | tuple)
    if several and len(given) != count:
        raise InputError(f"{name}: {len(given)} given for {count} bodies")
    return list(given) if several else [given] * count


def initial(name: str, given: Initial, bodies: Any, masses: Sequence[Mass]) -> Array:
    """A displacement or velocity of all bodies at the start, shape (ndofs,)."""
    if isinstance(given, ContactResult):
        given = given.u
    count = len(masses)
    if isinstance(given, np.ndarray) and count > 1 and given.shape == (bodies.ndofs,):
        each: list[Any] = [given[own] for own in bodies.slices]
    elif isinstance(given, list | tuple) and any(
        v is None or callable(v) or np.ndim(v) for v in given
    ):
        each = of_each(name, given, bodies)
    else:
        each = [given] * count
    zero = np.zeros(bodies.dim)
    return np.concatenate(
        [M.field(name, zero if v is None else v) for M, v in zip(masses, each, strict=True)]
    )
