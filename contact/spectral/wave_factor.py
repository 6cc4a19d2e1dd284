r"""Schur complement of a stack of layers, wave by wave, with loads on all its planes of nodes.

Slabs of :math:`2^l` layers of cells have for every wave the blocks (P, Q, R) of
`contact.spectral.slab_symbols`. The plane between two equal ones, with :math:`M = R + P`, moves by

.. math:: u = w - M^{-1} (Q^H u_{below} + Q u_{above}), \qquad w = M^{-1} f,

and transfers the loads :math:`-Q w` and :math:`-Q^H w` to the planes below and above. The pieces of
powers of two are added from the top: with the stiffness A of everything above a piece, the
stiffness on its lower plane is :math:`P - Q (R + A)^{-1} Q^H`.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contact.spectral.lateral_waves import LateralWaves
from contact.spectral.slab_symbols import Slab, joined
from skfem_adini.ground.arrays import host, namespace

Array = NDArray[np.float64]
Waves = Any  # arrays of NumPy or CuPy, shape (waves, r, ...)


class Middle(NamedTuple):
    """The plane between two equal slabs: its compliance, and its response to the outer planes."""

    inverse: Waves
    below: Waves  # M^-1 Q^H
    above: Waves  # M^-1 Q

    @classmethod
    def of(cls, slab: Slab) -> Middle:
        """The plane between two copies of a slab."""
        inverse = namespace(slab.P).linalg.inv(slab.R + slab.P)
        inverse = 0.5 * (inverse + _adjoint(inverse))
        return cls(inverse, inverse @ _adjoint(slab.Q), inverse @ slab.Q)


class Piece(NamedTuple):
    """A slab of 2^m layers with the planes of its halves, and the compliance of its top."""

    middles: tuple[Middle, ...]  # the finest first
    row: int  # number of its lowest plane
    inverse: Waves  # compliance of its top's free unknowns, including all above
    below: Waves  # minus their response to the lowest plane

    @property
    def height(self) -> int:
        """Number of layers of cells."""
        return 1 << len(self.middles)


class WaveFactor:
    """Elimination of all planes of nodes above the lowest one; a `SchurFactor`. Unknowns of all
    nodes are ordered by planes from the bottom up, zero if fixed; those of a node vary fastest."""

    def __init__(
        self,
        layers: Sequence[tuple[Slab, int]],
        lateral: LateralWaves,
        turns: NDArray[np.int64],  # powers of i that make the waves of an unknown real
        loose: NDArray[np.intp],  # node unknowns that are free on the top
        kept: NDArray[np.intp],  # kept unknowns of the lowest plane, including all values
        xp: Any,
        lengths: Array | None = None,  # unknowns times these are displacements
    ) -> None:
        self._lateral, self.xp = lateral, xp
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
        self._symbol = 0.5 * (symbol + _adjoint(symbol))
        self._inverse: Waves = None
        self._last: tuple[Any, Any] | None = None

    def _folded(self, layers: Sequence[tuple[Slab, int]]) -> Waves:
        """Fold all pieces from the top; returns the stiffness on the lowest plane."""
        xp, above = self.xp, None
        self.pieces: list[Piece] = []
        row = self.rows - 1
        for cell, count in reversed(layers):
            slab, middles = cell, []
            for level in range(count.bit_length()):
                if level:
                    middles.append(Middle.of(slab))
                    slab = joined(slab, slab)
                if not count >> level & 1:
                    continue
                row -= 1 << level
                if above is None:
                    M = slab.R[:, self._loose[:, None], self._loose]
                    coupling = slab.Q[:, :, self._loose]
                else:
                    M, coupling = slab.R + above, slab.Q
                inverse = xp.linalg.inv(M) if M.shape[1] else M
                below = inverse @ _adjoint(coupling)
                above = slab.P - coupling @ below
                above = 0.5 * (above + _adjoint(above))
                self.pieces.append(Piece(tuple(middles), row, inverse, below))
        return above

    @property
    def schur(self) -> Any:
        """Stiffness of the boundary, on the device, shape (nb, nb)."""
        return self._dense(self._symbol, forces=True)

    def hold(self, free: NDArray[np.intp]) -> bool:
        """Invert the stiffness wave by wave, with springs on the means of the unknowns `free`.
        Returns False if it is not positive definite; there is then no compliance."""
        kinds, symbol = host(self._kept), np.array(host(self._symbol))
        of_mean = np.flatnonzero(np.isin(kinds, free))
        symbol[0, of_mean, of_mean] += np.trace(symbol.mean(axis=0)) / kinds.size
        at, k = np.nonzero(self._lateral.missing(kinds).reshape(kinds.size, -1).T)
        symbol[at, k], symbol[at, :, k], symbol[at, k, k] = 0.0, 0.0, 1.0
        try:
            np.linalg.cholesky(symbol)
        except np.linalg.LinAlgError:
            return False
        inverse = np.linalg.inv(symbol)
        inverse[at, k, k] = 0.0  # a one there would cause rounding that depends on the unit
        self._inverse = self.xp.asarray(0.5 * (inverse + inverse.transpose(0, 2, 1)))
        return True

    @property
    def compliance(self) -> Any:
        """The inverse of the stiffness with the springs of `hold`, on the device, shape (nb,
        nb)."""
        return self._dense(self._inverse, forces=False)

    def flexed(self, r: Array) -> Array:
        """The product of the compliance and forces on the boundary, shape (nb,)."""
        size = 1.0 / self._lengths
        doubled = self._kept_grid(r) / self._lateral.weights[..., None, None]
        waves = self._inverse @ self._in_waves(doubled, self._kept, size)
        return self._of_kept(self._on_grid(waves, self._kept, size))

    def _kept_grid(self, values: Array) -> Any:
        """Values of the boundary on all nodes, shape (*points, m, 1), on the device."""
        whole = np.zeros(free_size(self._lateral, self._kept))
        whole[self._own] = values
        return self.xp.asarray(whole).reshape(*self._lateral.points, self._kept.size, 1)

    def _of_kept(self, grid: Any) -> Array:
        return np.asarray(host(grid)).reshape(-1)[self._own]

    def _dense(self, symbol: Waves, forces: bool) -> Any:
        """The dense matrix of a symbol, for the kept unknowns of all nodes that are not fixed."""
        kinds, own = host(self._kept), self.xp.asarray(self._own)
        size = self._lengths[self._kept]
        scaled = symbol * (size[:, None] * size) if forces else symbol / (size[:, None] * size)
        dense = dense_matrix(scaled, self._lateral, self._turn, kinds, forces)
        count = dense.shape[0] * dense.shape[1]
        dense = dense.reshape(count, count)
        if own.size < count:
            dense = dense[own[:, None], own]
        return 0.5 * (dense + dense.T)

    def _in_waves(self, grid: Any, kinds: Any, times: Any) -> Waves:
        """Values, (*points, m, n), of the given unknowns, each times its entry of `times`, as
        waves, (waves, m, n).
        """
        xp = self.xp
        waves = self._lateral.forward(xp.moveaxis(grid, -2, 0), kinds=host(kinds))
        flat = xp.moveaxis(waves.reshape(waves.shape[0], -1, waves.shape[-1]), 0, 1)
        return (xp.conj(self._turn) * times)[kinds][:, None] * flat

    def _on_grid(self, waves: Waves, kinds: Any, times: Any) -> Any:
        """The inverse of `_in_waves`; each node unknown is multiplied by its entry of `times`."""
        xp = self.xp
        turned = xp.moveaxis((self._turn * times)[kinds][:, None] * waves, 1, 0)
        shaped = turned.reshape(waves.shape[1], *self._lateral.shape, waves.shape[2])
        return xp.moveaxis(self._lateral.inverse(shaped, kinds=host(kinds)), 0, -2)

    def _halved(self, forces: Any) -> Any:
        return forces * self._lateral.weights[..., None, None]

    def reduce(self, load: Any) -> Array:
        """Reduce a load of all unknowns to the kept ones, shape (nb,), on the host."""
        f = self._forward(load)[:, :, 0]
        down = f[:, self._kept] - (_adjoint(self._across) @ f[:, self._rest, None])[..., 0]
        return self._of_kept(
            self._halved(self._on_grid(down[..., None], self._kept, self._lengths))
        )

    def expand(self, load: Any, z_b: Array) -> Any:
        """All unknowns, shape (rows * nodes * r,), from the kept ones, on the load's device."""
        xp = self.xp
        u = self._forward(load).copy()
        lowest = self._in_waves(self._kept_grid(z_b), self._kept, self._lengths)[..., 0]
        inner = self._face[:, self._rest[:, None], self._rest]
        if self._rest.size:
            force = u[:, self._rest, 0]
            own = xp.linalg.solve(inner, force[..., None])[..., 0]
            u[:, self._rest, 0] = own - (self._across @ lowest[..., None])[..., 0]
        u[:, self._kept, 0] = lowest
        for q in range(len(self.pieces) - 1, -1, -1):
            self._recover(q, u)
        full = self._on_grid(u, xp.arange(self._r), 1.0 / self._lengths)  # (*points, r, rows)
        u = xp.moveaxis(full, -1, 0).ravel()
        return host(u) if namespace(load) is np else u

    def _forward(self, load: Any) -> Waves:
        """Forward elimination of a load; the lowest plane has the reduced load. The last result is
        cached for `reduce` and `expand`."""
        xp = self.xp
        if self._last is not None and bool(xp.array_equal(self._last[0], xp.asarray(load))):
            return self._last[1]
        given = xp.array(load)
        grid = given.reshape(self.rows, *self._lateral.points, self._r)
        doubled = xp.moveaxis(grid, 0, -1) / self._lateral.weights[..., None, None]
        f = self._in_waves(doubled, xp.arange(self._r), 1.0 / self._lengths)
        f = xp.ascontiguousarray(f)
        for q, piece in enumerate(self.pieces):
            low, high = piece.row, piece.row + piece.height
            for level, between in enumerate(piece.middles):
                bottom, middle, top = _planes(piece, level)
                own = xp.ascontiguousarray(f[:, :, middle])
                f[:, :, top] -= _adjoint(between.above) @ own
                f[:, :, bottom] -= _adjoint(between.below) @ own
                f[:, :, middle] = between.inverse @ own
            free = self._free(q)
            own = f[:, free, high, None]
            f[:, :, low] -= (_adjoint(piece.below) @ own)[..., 0]
            above = xp.zeros_like(f[:, :, high])
            above[:, free] = (piece.inverse @ own)[..., 0]
            f[:, :, high] = above
        self._last = given, f
        return f

    def _recover(self, q: int, u: Waves) -> None:
        """Displacement of the planes of a piece above its lowest one."""
        xp, piece = self.xp, self.pieces[q]
        low, high = piece.row, piece.row + piece.height
        u[:, self._free(q), high] -= (piece.below @ u[:, :, low, None])[..., 0]
        for level in range(len(piece.middles) - 1, -1, -1):
            bottom, middle, top = _planes(piece, level)
            between = piece.middles[level]
            u[:, :, middle] -= between.below @ xp.ascontiguousarray(u[:, :, bottom])
            u[:, :, middle] -= between.above @ xp.ascontiguousarray(u[:, :, top])

    def _free(self, q: int) -> Any:
        """Free unknowns of the top of a piece."""
        return self._loose if q == 0 else self.xp.arange(self._r)


def free_size(lateral: LateralWaves, kept: Any) -> int:
    """Number of kept unknowns of all nodes of a plane, including fixed ones."""
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


# Dense matrices of symbols on the nodes of a plane, by images behind its mirrored sides.
#
# On a periodic grid the matrix of a symbol has the entry :math:`g_{kl}(i - j)` for unknown k of
# node i and unknown l of node j, with the inverse transform g of the symbol. Between mirrored sides
# a displacement of node j has an image at -j, with the sign of its parity :math:`s_l`, hence
#
# .. math:: g_{kl}(i - j) + s_l g_{kl}(i + j), \qquad g_{kl}(-d) = s_k s_l g_{kl}(d) .
#
# A node on a side is its own image, and half of the force on it belongs to the body. With two
# directions there are images in both.


def dense_matrix(
    symbol: Any, lateral: LateralWaves, turn: Any, kinds: NDArray[np.intp], forces: bool
) -> Any:
    """The matrix, (nodes, m, nodes, m), of a real symbol of some unknowns of a plane, of the turned
    waves of `lateral`; entries of unknowns fixed by a side are meaningless."""
    xp, m, points = lateral.xp, kinds.size, lateral.points
    odd = np.array([np.zeros(m, bool) if own is None else own[kinds] for own in lateral.odd])
    kernels = _kernels(symbol, lateral, turn[xp.asarray(kinds)], odd)
    images = list(product(*[(False, True) if twice else (False,) for twice in lateral.mirrored]))
    nodes = int(np.prod(points))
    dense = xp.empty((nodes, m, nodes, m))
    for k, l in np.ndindex(m, m):
        terms = [_term(kernels[k, l], lateral, at, odd[:, [k, l]], forces) for at in images]
        dense[:, k, :, l] = sum(terms).reshape(nodes, nodes)
    if forces:
        dense *= lateral.weights.reshape(nodes, 1, 1, 1)
    return dense


def _kernels(symbol: Any, lateral: LateralWaves, turn: Any, odd: NDArray[np.bool_]) -> Any:
    """Inverse transforms g of all entries, shape (m, m, *points), for distances from 0 on."""
    xp, m = lateral.xp, turn.size
    # An odd wave is -i times its coefficient; `LateralWaves.inverse` applies this if one of the two
    # unknowns is odd, but assumes that it is the force.
    signs = np.prod(np.where(~odd[:, :, None] & odd[:, None], -1.0, 1.0), axis=0)
    waves = symbol * (turn[:, None] * xp.conj(turn) * xp.asarray(signs))
    waves = xp.moveaxis(waves.reshape(-1, m * m), 0, 1).reshape(m * m, *lateral.shape)
    parities = [
        (own[:, None] ^ own).ravel() if twice else None
        for own, twice in zip(odd, lateral.mirrored, strict=True)
    ]
    grid = LateralWaves(lateral.cells, parities, xp).inverse(waves)
    return grid.reshape(m, m, *lateral.points)


def _term(
    kernel: Any, lateral: LateralWaves, images: tuple[bool, ...], odd: Any, forces: bool
) -> Any:
    """Influence between nodes, or from images in some directions, shape (*points, *points)."""
    xp, dim = lateral.xp, len(images)
    ends, flipped = [], [slice(None)] * dim
    for axis, (image, (of_force, of_source)) in enumerate(zip(images, odd, strict=True)):
        n, twice = lateral.cells[axis], lateral.mirrored[axis]
        if image:
            d = np.arange(2 * n + 1)
            turned, index = d > n, np.minimum(d, 2 * n - d)
        else:
            most = lateral.points[axis] - 1
            d = np.arange(-most, most + 1)
            turned, index = d < 0, np.abs(d) if twice else d % n
        sign = np.where(turned & (of_force ^ of_source), -1.0, 1.0)
        sign *= -1.0 if image and of_source else 1.0
        shape = [-1 if own == axis else 1 for own in range(dim)]
        kernel = kernel.take(xp.asarray(index), axis=axis) * xp.asarray(sign).reshape(shape)
        flipped.append(slice(None) if image else slice(None, None, -1))
        own_image = np.isin(np.arange(lateral.points[axis]), (0, n)) & (image and forces)
        ends.append(xp.asarray(np.where(own_image, 0.0, 1.0)).reshape(shape))
    windows = xp.lib.stride_tricks.as_strided(kernel, lateral.points * 2, kernel.strides * 2)[
        tuple(flipped)
    ]
    for weight in ends if forces else []:
        windows = windows * weight
    return windows
