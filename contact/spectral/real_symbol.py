r"""Hermitian symbols that are real up to factors i of some components.

.. math:: S_{ij} = i^{p_i} N_{ij} i^{-p_j}, \qquad N \text{ real and symmetric,}

whose upper triangle is stored: in space 6 real numbers per wave instead of 9 complex ones.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skfem_adini.ground.arrays import namespace

_TURNS = np.array([1, 1j, -1, -1j])  # powers of the imaginary unit


@dataclass(frozen=True)
class RealSymbol:
    """A symbol of n components, whose entries are real up to powers of i."""

    entries: Any  # (n (n + 1) / 2, *waves), the upper triangle row by row
    turns: tuple[int, ...]  # powers p of the imaginary unit

    @classmethod
    def of(cls, symbol: Any, turns: Sequence[int]) -> RealSymbol:
        """Convert a full complex symbol, shape (n, n, *waves)."""
        n = len(symbol)
        upper = [(i, j) for i in range(n) for j in range(i, n)]
        parts = [(complex(_TURNS[(turns[j] - turns[i]) % 4]) * symbol[i, j]).real for i, j in upper]
        return cls(namespace(symbol).stack(parts), tuple(turns))

    def __getitem__(self, pair: tuple[int, int]) -> Any:
        """Entry of N."""
        n, (i, j) = len(self.turns), sorted(pair)
        return self.entries[i * (2 * n - i - 1) // 2 + j]

    def full(self) -> Any:
        """The full complex symbol, shape (n, n, *waves)."""
        n, xp = len(self.turns), namespace(self.entries)
        symbol = xp.empty((n, n, *self.entries.shape[1:]), dtype=complex)
        for i in range(n):
            for j in range(n):
                symbol[i, j] = complex(_TURNS[(self.turns[i] - self.turns[j]) % 4]) * self[i, j]
        return symbol

    def inverse(self) -> RealSymbol:
        """The inverse for two or three components, by cofactors, for a nonzero determinant;
        inaccurate if entries differ by many orders of magnitude."""
        n, xp = len(self.turns), namespace(self.entries)
        if n == 2:
            cofactors = [self[1, 1], -self[0, 1], self[0, 0]]
        else:
            others = [[k for k in range(3) if k != i] for i in range(3)]
            cofactors = [
                (-1) ** (i + j) * (self[a, c] * self[b, d] - self[a, d] * self[b, c])
                for i in range(3)
                for j in range(i, 3)
                for (a, b), (c, d) in [(others[i], others[j])]
            ]
        determinant = sum(self[0, j] * cofactors[j] for j in range(n))
        return RealSymbol(xp.stack(cofactors) / determinant, self.turns)

    def times(self, waves: Any) -> Any:
        """The product with waves, shape (n, *waves), which may be overwritten."""
        n = len(self.turns)
        if n == 1:
            waves *= self.entries
            return waves
        factors = [[_turn(i - j, waves) for j in self.turns] for i in self.turns]
        if namespace(waves) is not np and n == 3 and waves.dtype.kind == "c":
            given = [factors[i][j] for i, j in ((0, 1), (0, 2), (1, 2))]
            _product_of_three()(*self.entries, *given, *waves)
            return waves
        products = namespace(waves).empty_like(waves)
        for i, product in enumerate(products):
            product[...] = self[i, 0] * (factors[i][0] * waves[0])
            for j in range(1, n):
                product += self[i, j] * (factors[i][j] * waves[j])
        return products


def _turn(power: int, waves: Any) -> Any:
    """Multiply waves by a power of i."""
    return complex(_TURNS[power % 4]) if waves.dtype.kind == "c" else float(_TURNS[power % 4].real)


@functools.cache
def _product_of_three() -> Any:
    """The product in place, in one pass over the memory of a device."""
    cupy = sys.modules["cupy"]
    entries = ", ".join(f"T a{i}{j}" for i in range(3) for j in range(i, 3))
    return cupy.ElementwiseKernel(
        f"{entries}, C t01, C t02, C t12",
        "C x, C y, C z",
        "const C u = x, v = y, w = z;"
        "x = a00 * u + a01 * (t01 * v) + a02 * (t02 * w);"
        "y = a01 * (conj(t01) * u) + a11 * v + a12 * (t12 * w);"
        "z = a02 * (conj(t02) * u) + a12 * (conj(t12) * v) + a22 * w;",
        "real_symbol_times",
    )
