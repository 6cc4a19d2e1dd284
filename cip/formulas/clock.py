"""Callables with an argument for the time that has a default: it is passed by its name."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

_NAMES = ("t", "time")


class WithTime:
    """Calls a function of the coordinates with the time as a named argument, or without it."""

    def __init__(self, function: Callable[..., Any], name: str | None) -> None:
        self._function, self._name = function, name

    def __call__(self, *point: Any) -> Any:
        """Its value at the coordinates and the time."""
        named = {} if self._name is None else {self._name: point[-1]}
        return self._function(*point[:-1], **named)


def clock_of(function: Any) -> str | None:
    """The name of an argument for the time that has a default, which a call without would use."""
    try:
        parameters = inspect.signature(function).parameters
    except (TypeError, ValueError):  # no callable, or one of C without a signature
        return None
    for name in _NAMES:
        found = parameters.get(name)
        if found is not None and found.default is not inspect.Parameter.empty:
            return name
    return None


def timed(function: Any) -> Any:
    """A callable of (x1, .., t) from one whose t has a default; others as they are."""
    name = clock_of(function)
    return function if name is None else WithTime(function, name)


def with_time(function: Any) -> Any:
    """The same, where a callable may also have no argument for the time at all."""
    if not callable(function) or clock_of(function) is not None:
        return timed(function)
    try:
        known = set(inspect.signature(function).parameters) & set(_NAMES)
    except (TypeError, ValueError):
        return function
    return function if known else WithTime(function, None)
