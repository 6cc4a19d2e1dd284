"""The check of arguments that are positive numbers."""

from __future__ import annotations

import numbers

import numpy as np

from skfem_adini.errors import InputError


def positive_number(name: str, value: object, most: float = np.inf) -> float:
    """Return the value as a float if it is a real number above 0, finite and at most `most`."""
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        number = float(value)
        if 0 < number <= most and np.isfinite(number):
            return number
    limit = "" if np.isinf(most) else f", at most {most:g}"
    raise InputError(f"{name}: expected a finite number above 0{limit}, got {value!r}")
