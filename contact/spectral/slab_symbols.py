r"""Stiffness of slabs of equal layers of cells, wave by wave.

On the nodes of a plane of a laterally periodic grid the waves :math:`\hat u e^{i k x}` of the
displacement decouple. The layer of cells between two planes has for the wave vector k, with the
blocks :math:`K_{ab}` of a cell's stiffness for its corners a and b at the lateral places
:math:`o_a` and :math:`o_b`, the Hermitian matrix

.. math:: L_{st}(k) = \sum_{a \in s, b \in t} K_{ab} e^{i k (o_b - o_a)}

with s and t the lower or the upper plane. A slab is the triple (P, Q, R) of its lower, coupling and
upper blocks. Two adjacent slabs are joined by eliminating the plane between them, of stiffness
:math:`M = R_1 + P_2`:

.. math::
    P = P_1 - Q_1 M^{-1} Q_1^H, \quad Q = -Q_1 M^{-1} Q_2, \quad R = R_2 - Q_2^H M^{-1} Q_2 ,

so that n equal layers take the binary logarithm of n steps (cyclic reduction, R. W. Hockney, J.
ACM 12 (1965), 95-113).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from skfem import MeshHex, MeshQuad

from contact.body.elastic_body import ElasticBody
from skfem_adini.ground.arrays import namespace

Waves = Any  # arrays of NumPy or CuPy, shape (waves, r, r) or (waves, r) with r unknowns a node


class Slab(NamedTuple):
    """Lower, coupling (lower with upper) and upper block of every wave."""

    P: Waves
    Q: Waves
    R: Waves


def cell(sizes: Sequence[float], element: Any, **material: Any) -> ElasticBody:
    """A body of one rectangular cell or brick."""
    kind = MeshQuad if len(sizes) == 2 else MeshHex
    mesh = kind.init_tensor(*([0.0, size] for size in sizes))
    return ElasticBody.from_mesh(mesh, element, **material)


def real_slab(table: Any, values: Any) -> Slab:
    """One layer of cells from its table and the functions of the waves."""
    xp, r = namespace(values), table.shape[0] // 2
    T = xp.ascontiguousarray(xp.tensordot(xp.asarray(table), values, axes=1).T)
    return Slab(T[:, :r, :r], T[:, r:, :r].transpose(0, 2, 1), T[:, r:, r:])


def joined(lower: Slab, upper: Slab) -> Slab:
    """Join two slabs, one above the other."""
    xp = namespace(lower.P)
    below, above = _adjoint(lower.Q), upper.Q
    both = xp.linalg.solve(lower.R + upper.P, xp.concatenate([below, above], axis=2))
    half = below.shape[2]
    down, up = both[:, :, :half], both[:, :, half:]
    return Slab(
        _hermitian(lower.P - lower.Q @ down),
        -(lower.Q @ up),
        _hermitian(upper.R - _adjoint(above) @ up),
    )


def released(slab: Slab, own: Any) -> Slab:
    """Eliminate the unshared unknowns `own` of the lower side; their entries become zero."""
    if not len(own):
        return slab
    xp, rest = namespace(slab.P), np.setdiff1d(np.arange(slab.P.shape[1]), own)
    P, Q = slab.P[:, rest][:, :, own], slab.Q[:, own]
    solved = xp.linalg.solve(slab.P[:, own][:, :, own], xp.concatenate([_adjoint(P), Q], axis=2))
    down, up = solved[:, :, : rest.size], solved[:, :, rest.size :]
    lower, coupling = xp.zeros_like(slab.P), xp.zeros_like(slab.Q)
    lower[:, rest[:, None], rest] = _hermitian(slab.P[:, rest][:, :, rest] - P @ down)
    coupling[:, rest] = slab.Q[:, rest] - P @ up
    return Slab(lower, coupling, _hermitian(slab.R - _adjoint(Q) @ up))


@dataclass(frozen=True)
class Stack:
    """Slabs of 2^l equal layers of cells, from the bottom up, and the slabs of their halves."""

    pieces: tuple[tuple[Slab, ...], ...]  # slabs of each piece: entry l has 2^l layers
    own: tuple[Any, ...]  # unshared unknowns of the lower side of each piece
    upto: tuple[Slab, ...]  # entry q: pieces 0 to q joined

    @classmethod
    def of(cls, layers: Sequence[tuple[Slab, int]], kinks: Sequence[Any] = ()) -> Stack:
        """Stack slabs of one layer and their numbers; `kinks`: unshared unknowns of lower sides."""
        none = np.zeros(0, dtype=int)
        pieces: list[tuple[Slab, ...]] = []
        own: list[Any] = []
        for (cell, count), kink in zip(layers, kinks or [none] * len(layers), strict=True):
            powers, begun = [cell], False
            for bit in range(count.bit_length()):
                if bit > 0:
                    powers.append(joined(powers[-1], powers[-1]))
                if count >> bit & 1:
                    pieces.append(tuple(powers))
                    own.append(none if begun else kink)
                    begun = True
        upto = [pieces[0][-1]]
        for piece, kink in zip(pieces[1:], own[1:], strict=True):
            upto.append(joined(upto[-1], released(piece[-1], kink)))
        return cls(tuple(pieces), tuple(own), tuple(upto))

    @property
    def whole(self) -> Slab:
        """All layers together."""
        return self.upto[-1]

    def at(self, row: int, lower: Waves, upper: Waves, above: bool = False) -> Waves:
        """Unknowns on a plane, counted from the bottom, from those of the lowest and the highest
        one, (waves, r); between two layers those of the upper one if `above`.
        """
        first = sum(2 ** (len(piece) - 1) for piece in self.pieces)
        for q in range(len(self.pieces) - 1, -1, -1):
            piece, own = self.pieces[q], self.own[q]
            first -= 2 ** (len(piece) - 1)
            bottom = lower
            if q:
                bottom = between(self.upto[q - 1], released(piece[-1], own), lower, upper)
            if row > first or (row == first and above):
                return _within(piece, row - first, _with_own(piece[-1], own, bottom, upper), upper)
            if row == first:
                return bottom
            upper = bottom
        raise AssertionError("row: below the lowest plane")


def _with_own(slab: Slab, own: Any, lower: Waves, upper: Waves) -> Waves:
    """The lower side's unknowns, with the slab's unshared ones from zero force."""
    if not len(own):
        return lower
    xp, full = namespace(lower), lower.copy()
    full[:, own] = 0.0
    load = slab.P[:, own] @ full[..., None] + slab.Q[:, own] @ upper[..., None]
    full[:, own] = -xp.linalg.solve(slab.P[:, own][:, :, own], load)[..., 0]
    return full


def between(below: Slab, above: Slab, lower: Waves, upper: Waves) -> Waves:
    """Displacement of the plane between two slabs from those of their outer planes."""
    load = -(_adjoint(below.Q) @ lower[..., None] + above.Q @ upper[..., None])
    return namespace(lower).linalg.solve(below.R + above.P, load)[..., 0]


def _within(powers: tuple[Slab, ...], row: int, lower: Waves, upper: Waves) -> Waves:
    for level in range(len(powers) - 2, -1, -1):
        middle = between(powers[level], powers[level], lower, upper)
        if row >= 2**level:
            lower, row = middle, row - 2**level
        else:
            upper = middle
    return lower if row == 0 else upper


def _adjoint(blocks: Waves) -> Waves:
    return namespace(blocks).conj(blocks.transpose(0, 2, 1))


def _hermitian(blocks: Waves) -> Waves:
    return 0.5 * (blocks + _adjoint(blocks))
