"""The stiffness of the free unknowns, scaled to a unit diagonal."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.dense_arrays import HostArrays
from contact.arrays.sparse_rows import SparseRows

Array = NDArray[np.float64]
# A stiffness stays on a device if it takes less than one in so many of the free bytes; it is
# assembled there if its local matrices, of which there are two to three times as many, take less
# than one in so many.
_SMALL, _LOCAL = 16, 8


@dataclass(frozen=True)
class ScaledStiffness:
    """``D S D``, or the same of the free rows and columns of S.

    Attributes
    ----------
    of_body : callable () -> csr_array
        S on the host, which need not be there where it is assembled on a device.
    free : ndarray, shape (n,), or None
        Rows and columns of S that remain; None for all.
    unit : ndarray, shape (n,)
        Diagonal of D. The magnitudes of values and derivatives, and of directions, then depend
        neither on the unit of length nor on the aspect ratio of cells. Powers of two cause no
        rounding.
    placed : SparseRows, optional
        S where dense matrices lie, if it is that of the body and there is room.
    """

    of_body: Callable[[], sparse.csr_array]
    free: NDArray[np.integer] | None
    unit: Array
    placed: SparseRows | None = None

    @classmethod
    def of(cls, body: Any, arrays: HostArrays) -> ScaledStiffness:
        """The stiffness of a body in its free unknowns z of ``u = P z + u0``."""
        P, free, placed = body.constraint[0], body.chosen, None
        if free is None:
            S = sparse.csr_array(P.T @ body.stiffness @ P)
            diagonal, of_body = S.diagonal(), partial(_kept, S)
        else:
            placed = _placed(body, arrays)
            diagonal = body.diagonal[free] if placed is None else placed.diagonal()[free]
            of_body = partial(_stiffness, copy(body))  # whose material nobody changes
        unit = unit_of(diagonal, np if placed is None else arrays.xp)
        return cls(of_body, free, np.asarray(arrays.get(unit)), placed)

    @property
    def whole(self) -> sparse.csr_array:
        """S."""
        return self.of_body()

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


def _kept(S: sparse.csr_array) -> sparse.csr_array:
    return S


def _stiffness(body: Any) -> sparse.csr_array:
    S: sparse.csr_array = body.stiffness
    return S


def _placed(body: Any, arrays: HostArrays) -> SparseRows | None:
    """The stiffness of a body on the device of the arrays, if there is one and room on it."""
    room = arrays.room()
    if room is None:
        return None
    local = 12 * body.basis.nelems * body.basis.Nbfun**2
    there = body.stiffness_on(arrays.xp) if _LOCAL * local < room else None
    if there is None and _SMALL * SparseRows.bytes(body.stiffness) < room:
        there = body.stiffness if body.stiffness.has_canonical_format else None
    return None if there is None else arrays.rows(there)


def unit_of(diagonal: Any, xp: Any) -> Any:
    """Powers of two next to the inverse roots of a diagonal, where it lies; 1 for no stiffness."""
    exponent = xp.round(-0.5 * xp.log2(xp.where(diagonal > 0, diagonal, 1.0)))
    return xp.ldexp(xp.ones_like(exponent), exponent.astype(np.int32))
