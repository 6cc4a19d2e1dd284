"""The unknowns of a layered block plane by plane, if its supports are those of its waves."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.elastic_body import ElasticBody
from contact.body.layers.lateral_sides import odd_unknowns
from contact.body.layers.meshed_block import MeshedBlock
from contact.errors import InputError
from contact.spectral.lateral_waves import LateralWaves
from contact.spectral.layer_arguments import node_kinds, node_lengths
from contact.spectral.slab_symbols import cell

Array = NDArray[np.float64]


class Planes(NamedTuple):
    """The unknowns of a block plane by plane.

    Attributes
    ----------
    P : csr_array, shape (ndofs, rows * nodes * r)
        ``u = P z`` with the unknowns z of `WaveFactor`; columns of held ones are empty.
    lateral : LateralWaves
    loose : ndarray of int
        Unknowns of a node that are free on the top.
    lengths : ndarray, shape (r,)
        By which the unknowns of a node are multiplied to become displacements.
    shape : tuple of int
        Of z: rows, nodes in each direction, r.
    cells : list of ElasticBody
        One cell of each layer.
    """

    P: sparse.csr_array
    lateral: LateralWaves
    loose: NDArray[np.int64]
    lengths: Array
    shape: tuple[int, ...]
    cells: list[ElasticBody]


def planes_of(body: MeshedBlock, xp: Any) -> Planes:
    """Read a block's supports and ties plane by plane; `xp` is the module that will compute.

    Raises
    ------
    InputError
        They are not those that transforms diagonalise.
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
        raise _besides()
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
    """Unknowns of a node that are free on the top; what is held must be what the waves hold."""
    r = shape[-1]
    of_z = np.zeros(shape, dtype=bool)
    of_z.ravel()[column[free]] = True
    held = np.stack([lateral.held(k) for k in range(r)], axis=-1)
    loose = np.flatnonzero((of_z[-1] & ~held).reshape(-1, r).any(axis=0))
    expected = np.broadcast_to(~held, shape).copy()
    expected[-1][..., np.setdiff1d(np.arange(r), loose)] = False
    if not np.array_equal(of_z, expected):
        raise _besides()
    return loose


def _same_span(body: MeshedBlock, P: sparse.csr_array) -> bool:
    """Whether the block's free unknowns are those of the planes, tied nodes moving alike."""
    own, square = body.constraint[0], np.asarray(P.multiply(P).sum(axis=0)).ravel()
    if own.shape[1] != np.count_nonzero(square):
        return False
    probe = own @ np.random.default_rng(0).standard_normal((own.shape[1], 2))
    back = P @ ((P.T @ probe) / np.where(square > 0, square, 1.0)[:, None])
    return bool(np.abs(back - probe).max(initial=0.0) <= 1e-9 * np.abs(probe).max(initial=0.0))


def _besides() -> InputError:
    return InputError(
        "path: supports or equations besides those of the sides and the whole top, which "
        "transforms do not diagonalise; leave path out"
    )
