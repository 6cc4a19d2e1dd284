"""What a step consists of: choices, stages, and what holds for each field of a state."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from cip.engines.engine import Engine
from cip.errors import InputError, NotSupported
from cip.formulas.formula import Formula
from cip.formulas.parameters import Parametrised
from cip.grid import Grid, Sphere, same_grid
from cip.output.budget import Tally
from cip.profiles.catalogue import CONSERVATIVE, LIMITER_CODES, LIMITERS, PLANE, moments
from cip.sources.kinetics import Kinetics
from cip.sources.reaction import HalfStep, halves
from cip.stages.coast import Coast, coast_of
from cip.stages.stage import Stage, stages
from cip.stages.state import State, state_of
from cip.stages.walls import Wall, closed_walls
from skfem_adini.ground.arguments import choice, real_array, real_number


class Rule(NamedTuple):
    """What holds for one field."""

    reactions: list[Any]  # source with decay, and diffusion, where it has them
    data: dict[Wall, Formula]  # on walls, with what the reaction does to them in a step
    inflow: dict[str, Formula]  # the same without it, by names of walls
    bounds: tuple[float, float]


class Scheme(NamedTuple):
    """The stages of a step and the rule of each field; of a state without names one."""

    stages: list[Stage]
    rules: list[Rule]


def is_by_field(value: Any) -> bool:
    """Whether an argument is a dict by names of fields (those of walls hold a sign)."""
    keys = list(value) if isinstance(value, Mapping) else []
    return bool(keys) and all(isinstance(key, str) and key.isidentifier() for key in keys)


def mapped(value: Any, function: Callable[[Any], Any]) -> Any:
    """A function of an argument, or of all that it is by field."""
    if not is_by_field(value):
        return function(value)
    return {name: function(one) for name, one in value.items()}


def of_field(value: Any, name: str) -> Any:
    """An argument as it holds for a field; None for one that a dict by field leaves out."""
    return value.get(name) if is_by_field(value) else value


def parts_of(value: Any) -> Iterator[Any]:
    """The functions in an argument, which may be a dict by wall, by field or of both."""
    if isinstance(value, Mapping):
        for one in value.values():
            yield from parts_of(one)
    else:
        yield value


def made_scheme(
    grid: Grid, velocity: tuple[Formula, ...], profile: str, advect: bool, rules: list[Rule],
    own: bool, coast: Coast | None,
) -> Scheme:  # fmt: skip
    """The stages of one step, which take in data where all fields have some; with `own` a part of
    each stage for every field."""
    shared = {
        wall: formula
        for wall, formula in rules[0].data.items()
        if all(wall in rule.data for rule in rules)
    }
    made = stages(grid, velocity, profile, advect, shared, rules[0].bounds, coast)
    for stage in made if own else []:
        stage.parts = tuple(stage.of_field(rule.data, rule.bounds) for rule in rules)
    return Scheme(made, rules)


def advanced(
    kernels: Engine,
    scheme: Scheme,
    kinetics: Kinetics | None,
    state: State,
    dt: float,
    sea: Any = None,
    tallies: Sequence[Tally] = (),
) -> State:
    """The state after a step: the stages between the halves of sources, decay, diffusion and
    reactions between fields. `sea` is the mask of moments that are not on land; `tallies`, of all
    fields or none, count what this changes."""
    data, t = state.data, state.t
    around = [halves(rule.reactions, t, dt, sea) for rule in scheme.rules]
    data = _reacted(kernels, state, data, [before for before, _ in around], tallies)
    if kinetics is not None:
        data = _mixed(kinetics, state, data, t, 0.5 * dt, sea, tallies)
    for stage in scheme.stages:
        data = kernels.apply(stage, data, t, dt, tallies=tallies)
    if kinetics is not None:
        data = _mixed(kinetics, state, data, t + 0.5 * dt, 0.5 * dt, sea, tallies)
    data = _reacted(kernels, state, data, [after for _, after in around], tallies)
    return state_of(state.grid, state.profile, data, t + dt, fields=state.fields)


def _reacted(
    kernels: Engine, state: State, data: Any, steps: list[list[HalfStep]], tallies: Sequence[Tally]
) -> Any:
    """The moments after half a step of what acts on each field by itself."""
    if not any(steps):
        return data
    found = []
    counted: list[Any] = [*tallies] or [None] * len(steps)
    rows = zip(data if state.fields else [data], steps, counted, strict=True)
    for row, halves_of_field, tally in rows:
        for half in halves_of_field:
            row = half.applied(row, tally)
        found.append(row)
    return kernels.xp.stack(found) if state.fields else found[0]


def _mixed(
    kinetics: Kinetics, state: State, data: Any, t: float, dt: float, sea: Any,
    tallies: Sequence[Tally],
) -> Any:  # fmt: skip
    """The moments after reactions between fields."""
    new = kinetics.applied(data, t, dt, sea)
    if tallies:
        old_mass, new_mass = (
            state_of(state.grid, state.profile, one, t, fields=state.fields).mass
            for one in (data, new)
        )
        for name, tally in zip(state.fields, tallies, strict=True):
            tally.change("reacted", new_mass[name] - old_mass[name])
    return new


def parameters_of(velocity: Any, source: Any, decay: Any, boundary: Any) -> dict[str, float]:
    """The values of all parameters of the solver's arguments, in order. Raises `InputError` for two
    values of one name, since code takes one name for one parameter."""
    found: dict[str, float] = {}
    first: dict[str, str] = {}
    functions = {"velocity": velocity, "source": source, "decay": decay, "boundary": boundary}
    for label, function in functions.items():
        for part in parts_of(function):
            own = part.parameters if isinstance(part, Parametrised) else {}
            for name, value in own.items():
                if found.setdefault(name, value) != value:
                    raise InputError(
                        f"{label}: its parameter {name!r} is {value:.6g}, that of {first[name]} "
                        f"{found[name]:.6g}; one name is one parameter: rename one of them"
                    )
                first.setdefault(name, label)
    return found


def with_values(function: Any, values: Mapping[str, float]) -> Any:
    """An argument of a solver with new values of those parameters that it has."""
    if isinstance(function, Mapping):
        return {wall: with_values(part, values) for wall, part in function.items()}
    if not isinstance(function, Parametrised):
        return function
    own = {name: values[name] for name in function.parameters if name in values}
    return function.with_parameters(**own) if own else function


def checked_coast(grid: Grid, profile: str, land: Any, boundary: Any) -> Coast | None:
    """The coasts of land and closed walls; raises unless the profile keeps the integral."""
    several = list(boundary.values()) if is_by_field(boundary) else [boundary]
    closed = [closed_walls(one, grid) for one in several]
    if any(set(one) != set(closed[0]) for one in closed):
        raise InputError("boundary: a wall is closed for all fields or for none")
    found = coast_of(grid, land, closed[0])
    if found is not None and profile not in CONSERVATIVE:
        argument = "boundary: closed walls" if land is None else "land: it"
        raise NotSupported(
            f"{argument} would not keep the integral of {profile!r}; take 'csl2' or 'csl4' with "
            "form='advection'"
        )
    return found


Form = Literal["transport", "advection"]


def check_choices(
    grid: Grid, form: Form, profile: str, limiter: Any, splitting: Any, backend: Any
) -> None:
    """Raise `InputError` for options of a solver that do not exist or are incompatible."""
    moments(profile, grid.dim)
    if not isinstance(limiter, str | None) or limiter not in LIMITER_CODES:
        raise InputError(
            f"limiter: expected one of {', '.join(map(str, LIMITER_CODES))}, got {limiter!r}"
        )
    if limiter is not None and limiter not in LIMITERS[profile]:
        allowed = ", ".join(LIMITERS[profile]) or "no limiter"
        raise InputError(f"limiter: {limiter!r} does not fit {profile!r}, which takes {allowed}")
    if splitting is not None and not (isinstance(splitting, str) and splitting == "strang"):
        raise InputError(f"splitting: expected None or 'strang', got {splitting!r}")
    if profile in PLANE and splitting is not None:
        raise InputError(f"splitting: {profile!r} is direct; pass splitting=None")
    if profile.startswith("csl") and form != "advection":
        raise InputError(
            f"form: {profile!r} conserves the integral and so needs form='advection' "
            "(the same equation where div c = 0)"
        )
    choice("backend", backend, ("cpu", "cupy"))


def form_of(form: Any) -> Form:
    """The equation of this name."""
    names = ("transport", "advective", "advection", "conservative")
    return "transport" if choice("form", form, names) in names[:2] else "advection"


def bounds_of(bounds: Any) -> tuple[float, float]:
    """The argument `bounds` as two numbers."""
    pair = real_array("bounds: expected (low, high)", bounds)
    if pair.shape != (2,):
        raise InputError(f"bounds: expected (low, high), got {bounds!r}")
    low, high = map(float, pair)
    if not low < high:
        raise InputError(f"bounds: low must be below high, got {bounds!r}")
    return low, high


def tolerance_of(given: float | None) -> float | None:
    """The argument `foot_tolerance`."""
    if given is None:
        return None
    value = real_number("foot_tolerance", given)
    if not 1e-12 <= value <= 1.0:
        raise InputError(f"foot_tolerance: expected 1e-12 to 1 cells, got {given!r}")
    return value


def check_within(
    values: Any, bounds: tuple[float, float], tolerance: float, what: str, remedy: str
) -> None:
    """Raise `InputError` for values outside the bounds by more than a tolerance and rounding."""
    low, high = float(values.min()), float(values.max())
    slack = tolerance + 8.0 * float(np.finfo(values.dtype).eps) * max(abs(low), abs(high))
    if low < bounds[0] - slack or high > bounds[1] + slack:
        worst = low if low < bounds[0] - slack else high
        raise InputError(
            f"{what} reaches {worst:.6g}, outside the bounds {bounds} of the limiter, which cannot "
            f"keep what was never inside; {remedy}"
        )


def check_bounded(state: State, bounds: tuple[float, float], tolerance: float) -> None:
    """Raise `InputError` for values or means of a field outside the bounds of the limiter."""
    for moment in moments(state.profile, state.grid.dim):
        if not any(moment.orders):
            what = f"state: moment {moment.name!r}"
            check_within(state[moment.name], bounds, tolerance, what, "clip it, or widen bounds")


def check_state(
    state: Any, grid: Grid | Sphere, profile: str, named: Mapping[str, tuple[str, ...]]
) -> None:
    """Raise `InputError` unless it is a state on this grid with the moments of this profile and
    the fields that arguments name."""
    if not isinstance(state, State):
        raise InputError(f"state: expected a State, got {type(state).__name__}")
    if state.profile != profile:
        raise InputError(
            f"state: it carries the moments of {state.profile!r}, the solver those of "
            f"{profile!r}; make it with solver.state(f)"
        )
    state.check()
    for argument, names in named.items():
        for name in names:
            if name not in state.fields:
                known = ", ".join(state.fields) or "one without a name"
                wall = "wall and no " if argument == "boundary" else ""
                raise InputError(
                    f"{argument}: {name!r} is no {wall}field of the state, which has {known}"
                )
    if not same_grid(state.grid, grid):
        raise InputError(f"state: it lives on {state.grid}, the solver on {grid}")
