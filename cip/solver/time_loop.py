"""The time loop: steps that land exactly on every output time."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from cip.characteristics.feet import check_step, signed_step
from cip.errors import CipError, InputError
from cip.output.recorder import Recorder
from cip.stages.state import State, by_field, state_of
from skfem_adini.ground.arguments import real_array, real_number
from skfem_adini.ground.progress import progress_bar

Record = TypeVar("Record")

_log = logging.getLogger(__name__)


def run(
    state: State,
    times: Sequence[float],
    dt: float,
    callback: Callable[[State], State] | None,
    progress: bool,
    advance: Callable[[State, float], State],
    place: Callable[[State], State],
    record: Callable[[Sequence[State], bool], Record],
    remember: Callable[[State], Any] = lambda state: None,
    recorder: Recorder | None = None,
) -> Record:
    """Step from one of the output `times` to the next; ``advance(state, dt)`` makes a step, `place`
    copies the first state to its memory, ``record(snapshots, interrupted)`` makes the
    result, which a `CipError` of a step carries as ``trajectory``. ``remember(state)`` is what a
    run that begins with a snapshot needs to know. Snapshots in the recorder are not made again."""
    no_step = _no_step(state.t, times[-1], dt)
    counts = [
        max(1, int(np.ceil((target - start) / dt - no_step)))
        for start, target in zip([state.t, *times], times, strict=False)
    ]
    kept = list(recorder.states) if recorder is not None else []
    if not kept:
        kept.append(_copy(state))  # the caller may modify the original
        if recorder is not None:
            recorder.see(kept[0])
            recorder.keep(kept[0])
    done = len(kept) - 1
    state = place(kept[-1])
    found = record(kept, False)
    try:
        with progress_bar(sum(counts), progress, sum(counts[:done])) as count_step:
            for target, count in zip(times[done:], counts[done:], strict=True):
                start = state.t
                for k in range(count):
                    last = k == count - 1
                    length = target - (start + k * dt) if last else dt
                    if abs(length - dt) <= no_step * abs(dt):
                        length = dt
                    t = target if last else start + (k + 1) * dt
                    state = _at(advance(state, length), t)
                    state = state if callback is None else callback(state)
                    if recorder is not None:
                        recorder.see(state)
                    count_step()
                kept.append(state.host().require_finite())
                kept[-1].__dict__["_memory"] = remember(state)
                if recorder is not None:
                    recorder.keep(kept[-1])
                found = record(kept, False)
                if progress:
                    mass = by_field(state, lambda one: f"{one.mass:.12g}")
                    _log.info("t = %.6g of %.6g, mass %s", state.t, times[-1], mass)
    except (KeyboardInterrupt, StopIteration):
        if state.t != kept[-1].t:
            kept.append(state.host().require_finite())
        return record(kept, True)
    except CipError as error:
        error.trajectory = found  # type: ignore[attr-defined]
        raise
    return found


def _no_step(start: float, end: float, dt: float) -> float:
    """Relative to dt: a shorter remainder before an output time joins the last step. The rounding
    of a million steps is below it; that of the times is added."""
    found = 1e-9 + 4.0 * np.finfo(float).eps * max(abs(start), abs(end)) / abs(dt)
    if found > 0.01:
        raise InputError(
            f"dt: {dt:.6g} is lost in the rounding of t = {end:.6g}; count t from the start"
        )
    return found


def _copy(state: State) -> State:
    """A copy in host memory."""
    found = replace(state.host())
    found.__dict__["_memory"] = state._memory
    return found


def _at(state: State, t: float) -> State:
    """The same moments at a time without the rounding of the steps."""
    return state_of(state.grid, state.profile, state.data, t, state._bounded, state.fields)


def checked_callback(
    callback: Any, accept: Callable[[State], Any], place: Callable[[State], State]
) -> Callable[[State], State] | None:
    """The callback of a run as a function that returns the next step's state. `accept` raises
    `InputError` for a state that the solver cannot take; `place` copies one to its memory."""
    if callback is None:
        return None
    if not callable(callback):
        raise InputError(f"callback: expected a callable, got {callback!r}")

    def call(state: State) -> State:
        found = callback(state)
        if not isinstance(found, State) or found is state:
            return state
        try:
            accept(found)
        except InputError as error:
            raise InputError(f"callback: it returned what does not fit: {error}") from error
        if found.fields != state.fields:
            raise InputError(
                f"callback: it returned the fields {found.fields}, expected {state.fields}"
            )
        if found.t != state.t:
            raise InputError(
                f"callback: it returned a state at t = {found.t!r}, expected one at the time of "
                f"the step, {state.t!r}"
            )
        return place(replace(found))

    return call


def output_times(t: float, t_end: float, snapshots: int | Sequence[float] | None) -> list[float]:
    """The times from t on at which the run stores a snapshot, `t_end` the last."""
    end = real_number("t_end", t_end)
    if not np.isfinite(end) or end == t:
        raise InputError(f"t_end: expected a time other than t = {t:.6g}, got {t_end!r}")
    if snapshots is None:
        return [end]
    if isinstance(snapshots, int | np.integer) and not isinstance(snapshots, bool):
        if snapshots < 1:
            raise InputError(f"snapshots: expected at least 1 interval, got {snapshots}")
        return [float(time) for time in np.linspace(t, end, int(snapshots) + 1)[1:]]
    times = real_array("snapshots", snapshots).astype(float)
    ahead = 1.0 if end > t else -1.0  # a run may lead back in time
    if times.ndim != 1 or not np.isfinite(times).all() or np.any(ahead * np.diff(times) <= 0):
        order = "increasing" if end > t else "decreasing"
        raise InputError(f"snapshots: expected {order} times, got {snapshots!r}")
    if times.size and not (ahead * (times[0] - t) >= 0.0 <= ahead * (end - times[-1])):
        raise InputError(f"snapshots: expected times from {t:.6g} to {end:.6g}, got {snapshots!r}")
    inner = [float(time) for time in times if time not in (t, end)]
    return [*inner, end]


def step_length(
    dt: float | None, cfl: float | None, t: float, t_end: float, scale: Callable[[], float]
) -> float:
    """The length of the steps, given itself or by the cells that a node moves; see `Solver.run`.
    ``scale()`` is the time in which it moves by one."""
    if (dt is None) == (cfl is None):
        raise InputError("dt: pass either dt or cfl")
    if dt is not None:
        found = signed_step(dt)
        if found * (t_end - t) < 0.0:
            raise InputError(
                f"dt: steps of {dt!r} do not lead from t = {t:.6g} to t_end = {t_end:.6g}; runs "
                "back in time take a negative dt"
            )
        return found
    ahead = 1.0 if t_end >= t else -1.0
    return ahead * check_step(cfl, "cfl") * scale()  # type: ignore[arg-type]
