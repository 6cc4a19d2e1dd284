"""What all solvers do: steps, runs with their records, sources, reactions and limiters by field."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from inspect import signature
from typing import Any

import numpy as np

from cip.characteristics.feet import signed_step
from cip.errors import InputError
from cip.formulas.formula import Formula
from cip.formulas.parameters import Parametrised
from cip.formulas.source import Source
from cip.output.budget import Tally, budget_of, masses
from cip.output.recorder import Recorder
from cip.output.trajectory import Trajectory
from cip.solver.scheme import (
    Form,
    Scheme,
    advanced,
    bounds_of,
    check_bounded,
    check_state,
    is_by_field,
    mapped,
    of_field,
    parameters_of,
    with_values,
)
from cip.solver.time_loop import checked_callback, output_times, run, step_length
from cip.sources.diffusion import diffusion as spread
from cip.sources.kinetics import Kinetics, kinetics
from cip.sources.reaction import Reaction
from cip.stages.state import State
from skfem_adini.ground.arguments import flag, keywords_named, real_number


class Runs(Parametrised):
    """Base of solvers. One has a `grid`, `velocity`, `form`, `profile`, `limiter`, an engine
    `_kernels`, and the methods without a body here."""

    _kind = "solver"
    _kernels: Any
    _sea: Any = None
    _boundary: Any = None
    grid: Any
    velocity: Any
    form: Form
    land: Any = None
    profile: str
    limiter: str | None
    foot_tolerance: float | None
    bounds_tolerance: float = 1e-14

    def _set_terms(
        self, source: Any, decay: Any, diffusion: Any, reactions: Any, bounds: Any, boundary: Any
    ) -> None:
        """Take the terms beside the transport, each for all fields or by field."""
        self.source = mapped(source, lambda one: Source.of(one, "source"))
        self.decay = mapped(decay, lambda one: Source.of(one, "decay"))
        self.bounds = mapped(bounds, bounds_of)
        self._parameters = parameters_of(self.velocity, self.source, self.decay, boundary)
        own = {
            "source": source, "decay": decay, "boundary": boundary, "bounds": bounds,
            "diffusion": diffusion, "reactions": reactions,
        }  # fmt: skip
        self._named = {name: tuple(one) for name, one in own.items() if is_by_field(one)}
        if reactions is not None and "reactions" not in self._named:
            raise InputError(f"reactions: expected formulas by names of fields, got {reactions!r}")
        self.reactions = None if reactions is None else dict(reactions)
        self._kinetics: dict[tuple[str, ...], Kinetics | None] = {}
        self._schemes: dict[tuple[str, ...], Scheme] = {}

    def _first_scheme(self, diffusion: Any) -> Scheme:
        """Take the diffusion, which needs the engine; the scheme of the fields that arguments
        name."""
        self.diffusion = mapped(diffusion, lambda one: getattr(self._spread(one), "rates", None))
        return self._scheme(tuple(dict.fromkeys(sum(self._named.values(), ()))))

    def _acting(self, field: str) -> tuple[Reaction | None, list[Any], tuple[float, float]]:
        """Source with decay of a field, all that acts beside the transport, and its bounds."""
        xp = self._kernels.xp
        source, decay = of_field(self.source, field), of_field(self.decay, field)
        made = None
        if source is not None or decay is not None:
            made = Reaction(self.grid, self.profile, source, decay, xp)
        spreads = self._spread(of_field(self.diffusion, field))
        bounds = (self.limiter == "bounds" and of_field(self.bounds, field)) or (-np.inf, np.inf)
        return made, [one for one in (made, spreads) if one is not None], bounds

    def _spread(self, value: Any) -> Any:
        """The diffusion of a field."""
        limited = self.limiter is not None
        return spread(self.grid, self.profile, value, limited, self._kernels.xp)

    def _kinetics_of(self, fields: tuple[str, ...]) -> Kinetics | None:
        """The reactions between fields of these names."""
        if fields not in self._kinetics:
            made = kinetics(self.grid, self.profile, fields, self.reactions, self._kernels.xp)
            self._kinetics[fields] = made
        return self._kinetics[fields]

    def _arguments(self, boundary: Any) -> tuple[Any, ...]:
        """Arguments of the constructor, from the attributes of their names, to make a copy."""
        given = vars(self) | {"boundary": boundary, "sphere": self.grid}
        return tuple(given[name] for name in signature(type(self)).parameters)

    def _portable(self) -> tuple[Any, ...]:
        """The same as they can be pickled."""
        return self._arguments(self._boundary)

    def __reduce__(self) -> Any:
        return type(self), self._portable()

    def _with(self, values: dict[str, float]) -> Any:
        return type(self)(*(with_values(one, values) for one in self._arguments(self._boundary)))

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        return type(self)(*deepcopy(self._arguments(self._boundary), memo))

    def _scheme(self, fields: tuple[str, ...]) -> Scheme:
        """The stages for a state of these fields, and what holds for each of them."""
        raise NotImplementedError

    def _time_scale(self, t: float) -> float:
        """The time in which the fastest node moves by a cell."""
        raise NotImplementedError

    def _velocity_at(self, point: list[Any], times: Sequence[float]) -> Any:
        """The velocity at some points, as numbers in lists."""
        raise NotImplementedError

    def step(self, state: State, dt: float) -> State:
        """The state after one step of length dt, of any size.

        Parameters
        ----------
        state : State
            On this solver's grid, with the moments of its profile.
        dt : float
            Negative for a step back in time, along the same characteristics.

        Returns
        -------
        State
            At the time ``state.t + dt``.

        Raises
        ------
        InputError
            A state of another grid, profile or with NaN; dt that is zero, or on a sphere so long
            that an edge of a cell is drawn out over a radian.
        LeftDomain
            A characteristic comes in through a wall without data.
        NotFinite
            The velocity, a characteristic or the new field is not finite; names node and time.
        NotConverged
            Paths on a sphere that need too many sub-steps, or reactions that do.
        """
        dt = signed_step(dt)
        self._accept(state)
        self._check_times(state, state.t + dt)
        return self._advance(self._kernels.place(state), dt).require_finite()

    @keywords_named
    def run(
        self,
        state: State,
        t_end: float,
        dt: float | None = None,
        cfl: float | None = None,
        snapshots: int | Sequence[float] | None = None,
        callback: Callable[[State], State | Any] | None = None,
        progress: bool = False,
        gauges: Any = None,
        save: Any = None,
        resume: bool = False,
    ) -> Any:
        """Steps to `t_end`, landing exactly on it and on every snapshot's time.

        With `t_end` before the time of `state`, and a negative `dt`, the run leads back in time:
        the equation is solved for the past, sources and decay included, and what was outflow
        becomes inflow, for which `boundary` needs data.

        Parameters
        ----------
        state : State
        t_end : float
            After the time of `state`, or before it.
        dt : float, optional
            Length of the steps; the last one before each snapshot may be shorter. Negative in a
            run back in time.
        cfl : float, optional
            Instead of `dt`: the largest number of cells that a node moves in a step, by the
            velocity at the start.
        snapshots : int or sequence of float, optional
            The number of equal intervals whose ends are kept, or the times to keep; default start
            and end.
        callback : callable, optional
            Called with the state after every step. A State that it returns takes the place of this
            one, for instance with a field that was corrected; `tangent` and `adjoint` refuse such
            a run. What else it returns is ignored. It may raise StopIteration to end the run.
        progress : bool
            Show a bar of the steps (on a terminal where tqdm is installed) and log one line for
            each snapshot at level INFO.
        gauges : array_like, optional
            Points as for `Trajectory.sample`, at which the field is sampled after every step, for
            `Trajectory.gauges`.
        save : path, optional
            A folder to which each snapshot is written as soon as it is reached.
        resume : bool
            Go on from the last complete snapshot in that folder, if there is one, with the bits of
            a run that was not interrupted. Grid, profile, velocity, sources, data on walls, start
            and times must be those with which the run began.

        Returns
        -------
        Trajectory
            After an interruption from the keyboard or a StopIteration it ends with the last
            finished step and is marked ``interrupted``.
        """
        self._accept(state)
        self._check_times(state, real_number("t_end", t_end))
        length = step_length(dt, cfl, state.t, float(t_end), lambda: self._time_scale(state.t))
        times = output_times(state.t, t_end, snapshots)
        plan = {}
        if save is not None:
            at = [state.t, 0.5 * (state.t + times[-1]), times[-1]]
            plan = {"dt": length, "times": times, **self._plan(state, at)}
        recorder = Recorder(state, gauges, save, flag("resume", resume), plan)
        tallies = self._tallies(state, recorder)

        def record(states: Sequence[State], interrupted: bool) -> Trajectory:
            budget = budget_of(tallies, states)
            kept = recorder.gauges()
            return Trajectory(tuple(states), self, length, interrupted, kept, budget)

        def advance(state: State, dt: float) -> State:
            new = self._advance(state, dt, tallies)
            for tally in tallies:
                tally.commit()
            return new

        change = checked_callback(callback, self._accept, self._kernels.place)

        def counted(state: State) -> State:
            new = state if change is None else change(state)
            if new is not state and tallies:
                for tally, now, then in zip(tallies, masses(new), masses(state), strict=True):
                    tally.change("replaced", now - then)
                    tally.commit()
            return new

        loop = (advance, self._begin, record, self._memory_at, recorder)
        change_all = None if change is None else counted
        return run(state, times, length, change_all, progress, *loop)

    def _tallies(self, state: State, recorder: Recorder) -> list[Tally]:
        """What counts the integral of each field, from where a resumed run was; none for profiles
        that do not keep it, or where the folder's first part did not count."""
        if not self.profile.startswith("csl"):
            return []
        found = [Tally(self.grid) for _ in state.fields or [""]]
        if recorder.states:
            rows = [extra.get("budget") for extra in recorder.extra]
            if any(row is None for row in rows):
                return []
            for k, tally in enumerate(found):
                tally.restore([row[k] for row in rows])  # type: ignore[index]
        recorder.beside = lambda: {"budget": np.stack([tally.sums for tally in found])}
        return found

    def _plan(self, state: State, times: Sequence[float]) -> dict[str, Any]:
        """What a run depends on: choices, and values of all functions at some points."""
        part = np.arange(1, 17)
        point = [
            low + (high - low) * ((axis + 1) * 0.6180339887 * part % 1.0)
            for axis, (low, high) in enumerate(self.grid.bounds)
        ]
        point += [np.zeros(part.size)] * (3 - self.grid.dim)

        def values(formula: Formula) -> list[Any]:
            return values_at(self.grid, formula, point, times)

        rules = self._scheme(state.fields).rules
        reactions = [
            next((one for one in rule.reactions if isinstance(one, Reaction)), None)
            for rule in rules
        ]
        return {
            "grid": [line.tolist() for line in self.grid.edges], "form": self.form,
            "profile": self.profile, "limiter": self.limiter, "bounds": repr(self.bounds),
            "fields": list(state.fields), "velocity": self._velocity_at(point, times),
            "source": [values(r.source_formula) if r and r.source else None for r in reactions],
            "decay": [values(r.decay_formula) if r and r.decay else None for r in reactions],
            "boundary": [{w: values(one) for w, one in rule.inflow.items()} for rule in rules],
            "diffusion": repr(self.diffusion), "reactions": repr(self.reactions),
            "foot_tolerance": self.foot_tolerance,
        }  # fmt: skip

    def _memory_at(self, state: State) -> Any:
        """What a run that begins with this snapshot needs to know."""
        return None

    def _begin(self, state: State) -> State:
        """Place the first state of a run."""
        return state

    def _accept(self, state: State) -> None:
        check_state(state, self.grid, self.profile, self._named)
        self._kinetics_of(state.fields)
        # A state that this limiter has stepped may exceed them by sources and splitting.
        if self.limiter == "bounds" and state._bounded != self.bounds:
            parts = [state.field(name) for name in state.fields] or [state]
            for part, rule in zip(parts, self._scheme(state.fields).rules, strict=True):
                check_bounded(part, rule.bounds, self.bounds_tolerance)

    def _check_times(self, state: State, end: float) -> None:
        """Raise `InputError` if sources are not known until `end`."""
        for rule in self._scheme(state.fields).rules:
            for acting in rule.reactions:
                acting.check_times(min(state.t, end), max(state.t, end))

    def _advance(self, state: State, dt: float, tallies: Sequence[Tally] = ()) -> State:
        made, scheme = self._kinetics_of(state.fields), self._scheme(state.fields)
        new = advanced(self._kernels, scheme, made, state, dt, self._sea, tallies)
        if self.limiter == "bounds":
            new.__dict__["_bounded"] = self.bounds
        return new


def values_at(grid: Any, formula: Formula, point: list[Any], times: Sequence[float]) -> list[Any]:
    """Values of a formula at points and times, as numbers in lists."""
    steps = (*grid.spacing, *([1.0] * (4 - grid.dim)))
    compute = formula.derivative((0, 0, 0, 0), steps)
    with np.errstate(all="ignore"):
        return [(compute(*point, t) + np.zeros(len(point[0]))).tolist() for t in times]
