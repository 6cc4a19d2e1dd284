"""The choices that a solver is given: equation, profile, limiter, splitting, backend, bounds."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from cip.errors import InputError
from cip.grid import Grid
from cip.profiles.catalogue import LIMITER_CODES, LIMITERS, LINE, PLANE, moments
from cip.reals import real_array
from cip.stages.state import State

Form = Literal["transport", "advection"]
_FORMS: dict[Any, Form] = {
    "transport": "transport",
    "advective": "transport",
    "advection": "advection",
    "conservative": "advection",
}


def check_choices(
    grid: Grid, form: Form, profile: str, limiter: Any, splitting: Any, backend: Any
) -> None:
    """Raise `InputError` for choices of a solver that do not exist or do not fit together."""
    moments(profile, grid.dim)
    if not isinstance(limiter, str | None) or limiter not in LIMITER_CODES:
        raise InputError(
            f"limiter: expected one of {', '.join(map(str, LIMITER_CODES))}, got {limiter!r}"
        )
    if limiter is not None and limiter not in LIMITERS[profile]:
        allowed = ", ".join(LIMITERS[profile]) or "no limiter"
        raise InputError(f"limiter: {limiter!r} does not fit {profile!r}, which takes {allowed}")
    if splitting is not None and not _is(splitting, "strang"):
        raise InputError(f"splitting: expected None or 'strang', got {splitting!r}")
    if profile in PLANE and splitting is not None:
        raise InputError(f"splitting: {profile!r} is direct; pass splitting=None")
    if profile in LINE and grid.dim > 1 and splitting is None:
        raise InputError(
            f"splitting: {profile!r} is one-dimensional; pass splitting='strang', or "
            "profile='adini' or 'bicubic' in two dimensions"
        )
    if profile.startswith("csl") and form != "advection":
        raise InputError(
            f"form: {profile!r} conserves the integral and so needs form='advection' "
            "(the same equation where div c = 0)"
        )
    if not _is(backend, "cpu", "cupy"):
        raise InputError(f"backend: expected 'cpu' or 'cupy', got {backend!r}")


def _is(value: Any, *names: str) -> bool:
    return isinstance(value, str) and value in names


def form_of(form: Any) -> Form:
    """The equation that a name of it stands for."""
    found = _FORMS.get(form) if isinstance(form, str) else None
    if found is None:
        raise InputError(f"form: expected one of {', '.join(_FORMS)}, got {form!r}")
    return found


def bounds_of(bounds: Any) -> tuple[float, float]:
    """The argument `bounds` as two numbers."""
    pair = real_array(bounds, "bounds: expected (low, high)")
    if pair.shape != (2,):
        raise InputError(f"bounds: expected (low, high), got {bounds!r}")
    low, high = map(float, pair)
    if not low < high:
        raise InputError(f"bounds: low must be below high, got {bounds!r}")
    return low, high


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
    """Raise `InputError` for values or means outside the bounds of the limiter. A state that this
    limiter has stepped is accepted: sources and splitting may exceed the bounds.
    """
    if state._bounded == bounds:
        return
    for moment in moments(state.profile, state.grid.dim):
        if not any(moment.orders):
            what = f"state: moment {moment.name!r}"
            check_within(state[moment.name], bounds, tolerance, what, "clip it, or widen bounds")


def check_state(state: Any, grid: Grid, profile: str) -> None:
    """Raise `InputError` unless it is a state on this grid with the moments of this profile."""
    if not isinstance(state, State):
        raise InputError(f"state: expected a State, got {type(state).__name__}")
    if state.profile != profile:
        raise InputError(
            f"state: it carries the moments of {state.profile!r}, the solver those of "
            f"{profile!r}; make it with solver.state(f)"
        )
    state.check()
    if state.grid is not grid and (
        state.grid.nodes != grid.nodes
        or state.grid.periodic != grid.periodic
        or any(not np.array_equal(a, b) for a, b in zip(state.grid.edges, grid.edges, strict=True))
    ):
        raise InputError(f"state: it lives on {state.grid}, the solver on {grid}")
