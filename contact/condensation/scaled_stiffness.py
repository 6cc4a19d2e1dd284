"""The stiffness of the free unknowns, scaled to a unit diagonal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.dense_arrays import HostArrays
from contact.arrays.sparse_rows import SparseRows

Array = NDArray[np.float64]
_SMALL = 16  # a stiffness stays on a device if it takes less than one in so many of the free bytes


@dataclass(frozen=True)
class ScaledStiffness:
    """``D S D``, or the same of the free rows and columns of S.

    Attributes
    ----------
    whole : csr_array
        S.
    free : ndarray, shape (n,), or None
        Rows and columns of S that remain; None for all.
    unit : ndarray, shape (n,)
        Diagonal of D. The magnitudes of values and derivatives, and of directions, then depend
        neither on the unit of length nor on the aspect ratio of cells. Powers of two cause no
        rounding.
    placed : SparseRows, optional
        S where dense matrices lie, if it is that of the body and there is room.
    """

    whole: sparse.csr_array
    free: NDArray[np.integer] | None
    unit: Array
    placed: SparseRows | None = None

    @classmethod
    def of(cls, body: Any, arrays: HostArrays) -> ScaledStiffness:
        """The stiffness of a body in its free unknowns z of ``u = P z + u0``."""
        P, S, placed = body.constraint[0], body.stiffness, None
        free = body.chosen
        if free is None:
            S = sparse.csr_array(P.T @ S @ P)
            diagonal = S.diagonal()
        else:
            room = arrays.room()
            roomy = room is not None and _SMALL * SparseRows.bytes(S) < room
            placed = arrays.rows(S) if roomy else None
            diagonal = body.diagonal[free] if placed is None else placed.diagonal()[free]
        unit = unit_of(diagonal, np if placed is None else arrays.xp)
        return cls(S, free, np.asarray(arrays.get(unit)), placed)

    @property
    def diagonal(self) -> Array:
        """Diagonal of ``D S D``, shape (n,)."""
        own = self.whole.diagonal()
        found: Array = self.unit**2 * (own if self.free is None else own[self.free])
        return found

    def matrix(self) -> sparse.csr_array:
        """``D S D`` on the host."""
        S = self.whole if self.free is None else self.whole[self.free][:, self.free]
        S = sparse.csr_array(S, copy=self.free is None)
        S.data *= np.repeat(self.unit, np.diff(S.indptr))
        S.data *= self.unit[S.indices]
        return S


def unit_of(diagonal: Any, xp: Any) -> Any:
    """Powers of two next to the inverse roots of a diagonal, where it lies; 1 for no stiffness."""
    exponent = xp.round(-0.5 * xp.log2(xp.where(diagonal > 0, diagonal, 1.0)))
    return xp.ldexp(xp.ones_like(exponent), exponent.astype(np.int32))
