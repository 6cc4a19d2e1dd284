"""Callables whose argument for the time has a default: they get the time by keyword."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

_NAMES = ("t", "time")


class WithTime:
    """A callable of (x1, .., t) that calls ``function(x1, .., name=t)``, without t if no name."""

    def __init__(self, function: Callable[..., Any], name: str | None) -> None:
        self._function, self._name = function, name

    def __call__(self, *point: Any) -> Any:
        """The value at the coordinates and the time, which is the last argument."""
        named = {} if self._name is None else {self._name: point[-1]}
        return self._function(*point[:-1], **named)


def clock_of(function: Any) -> str | None:
    """The name of the argument for the time (``t`` or ``time``) if it has a default, else None."""
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
    """A callable of (x1, .., t) if the given one has a default for t; anything else as it is."""
    name = clock_of(function)
    return function if name is None else WithTime(function, name)


def with_time(function: Any) -> Any:
    """As `timed`; a callable without any argument for the time is wrapped so that it ignores t."""
    if not callable(function) or clock_of(function) is not None:
        return timed(function)
    try:
        known = set(inspect.signature(function).parameters) & set(_NAMES)
    except (TypeError, ValueError):
        return function
    return function if known else WithTime(function, None)
