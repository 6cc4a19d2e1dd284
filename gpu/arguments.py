"""What several entries ask of an argument; each error names it, what was found and what to do."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy import sparse

from gpu.errors import InputError


def holds_masked(value: Any) -> bool:
    """Whether entries are masked, also those of arrays in lists, in tuples and among objects."""
    nested = isinstance(value, list | tuple)
    if isinstance(value, np.ndarray):
        nested = value.dtype == object and value.ndim > 0
        if np.ma.is_masked(value):
            return True
    return nested and any(type(one) not in (float, int) and holds_masked(one) for one in value)


def unmasked(name: str, value: Any) -> None:
    """Refuse arrays whose entries would be taken for others: masked ones, and sparse vectors."""
    if holds_masked(value):
        raise InputError(
            f"{name} has masked entries: fill them, or leave out their rows and columns"
        )
    dimensions = len(getattr(value, "shape", ())) if sparse.issparse(value) else 2
    if dimensions != 2:
        raise InputError(
            f"{name} is a sparse array of {dimensions} dimensions: pass a matrix, or a dense vector"
        )


def flag(name: str, value: Any) -> bool:
    """True or False."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name}={shown(value)}: expected True or False")
    return bool(value)


def choice(name: str, value: Any, among: Iterable[str]) -> str:
    """One of some words."""
    among = tuple(among)
    if not isinstance(value, str) or value not in among:
        raise InputError(f"{name}={shown(value)}: expected one of {', '.join(among)}")
    return value


def whole(name: str, value: Any, least: float, most: float = np.inf) -> int:
    """A whole number within limits."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise InputError(f"{name}={shown(value)}: expected a whole number")
    if not least <= value <= most:
        upper = "" if most == np.inf else f" to {most:.0f}"
        raise InputError(f"{name}={shown(value)}: expected a whole number from {least:.0f}{upper}")
    return int(value)


def is_finite_number(value: Any) -> bool:
    """Whether a value is one number, real or complex, that double precision has."""
    if isinstance(value, bool) or not isinstance(value, int | float | complex | np.number):
        return False
    try:
        return bool(np.isfinite(complex(value)))
    except OverflowError:
        return False


def shown(value: Any) -> str:
    """A value as a message shows it: of what is large its type."""
    if isinstance(value, int) and abs(value) > 1e18:
        return "a whole number beyond 1e18"
    if isinstance(value, int | float | complex | np.number | str | None):
        return f"{value.item() if isinstance(value, np.generic) else value!r:.60}"
    return type(value).__name__
