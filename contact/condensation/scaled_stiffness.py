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


@dataclass(frozen=True)
class ScaledStiffness:
    """``D S D`` for S or its free rows and columns."""

    given: sparse.csr_array | Callable[[], sparse.csr_array]  # S on the host, or its getter
    free: NDArray[np.integer] | None  # rows and columns of S that remain, (n,); None: all
    unit: Array  # diagonal of D, powers of two (no rounding), shape (n,)
    diagonal: Array  # diagonal of D S D, about one, shape (n,)
    placed: SparseRows | None = None  # S on the device of dense matrices, if it fits

    @classmethod
    def of(cls, body: Any, arrays: HostArrays) -> ScaledStiffness:
        """The stiffness of a body in its free unknowns z of ``u = P z + u0``."""
        P, free = body.constraint[0], body.chosen
        placed = None if free is None else _placed(body, arrays)
        given: Any
        if free is None:
            given = sparse.csr_array(P.T @ body.stiffness @ P)
            diagonal = given.diagonal()
        elif placed is None:
            given, diagonal = body.stiffness, body.diagonal[free]
        else:
            given, diagonal = partial(_stiffness, body, copy(body)), placed.diagonal()[free]
        unit = unit_of(diagonal, np if placed is None else arrays.xp)
        unit, diagonal = (np.asarray(arrays.get(v)) for v in (unit, unit**2 * diagonal))
        return cls(given, free, unit, diagonal, placed)

    @property
    def whole(self) -> sparse.csr_array:
        """S on the host."""
        S: sparse.csr_array = self.given() if callable(self.given) else self.given
        return S

    def matrix(self) -> sparse.csr_array:
        """``D S D`` on the host."""
        S = self.whole if self.free is None else self.whole[self.free][:, self.free]
        S = sparse.csr_array(S, copy=self.free is None)
        S.data *= np.repeat(self.unit, np.diff(S.indptr))
        S.data *= self.unit[S.indices]
        return S


def _stiffness(body: Any, then: Any) -> sparse.csr_array:
    """Stiffness of the body, or of its copy `then` if the material has changed since."""
    same = all(a is b for a, b in zip(body.materials, then.materials, strict=True))
    S: sparse.csr_array = (body if same else then).stiffness
    return S


def _placed(body: Any, arrays: HostArrays) -> SparseRows | None:
    """The stiffness of a body on the device of the arrays, if there is one and it fits."""
    room = arrays.room()
    if room is None:
        return None
    local = 12 * body.basis.nelems * body.basis.Nbfun**2
    # Assembling takes two to three times the size of the local matrices.
    there = body.stiffness_on(arrays.xp) if 8 * local < room else None
    if there is None and 16 * SparseRows.bytes(body.stiffness) < room:
        there = body.stiffness if body.stiffness.has_canonical_format else None
    return None if there is None else arrays.rows(there)


def unit_of(diagonal: Any, xp: Any) -> Any:
    """Powers of two nearest to the inverse roots of a diagonal; 1 for zero stiffness."""
    exponent = xp.round(-0.5 * xp.log2(xp.where(diagonal > 0, diagonal, 1.0)))
    return xp.ldexp(xp.ones_like(exponent), exponent.astype(np.int32))
