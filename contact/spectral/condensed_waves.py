"""Condensation of a layered block by transforms, where its supports are those of its waves."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.blas_threads import one_blas_thread
from contact.arrays.dense_arrays import HostArrays, arrays_on
from contact.body.free_motions import unseen_motion
from contact.body.layers.lateral_sides import adrift
from contact.body.layers.meshed_block import MeshedBlock
from contact.condensation.condense import condense
from contact.condensation.condensed_body import BodyRows, CondensedBody
from contact.condensation.sparse import SparseBody
from contact.errors import InputError
from contact.spectral.layer_arguments import node_kinds
from contact.spectral.planes_of_nodes import Planes, planes_of
from contact.spectral.slab_symbols import real_slab
from contact.spectral.wave_cells import cell_table, functions, parities
from contact.spectral.wave_condensation import phases_of
from contact.spectral.wave_factor import WaveFactor

Array = NDArray[np.float64]


class CondensedWaves(CondensedBody):
    """A layered block, condensed onto its bottom wave by wave.

    Parameters
    ----------
    body : MeshedBlock
    rows : BodyRows
        On unknowns of the bottom alone.
    planes : Planes
    arrays : HostArrays
        Where to compute.
    """

    path = "fourier"

    def __init__(
        self, body: MeshedBlock, rows: BodyRows, planes: Planes, arrays: HostArrays
    ) -> None:
        self.arrays, self.slender, self._P = arrays, body.slender, planes.P
        self._prescribe(body)
        B = self._touch(rows)
        plane = int(np.prod(planes.shape[1:]))
        if self._boundary.size and self._boundary[-1] >= plane:
            raise InputError("boundary: transforms condense a block onto its bottom alone")
        r = planes.shape[-1]
        kept = np.union1d(np.arange(body.dim), self._boundary % r)
        lateral = planes.lateral
        parity = parities(node_kinds(planes.cells[0]), body.dim)
        turns = (lateral.turns + parity - (lateral.turns + parity)[0]) % 4
        values = functions(phases_of(lateral.steps, slice(0, int(np.prod(lateral.shape)))))
        slabs = [
            (real_slab(cell_table(one, planes.lengths, parity), values), layer.cells)
            for one, layer in zip(planes.cells, body.layers, strict=True)
        ]
        self._factor = WaveFactor(slabs, lateral, turns, planes.loose, kept, arrays.xp)
        self._boundary = self._factor.boundary
        self.B = sparse.csr_array(B[:, self._boundary])
        loose = np.isin(np.arange(body.dim), planes.loose)
        moving = np.flatnonzero(adrift(body.lateral or (), ~loose))
        modes = np.zeros((planes.P.shape[1], moving.size))
        for column, component in enumerate(moving):
            modes[component::r, column] = 1.0
        self._refuse(unseen_motion(modes, modes[self._boundary]))
        with one_blas_thread(max(self.B.shape)):
            self._hold(modes[self._boundary], modes)

    def _prescribe(self, body: Any) -> None:
        u0 = body.constraint[1]
        self.body, self._u0 = body, u0
        self._lifted = body.internal(u0) if u0.any() else None

    def unbalanced(self, rest: Array, u: Array) -> Array:
        """Residual forces on free dofs, for one step of iterative refinement."""
        left: Array = rest - self.body.internal(u)
        return left

    def scaled_schur(self) -> Any:
        """S_b on the device, a copy."""
        return self.arrays.put(self._factor.schur)


@condense.register(MeshedBlock)
def _by_waves(body: MeshedBlock, rows: BodyRows, solver: str, device: str) -> CondensedBody:
    """By transforms where the supports allow it, else by a sparse factorisation."""
    arrays = arrays_on(device)
    try:
        if solver != "auto" and body.path is None:
            raise InputError("solver: a sparse factorisation was asked for")
        return CondensedWaves(body, rows, planes_of(body, arrays.xp), arrays)
    except InputError:
        if body.path == "fourier":
            raise
    return SparseBody(body, rows, solver, None if device == "cpu" else arrays)
