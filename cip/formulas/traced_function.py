"""Picklable callables: a lambda or local function is replaced by the formula traced from it."""

from __future__ import annotations

import inspect
import pickle
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cip.errors import InputError
from cip.formulas.expression import OPERATORS, Expression, ordered


class TracedFunction:
    """The formulas that a callable computes, as a callable of numbers, arrays or formulas.
    `outputs` maps tuples of argument names to formulas; a call selects them by the number of
    arguments."""

    def __init__(self, outputs: dict[tuple[str, ...], Sequence[Expression]]) -> None:
        self._outputs = {names: tuple(formulas) for names, formulas in outputs.items()}

    def __call__(self, *point: Any) -> Any:
        """The value of the one formula, or a tuple of values if there are several."""
        fitting = [names for names in self._outputs if len(names) == len(point)]
        if not fitting:
            raise TypeError(f"it was traced with {sorted(map(len, self._outputs))} arguments")
        known, formulas = dict(zip(fitting[0], point, strict=True)), self._outputs[fitting[0]]
        values: dict[Expression, Any] = {}
        for node in ordered(formulas):
            args = [values[argument] for argument in node.args]
            if node.op == "constant":
                values[node] = node.value
            elif node.op == "variable":
                values[node] = known[node.value]
            else:
                values[node] = (OPERATORS.get(node.op) or getattr(np, node.op))(*args)
        found = tuple(values[formula] for formula in formulas)
        return found if len(found) > 1 else found[0]


def portable(
    value: Any, name: str, trace: Callable[[], dict[tuple[str, ...], Sequence[Expression]]]
) -> Any:
    """The value itself if it can be pickled, else a `TracedFunction` of what `trace` finds. Raises
    `InputError` if this fails too.
    """
    if not callable(value):
        return value
    try:
        pickle.dumps(value)
    except Exception:  # pickling runs code of the user's objects, which may raise anything
        found = trace()
        if not found:
            raise InputError(
                f"{name}: {value!r} cannot be pickled, and it is no formula that could be kept in "
                "its place; define it with def at the top of a module"
            ) from None
        return TracedFunction(found)
    return value


class WithTime:
    """A callable of (x1, .., t) that calls ``function(x1, .., name=t)``, without t if no name."""

    def __init__(self, function: Callable[..., Any], name: str | None) -> None:
        self._function, self._name = function, name

    def __call__(self, *point: Any) -> Any:
        """The value at the coordinates and the time, which is the last argument."""
        named = {} if self._name is None else {self._name: point[-1]}
        return self._function(*point[:-1], **named)


def clocks_in(function: Any) -> dict[str, Any] | None:
    """Which arguments ``t`` and ``time`` a callable has, with their defaults; None where that is
    not known."""
    try:
        parameters = inspect.signature(function).parameters
    except (TypeError, ValueError):  # no callable, or one of C without a signature
        return None
    return {name: parameters[name].default for name in ("t", "time") if name in parameters}


def clock_of(function: Any) -> str | None:
    """The name of the argument for the time (``t`` or ``time``) if it has a default, else None."""
    known = clocks_in(function) or {}
    return next(
        (name for name, default in known.items() if default is not inspect.Parameter.empty), None
    )


def timed(function: Any) -> Any:
    """A callable of (x1, .., t) if the given one has a default for t; anything else as it is."""
    name = clock_of(function)
    return function if name is None else WithTime(function, name)


def with_time(function: Any) -> Any:
    """As `timed`; a callable without an argument for the time is wrapped so that it ignores t."""
    if not callable(function) or clock_of(function) is not None:
        return timed(function)
    return WithTime(function, None) if clocks_in(function) == {} else function
