"""Quasi-static load histories: successive steps, because friction depends on the path."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.derivatives.gradient import ContactGradient
from contact.derivatives.history_gradient import Backward
from contact.errors import InputError, NotConverged
from contact.histories.finite_sliding import FiniteSliding
from contact.histories.history_folder import HistoryFolder, same_conditions, same_path
from contact.histories.load_history import LoadHistory, LoadStep, checked_times
from contact.histories.load_program import LoadProgram
from contact.histories.step_history import as_path, reporter
from contact.laws.options import Options
from contact.portable import Origin
from contact.problem.large_motion import check_motion, with_jump
from contact.problem.sagitta import warn_of_sagitta
from contact.problem.solve_system import solve_system
from contact.result.contact_result import ContactResult
from contact.settled import settled
from skfem_adini.ground.arguments import choice, finite_number, integer, keywords_named

if TYPE_CHECKING:
    from contact.problem.contact_problem import ContactProblem

Array = NDArray[np.float64]
Boundary = str | Sequence[str] | ArrayLike
Progress = Callable[["LoadStep"], None]
Report = Callable[[LoadStep], None]
logger = logging.getLogger(__name__)


@settled("make a new LoadStepper", "problem")
class LoadStepper(LoadProgram):
    r"""Quasi-static steps of a contact problem along a history of loads, supports and obstacles.

    Friction depends on the path: in step k it opposes the slip increment since the last converged
    step (backward Euler in the load),

    .. math::
        |t^k| \le g^k, \qquad t^k = g^k\, \Delta u_t / |\Delta u_t| \ \text{where}\
        \Delta u_t = u_t^k - u_t^{k-1} \ne 0,

    with :math:`g = F p^k` (Coulomb) or given (Tresca), and :math:`u_t^0 = 0` in the state of rest.
    The body is factored once for the whole history, each step starts from the last, and every step
    is certified on its own.

    Loads and supports of the body stay; `load`, `move`, `obstacle`, ... add what varies in time.

    Parameters
    ----------
    problem : ContactProblem
    method, tol, max_iterations
        Of each step, as for `ContactProblem.solve`.
    halvings : int
        How often a step that does not converge may be halved, at times between the given ones.
    sliding : {"small", "finite"}
        "finite" recomputes in every step which points face each other, for bodies that slide by
        more than a facet on each other or on rigid shapes, which may move and turn by any amount,
        as functions of time (`obstacle`) or under the motions and forces of a `Rigid`; see
        `contact.histories.finite_sliding`. Tied boundaries and gaps given as numbers or functions
        keep their rows.
    largest_rotation : float, optional
        Largest rotation in radians of a sliding body or its contact boundary; larger ones are
        refused.
        A rotation causes a spurious strain of 1 - cos: 5e-3 for the default, 0.1.

    Attributes
    ----------
    history : LoadHistory
        The finished steps, also after an interruption: `run` goes on from there.

    Raises
    ------
    InputError
        Not a problem, or options that `ContactProblem.solve` refuses.

    References
    ----------
    P. Wriggers, Computational Contact Mechanics, 2nd ed., Springer 2006, section 5.2.

    Examples
    --------
    Pressed, then dragged to and fro; on the way back the shear force differs:

    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> body = body.fix("top", "xy")
    >>> stepper = LoadStepper(ContactProblem(body, "bottom", 0.0, friction=0.5))
    >>> _ = stepper.move("top", "y", -0.02)
    >>> _ = stepper.move("top", "x", 0.1, lambda t: min(t, 2 - t))
    >>> history = stepper.run([0.5, 1.0, 1.5])
    >>> forward, _, back = (step.resultant[0] for step in history.results)
    >>> bool(forward < 0 < back)
    True
    """

    @keywords_named
    def __init__(
        self,
        problem: ContactProblem,
        *,
        method: str = "newton",
        tol: float | None = None,
        max_iterations: int | None = None,
        halvings: int = 4,
        sliding: str = "small",
        largest_rotation: float | None = None,
    ) -> None:
        from contact.problem.contact_problem import ContactProblem

        if not isinstance(problem, ContactProblem):
            raise InputError(f"problem: expected a ContactProblem, got {type(problem).__name__}")
        integer("halvings", halvings, 0)
        choice("sliding", sliding, ("small", "finite"))
        if largest_rotation is not None and sliding == "small":
            raise InputError("largest_rotation: it belongs to sliding='finite'")
        super().__init__(problem)
        self.halvings = halvings
        self._finite = FiniteSliding(problem, largest_rotation) if sliding == "finite" else None
        self.options = Options.checked(
            problem.law, problem.body.dim, method, tol, max_iterations, None
        )
        self.history = LoadHistory()
        self._supports = self._conditions()

    def _conditions(self) -> tuple[int, int]:
        body = self.problem.body
        return len(body._supports), len(body._couplings)

    def __repr__(self) -> str:
        varied = len(self._loads) + len(self._motions) + len(self._obstacle)
        return f"LoadStepper({self.problem!r}; {varied} vary; {len(self.history)} steps finished)"

    def step(self, time: float) -> ContactResult:
        """Solve one step, the next of the history, and keep it.

        Parameters
        ----------
        time : float
            Later than that of the last step.

        Returns
        -------
        ContactResult

        Raises
        ------
        InputError
            The time is not finite, or not later than that of the last step.
        NotConverged
            Not even steps halved `halvings` times converge; the history holds what was finished.
        """
        if self._conditions() != self._supports:
            raise InputError(
                "body: it was fixed elsewhere after the LoadStepper was made; make a new one"
            )
        times = self.history.times
        finite_number("time", time)
        if times.size and time <= times[-1]:
            raise InputError(f"time={time!r}: the history has reached {times[-1]} already")
        last = self.history.results[-1] if times.size else None
        begin = float(times[-1]) if times.size else np.nan
        result = self._advance(last, begin, float(time), self.halvings)
        self.history = self.history.extended(float(time), result)
        return result

    def run(
        self,
        times: ArrayLike,
        *,
        path: str | Path | None = None,
        progress: bool = False,
        callback: Progress | None = None,
    ) -> LoadHistory:
        """Solve a step at each of the times.

        Parameters
        ----------
        times : array, shape (n,)
            Increasing, later than the steps that are finished.
        path : str or Path, optional
            A folder that gets a file for each finished step, for `resume` and
            `LoadHistory.load`; new, or empty. One process writes there at a time.
        progress : bool
            Print a line for each step.
        callback : callable, optional
            Receives each `LoadStep`.

        Returns
        -------
        LoadHistory

        Raises
        ------
        InputError
            Times that do not increase; a folder that holds another history.
        NotConverged
            See `step`.
        OSError
            A step could not be written. Steps written before it stay readable.
        """
        schedule, report = checked_times(times, self.history.times), reporter(progress, callback)
        if path is None:
            return self._run(schedule, None, report)
        everything = np.concatenate((self.history.times, schedule))
        system = self.problem.system
        folder = HistoryFolder.created(as_path(path), everything, system, self._fingerprint())
        with folder.locked():
            folder.prepare(0, system)
            for k in range(len(self.history)):
                folder.write(k, self.history.results[k])
            return self._run(schedule, folder, report)

    def vjp(
        self,
        times: ArrayLike,
        cotangents: Callable[[int, ContactResult], dict[str, Any]],
        collect: Callable[[int, ContactGradient], Any],
        keep: int = 0,
    ) -> None:
        """Gradients of a function of a long history, of which few states are in memory.

        The steps are solved as by `run`, but only every `keep`-th result is kept; the others are
        solved again on the way back. The history of the stepper stays as it is.

        Parameters
        ----------
        times : array, shape (n,)
            Increasing, from the state of rest.
        cotangents : callable
            (number, result) to a dict: the arguments of `ContactResult.vjp`, the derivatives of the
            function by the parts of this step.
        collect : callable
            Receives (number, `ContactGradient`) of each step, the last one first.
        keep : int
            Steps from one kept result to the next. Default: 0, the root of their number, with which
            fewest are in memory.

        Raises
        ------
        InputError
            Times that do not increase, `keep` negative, or as for `ContactResult.vjp`.
        NotConverged
            A step does not converge, and steps must not be halved here; or as for
            `ContactResult.vjp`.

        Warns
        -----
        ContactWarning
            As for `ContactResult.vjp`.

        Examples
        --------
        By how much the shear force of the last of fifty steps grows with friction:

        >>> from skfem import MeshQuad
        >>> from contact import ContactProblem, ElasticBody, LoadStepper
        >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
        >>> problem = ContactProblem(body.fix("top", "xy"), "bottom", 0.0, friction=0.2)
        >>> stepper = LoadStepper(problem).move("top", "y", -0.02, lambda t: min(1.0, 5 * t))
        >>> stepper, found = stepper.move("top", "x", 0.1), []
        >>> stepper.vjp(
        ...     [0.02 * (k + 1) for k in range(50)],
        ...     lambda k, result: {"resultant": (-1.0 if k == 49 else 0.0, 0.0)},
        ...     lambda k, gradient: found.append(float(gradient.friction.sum())),
        ... )
        >>> len(found), sum(found) > 0.01
        (50, True)
        """
        schedule, every = checked_times(times, np.zeros(0)), integer("keep", keep, 0)
        every = every or max(int(np.sqrt(schedule.size)), 1)
        kept: dict[int, ContactResult | None] = {-1: None}

        def solved(k: int, last: ContactResult | None) -> ContactResult:
            return self._advance(last, float(schedule[k - 1]) if k else np.nan,
                                 float(schedule[k]), 0)  # fmt: skip

        last: ContactResult | None = None
        for k in range(schedule.size):
            last = solved(k, last)
            if (k + 1) % every == 0:
                kept[k] = last
        backward = Backward()
        for begin in range((schedule.size - 1) // every * every, -1, -every):
            last, part = kept.pop(begin - 1), []
            for k in range(begin, min(begin + every, schedule.size)):
                last = solved(k, last)
                part.append(last)
            for k in range(begin + len(part) - 1, begin - 1, -1):
                result = part.pop()
                before = part[-1] if part else kept.get(begin - 1)
                collect(k, backward.step(result, before, cotangents(k, result)))

    def resume(
        self,
        path: str | Path,
        *,
        progress: bool = False,
        callback: Progress | None = None,
    ) -> LoadHistory:
        """Take over the finished steps of an interrupted `run` and solve the others.

        The stepper must be built as it was then: same problem, loads, motions.

        Parameters
        ----------
        path : str or Path
            The folder that was given to `run`.
        progress, callback
            As for `run`.

        Returns
        -------
        LoadHistory
            Of all steps.

        Raises
        ------
        InputError
            The folder holds no history, or that of another problem; a step belongs to another run
            or was changed; another process is writing to the folder.
        """
        report = reporter(progress, callback)
        folder = self._opened(path)
        with folder.locked():
            history, last, begin = LoadHistory(), None, np.nan
            for t, result in zip(folder.times, folder.finished(self.problem.system), strict=False):
                if not self._belongs(last, result, begin, float(t)):
                    raise self._another(path)  # different function of time
                last, begin = result, float(t)
                history = history.extended(float(t), result)
            folder.prepare(len(history), self.problem.system)
            self.history = history
            left = folder.times[len(self.history) :]
            logger.info("resuming after %d of %d steps", len(self.history), folder.times.size)
            return self._run(left, folder, report)

    def _belongs(
        self, last: ContactResult | None, result: ContactResult, begin: float, end: float
    ) -> bool:
        """Whether a step from a file has the loads, supports and obstacles of this history."""
        body = self._body_at(end)
        if self._finite is not None:
            now = self._finite.system_at(
                body, last, result, self._moving(np.nan if last is None else begin, end)
            )
            return same_conditions(now, result.system) and same_path(now, result.system)
        moving = {"obstacle": self._obstacle_at(end)} if self._obstacle else {}
        now = self.problem.system_of(body, **moving)
        return same_conditions(now, result.system) and self._travels_so(last, result, begin, end)

    def _travels_so(
        self, last: ContactResult | None, result: ContactResult, begin: float, end: float
    ) -> bool:
        """Whether obstacles travel along the boundary as in a step from a file; halved steps
        followed a curved path, whose length bounds the difference."""
        if not self._obstacle:
            return True
        rows = self.problem.rows
        rest = np.zeros((rows.gap.size, rows.tangents.shape[1]))

        def path(times: Array) -> Array:
            total = rest
            for a, b in pairwise(times):
                where, said = (self._obstacle_at(a), self._obstacle_at(b)), self._said_between(a, b)
                known = {"unchanged": rest[:, 0] == 0, "felt": rest[:, 0]}  # else it was refused
                total = total + self.problem.boundaries.travel(*where, said, **known)
            return total

        def stored(step: ContactResult | None) -> Array:
            motion = None if step is None else step.system.motion
            return rest if motion is None or motion.travel is None else motion.travel

        direct, found = path(np.array([begin, end])), stored(result) - stored(last)
        curve = rest
        if last is not None and self.halvings:
            curve = np.abs(path(np.linspace(begin, end, 2**self.halvings + 1)) - direct)
        size = max(np.abs(part).max(initial=0.0) for part in (direct, stored(result)))
        return bool(np.all(np.abs(found - direct) <= 2 * curve + 1e-9 * size))

    def _run(self, schedule: Array, folder: HistoryFolder | None, report: Report) -> LoadHistory:
        count = len(self.history) + schedule.size
        for t in schedule:
            begin = time.perf_counter()
            result = self.step(float(t))
            number = len(self.history)
            if folder is not None:
                folder.write(number - 1, result)
            report(LoadStep(number, count, float(t), result, time.perf_counter() - begin))
        return self.history

    def _advance(
        self, last: ContactResult | None, begin: float, end: float, halvings: int
    ) -> ContactResult:
        try:
            if self._finite is not None:
                near = None if last is None else self._extrapolated(last, begin, end).u
                moving = self._moving(np.nan if last is None else begin, end)
                body = self._body_at(end)
                result = self._finite.step(body, last, near, self.options, moving)
                opposite = moving.get("obstacle", self.problem.opposite)
                follow = self._finite.following(result, opposite)
                check_motion(result, self.problem.boundaries, opposite, follow)
                return with_jump(result, last, far=True)
            return self._small_step(last, begin, end)
        except NotConverged:
            if halvings == 0 or last is None:
                raise
        middle = 0.5 * (begin + end)
        logger.info("no convergence at t = %g: by way of t = %g", end, middle)
        last = self._advance(last, begin, middle, halvings - 1)
        return self._advance(last, middle, end, halvings - 1)

    def _small_step(self, last: ContactResult | None, begin: float, end: float) -> ContactResult:
        self.problem.condense()  # the body now computes on the device of the condensation
        start = last if last is None else self._extrapolated(last, begin, end)
        result = self._solved(self._body_at(end), last, begin, end, start)
        result = with_jump(result, last)
        self._check(result)
        vars(result)["origin"] = Origin(self.problem)
        return result

    def _solved(
        self, body: Any, last: ContactResult | None, begin: float, end: float, start: Any
    ) -> ContactResult:
        """The contact of a body under the loads of a step of small sliding, solved from `start`."""
        problem, moving = self.problem, self._moving(np.nan if last is None else begin, end)
        if last is not None and not moving:  # a step from a file has no obstacle
            moving = {"since": problem.opposite}
        system = problem.system_of(body, last, **moving)
        condensed = problem.condense().under(system.body)
        return solve_system(system, condensed, self.options, start)

    def _check(self, result: ContactResult) -> None:
        """Warn, or raise, where a result of small sliding moved too far along its obstacles."""
        boundaries, system = self.problem.boundaries, result.system
        check_motion(result, boundaries, system.obstacle)
        condensed = self.problem.condense().under(system.body)
        warn_of_sagitta(result, boundaries.rise(system.obstacle), condensed, self.options)

    def _extrapolated(self, last: ContactResult, begin: float, end: float) -> ContactResult:
        """Linear extrapolation of the last two steps: a start that saves about one Newton step."""
        if len(self.history) < 2 or self.history.times[-1] != begin:
            return last
        before = self.history.results[-2]
        ahead = (end - begin) / (begin - float(self.history.times[-2]))
        if before.mu.shape != last.mu.shape or ahead > 2.0:
            return last
        mu, surface = last.mu + ahead * (last.mu - before.mu), last.system.surface
        mu = mu if surface is not None and surface.adhesion else np.maximum(mu, 0.0)
        t, u = last.t + ahead * (last.t - before.t), last.u + ahead * (last.u - before.u)
        return replace(last, mu=mu, t=t, u=u)
