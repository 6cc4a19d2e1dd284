r"""Dense matrices of symbols on the nodes of a plane, by images behind its mirrored sides.

On a periodic grid the matrix of a symbol has the entry :math:`g_{kl}(i - j)` for unknown k of node
i and unknown l of node j, with the inverse transform g of the symbol. Between mirrored sides a
displacement of node j comes with its image at -j, of the sign of the parity :math:`s_l`, hence

.. math:: g_{kl}(i - j) + s_l g_{kl}(i + j), \qquad g_{kl}(-d) = s_k s_l g_{kl}(d) .

A node on a side is its own image, and of the force on it half belongs to the body. With two
directions the images in both are taken.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.spectral.lateral_waves import LateralWaves


def dense_matrix(
    symbol: Any, lateral: LateralWaves, turn: Any, kinds: NDArray[np.intp], forces: bool
) -> Any:
    """The matrix of a symbol, of some unknowns of all nodes of a plane.

    Parameters
    ----------
    symbol : array of NumPy or CuPy, shape (waves, m, m)
        Real, of the waves that `turn` makes of those of `lateral`.
    lateral : LateralWaves
    turn : array, shape (r,)
        Powers of the imaginary unit, one for each unknown of a node.
    kinds : ndarray of int, shape (m,)
        The unknowns of the symbol.
    forces : bool
        It makes forces of displacements; else displacements of forces.

    Returns
    -------
    array, shape (nodes, m, nodes, m)
        Entries of unknowns that a side holds mean nothing.
    """
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
    # An odd wave is -i times its coefficient; `LateralWaves.inverse` sees to it where one of the
    # two unknowns is odd, but takes it to be the force.
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
    """Nodes on nodes, or in some directions on images of nodes, shape (*points, *points)."""
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
