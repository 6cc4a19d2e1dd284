"""The sine and cosine transforms that make a uniform grid block diagonal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from skfem_adini.solvers.exact_matrices import exact_matrix
from skfem_adini.uniform.symbols import exact_symbol, is_odd, phase

Array = NDArray[np.float64]


class BlockDiagonalGrid:
    r"""The matrix of :math:`-\sum_i k_i u_{ii} + c u` in a basis of sines (`dirichlet`) or cosines.
    All blocks are factored together as :math:`L D L^T`, with an array over the modes for each
    entry. Arrays of dofs have the shape (dim + 1, n_x + 1, n_y + 1(, n_z + 1))."""

    def __init__(
        self,
        cells: Sequence[int],
        steps: Sequence[float],
        k: Sequence[float],
        c: float,
        dirichlet: bool,
    ) -> None:
        self._cells, self._dim, self._dirichlet = tuple(cells), len(cells), dirichlet
        self._scale = np.array([1.0, *steps])
        self.shape = (self._dim + 1, *(n + 1 for n in cells))
        self.singular = not dirichlet and c == 0
        volume = float(np.prod(steps))
        self._weights: list[tuple[int | None, float]] = [
            (i, volume * k[i] / h**2) for i, h in enumerate(steps)
        ]
        self._weights += [(None, volume * c)]
        self._lower, self._pivots = self._factorize()

    def fixed(self) -> NDArray[np.bool_]:
        """Return a mask of the dofs that vanish: those on the boundary where a sine is zero."""
        mask = np.ones(self.shape, dtype=bool)
        for p, part in enumerate(mask):
            part[self._inside(p)] = False
        return mask

    def diagonal(self) -> Array:
        """Return the diagonal of the matrix at an inner vertex, shape (dim + 1,)."""
        total = np.zeros(self._dim + 1)
        for direction, weight in self._weights:
            exact = exact_matrix(self._dim, direction, direction)
            cell = np.diag(exact.numerators)[: self._dim + 1] / exact.denominator
            total += 2**self._dim * weight * cell
        return total * self._scale**2

    def solve(self, load: Array, constant: float = 0.0) -> Array:
        """Return the solution for an assembled load; entries of fixed dofs do not count.
        A singular matrix is inverted on loads of mean zero; the mean itself is multiplied by
        `constant`."""
        z = np.zeros(self.shape)
        for p, scale in enumerate(self._scale):
            inside: Any = (p, *self._inside(p))
            z[inside] = self._forward(p, load[inside] / scale)
        origin = (0,) * z.ndim
        mean = z[origin]
        for (p, q), factor in self._lower.items():
            z[p] -= factor * z[q]
        z /= self._pivots
        if self.singular:
            z[origin] = constant * mean
        for (p, q), factor in reversed(self._lower.items()):
            z[q] -= factor * z[p]
        x = np.zeros(self.shape)
        for p, scale in enumerate(self._scale):
            inside = (p, *self._inside(p))
            x[inside] = self._backward(p, z[inside]) / scale
        return x

    def _has_sine(self, p: int, direction: int) -> bool:
        return (p == direction + 1) != self._dirichlet

    def _inside(self, p: int) -> tuple[slice, ...]:
        """Return the places, and also the modes, at which the sines of a dof do not vanish."""
        return tuple(
            slice(1, -1) if self._has_sine(p, i) else slice(None) for i in range(self._dim)
        )

    def _axes(self, p: int) -> tuple[list[int], list[int]]:
        sines = [i for i in range(self._dim) if self._has_sine(p, i)]
        return sines, [i for i in range(self._dim) if i not in sines]

    def _forward(self, p: int, load: Array) -> Array:
        """Transform a load, continued by reflection: with cosines this doubles boundary values."""
        sines, cosines = self._axes(p)
        for axis in cosines:
            ends = np.moveaxis(load, axis, 0)
            ends[0] *= 2
            ends[-1] *= 2
        load = fft.dctn(load, type=1, axes=cosines, overwrite_x=True)
        return fft.dstn(load, type=1, axes=sines, overwrite_x=True)

    def _backward(self, p: int, modes: Array) -> Array:
        sines, cosines = self._axes(p)
        values = fft.idctn(modes, type=1, axes=cosines)
        return fft.idstn(values, type=1, axes=sines, overwrite_x=True)

    def _factorize(self) -> tuple[dict[tuple[int, int], Array], Array]:
        """Return the entries below the diagonal of L, row by row, and the diagonal D."""
        size = self._dim + 1
        blocks = {(p, q): self._entry(p, q) for p in range(size) for q in range(p + 1)}
        if self.singular or self._dirichlet:  # no zero pivot for constants or a mode u lacks
            blocks[0, 0][(0,) * self._dim] = 1.0
        lower: dict[tuple[int, int], Array] = {}
        pivots = np.empty(self.shape)
        for p in range(size):
            for q in range(p):
                entry = blocks[p, q]
                for r in range(q):
                    entry = entry - lower[p, r] * pivots[r] * lower[q, r]
                lower[p, q] = entry / pivots[q]
            pivots[p] = blocks[p, p]
            for r in range(p):
                pivots[p] -= lower[p, r] ** 2 * pivots[r]
        return lower, pivots

    def _entry(self, p: int, q: int) -> Array:
        """Return one entry of the blocks of all modes."""
        entry: Any = sum(
            weight * exact_symbol(self._dim, i).numerators[p, q] / exact_symbol(self._dim, i)[1]
            for i, weight in self._weights
        )
        for i, n in enumerate(self._cells):
            half = 0.5 * np.pi * np.arange(n + 1) / n
            if is_odd(p, q, i):
                sines = 4 * np.sin(half) * np.cos(half)
                sines[-1] = 0.0
                waves = np.array([np.zeros(n + 1), sines])
            else:
                waves = np.array([np.ones(n + 1), -4 * np.sin(half) ** 2])
            entry = np.tensordot(entry, waves, axes=(0, 0))
        return phase(p, q, self._dirichlet) * np.asarray(entry)
