"""Dates and durations as seconds."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError

Array = NDArray[np.float64]
_SECOND = np.timedelta64(1, "s")


def seconds(times: Any, name: str, since: Any = None) -> Array:
    """Times as numbers: durations in seconds, dates in seconds since the date `since` (by default
    the first of them), numbers as given. Messages of `InputError` call them `name`.
    """
    if np.ma.is_masked(times):
        raise InputError(f"{name} holds masked times; leave them out")
    found = np.asarray(times)
    if since is not None and found.dtype.kind != "M":
        raise InputError(f"since: {name} holds {found.dtype}, no dates; leave since out")
    if found.dtype.kind == "M":
        found = (found - (found.flat[0] if since is None else _date(since))) / _SECOND
    elif found.dtype.kind == "m":
        found = found / _SECOND
    elif found.dtype.kind not in "fiu":
        raise InputError(
            f"{name} holds {found.dtype}, expected numbers, datetime64 or timedelta64; "
            "convert dates of other calendars to seconds before"
        )
    return found.astype(float)


def _date(since: Any) -> np.datetime64:
    try:
        found = np.datetime64(since, "ns")
    except (TypeError, ValueError) as error:
        raise InputError(
            f"since: expected a date such as '2010-05-04T12:00', got {since!r}: {error}"
        ) from error
    if isinstance(since, int | np.integer) or np.isnat(found):
        raise InputError(f"since: expected a date such as '2010-05-04T12:00', got {since!r}")
    return found
