"""Histories of bodies of large strain in contact: Newton's method, step cuts, certificates."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from contact.body.several_bodies import Bodies
from contact.condensation.device_choice import chosen_device
from contact.errors import InputError, NotConverged
from contact.histories.load_history import checked_times
from contact.histories.load_program import LoadProgram, checked_factor
from contact.histories.step_history import as_path
from contact.laws.iteration import Iteration
from contact.nonlinear.arc_length import MOST_CURVED, EquilibriumPath, control_of, mean_square
from contact.nonlinear.body_forces import BodyForces
from contact.nonlinear.bulk_newton import MOST_MOVES, StepProblem, Trial, settle, solve_step
from contact.nonlinear.cell_forces import det
from contact.nonlinear.chord import Chord
from contact.nonlinear.nonlinear_body import NonlinearBody
from contact.nonlinear.nonlinear_result import NonlinearHistory, NonlinearResult, Start
from contact.nonlinear.stress_forces import FollowerPressure
from contact.nonlinear.touching import ElasticSides, RigidSide, Touch, checked_obstacle, joined
from contact.rows.interfaces import Interfaces
from skfem_adini.ground.archives import checksum, read_arrays, write_arrays
from skfem_adini.ground.arguments import finite_number, integer

Array = NDArray[np.float64]
Csr = sparse.csr_array
__all__ = ["NonlinearStepper"]
logger = logging.getLogger(__name__)
LARGEST_CHANGE = 0.6  # of the deformation gradient in a step that is not halved
SMALL = 0.1  # mean displacement gradient of bodies of small strain


class NonlinearStepper(LoadProgram):
    """Quasi-static steps of bodies of large strain in contact, on the current configuration.

    Contact acts at the current places, along the current normal of the obstacle, on current areas;
    friction opposes the slip since the last step. Each step is solved for bodies and contact
    together by Newton's method (`contact.nonlinear.bulk_newton`), certified by residuals that are
    recomputed from the forms, and halved where it does not converge. The state of the material
    changes only where a step is accepted.

    `load`, `move`, `obstacle`, ... add what varies in time, as for `LoadStepper`.

    Parameters
    ----------
    problem : ContactProblem
        With at least one `NonlinearBody`; others may be `ElasticBody`, of small strains and
        rotations. Obstacles are shapes with a place, friction is Coulomb's.
    tol : float
        Every relative residual of the certificate is at most this.
    halvings : int
        How often a step may be halved.
    device : {"cpu", "cuda", "auto"}
        Where tangents are assembled and factored: with "cuda" by CuPy and cuDSS, if the stress
        functions take arrays of CuPy, as those of NumPy's functions do; "auto" chooses, and logs
        why. The certificate is computed on the host.

    Attributes
    ----------
    history : NonlinearHistory
        The finished steps; `run` goes on from there.

    Raises
    ------
    InputError
        Another problem, an obstacle without a distance, given friction or compliant surfaces; on a
        device bodies given by forms, or a stress that does not take its arrays.
    MissingDependency
        A device without CuPy or cuDSS.

    References
    ----------
    P. Wriggers, Computational Contact Mechanics, 2nd ed., Springer 2006, chapters 4, 9 and 10.

    Examples
    --------
    A block of rubber, pressed by a fifth and dragged:

    >>> from contact import ContactProblem, NeoHooke, NonlinearBody, Plane
    >>> from skfem import MeshQuad
    >>> mesh = MeshQuad().refined(2).with_defaults()
    >>> body = NonlinearBody.from_mesh(mesh, stress=NeoHooke(mu=1.0, lam=9.0)).fix("top", "xy")
    >>> problem = ContactProblem(body, "bottom", Plane((0.0, 0.0), (0.0, 1.0)), friction=0.1)
    >>> stepper = NonlinearStepper(problem).move("top", "y", -0.2, lambda t: min(t, 1.0))
    >>> _ = stepper.move("top", "x", 0.5, lambda t: max(t - 1.0, 0.0))
    >>> last = stepper.run([0.5, 1.0, 1.5, 2.0]).results[-1]
    >>> ratio = last.resultant[0] / last.resultant[1]
    >>> round(float(ratio), 6)
    -0.1
    """

    def __init__(
        self, problem: Any, *, tol: float = 1e-9, halvings: int = 6, device: str = "cpu"
    ) -> None:
        from contact.problem.contact_problem import ContactProblem

        if not isinstance(problem, ContactProblem):
            raise InputError(f"problem: expected a ContactProblem, got {type(problem).__name__}")
        bodies = problem.body.bodies
        if not any(isinstance(body, NonlinearBody) for body in bodies):
            raise InputError("problem: it has no NonlinearBody; take LoadStepper")
        for body in bodies:
            if not hasattr(body, "basis"):
                raise InputError(
                    f"problem: a {type(body).__name__} does not go with a NonlinearBody; take "
                    "ElasticBody"
                )
        if problem.law == "tresca" or any(law is not None for law in problem.overclosure):
            raise InputError(
                "problem: large strain takes Coulomb's law or none, and hard contact; leave "
                "law='tresca' and overclosure out"
            )
        if problem.surface is not None:
            raise InputError("problem: large strain takes no adhesion, hardness or wear")
        finite_number("tol", tol)
        if not 0.0 < tol < 1e-3:
            raise InputError(f"tol={tol!r}: expected a number between 0 and 1e-3")
        integer("halvings", halvings, 0)
        super().__init__(problem)
        self.tol, self.halvings = tol, halvings
        self.history = NonlinearHistory(np.zeros(0), ())
        self._sides, self._elastic = self._read_sides()
        self._forces = BodyForces(problem.body, chosen_device(device, problem.body, problem.solver))
        self._analysis, self._chord = list[Any](), Chord()

    def pressure(
        self,
        boundary: Any,
        pressure: Any,
        factor: Callable[[float], float] | None = None,
        *,
        body: Any = None,
    ) -> Self:
        """Add the pressure ``factor(t) * pressure`` on the deformed boundary, against its normal.

        Parameters
        ----------
        boundary : str, list of str or array of facet numbers
        pressure : float or callable x -> array of shape x.shape[1:]
            Force per deformed area, positive against the outward normal; x are undeformed places.
        factor : callable t -> float, optional
            Default: t itself.
        body : body, str or int, optional
            Which one, if the problem has several.

        Returns
        -------
        NonlinearStepper
            Itself, for chaining.

        Raises
        ------
        InputError
            No such boundary, or a pressure that is not finite.
        """
        k = self._number(body)
        one = FollowerPressure(self.problem.body.bodies[k], boundary, pressure)
        self._forces.pressures.append((k, one, checked_factor(factor)))
        return self

    def _read_sides(self) -> tuple[list[tuple[int, RigidSide]], list[ElasticSides]]:
        """Sides opposite rigid obstacles with their numbers, and pairs of bodies, then ties."""
        problem, body = self.problem, self.problem.body
        given = problem.given_friction
        if problem.functional is not None or any(
            pair.functional is not None and not pair.two_bodies for pair in problem.pairs
        ):
            raise InputError(
                "functional: in large strain the contact points are the nodes; leave it out"
            )
        if not problem.pairs:
            several = getattr(problem.boundaries, "several", False)
            places: Any = problem.boundary if several else [problem.boundary]
            friction = given if several and isinstance(given, list | tuple) else None
            each = friction or [given] * len(places)
            for one in problem.opposite if several else [problem.opposite]:
                checked_obstacle(one)
            return [
                (k, RigidSide(body, 0, place, f, k))
                for k, (place, f) in enumerate(zip(places, each, strict=True))
            ], []
        rigid, free, tied = [], list[Any](), list[Any]()
        for k, pair in enumerate(problem.pairs):
            if pair.two_bodies:
                if pair.opposite.clearance is not None:
                    raise InputError(
                        "clearance: in large strain the gap is that between the meshes where the "
                        "bodies are; leave clearance out"
                    )
                (tied if problem.rows.ties[problem.rows.part == k].any() else free).append(
                    (k, pair)
                )
                continue
            checked_obstacle(pair.opposite)
            own, number = pair.friction if given is None else given, body.number_of(pair.body)
            rigid.append((k, RigidSide(body, number, pair.boundary, own, k)))
        if given is not None:
            finite_number("friction", given)
            free = [(k, replace(pair, friction=given)) for k, pair in free]
        together = body if isinstance(body, Bodies) else Bodies([body])
        each = [tuple(zip(*part, strict=True)) for part in (free, tied) if part]
        return rigid, [ElasticSides(Interfaces.of(together, p), list(k)) for k, p in each]

    def _touch_at(self, last: Start, end: float) -> Callable[[Array, Array, Array], Touch]:
        """The rows of all sides as a function of u and the forces."""
        begin = last.time if last.touch is not None else np.nan
        before, now = self._obstacle_at(begin), self._obstacle_at(end)
        said = self._said_between(begin, end)
        several = isinstance(now, list)

        def touch(u: Array, mu: Array, t: Array) -> Touch:
            parts, start = [], 0
            for k, side in self._sides:
                own = slice(start, start + side.weights.size)
                start = own.stop
                pair = (before[k], now[k]) if several else (before, now)
                there = said[k] if isinstance(said, list) and several else said
                forces = mu[own], t[own]
                if mu.size < own.stop:
                    forces = np.zeros(side.weights.size), np.zeros((side.weights.size, self._slips))
                parts.append(side.at(u, last.u, forces, pair, there))
            for elastic in self._elastic:
                parts.append(elastic.at(u, last.u, (mu[start:], t[start:])))
                start += parts[-1].gap.size
            return joined(parts)

        return touch

    @property
    def _lasting(self) -> bool:
        """Whether the tangent depends on the displacement alone, and not on the step."""
        bodies = [body for body, _ in self._forces.bodies if isinstance(body, NonlinearBody)]
        return not self._forces.pressures and not any(body.cells.rest for body in bodies)

    @property
    def _slips(self) -> int:
        return int(self.problem.body.dim - 1)

    def _start(self) -> Start:
        """The end of the last step, or the undeformed bodies."""
        if len(self.history):
            return self.history.results[-1].end
        bodies = self._forces.bodies
        states = tuple(
            body.cells.rest if isinstance(body, NonlinearBody) else {} for body, _ in bodies
        )
        u, forces = np.zeros(bodies[-1][1].stop), (np.zeros(0), np.zeros((0, self._slips)))
        rest = Start(0.0, u, *forces, states, None, u)
        return replace(rest, internal=self._forces.internal(u, states, 0.0))

    def step(self, time: float) -> NonlinearResult:
        """Solve one step, the next of the history, and keep it.

        Parameters
        ----------
        time : float
            Later than that of the last step; steps of viscous bodies take this much time. The first
            step starts at 0.

        Returns
        -------
        NonlinearResult

        Raises
        ------
        InputError
            The time is not later than that of the last step.
        NotConverged
            Not even steps halved `halvings` times converge, nor does an overdamped motion from the
            last of them come to rest; the history holds what was finished.
        """
        finite_number("time", time)
        times = self.history.times
        if time <= (times[-1] if times.size else 0.0):
            raise InputError(f"time={time!r}: expected one later than the last step, or than 0")
        return self._kept(self._advance(self._start(), float(time), self.halvings))

    def _kept(self, result: NonlinearResult) -> NonlinearResult:
        done = np.append(self.history.times, result.time)
        self.history = NonlinearHistory(done, (*self.history.results, result))
        return result

    def run(
        self,
        times: ArrayLike,
        *,
        path: str | Path | None = None,
        callback: Callable[[NonlinearResult], None] | None = None,
    ) -> NonlinearHistory:
        """Solve a step at each of the times.

        Parameters
        ----------
        times : array, shape (n,)
            Increasing, from above 0 or the last finished step.
        path : str or Path, optional
            A folder that gets a file for each finished step, for `resume`.
        callback : callable, optional
            Receives each `NonlinearResult`.

        Returns
        -------
        NonlinearHistory

        Raises
        ------
        InputError
            Times that do not increase, or a folder that holds steps already.
        NotConverged
            See `step`.
        """
        schedule = checked_times(times, self.history.times)
        return self._each((lambda t=t: self.step(float(t)) for t in schedule), path, callback)

    def _each(self, steps: Any, path: Any, callback: Any) -> NonlinearHistory:
        """Solve steps, write a file for each, and call back."""
        folder = None if path is None else as_path(path)
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            if not len(self.history) and any(folder.glob("step_*.npz")):
                raise InputError(f"path: {folder} holds a history already; resume(path) goes on")
            for k, result in enumerate(self.history.results):
                self._write(folder, k, result)
        for step in steps:
            if folder is not None:
                self._chord = Chord()  # as a resumed history begins, which is to be the same
            result = step()
            if folder is not None:
                self._write(folder, len(self.history) - 1, result)
            if callback is not None:
                callback(result)
        return self.history

    def follow(
        self,
        length: float,
        steps: int,
        *,
        control: tuple[Any, Any] | None = None,
        body: Any = None,
        path: str | Path | None = None,
        callback: Callable[[NonlinearResult], None] | None = None,
    ) -> NonlinearHistory:
        """Follow the path of equilibrium past limit points, by steps whose time is found.

        Loads and pressures vary with it, supports and obstacles must stay; materials that depend on
        rates are refused. Branches that begin at a bifurcation are not looked for.

        Parameters
        ----------
        length : float
            Of each step: root mean square displacement of the nodes along the last step, at first
            along the tangent of rising time. With `control` the change of that displacement.
        steps : int
        control : (boundary, component), optional
            The mean displacement of a boundary's nodes is prescribed instead of the arc's length,
            for instance ``("top", "y")``.
        body : body, str or int, optional
            That of the boundary, if the problem has several.
        path, callback
            As for `run`; ``resume(path)`` takes the steps over.

        Returns
        -------
        NonlinearHistory
            ``times`` are the times found, which may fall.

        Raises
        ------
        InputError
            Nothing varies in time but supports or an obstacle, or a material depends on rates.
        NotConverged
            Not even steps halved `halvings` times converge.

        References
        ----------
        E. Riks, An incremental approach to the solution of snapping and buckling problems, Int. J.
        Solids Struct. 15 (1979), 529-551.
        """
        finite_number("length", length)
        integer("steps", steps, 1)
        if length == 0.0 or (control is None and length < 0.0):
            raise InputError(f"length={length!r}: expected a positive number")
        self._refuse_rates()
        row = None
        if control is not None:
            if not isinstance(control, tuple) or len(control) != 2:
                raise InputError(f"control={control!r}: expected (boundary, component)")
            own = self._forces.bodies[self._number(body)]
            row = control_of(*own, self.problem.body.slices[-1].stop, *control)

        def step() -> NonlinearResult:
            way = None
            if len(self.history):
                last = self.history.results[-1]
                way = last.u - last.before.u
            return self._kept(self._along(self._start(), way, length, row, self.halvings))

        return self._each((step for _ in range(steps)), path, callback)

    def _refuse_rates(self) -> None:
        """Raise InputError if the forces of a body depend on the time that a step takes, or if an
        obstacle moves."""
        if self._obstacle:
            raise InputError("follow: obstacles stay where they are; use run(times) to move them")
        for body, _ in self._forces.bodies:
            if isinstance(body, NonlinearBody):
                u = np.random.default_rng(0).uniform(-1.0, 1.0, body.ndofs)
                u *= 1e-3 * body.extent / body.mesh.nelements
                slow, fast = (body.cells.at(u, body.cells.rest, dt) for dt in (1.0, 1e-3))
                if np.abs(slow - fast).max() > 1e-9 * np.abs(slow).max():
                    raise InputError("follow: the material depends on rates, but time is unknown")

    def _along(
        self, last: Start, way: Array | None, length: float, row: Array | None, halvings: int
    ) -> NonlinearResult:
        """A step of the path, or two halves of it; `way` is the displacement of the last step."""
        failure: NotConverged | str = "the path bends too much for one step"
        try:
            result = self._followed(last, way, length, row)
            change = np.sqrt(self._mean_square @ (result.u - last.u) ** 2)
            bends = row is None and change > MOST_CURVED * length
            if halvings == 0 or not (
                bends or self._forces.largest_change(last.u, result.u) > LARGEST_CHANGE
            ):
                return result
        except NotConverged as error:
            if halvings == 0:
                raise
            failure = error
        logger.info("after t = %g: %s; the step along the path is halved", last.time, failure)
        half = self._along(last, way, 0.5 * length, row, halvings - 1)
        way = half.u - half.before.u
        return after(half, self._along(half.end, way, 0.5 * length, row, halvings - 1))

    def _followed(
        self, last: Start, way: Array | None, length: float, row: Array | None
    ) -> NonlinearResult:
        path = EquilibriumPath(
            lambda time: self._step_problem(last, time), last.time, last.u, row, length
        )
        if row is None:
            path.check()
            way = path.tangent() if way is None else way
            weighted = self._mean_square * way
            path = replace(path, direction=weighted / np.sqrt(weighted @ way))
        lines = list[Iteration]()
        start = np.append(last.u, 0.0), last.mu, last.t, last.touch
        now, scale = solve_step(path.problem(), start, self.tol, report=lines.append)
        end = path.time_of(now.u)
        step = self._step_problem(last, end)
        if np.abs(step.u0 - path.at(last.time).u0).max(initial=0.0) > 0.0:
            raise InputError("follow: supports stay where they are; use run(times) to move them")
        now = step.trial(now.u[:-1], now.mu, now.t, now.touch)
        return self._certified(step, last, end, now, scale, tuple(lines))

    @cached_property
    def _mean_square(self) -> Array:
        return mean_square(self.problem.body.bodies)

    def resume(self, path: str | Path, times: ArrayLike | None = None) -> NonlinearHistory:
        """Take over the finished steps of an interrupted `run`, certify them, and go on.

        Parameters
        ----------
        path : str or Path
            The folder that was given to `run`; the stepper is built as it was then.
        times : array, shape (n,)
            All times of the run, finished ones included. None: the steps are taken over only,
            as those of `follow`.

        Returns
        -------
        NonlinearHistory

        Raises
        ------
        InputError
            The folder holds steps of another problem, or of other times.
        """
        folder = as_path(path)
        schedule = None if times is None else checked_times(times, np.zeros(0))
        self.history = NonlinearHistory(np.zeros(0), ())
        for k, file in enumerate(sorted(folder.glob("step_*.npz"))):
            known, _ = read_arrays(file)
            another = InputError(f"path: {file} is a step of another problem, or of other times")
            if str(known["of"]) != self._fingerprint():
                raise another
            if schedule is not None and float(known["time"]) not in schedule[k : k + 1]:
                raise another
            self._kept(self._read(known))
        if schedule is None:
            return self.history
        left = schedule[len(self.history) :]
        return self.run(left, path=folder) if left.size else self.history

    def _write(self, folder: Path, k: int, result: NonlinearResult) -> None:
        """Write a step: its end, and what its last part started from."""
        arrays = {"time": np.array(result.time), "of": np.array(self._fingerprint())}
        arrays["scale"] = result.scale
        for name, point in (("begin", result.before), ("end", result.end)):
            arrays[f"{name}/time"] = np.array(point.time)
            arrays |= {f"{name}/{n}": getattr(point, n) for n in ("u", "mu", "t", "internal")}
            for number, state in enumerate(point.states):
                arrays |= {f"{name}/{number}/{n}": value for n, value in state.items()}
        write_arrays(folder / f"step_{k:05d}.npz", arrays)

    def _read(self, known: dict[str, Any]) -> NonlinearResult:
        """A step from a file, certified anew."""
        begin, end = (
            Start(
                float(known[f"{name}/time"]),
                known[f"{name}/u"],
                known[f"{name}/mu"],
                known[f"{name}/t"],
                tuple(
                    {n: known[f"{name}/{k}/{n}"] for n in body.cells.rest}
                    if isinstance(body, NonlinearBody)
                    else {}
                    for k, (body, _) in enumerate(self._forces.bodies)
                ),
                None,
                known[f"{name}/internal"],
            )
            for name in ("begin", "end")
        )
        step = self._step_problem(begin, end.time)
        trial = step.trial(end.u, end.mu, end.t)
        return self._certified(step, begin, end.time, trial, known["scale"], ())

    def _fingerprint(self) -> str:
        """Checksum of the problem, of its program's vectors, and of sample stresses."""
        arrays: dict[str, Array] = {"friction": self.problem.friction}
        rng = np.random.default_rng(1)
        for k, (body, _) in enumerate(self._forces.bodies):
            arrays |= {f"{k}/p": body.mesh.p, f"{k}/t": body.mesh.t, f"{k}/f": body.f}
            u = 1e-3 * body.extent / body.mesh.nelements * rng.standard_normal(body.ndofs)
            if isinstance(body, NonlinearBody):
                forces = body.cells.at(u, body.cells.rest, 1.0)
            else:
                forces = body.stiffness @ u
            size = np.abs(forces).max() or 1.0
            arrays[f"{k}/stress"] = np.asarray(np.round(forces / size, 6) + 0.0, dtype=float)
            arrays[f"{k}/size"] = np.array(float(f"{size:.6g}"))
        vectors = [vector for vector, _ in (*self._loads, *self._motions)]
        for k, one, _ in self._forces.pressures:
            vectors.append(one.at(np.zeros(self.problem.body.bodies[k].ndofs), {}, 0.0))
        return checksum(arrays | {f"vector/{i}": v for i, v in enumerate(vectors)})

    def _advance(self, last: Start, end: float, halvings: int) -> NonlinearResult:
        failure: NotConverged | str = "the deformation changes too much for one step"
        try:
            result = self._found(last, end, halvings)
            if halvings == 0 or self._forces.largest_change(last.u, result.u) <= LARGEST_CHANGE:
                return result
        except NotConverged as error:
            if halvings == 0:
                raise
            failure = error
        middle = 0.5 * (last.time + end)
        logger.info("t = %g: %s; halved, by way of t = %g", end, failure, middle)
        half = self._advance(last, middle, halvings - 1)
        return after(half, self._advance(half.end, end, halvings - 1))

    def _found(self, last: Start, end: float, halvings: int) -> NonlinearResult:
        """A step by Newton's method, or by an overdamped motion: by a few of its moves where half
        of the halvings did not help, by many where none did."""
        try:
            return self._solved(last, end)
        except NotConverged as error:
            if halvings not in (0, self.halvings // 2):
                raise
            failure = error
        moves = MOST_MOVES if halvings == 0 else MOST_MOVES // 10
        try:
            result = self._solved(last, end, partial(settle, moves=moves))
        except NotConverged as error:
            why = str(error).removeprefix("large strain: ")
            raise NotConverged(
                f"{failure}. From t = {last.time:g} not even a step to {end:g} was found: {why}. "
                f"There the least det F is {self._forces.place_of_least(last.u)}. Where cells fold "
                "take a finer mesh, and name all sides that may touch; past a greatest load use "
                "follow(...); otherwise try other times or less friction",
                error.history,
            ) from failure
        if halvings == 0:
            logger.warning(
                "t = %g: Newton's method found no equilibrium near that of t = %g, an overdamped "
                "motion from there came to rest at one: the body may have snapped, or friction "
                "given way",
                *(end, last.time),
            )
        return result

    def _step_problem(self, last: Start, end: float) -> StepProblem:
        body, dt = self._body_at(end), end - last.time
        return StepProblem(
            load=self._forces.pressed(body.loads, end),
            free=self._forces.free,
            u0=body.constraint[1],
            picked=Csr(sparse.block_diag([one.picked for one in body.bodies], format="csr")),
            lengths=np.concatenate([one.lengths[1] for one in body.bodies]),
            extent=body.extent,
            stiffness=self._forces.stiffness[0],
            of_cells=self._forces.stiffness[1],
            internal=lambda u: self._forces.internal(u, last.states, dt),
            tangent=lambda u: self._forces.tangent(u, last.states, dt, end),
            touch=self._touch_at(last, end),
            order=self._forces.order,
            kept=np.zeros(0, dtype=np.int64),
            analysis=self._analysis,
            least_volume=self._forces.least_volume,
            chord=self._chord if self._lasting else Chord(),
        )

    def _solved(self, last: Start, end: float, solve: Any = solve_step) -> NonlinearResult:
        step, lines = self._step_problem(last, end), list[Iteration]()

        def report(line: Iteration) -> None:
            lines.append(line)
            logger.info("t = %g: %s", end, line)

        start = last.u, last.mu, last.t, last.touch
        now, scale = solve(step, start, self.tol, report=report)
        return self._certified(step, last, end, now, scale, tuple(lines))

    def _certified(
        self,
        step: StepProblem,
        last: Start,
        end: float,
        now: Trial,
        scale: Array,
        lines: tuple[Iteration, ...],
    ) -> NonlinearResult:
        """The result with residuals recomputed from the forms.
        Raises NotConverged if one exceeds the tolerance, or a cell is inverted."""
        u, dt = now.u, end - last.time
        now = now._replace(internal=self._forces.internal(u, last.states, dt, recomputed=True))
        found = step.residuals(now, scale)
        missed = {name: value for name, value in found.items() if not value <= self.tol}
        if missed:
            said = ", ".join(f"{name} {value:.1e}" for name, value in missed.items())
            raise NotConverged(f"large strain: the step fails its certificate: {said}", lines)
        self._refuse_large_rotations(u)
        ranges = [det(F) for corners in (False, True) for F in self._forces.gradients(u, corners)]
        found["det_F_min"] = min(float(J.min()) for J in ranges)
        found["det_F_max"] = max(float(J.max()) for J in ranges)
        if not found["det_F_min"] > 0.0:
            raise NotConverged(
                f"large strain: a cell folds, det F is {self._forces.place_of_least(u)}; take "
                "smaller steps, or a finer mesh there, and name all sides that may touch as "
                "contact boundaries",
                lines,
            )
        states = tuple(
            body.cells.updated(u[own], last.states[k], dt)
            if isinstance(body, NonlinearBody)
            else {}
            for k, (body, own) in enumerate(self._forces.bodies)
        )
        found["work"] = self._work_defect(u, now, last)
        values = (self.problem, end, u, now.mu, now.t, states, now.touch, now.internal, now.load)
        return NonlinearResult(*values, scale, found, lines, last)

    def _refuse_large_rotations(self, u: Array) -> None:
        """Raise InputError if a linear body strains or turns too much for its theory."""
        for k, (body, own) in enumerate(self._forces.bodies):
            if isinstance(body, NonlinearBody):
                continue
            H, dx = body.gradients(u[own]), body.measure
            size = float(np.sqrt((np.sum(H**2, axis=(0, 1)) * dx).sum() / dx.sum()))
            if size > SMALL:
                raise InputError(
                    f"bodies: the displacement gradient of {self.problem.body.called(k)}, an "
                    f"ElasticBody, has the mean {size:.2g}, too large for small strains (up to "
                    f"{SMALL}); take NonlinearBody.from_mesh(..., stress=SaintVenant(E, nu))"
                )

    def _work_defect(self, u: Array, now: Trial, last: Start) -> float:
        """Work of the internal forces by the trapezoidal rule minus the change of energy, over the
        work; NaN if an energy is unknown."""
        change = u - last.u
        work = 0.5 * float((now.internal + last.internal) @ change)
        stored = 0.0
        for body, own in self._forces.bodies:
            for sign, v in ((1.0, u[own]), (-1.0, last.u[own])):
                if isinstance(body, NonlinearBody):
                    stored += sign * body.cells.energy(v)
                else:
                    stored += sign * 0.5 * float(v @ (body.stiffness @ v))
        size = 0.5 * float(np.abs(now.internal + last.internal) @ np.abs(change))
        return (work - stored) / (size or 1.0)


def after(half: NonlinearResult, result: NonlinearResult) -> NonlinearResult:
    """The second half of a step with the iterations of both."""
    return replace(result, history=(*half.history, *result.history))
