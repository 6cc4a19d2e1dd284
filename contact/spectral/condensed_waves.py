"""Condensation of a layered block by transforms, if these diagonalise its supports."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.blas_threads import one_blas_thread
from contact.arrays.dense_arrays import HostArrays, arrays_on
from contact.body.elastic_body import ElasticBody
from contact.body.free_motions import unseen_motion
from contact.body.layers.lateral_sides import odd_unknowns, unsupported
from contact.body.layers.meshed_block import MeshedBlock
from contact.condensation.condense import condense
from contact.condensation.condensed_body import BodyRows, CondensedBody
from contact.condensation.sparse import SparseBody
from contact.errors import InputError
from contact.spectral.lateral_waves import LateralWaves
from contact.spectral.layer_arguments import node_kinds, node_lengths
from contact.spectral.slab_symbols import cell, real_slab
from contact.spectral.wave_cells import cell_table, functions, parities
from contact.spectral.wave_condensation import phases_of
from contact.spectral.wave_factor import WaveFactor

Array = NDArray[np.float64]


class CondensedWaves(CondensedBody):
    """A layered block, condensed onto its bottom wave by wave."""

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
        moving = np.flatnonzero(unsupported(body.lateral or (), ~loose))
        modes = np.zeros((planes.P.shape[1], moving.size))
        for column, component in enumerate(moving):
            modes[component::r, column] = 1.0
        self._refuse(unseen_motion(modes, modes[self._boundary]))
        with one_blas_thread(max(self.B.shape)):
            self._hold(modes[self._boundary], modes)

    def unbalanced(self, rest: Array, u: Array) -> Array:
        """Residual forces on free dofs, for one step of iterative refinement."""
        left: Array = rest - self.body.internal(u)
        return left


@condense.register(MeshedBlock)
def _by_waves(body: MeshedBlock, rows: BodyRows, solver: str, device: str) -> CondensedBody:
    """Condense by transforms if the supports allow it, else by a sparse factorisation."""
    arrays = arrays_on(device)
    try:
        if solver != "auto" and body.path is None:
            raise InputError("solver: a sparse factorisation was asked for")
        return CondensedWaves(body, rows, planes_of(body, arrays.xp), arrays)
    except InputError:
        if body.path == "fourier":
            raise
    return SparseBody(body, rows, solver, None if device == "cpu" else arrays)


class Planes(NamedTuple):
    """The unknowns of a block plane by plane."""

    P: sparse.csr_array  # u = P z with the unknowns of `WaveFactor`
    lateral: LateralWaves
    loose: NDArray[np.int64]  # unknowns of a node that are free on the top
    lengths: Array  # factors that scale unknowns to displacements
    shape: tuple[int, ...]  # shape of z: rows, nodes in each direction, node unknowns
    cells: list[ElasticBody]  # one cell of each layer


def planes_of(body: MeshedBlock, xp: Any) -> Planes:
    """Read supports and ties plane by plane, for the array module xp; `InputError` if transforms do
    not diagonalise them.
    """
    if body.lateral is None or body._material is not body._made_of:
        raise InputError(
            f"path: transforms diagonalise neither sides={body.sides!r} nor a material that the "
            "layers were not given"
        )
    spacing = [width / n for width, n in zip(body.widths, body.cells, strict=True)]
    in_plane = {"plane": body.plane} if body.dim == 2 else {}
    cells = [
        cell((*spacing, l.height / l.cells), body.element, E=l.E, nu=l.nu, **in_plane)
        for l in body.layers
    ]
    kinds = node_kinds(cells[0])
    lengths = node_lengths(kinds, spacing, body.layers)
    lateral = LateralWaves(body.cells, odd_unknowns(body.lateral, kinds), xp)
    shape = (1 + sum(layer.cells for layer in body.layers), *lateral.points, kinds.size)
    column = _columns(body, spacing, shape)
    free = np.diff(body.constraint[0].indptr) > 0
    loose = _loose(column, free, lateral, shape)
    per_length = (1.0 / lengths)[column % kinds.size]
    here = np.flatnonzero(free)
    entries = per_length[here], (here, column[here])
    size = body.f.size, int(np.prod(shape))
    P = sparse.csr_array(sparse.coo_array(entries, shape=size))
    if not _same_span(body, P):
        raise _not_diagonal()
    return Planes(P, lateral, loose, lengths, shape, cells)


def _columns(body: MeshedBlock, spacing: list[float], shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Number of the unknown z of each dof."""
    p, r = body.mesh.p, shape[-1]
    row = np.empty(p.shape[1], dtype=np.int64)
    row[np.argsort(p[-1], kind="stable")] = np.arange(row.size) // (row.size // shape[0])
    place = [
        np.rint(p[axis] / h).astype(np.int64) % points
        for axis, (h, points) in enumerate(zip(spacing, shape[1:-1], strict=True))
    ]
    node = np.ravel_multi_index((row, *place), shape[:-1])
    column = np.empty(body.f.size, dtype=np.int64)
    column[body.basis.nodal_dofs] = r * node + np.arange(r)[:, None]
    return column


def _loose(
    column: NDArray[np.int64],
    free: NDArray[np.bool_],
    lateral: LateralWaves,
    shape: tuple[int, ...],
) -> NDArray[np.int64]:
    """Node unknowns that are free on the top; fixed ones must be those fixed for all waves."""
    r = shape[-1]
    of_z = np.zeros(shape, dtype=bool)
    of_z.ravel()[column[free]] = True
    held = np.stack([lateral.held(k) for k in range(r)], axis=-1)
    loose = np.flatnonzero((of_z[-1] & ~held).reshape(-1, r).any(axis=0))
    expected = np.broadcast_to(~held, shape).copy()
    expected[-1][..., np.setdiff1d(np.arange(r), loose)] = False
    if not np.array_equal(of_z, expected):
        raise _not_diagonal()
    return loose


def _same_span(body: MeshedBlock, P: sparse.csr_array) -> bool:
    """Whether the block's free unknowns equal those of the planes, with tied nodes merged."""
    own, square = body.constraint[0], np.asarray(P.multiply(P).sum(axis=0)).ravel()
    if own.shape[1] != np.count_nonzero(square):
        return False
    probe = own @ np.random.default_rng(0).standard_normal((own.shape[1], 2))
    back = P @ ((P.T @ probe) / np.where(square > 0, square, 1.0)[:, None])
    return bool(np.abs(back - probe).max(initial=0.0) <= 1e-9 * np.abs(probe).max(initial=0.0))


def _not_diagonal() -> InputError:
    return InputError(
        "path: supports or equations besides those of the sides and the whole top, which "
        "transforms do not diagonalise; leave path out"
    )
