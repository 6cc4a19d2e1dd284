r"""One layer of equal cells, wave by wave, as real symmetric matrices.

A cell is invariant under half a turn about the vertical (in the plane: a reflection), which
reverses the phases :math:`\theta` of a wave. With :math:`p_i = 1` for unknowns whose sign the turn
changes (an odd number of lateral components and derivatives), and 0 for the others, the Hermitian
stiffness of a layer, :math:`L(\theta)` of `contact.spectral.slab_symbols`, is

.. math::
    L_{ij} = i^{p_i} N_{ij} i^{-p_j}, \qquad
    N(\theta) = \sum_f N_f f(\theta) \text{ real and symmetric,}

with the cosines f of 0 and of the phases from a corner of a cell to another for :math:`p_i = p_j`,
and their sines otherwise. This takes half the memory and a quarter of the operations of complex
arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body.elastic_body import ElasticBody
from skfem_adini.ground.arrays import namespace

Array = NDArray[np.float64]
_STEPS: dict[int, list[tuple[int, ...]]] = {1: [(1,)], 2: [(1, 0), (0, 1), (1, 1), (1, -1)]}


@dataclass(frozen=True)
class Column:
    """The layers above a point of the surface grid, from the bottom up, the same for all waves."""

    tables: Array  # (layers, 2 r, 2 r, m), by `cell_table`
    counts: Sequence[int]  # layers of cells of each kind
    free: NDArray[np.intp]  # free node unknowns of the top
    dim: int  # number of node unknowns with forces: the first ones
    # Unknowns of each kind's lowest nodes, not shared with the layers below.
    kinks: tuple[NDArray[np.intp], ...] = ()

    @property
    def eliminated(self) -> list[int]:
        """Number of unknowns without forces, free ones of the top first."""
        r = self.tables.shape[1] // 2
        return [r + int(k) for k in self.free] + list(range(self.dim, r))


def parities(kinds: NDArray[np.int64], dim: int) -> NDArray[np.int64]:
    """p of each unknown of a node, 0 or 1, from `kinds`: -1 for values, -2 for the second mixed
    derivative, else the axis of a first derivative; components alternate.
    """
    lateral = (np.arange(kinds.size) % dim < dim - 1).astype(int)
    along = (kinds >= 0) & (kinds < dim - 1)
    # In the plane a mixed derivative has one lateral direction, in space (x and y) two.
    mixed = (kinds == -2) & (dim == 2)
    return np.asarray((lateral + along + mixed) % 2)


def functions(phases: Sequence[Any]) -> Any:
    """Values, (m, waves), of 1 and of the cosines and sines of the phases of each direction."""
    xp = namespace(phases[0])
    angles = [
        sum(s * phase for s, phase in zip(step, phases, strict=True))
        for step in _STEPS[len(phases)]
    ]
    one = [xp.ones_like(phases[0])]
    return xp.stack(one + [xp.cos(a) for a in angles] + [xp.sin(a) for a in angles])


def cell_table(body: ElasticBody, lengths: Array, parity: NDArray[np.int64]) -> Array:
    """Coefficients, (2 r, 2 r, m), of the functions for the lower and upper unknowns of a layer of
    the cell, each multiplied by its length to become a displacement.
    """
    mesh, r = body.mesh, lengths.size
    K, dofs = body.stiffness.toarray(), body.basis.nodal_dofs
    places = (mesh.p > 0.5 * mesh.p.max(axis=1, keepdims=True)).astype(int)
    steps = _STEPS[mesh.dim() - 1]
    quarter = parity[None, :] - parity[:, None]  # power of i that the phase is multiplied by
    table = np.zeros((2 * r, 2 * r, 1 + 2 * len(steps)))
    for a in range(mesh.nvertices):
        for b in range(mesh.nvertices):
            block = K[np.ix_(dofs[:, a], dofs[:, b])] / np.outer(lengths, lengths)
            step = tuple((places[:-1, b] - places[:-1, a]).tolist())
            back = tuple(-s for s in step)
            into = table[r * places[-1, a] :][:r, r * places[-1, b] :][:, :r]
            if not any(step):
                into[..., 0] += np.where(quarter == 0, block, 0.0)
                continue
            forward = step in steps
            k = 1 + steps.index(step if forward else back)
            into[..., k] += np.where(quarter == 0, block, 0.0)
            into[..., k + len(steps)] -= quarter * (1 if forward else -1) * block
    return 0.5 * (table + table.transpose(1, 0, 2))
