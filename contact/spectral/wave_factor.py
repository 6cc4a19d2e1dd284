r"""Schur complement of a stack of layers, wave by wave, with loads on all its planes of nodes.

Slabs of :math:`2^l` layers of cells have for every wave the blocks (P, Q, R) of
`contact.spectral.slab_symbols`. The plane between two equal ones, with :math:`M = R + P`, moves by

.. math:: u = w - M^{-1} (Q^H u_{below} + Q u_{above}), \qquad w = M^{-1} f,

and hands the loads :math:`-Q w` and :math:`-Q^H w` to the planes below and above. The pieces of
powers of two are folded from the top: with the stiffness A of all above a piece, the one on its
lower plane is :math:`P - Q (R + A)^{-1} Q^H`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contact.spectral.lateral_waves import LateralWaves
from contact.spectral.slab_symbols import Slab, joined
from contact.spectral.transforms import host

Array = NDArray[np.float64]
Waves = Any  # arrays of NumPy or CuPy, shape (waves, r, ...)
_COLUMNS = 256  # unit displacements that are transformed at a time


class Piece(NamedTuple):
    """A slab of 2^m layers: those of its halves, its lowest plane, the stiffness M on its top."""

    powers: list[Slab]
    row: int
    M: Waves

    @property
    def height(self) -> int:
        """Number of layers of cells."""
        return 1 << (len(self.powers) - 1)


class WaveFactor:
    """Elimination of all planes of nodes above the lowest one; a `SchurFactor`.

    Unknowns are those of all nodes, held ones included: planes from the bottom up, in them the
    nodes, the unknowns of a node last. Values of held ones are zero.

    Parameters
    ----------
    layers : sequence of (Slab, int)
        Slab of one layer of cells and number of layers, from the bottom up.
    lateral : LateralWaves
    turns : ndarray of int, shape (r,)
        Powers of the imaginary unit that take the waves of each unknown to those of real slabs.
    loose : ndarray of int
        Unknowns of a node that are free on the top.
    kept : ndarray of int
        Unknowns of a node of the lowest plane that are kept; all values are among them.
    xp : module
        `numpy` or `cupy`.
    lengths : ndarray, shape (r,), optional
        By which the unknowns of a node are multiplied to become displacements, the unknowns of
        the slabs. Default: they are displacements.

    Attributes
    ----------
    boundary : ndarray of int
        The kept unknowns that no side holds, ascending.
    schur : array, shape (nb, nb)
        Their stiffness, on the device.
    """

    def __init__(
        self,
        layers: Sequence[tuple[Slab, int]],
        lateral: LateralWaves,
        turns: NDArray[np.int64],
        loose: NDArray[np.intp],
        kept: NDArray[np.intp],
        xp: Any,
        lengths: Array | None = None,
    ) -> None:
        self._lateral, self._xp = lateral, xp
        turn = np.array([1, 1j, -1, -1j])[turns % 4]
        self._turn = xp.asarray(turn.real if all(lateral.mirrored) else turn)
        self._loose = xp.asarray(loose)
        r = layers[0][0].P.shape[1]
        self._lengths = xp.ones(r) if lengths is None else xp.asarray(lengths)
        self._kept = xp.asarray(kept)
        self._rest = xp.asarray(np.setdiff1d(np.arange(r), kept))
        self.rows, self._r = 1 + sum(count for _, count in layers), r
        free = np.stack([~lateral.held(k) for k in kept], axis=-1)  # (*points, nkept)
        of_node = r * np.arange(int(np.prod(lateral.points))).reshape(*lateral.points, 1)
        self._own, self.boundary = np.flatnonzero(free), (of_node + kept)[free]
        self._face = self._folded(layers)
        inner = self._face[:, self._rest[:, None], self._rest]
        outer = self._face[:, self._rest[:, None], self._kept]
        self._across = xp.linalg.solve(inner, outer) if self._rest.size else outer
        symbol = self._face[:, self._kept[:, None], self._kept] - _adjoint(outer) @ self._across
        self.schur = self._assembled(0.5 * (symbol + _adjoint(symbol)))
        self._last: tuple[Array, Any] | None = None

    def _folded(self, layers: Sequence[tuple[Slab, int]]) -> Waves:
        """Fold all pieces from the top; returns the stiffness on the lowest plane."""
        xp, above = self._xp, None
        self.pieces: list[Piece] = []
        row = self.rows - 1
        for cell, count in reversed(layers):
            powers = [cell]
            while 2 << (len(powers) - 1) <= count:
                powers.append(joined(powers[-1], powers[-1]))
            for level, slab in enumerate(powers):
                if not count >> level & 1:
                    continue
                row -= 1 << level
                if above is None:
                    M = slab.R[:, self._loose[:, None], self._loose]
                    coupling = slab.Q[:, :, self._loose]
                else:
                    M, coupling = slab.R + above, slab.Q
                above = slab.P
                if M.shape[1]:
                    above = slab.P - coupling @ xp.linalg.solve(M, _adjoint(coupling))
                    above = 0.5 * (above + _adjoint(above))
                self.pieces.append(Piece(powers[: level + 1], row, M))
        return above

    def _assembled(self, symbol: Waves) -> Any:
        """The dense matrix of a symbol, of the kept unknowns of all nodes that are not held."""
        xp, count = self._xp, self._own.size
        dense = xp.empty((count, count))
        for first in range(0, count, _COLUMNS):
            columns = self._own[first : first + _COLUMNS]
            unit = np.zeros((free_size(self._lateral, self._kept), columns.size))
            unit[columns, np.arange(columns.size)] = 1.0
            grid = xp.asarray(unit).reshape(*self._lateral.points, self._kept.size, -1)
            waves = symbol @ self._in_waves(grid, self._kept, self._lengths)
            forces = self._on_grid(waves, self._kept, self._lengths)
            flat = self._halved(forces).reshape(-1, columns.size)
            dense[:, first : first + columns.size] = flat[xp.asarray(self._own)]
        return 0.5 * (dense + dense.T)

    def _in_waves(self, grid: Any, kinds: Any, times: Any) -> Waves:
        """Values, shape (*points, m, n), of the given unknowns as waves, (waves, m, n).

        Each unknown of a node is multiplied by its entry of `times`.
        """
        xp = self._xp
        waves = self._lateral.forward(xp.moveaxis(grid, -2, 0), kinds=host(kinds))
        flat = xp.moveaxis(waves.reshape(waves.shape[0], -1, waves.shape[-1]), 0, 1)
        return (xp.conj(self._turn) * times)[kinds][:, None] * flat

    def _on_grid(self, waves: Waves, kinds: Any, times: Any) -> Any:
        """The values of such waves, each unknown of a node multiplied by its entry of `times`."""
        xp = self._xp
        turned = xp.moveaxis((self._turn * times)[kinds][:, None] * waves, 1, 0)
        shaped = turned.reshape(waves.shape[1], *self._lateral.shape, waves.shape[2])
        return xp.moveaxis(self._lateral.inverse(shaped, kinds=host(kinds)), 0, -2)

    def _halved(self, forces: Any) -> Any:
        return forces * self._lateral.weights[..., None, None]

    def reduce(self, load: Array) -> Array:
        """Carry a load of all unknowns to the kept ones, shape (nb,)."""
        f = self._forward(load)[:, :, 0]
        down = f[:, self._kept] - (_adjoint(self._across) @ f[:, self._rest, None])[..., 0]
        grid = self._halved(self._on_grid(down[..., None], self._kept, self._lengths))
        return np.asarray(host(grid)).reshape(-1)[self._own]

    def expand(self, load: Array, z_b: Array) -> Array:
        """All unknowns, shape (rows * nodes * r,), from the kept ones."""
        xp = self._xp
        u = self._forward(load).copy()
        values = np.zeros(free_size(self._lateral, self._kept))
        values[self._own] = z_b
        grid = xp.asarray(values).reshape(*self._lateral.points, self._kept.size, 1)
        lowest = self._in_waves(grid, self._kept, self._lengths)[..., 0]
        inner = self._face[:, self._rest[:, None], self._rest]
        if self._rest.size:
            force = u[:, self._rest, 0]
            own = xp.linalg.solve(inner, force[..., None])[..., 0]
            u[:, self._rest, 0] = own - (self._across @ lowest[..., None])[..., 0]
        u[:, self._kept, 0] = lowest
        for q in range(len(self.pieces) - 1, -1, -1):
            self._recover(q, u)
        full = self._on_grid(u, xp.arange(self._r), 1.0 / self._lengths)  # (*points, r, rows)
        return np.asarray(host(xp.moveaxis(full, -1, 0))).ravel()

    def _forward(self, load: Array) -> Waves:
        """Eliminate a load: what `expand` needs on each plane, on the lowest one what arrives.

        Of the last load the result is kept: `reduce` and `expand` both need it.
        """
        if self._last is not None and np.array_equal(self._last[0], load):
            return self._last[1]
        xp = self._xp
        grid = xp.asarray(load).reshape(self.rows, *self._lateral.points, self._r)
        doubled = xp.moveaxis(grid, 0, -1) / self._lateral.weights[..., None, None]
        f = self._in_waves(doubled, xp.arange(self._r), 1.0 / self._lengths)
        f = xp.ascontiguousarray(f)
        for q, piece in enumerate(self.pieces):
            low, high = piece.row, piece.row + piece.height
            for level, slab in enumerate(piece.powers[:-1]):
                bottom, middle, top = _planes(piece, level)
                M = slab.R + slab.P
                w = xp.linalg.solve(M, f[:, :, middle])
                f[:, :, middle] = w
                f[:, :, top] -= _adjoint(slab.Q) @ w
                f[:, :, bottom] -= slab.Q @ w
            free, slab = self._free(q), piece.powers[-1]
            above = xp.zeros_like(f[:, :, high])
            if piece.M.shape[1]:
                w = xp.linalg.solve(piece.M, f[:, free, high, None])
                above[:, free] = w[..., 0]
                f[:, :, low] -= (slab.Q[:, :, free] @ w)[..., 0]
            f[:, :, high] = above
        self._last = load.copy(), f
        return f

    def _recover(self, q: int, u: Waves) -> None:
        """Displacement of the planes of a piece above its lowest one."""
        xp, piece, free = self._xp, self.pieces[q], self._free(q)
        low, high = piece.row, piece.row + piece.height
        slab = piece.powers[-1]
        if piece.M.shape[1]:
            pull = _adjoint(slab.Q[:, :, free]) @ u[:, :, low, None]
            u[:, free, high] -= xp.linalg.solve(piece.M, pull)[..., 0]
        for level in range(len(piece.powers) - 2, -1, -1):
            slab = piece.powers[level]
            bottom, middle, top = _planes(piece, level)
            pull = _adjoint(slab.Q) @ u[:, :, bottom] + slab.Q @ u[:, :, top]
            u[:, :, middle] -= xp.linalg.solve(slab.R + slab.P, pull)

    def _free(self, q: int) -> Any:
        """Free unknowns of the top of a piece."""
        return self._loose if q == 0 else self._xp.arange(self._r)


def free_size(lateral: LateralWaves, kept: Any) -> int:
    """Number of kept unknowns of all nodes of a plane, held ones included."""
    return int(np.prod(lateral.points)) * int(kept.size)


def _planes(piece: Piece, level: int) -> tuple[slice, slice, slice]:
    """Planes below, between and above the pairs of slabs of one level."""
    low, high, step = piece.row, piece.row + piece.height, 2 << level
    return (
        slice(low, high, step),
        slice(low + step // 2, high, step),
        slice(low + step, high + 1, step),
    )


def _adjoint(blocks: Waves) -> Waves:
    """The transposed blocks: they are real."""
    return blocks.transpose(0, 2, 1)
