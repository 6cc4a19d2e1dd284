"""Factors that make a load or a motion vary in time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from contact.errors import InputError, numbers

Factor = Callable[[float], float]


def checked_factor(factor: Factor | None) -> Factor:
    """The factor, by default time itself; `InputError` unless it can be called."""
    if factor is None:
        return _time_itself
    if not callable(factor):
        raise InputError(f"factor={factor!r}: expected a function of time")
    return factor


def value_at(factor: Factor, t: float) -> float:
    """The factor at a time; `InputError` unless it is a finite number."""
    value = numbers("factor", factor(t))
    if value.shape != () or not np.isfinite(value):
        raise InputError(f"factor: returned {value!r} at t = {t}; expected a finite number")
    return float(value)


def _time_itself(t: float) -> float:
    return t
