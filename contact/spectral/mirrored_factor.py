"""The factor of a mirrored block without a mesh, by cosine and sine transforms."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.arrays.dense_arrays import HostArrays
from contact.body.layers.lateral_sides import KINDS, odd_of
from contact.body.layers.layered_block import LayeredBlock
from contact.body.layers.layers import PER_NODE
from contact.condensation.layers import FACTORS
from contact.errors import InputError
from contact.spectral.lateral_waves import LateralWaves
from contact.spectral.layer_arguments import node_lengths
from contact.spectral.slab_symbols import real_slab
from contact.spectral.wave_cells import cell_table, functions, parities
from contact.spectral.wave_factor import WaveFactor


class MirroredFactor(WaveFactor):
    """`WaveFactor` of a `LayeredBlock`, with derivatives in their own units. `free` (2, 6 (columns
    + 1)) marks free unknowns of all rows but the top, and of the top; `boundary` are kept.
    """

    def __init__(
        self,
        body: LayeredBlock,
        free: NDArray[np.bool_],
        boundary: NDArray[np.int64],
        arrays: HostArrays,
    ) -> None:
        xp, lateral = arrays.xp, LateralWaves((body.columns,), [odd_of(body)], arrays.xp)
        held = np.stack([lateral.held(k) for k in range(PER_NODE)], axis=-1)
        below, top = free.reshape(2, *held.shape)
        loose = np.flatnonzero(top[1:-1].any(axis=0) if body.columns > 1 else top.any(axis=0))
        at_top = ~held & np.isin(np.arange(PER_NODE), loose)
        if not (np.array_equal(below, ~held) and np.array_equal(top, at_top)):
            raise InputError(
                "path: supports besides those of the sides and the whole top, which transforms do "
                "not diagonalise; leave path out"
            )
        lengths = node_lengths(KINDS, [body.width / body.columns], body.layers)
        parity = parities(KINDS, 2)
        turns = (lateral.turns + parity - (lateral.turns + parity)[0]) % 4
        values = functions(lateral.steps)
        slabs = [
            (real_slab(cell_table(one, lengths, parity), values), layer.cells)
            for one, layer in zip(body.cell_bodies, body.layers, strict=True)
        ]
        kept = np.unique(boundary % PER_NODE)
        super().__init__(slabs, lateral, turns, loose, kept, xp, lengths)
        if not np.array_equal(self.boundary, boundary):
            raise AssertionError("boundary: not of some kinds at all nodes")


def _mirrored(body: Any, free: Any, boundary: Any, arrays: HostArrays) -> MirroredFactor:
    return MirroredFactor(body, free, boundary, arrays)


FACTORS["fourier"] = _mirrored
