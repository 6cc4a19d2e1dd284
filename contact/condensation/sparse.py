"""Condensation of a body by one sparse factorisation."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from scipy import sparse

from contact.arrays.blas_threads import one_blas_thread
from contact.arrays.dense_arrays import HostArrays
from contact.body.free_motions import free_motions, unseen_motion
from contact.condensation.condensed_body import BodyRows, CondensedBody
from contact.condensation.device_schur import DeviceSchur
from contact.condensation.elimination_order import elimination_order
from contact.condensation.schur import schur_factor
from contact.condensation.strain_factor import factor_of_strains, strains_can_be_factored


class SparseBody(CondensedBody):
    """A body with a Basis; its stiffness matrix is factored by a sparse solver.

    Parameters
    ----------
    body : BasisSolid
    rows : BodyRows
    solver : {"auto", "pardiso", "superlu"}
        See `contact.condensation.schur`.
    arrays : HostArrays
        Where the complement is computed and the dense matrices lie.

    Raises
    ------
    Unbounded
        A piece of the body is neither fixed nor connected to the contact boundary.
    """

    def __init__(
        self, body: Any, rows: BodyRows, solver: str = "auto", arrays: HostArrays | None = None
    ) -> None:
        self.arrays = arrays or HostArrays()
        self.slender = body.slender
        P, _ = body.constraint
        if P.nnz == P.shape[1] and np.all(P.data == 1.0):
            free = P.tocsc().indices
            S = body.stiffness[free][:, free]
        else:
            S = sparse.csr_array(P.T @ body.stiffness @ P)
        # Scale the unknowns to unit stiffness: the magnitudes of values and derivatives, and of
        # directions, then depend neither on the unit of length nor on the aspect ratio of cells.
        # Powers of two cause no rounding.
        diagonal = S.diagonal()
        exponent = np.round(-0.5 * np.log2(np.where(diagonal > 0, diagonal, 1.0)))
        unit = np.ldexp(1.0, exponent.astype(np.int64))
        self._P = sparse.csr_array(P @ sparse.diags_array(unit))
        S = sparse.csr_array(S)
        S.data *= np.repeat(unit, np.diff(S.indptr)) * unit[S.indices]
        self._prescribe(body)
        B = self._touch(rows)
        self.B = sparse.csr_array(B[:, self._boundary])
        modes = free_motions(body) / unit[:, None]
        self._refuse(unseen_motion(modes, modes[self._boundary]))
        with one_blas_thread(max(self.B.shape)):
            if strains_can_be_factored(body, S.shape[0]):
                self._factor, change, back = factor_of_strains(body, self._P, self._boundary)
                self._P = sparse.csr_array(self._P @ change)
                self.B = sparse.csr_array(B @ change[:, self._boundary])
                modes = back @ modes
            else:
                order = partial(elimination_order, body)
                inner = self._boundary.size < S.shape[0]
                self._factor = (
                    DeviceSchur(S, self._boundary)
                    if arrays is not None and inner
                    else schur_factor(S, self._boundary, order, solver)
                )
            self._hold(modes[self._boundary], modes)

    def _prescribe(self, body: Any) -> None:
        u0 = body.constraint[1]
        self.body = body
        self._u0 = u0
        self._lifted = body.internal(u0) if u0.any() else None
