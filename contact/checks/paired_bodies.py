"""Internal forces, reactions and resultants of bodies on the host, in pairs of numbers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.paired_rows import blocks_times, rows_times
from contact.arrays.pairs import Pairs
from contact.body.basis_solid import BasisSolid
from contact.body.layers.layered_block import LayeredBlock
from contact.body.layers.layers import PER_NODE
from contact.checks.paired_strains import strained_forces
from contact.errors import InputError

Array = NDArray[np.float64]
_CELLS = 2**12  # whose forces are kept at a time
_VALUES = np.arange(PER_NODE) < 2  # displacements among the dofs of a node


class PairedBody(ABC):
    """What a check in pairs needs of a body, of which forces are `Pairs` of shape (ndofs,).

    Attributes
    ----------
    host : Solid
        The body on the host, for scales in float64.
    """

    host: Any

    @abstractmethod
    def internal(self, u: Array) -> Pairs:
        """Internal forces of a displacement."""

    @abstractmethod
    def unbalanced(self, forces: Pairs) -> float:
        """Largest force at a free unknown; those of derivatives are divided by their length."""

    @abstractmethod
    def at_supports(self, forces: Pairs) -> Pairs:
        """The part of forces that acts where a displacement is prescribed."""

    @abstractmethod
    def total(self, forces: Pairs) -> Pairs:
        """Resultant of forces, shape (dim,); of a ring along its axis only."""

    @abstractmethod
    def support_error(self, u: Array) -> float:
        """Largest deviation from a prescribed displacement; derivatives are times their length."""


def paired_body(body: Any) -> PairedBody:
    """A body for checks in pairs.

    Raises
    ------
    InputError
        A kind of body that has none.
    """
    if isinstance(body, BasisSolid):
        return PairedBasisBody(body)
    if isinstance(body, LayeredBlock):
        return PairedBlock(body)
    raise InputError(
        f"result: its body is a {type(body).__name__}, of which no process has all forces; solve "
        "with an ElasticBody on one process to check a result in other arithmetic"
    )


class PairedBasisBody(PairedBody):
    """A body with a Basis: its sparse matrices, or the strains of its cells if these are slender.

    Parameters
    ----------
    body : BasisSolid
    """

    def __init__(self, body: BasisSolid) -> None:
        self.host = body.on_host()
        self._P, self._u0 = body.constraint
        self._transposed = sparse.csr_array(self._P.T)

    def internal(self, u: Array) -> Pairs:
        """``S u`` without mean translations, or the forces of `strained_forces`."""
        body = self.host
        if body.slender:
            return strained_forces(body, u)
        return rows_times(body.stiffness, Pairs.of(u) - body.vectors.mean_translation(u))

    def unbalanced(self, forces: Pairs) -> float:
        """Largest force at a free unknown; those of derivatives are divided by their length."""
        at_free = rows_times(self._transposed, forces).rounded
        return _largest(at_free / self.host.lengths[1])

    def at_supports(self, forces: Pairs) -> Pairs:
        """The part of forces that acts where a displacement is prescribed."""
        return forces - rows_times(self.host.picked, rows_times(self._transposed, forces))

    def total(self, forces: Pairs) -> Pairs:
        """Resultant of forces, shape (dim,); of a ring along its axis only."""
        body = self.host
        moved = body.are_values & (np.arange(body.ndofs) % body.dim == 1 if body.is_ring else True)
        return Pairs.where(moved, forces, 0.0).reshape(-1, body.dim).sum()

    def support_error(self, u: Array) -> float:
        """Largest deviation from a prescribed displacement; derivatives are times their length."""
        off = Pairs.of(u) - self._u0
        off = off - rows_times(self._P, rows_times(self.host.picked.T, off))
        return _largest(self.host.lengths[0] * off.rounded)


class PairedBlock(PairedBody):
    """A block without a matrix: the element matrix of each layer, cell by cell.

    Parameters
    ----------
    block : LayeredBlock
    """

    def __init__(self, block: LayeredBlock) -> None:
        self.host = block.on_host()
        self._held, self._values = block.prescribed
        self._length = np.tile([1.0, 1.0] + [block.cell_size] * 4, block.ndofs // PER_NODE)

    def internal(self, u: Array) -> Pairs:
        """Internal forces of a displacement, in every cell relative to its first node."""
        block = self.host
        nodes = u.reshape(block.node_rows, -1, PER_NODE)
        forces = Pairs.zeros(nodes.shape)
        for K, corners in block.stiffness.strips(max(1, _CELLS // block.columns)):
            cells = np.concatenate([nodes[c] for c in corners], axis=2)
            first = np.tile(nodes[corners[0]] * _VALUES, 4)
            moved = (Pairs.of(cells) - first).reshape(-1, K.shape[0])
            each = np.broadcast_to(K, (len(moved.high), *K.shape))
            local = blocks_times(each, moved).reshape(*cells.shape)
            for k, c in enumerate(corners):
                forces[c] = forces[c] + local[:, :, PER_NODE * k : PER_NODE * (k + 1)]
        return forces.reshape(-1)

    def unbalanced(self, forces: Pairs) -> float:
        """Largest force at a free dof; those of derivatives are divided by the cell size."""
        left = forces.rounded / self._length
        left[self._held] = 0.0
        return _largest(left)

    def at_supports(self, forces: Pairs) -> Pairs:
        """The part of forces that acts where a displacement is prescribed."""
        held = np.zeros(forces.high.size, dtype=bool)
        held[self._held] = True
        return Pairs.where(held, forces, 0.0)

    def total(self, forces: Pairs) -> Pairs:
        """Resultant of forces, shape (2,)."""
        return forces.reshape(-1, PER_NODE)[:, :2].sum()

    def support_error(self, u: Array) -> float:
        """Largest deviation from a prescribed displacement; derivatives are times the cell size."""
        return _largest(self._length[self._held] * (Pairs.of(u)[self._held] - self._values).rounded)


def _largest(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))
