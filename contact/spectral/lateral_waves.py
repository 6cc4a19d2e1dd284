r"""Waves along the sides of layers: Fourier series, or cosines and sines of a mirrored body.

A body between two sides with zero normal displacement and zero shear is half of a periodic,
mirror-symmetric body of twice the width: displacements along the side are even functions of the
distance from it, the normal one is odd. If the displacements along the side and the normal traction
are zero, parities are reversed. A derivative across the side has the opposite parity. With n cells
the waves have the phases :math:`\theta_k = \pi k / n` a cell, and

.. math::
    u_j = \frac{1}{2n} \sum_k \hat u_k e^{i \theta_k j}, \qquad
    \hat u_k = \hat w_k \text{ (even)}, \quad -i \hat w_k \text{ (odd)}

has real w: a cosine transform of the even unknowns and a sine transform of the odd ones (both of
the first type, on the nodes), here by real transforms of the mirrored values.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.spectral.real_symbol import RealSymbol
from contact.spectral.transforms import fft_of
from skfem_adini.ground.arrays import namespace

Grid = Any  # an array of NumPy or CuPy, shape (m, nx[, ny]) or (nx[, ny])


class LateralWaves:
    """Transforms of values on the nodes of a plane. `odd` lists for each direction the odd node
    unknowns, None if periodic; `points` are the numbers of nodes, `shape` those of waves.
    """

    def __init__(
        self, cells: Sequence[int], odd: Sequence[NDArray[np.bool_] | None], xp: Any
    ) -> None:
        self.cells, self.odd, self.xp = tuple(cells), tuple(odd), xp
        self.mirrored = tuple(parity is not None for parity in odd)
        self._turning = [axis for axis, twice in enumerate(self.mirrored) if not twice]
        self.points = tuple(n + twice for n, twice in zip(cells, self.mirrored, strict=True))
        halved = self._turning[-1:]
        self.shape = tuple(
            n // 2 + 1 if axis in halved else n for axis, n in enumerate(self.points)
        )

    @property
    def steps(self) -> list[Any]:
        """Phase change per cell of the waves in each direction, one-dimensional arrays."""
        xp, steps = self.xp, []
        for axis, n in enumerate(self.cells):
            if self.mirrored[axis]:
                steps.append(xp.pi / n * xp.arange(n + 1))
            else:
                steps.append(2 * xp.pi * xp.fft.fftfreq(n)[: self.shape[axis]])
        return [abs(step) if axis in self._turning[-1:] else step
                for axis, step in enumerate(steps)]  # fmt: skip

    @property
    def turns(self) -> NDArray[np.int64]:
        """Power of i that multiplies the complex waves of each unknown, so that the symbols of
        mirrored directions are real.
        """
        odd = [np.asarray(p, dtype=int) for p in self.odd if p is not None]
        return np.sum(odd, axis=0) if odd else np.zeros(1, dtype=int)

    def doubled(self, forces: Grid) -> Grid:
        """Forces on the mirrored body: doubled on sides."""
        return forces * self._ends if any(self.mirrored) else forces

    def halved(self, forces: Grid) -> Grid:
        """Forces on the body from those on the mirrored body: halved on sides."""
        return forces / self._ends if any(self.mirrored) else forces

    @property
    def weights(self) -> Grid:
        """Area of each node in units of a cell, shape (nx[, ny]): halves at sides."""
        return 1.0 / self._ends

    @cached_property
    def _ends(self) -> Grid:
        ends = self.xp.ones(self.points)
        for axis, twice in enumerate(self.mirrored):
            if twice:
                at: Any = [slice(None)] * len(self.points)
                at[axis] = [0, -1]
                ends[tuple(at)] *= 2.0
        return ends

    def forward(self, values: Grid, first: int = 0, kinds: Any = None) -> Any:
        """Waves, (m, *shape, ...), of node values (m, *points, ...), for unknowns from `first` on,
        or with the numbers `kinds`."""
        chosen = slice(first, None) if kinds is None else kinds
        for axis, parity in enumerate(self.odd):
            if parity is not None:
                values = self._mirrored(_series, values, parity[chosen], axis)
        if not self._turning:
            return values
        return fft_of(self.xp).rfftn(values, axes=[axis + 1 for axis in self._turning])

    def inverse(self, waves: Any, first: int = 0, kinds: Any = None) -> Grid:
        """Values on the nodes, shape (m, *points, ...), the inverse of `forward`."""
        values, chosen = waves, slice(first, None) if kinds is None else kinds
        if self._turning:
            size = [self.cells[axis] for axis in self._turning]
            axes = [axis + 1 for axis in self._turning]
            values = fft_of(self.xp).irfftn(waves, s=size, axes=axes)
        for axis, parity in enumerate(self.odd):
            if parity is not None:
                values = self._mirrored(_sum, values, parity[chosen], axis)
        return values

    def filtered(self, symbol: RealSymbol, values: Grid, first: int = 0) -> Grid:
        """The product of a symbol of m components and values, shape (m, *points)."""
        return self.inverse(symbol.times(self.forward(values, first)), first)

    def held(self, unknown: int) -> NDArray[np.bool_]:
        """Nodes on which an unknown is zero because it is odd, shape (nx[, ny]), on the host."""
        zero = np.zeros(self.points, dtype=bool)
        for axis, parity in enumerate(self.odd):
            if parity is not None and parity[unknown]:
                np.moveaxis(zero, axis, 0)[[0, -1]] = True
        return zero

    def missing(self, kinds: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Host mask (m, *shape) of the waves that odd unknowns lack: constant and shortest."""
        none = np.zeros((kinds.size, *self.shape), dtype=bool)
        for axis, parity in enumerate(self.odd):
            if parity is not None:
                for end in (0, -1):
                    np.moveaxis(none, axis + 1, 1)[parity[kinds], end] = True
        return none

    def _mirrored(self, transform: Any, values: Grid, parity: Any, axis: int) -> Grid:
        xp = self.xp
        parts = [transform(xp.moveaxis(part, axis, -1), bool(odd), self.cells[axis])
                 for part, odd in zip(values, parity, strict=False)]  # fmt: skip
        return xp.moveaxis(xp.stack(parts), -1, axis + 1)


def _series(values: Grid, odd: bool, cells: int) -> Grid:
    """Cosine or sine transform of the first type along the last axis, n + 1 coefficients."""
    xp, inner = namespace(values), values[..., -2:0:-1]
    whole = xp.concatenate((values, -inner if odd else inner), axis=-1)
    if odd:
        whole[..., 0] = whole[..., cells] = 0.0
    waves = fft_of(xp).rfft(whole, axis=-1)
    return -waves.imag if odd else waves.real


def _sum(waves: Grid, odd: bool, cells: int) -> Grid:
    """The inverse of `_series`: n + 1 values along the last axis."""
    fft = fft_of(namespace(waves))
    values = fft.irfft(-1j * waves if odd else waves, n=2 * cells, axis=-1)[..., : cells + 1]
    if odd:
        values[..., 0] = values[..., cells] = 0.0
    return values
