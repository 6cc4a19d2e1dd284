"""The description of a scheme that an engine runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cip.formulas.formula import Formula
from cip.grid import Grid


@dataclass(frozen=True, eq=False)
class Setting:
    """A scheme on a grid: everything about it that its stages need."""

    grid: Grid
    formulas: tuple[Formula, ...]  # the velocity, a component for each direction
    profile: str
    limiter: str | None
    bounds: tuple[float, float]  # (low, high) of the field, for the limiter "bounds"
    bounds_tolerance: float  # smaller violations are not limited; in the unit of the field
    dtype: np.dtype[Any]  # of the moments and the stored feet
    store_feet: bool | None  # None: if the velocity is steady
    steady: bool  # whether the velocity is the same at all times

    @property
    def stores_feet(self) -> bool:
        """Whether feet are stored even if a kernel could compute them: by default, steady ones."""
        return self.steady if self.store_feet is None else self.store_feet
