"""Condensation of a body by one sparse factorisation."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from scipy import sparse

from contact.arrays.blas_threads import one_blas_thread
from contact.arrays.dense_arrays import HostArrays
from contact.body.free_motions import free_motions, unseen_motion
from contact.body.supports import scaled_columns, selected
from contact.condensation.condensed_body import Array, BodyRows, CondensedBody
from contact.condensation.device_schur import DeviceSchur
from contact.condensation.elimination_order import elimination_order, elimination_tree
from contact.condensation.schur import schur_factor
from contact.condensation.strain_factor import factor_of_strains, strains_can_be_factored

_MANY = 8  # rows of the stiffness are copied where there are fewer than one in so many


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

    always_refined = False

    def __init__(
        self, body: Any, rows: BodyRows, solver: str = "auto", arrays: HostArrays | None = None
    ) -> None:
        self.arrays = arrays or HostArrays()
        self.slender = body.slender
        P, _ = body.constraint
        free = selected(P)
        S = body.stiffness if free is not None else sparse.csr_array(P.T @ body.stiffness @ P)
        # Scale the unknowns to unit stiffness: the magnitudes of values and derivatives, and of
        # directions, then depend neither on the unit of length nor on the aspect ratio of cells.
        # Powers of two cause no rounding.
        diagonal = S.diagonal() if free is None else body.diagonal[free]
        exponent = np.round(-0.5 * np.log2(np.where(diagonal > 0, diagonal, 1.0)))
        unit = np.ldexp(1.0, exponent.astype(np.int64))
        self._P = scaled_columns(P, unit)
        self.body = body
        B = self._touch(rows)
        self.B = sparse.csr_array(B[:, self._boundary])
        modes = free_motions(body) / unit[:, None]
        self._refuse(unseen_motion(modes, modes[self._boundary]))
        self._on_device = arrays is not None
        self._eliminate(B, modes, S, free, unit, solver)
        if self._on_device:
            # Kept here, so that it leaves the device together with the factors.
            compliance = 8 * self.B.shape[0] * (self.B.shape[0] + self.order)
            self._vectors = body.compute_with(self.arrays, compliance)
        self._prescribe(body)

    def _eliminate(
        self, B: sparse.csr_array, modes: Array, S: sparse.csr_array, free: Any, unit: Array,
        solver: str,
    ) -> None:  # fmt: skip
        """Factor what is not the boundary's, and then the boundary's complement."""
        with one_blas_thread(max(self.B.shape)):
            if strains_can_be_factored(self.body, unit.size):
                self._factor, change, back = factor_of_strains(self.body, self._P, self._boundary)
                self._P = sparse.csr_array(self._P @ change)
                self.B = sparse.csr_array(B @ change[:, self._boundary])
                modes = back @ modes
            else:
                self._factor = self._factored(S, free, unit, solver)
            self._hold(modes[self._boundary], modes)

    def _prescribe(self, body: Any) -> None:
        u0 = body.constraint[1]
        self.body = body
        self._u0 = u0
        self._lifted = forces_of_supports(body, u0) if u0.any() else None

    def unbalanced(self, rest: Array, u: Array) -> Array | None:
        """Residual forces on free dofs, for a step of iterative refinement.

        The stiffness of n cells in a row for smooth motions is 1/n^2 of its largest entries, whose
        rounding leaves forces of one sign: their sum is n^2 machine precisions. The forces of
        `BasisSolid.internal`, without the mean translation, have no such error.
        """
        body = self.body
        if self.slender:  # the stiffness form refines these
            return None
        external = body.placed(rest)
        forces = external - body.internal(body.placed(u))
        left: Array = body.vectors.returned(forces - body.at_supports(forces), rest)
        return left

    def _factored(self, S: sparse.csr_array, free: Any, unit: Array, solver: str) -> Any:
        """Factor ``D S D``, or the same of the free rows and columns of S."""
        b, inner = self._boundary, self._boundary.size < unit.size
        if self._on_device and inner and can_be_restricted(free):
            return DeviceSchur.of_selection(S, free, unit, b, elimination_tree(self.body, b))
        if self._on_device and inner:
            return DeviceSchur(scaled(S, free, unit), b)
        return schur_factor(scaled(S, free, unit), b, partial(elimination_order, self.body), solver)


def forces_of_supports(body: Any, u0: Array) -> Array:
    """Internal forces of prescribed displacements, which are zero but at few dofs."""
    moved = np.flatnonzero(u0)
    if body.slender or _MANY * moved.size > u0.size:
        return np.asarray(body.internal(u0))
    forces: Array = body.stiffness[moved].T @ u0[moved]
    return forces


def can_be_restricted(free: Any) -> bool:
    """Whether a device takes the free rows and columns itself: their numbers ascend."""
    return free is not None and bool((np.diff(free) > 0).all())


def scaled(S: sparse.csr_array, free: Any, unit: Array) -> sparse.csr_array:
    """``D S D``, or the same of the free rows and columns of S; D is the diagonal matrix unit."""
    S = sparse.csr_array(S if free is None else S[free][:, free])
    S.data *= np.repeat(unit, np.diff(S.indptr))
    S.data *= unit[S.indices]
    return S
