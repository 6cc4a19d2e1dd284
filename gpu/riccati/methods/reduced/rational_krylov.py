"""Orthonormal bases of block rational Krylov spaces, with a few shifts used cyclically."""

from __future__ import annotations

from typing import Any

import numpy as np

from gpu.arrays.namespace import to_host
from gpu.riccati.problem.state_matrix import EPS, Factors, StateMatrix

DROP = 1e-11  # a new unit vector whose part outside the space is smaller counts as rounding


class RationalKrylov:
    r"""The space of :math:`G,\ (A - s_1 E)^{-1} G,\ (A - s_2 E)^{-1} E (A - s_1 E)^{-1} G,\ \dots`

    with the shifts used cyclically; the orthonormal basis grows by a block at a time (Ruhe 1984).
    Each of the few matrices is factored only once.

    Parameters
    ----------
    state : StateMatrix
    seed : array, shape (n, p)
        G.
    shifts : sequence of Factors
        Of A - s E, one for each shift s.
    transposed : bool
        Whether the space is that of :math:`A^T, E^T`.

    Attributes
    ----------
    rank : int
        Columns of the basis.
    solves : int
    exhausted : bool
        Whether the last block added no direction, so that the space is invariant, or filled the
        whole space.
    """

    def __init__(
        self, state: StateMatrix, seed: Any, shifts: list[Factors], transposed: bool = False
    ) -> None:
        self._state, self._shifts, self._transposed = state, shifts, transposed
        self._turn, self.solves, self.exhausted = 0, 0, False
        self._kept = state.xp.empty((state.n, 4 * seed.shape[1]), order="F")
        self.rank = 0
        self._append(seed)

    @property
    def W(self) -> Any:
        """The basis, shape (n, rank)."""
        return self._kept[:, : self.rank]

    def grow(self) -> None:
        """Add a block: the last block multiplied by E and solved with the next shifted matrix."""
        if self.exhausted:
            return
        factors = self._shifts[self._turn % len(self._shifts)]
        self._turn += 1
        self.solves += 1
        if self._transposed:
            block = factors.solve_transposed(self._state.mass_transposed(self._last))
        else:
            block = factors.solve(self._state.mass(self._last))
        self._append(block)

    def _projected(self, block: Any) -> Any:
        """The part of a block orthogonal to the space.

        The second product is transposed, as it is twice as fast with rows as with columns.
        """
        inside = self.W.T @ block
        return block - (inside.T @ self.W.T).T

    def _append(self, block: Any) -> None:
        xp = self._state.xp
        size = xp.linalg.norm(block, axis=0)
        moving = xp.flatnonzero(size > 0.0)
        block = self._projected(block[:, moving] / size[moving])
        # Columns that are nearly parallel among themselves or to the space are left out.
        if block.shape[1]:
            gram = to_host(block.T @ block)
            values, vectors = np.linalg.eigh((gram + gram.T) / 2)
            kept = values > DROP**2 + EPS * values.max()
            block = block @ xp.asarray(vectors[:, kept] / np.sqrt(values[kept]))
        if block.shape[1]:
            block = xp.linalg.qr(self._projected(block))[0]
        room = self._state.n - self.rank
        block = block[:, :room]
        self._last = block
        rank = self.rank + block.shape[1]
        if rank > self._kept.shape[1]:
            # Allocate twice as much: copying the basis for each block costs more than computing it.
            kept = xp.empty((self._state.n, min(2 * rank, self._state.n)), order="F")
            kept[:, : self.rank] = self.W
            self._kept = kept
        self._kept[:, self.rank : rank] = block
        self.rank = rank
        self.exhausted = block.shape[1] in (0, room)
