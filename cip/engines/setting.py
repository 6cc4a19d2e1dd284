"""The description of a scheme that an engine runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cip.formulas.formula import Formula
from cip.grid import Grid


@dataclass(frozen=True, eq=False)
class Setting:
    """A scheme on a grid: everything about it that its stages need. Immutable.

    Attributes
    ----------
    grid : Grid
    formulas : tuple of Formula
        The velocity, a component for each direction.
    profile : str
    limiter : str or None
    bounds : (low, high)
        Of the field, for the limiter ``"bounds"``.
    bounds_tolerance : float
        In the unit of the field: a profile that exceeds the bounds by less is not limited.
    dtype : dtype
        Of the moments and the stored feet.
    store_feet : bool or None
        Whether feet are stored; None: if the velocity is steady.
    steady : bool
        Whether the velocity is the same at all times.
    """

    grid: Grid
    formulas: tuple[Formula, ...]
    profile: str
    limiter: str | None
    bounds: tuple[float, float]
    bounds_tolerance: float
    dtype: np.dtype[Any]
    store_feet: bool | None
    steady: bool

    @property
    def stores_feet(self) -> bool:
        """Whether feet are stored even if a kernel could compute them: by default, steady ones."""
        return self.steady if self.store_feet is None else self.store_feet
