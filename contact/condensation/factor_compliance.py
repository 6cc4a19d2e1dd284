"""The compliance of contact rows as an operator: each product requires a solution per body."""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np

from contact.arrays.dense_arrays import HostArrays
from contact.condensation.boundary_problem import Array


def guessed_diagonal(parts: tuple[Any, ...]) -> Array:
    """Approximate diagonal of the compliance, shape (n,), used only for scaling.
    Relative values come from the diagonals of the stiffness, their scale from a few rows."""
    guess = np.asarray(sum(part.row_compliance() for part in parts))
    live = np.flatnonzero(guess > 0)
    some = live[np.unique(np.linspace(0, live.size - 1, 16).astype(np.int64))]
    unit = np.zeros((guess.size, some.size))
    unit[some, np.arange(some.size)] = 1.0
    true = sum(part.yielded(unit, corrected=False) for part in parts)[some, np.arange(some.size)]
    return guess * float(np.exp(np.mean(np.log(true / guess[some]))))


class ProductArrays(HostArrays):
    """Host arrays for a compliance that is an operator."""

    def shifted(self, W: FactorCompliance, shift: float) -> FactorCompliance:
        """``W + shift I``."""
        return W.shifted(shift)


class FactorCompliance:
    """The matrix W of a `BoundaryProblem` as an operator, the sum over the bodies `parts`.
    `scale`, (n,), is the ratio of physical to scaled displacement of each row."""

    __array_ufunc__ = None  # leave products with an array on the left to __rmatmul__
    arrays = ProductArrays()

    def __init__(self, parts: tuple[Any, ...], scale: Array) -> None:
        self._parts, self._scale, self._shift = parts, scale, 0.0
        self.shape = scale.size, scale.size
        # Cached: the residual and the zones of a step need the same product.
        self._last: tuple[Array, Array] | None = None

    def __matmul__(self, forces: Array) -> Array:
        if forces.ndim > 1:
            return np.stack([self @ column for column in forces.T], axis=1)
        last = self._last
        if last is not None and np.array_equal(last[0], forces):
            return last[1] + self._shift * forces
        moved = self._moved(forces, corrected=True)
        self._last = forces.copy(), moved
        return moved + self._shift * forces

    __rmatmul__ = __matmul__

    def quickly(self, forces: Array) -> Array:
        """The product without iterative refinement, which is one or two digits less accurate."""
        return self._moved(forces, corrected=False) + self._shift * forces

    def _moved(self, forces: Array, corrected: bool) -> Array:
        physical = forces / self._scale
        moved = sum(part.yielded(physical, corrected) for part in self._parts)
        return np.asarray(moved / self._scale)

    def shifted(self, shift: float) -> FactorCompliance:
        """``W + shift I``."""
        other = copy(self)
        other._shift = self._shift + shift
        return other

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        return np.asarray(self @ np.eye(self.shape[0]), dtype=dtype)
