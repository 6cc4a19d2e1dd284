"""An entry in the history of an active set."""

from __future__ import annotations

from typing import NamedTuple


class Step(NamedTuple):
    """One active-set step: how many variables were held, how many were found violated."""

    active: int
    violated: int
