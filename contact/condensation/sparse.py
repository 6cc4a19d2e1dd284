"""Condensation of a body by one sparse factorisation."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from scipy import sparse

from contact.arrays.blas_threads import one_blas_thread
from contact.arrays.dense_arrays import HostArrays
from contact.body.free_motions import unseen_motion
from contact.body.supports import scaled_columns
from contact.condensation.background import BackgroundWork
from contact.condensation.condensed_body import Array, BodyRows, CondensedBody
from contact.condensation.device_schur import DeviceSchur, restricted
from contact.condensation.elimination_order import elimination_order
from contact.condensation.scaled_stiffness import ScaledStiffness
from contact.condensation.schur import schur_factor
from contact.condensation.strain_factor import factor_of_strains, strains_can_be_factored
from contact.errors import ContactError


class SparseBody(CondensedBody):
    """A body with a Basis, whose stiffness is factored by a sparse solver on host or device.
    Raises Unbounded if a piece is neither fixed nor connected to the contact boundary."""

    always_refined = False
    _there: tuple[Any, Any] | None = None  # on a device: dofs of the unknowns, and their factors

    def __init__(
        self, body: Any, rows: BodyRows, solver: str = "auto", arrays: HostArrays | None = None
    ) -> None:
        self.arrays, self._on_device = arrays or HostArrays(), arrays is not None
        self.body = body
        with BackgroundWork(body, self._on_device) as background:
            self.slender = body.slender
            system = ScaledStiffness.of(body, self.arrays)
            self._P = scaled_columns(body.constraint[0], system.unit)
            B = self._touch(rows)
            self.B = sparse.csr_array(B[:, self._boundary])
            self._eliminate(B, background, system, solver)
        if self._on_device:
            # Kept here to be freed together with the factors.
            compliance = 8 * self.B.shape[0] * (self.B.shape[0] + self.order)
            self._vectors = body.compute_with(self.arrays, compliance, system.placed)
        self._prescribe(body)

    def _eliminate(
        self, B: sparse.csr_array, background: BackgroundWork, system: ScaledStiffness, solver: str
    ) -> None:
        """Factor the inner unknowns, then the boundary's complement; motions in another thread.
        A motion that no row resists is reported even if the factorisation fails: zero pivots are
        detected only up to rounding."""
        back: Any = None
        with one_blas_thread(max(self.B.shape)):
            try:
                if strains_can_be_factored(self.body, system.unit.size):
                    self._factor, change, back = factor_of_strains(
                        self.body, self._P, self._boundary
                    )
                    self._P = sparse.csr_array(self._P @ change)
                    self.B = sparse.csr_array(B @ change[:, self._boundary])
                else:
                    self._factor = self._factored(background, system, solver)
            except ContactError:
                self._seen(background, system.unit)
                raise
            modes = self._seen(background, system.unit)
            modes = modes if back is None else back @ modes
            self._hold(modes[self._boundary], modes)

    def _seen(self, background: BackgroundWork, unit: Array) -> Array:
        """Free rigid motions of the unknowns; raises if no row resists one."""
        modes: Array = background.motions() / unit[:, None]
        self._refuse(unseen_motion(modes, modes[self._boundary]))
        return modes

    def _prescribe(self, body: Any) -> None:
        u0 = body.constraint[1]
        self.body = body
        self._u0 = u0
        self._lifted: Any = None  # on the device of the factors, or on all dofs
        if u0.any() and self._there is None:
            self._lifted = forces_of_supports(body, u0, self._on_device)
        elif u0.any():
            self._lifted = self._gathered(body.internal(body.placed(u0)))

    def unbalanced(self, rest: Array, u: Array) -> Array | None:
        """Residual forces on free dofs, for a step of iterative refinement.
        The rounding of the stiffness of n cells in a row causes an error n^2 eps for smooth
        motions; the forces of `BasisSolid.internal`, without the mean translation, have no such
        error."""
        body = self.body
        if self.slender:  # the stiffness form refines these
            return None
        external = body.placed(rest)
        forces = external - body.internal(body.placed(u))
        left: Array = body.vectors.returned(forces - body.at_supports(forces), rest)
        return left

    def _factored(self, background: BackgroundWork, system: ScaledStiffness, solver: str) -> Any:
        b, order = self._boundary, partial(elimination_order, self.body)
        if not self._on_device or b.size == system.unit.size:
            return schur_factor(system.matrix(), b, order, solver)
        here = restricted(system)
        if here is None:
            return DeviceSchur(system.matrix(), b)
        factor = DeviceSchur(here, b, background.tree(b))
        self._there = self.arrays.xp.asarray(system.free), self.arrays.put(system.unit)
        return factor

    def _gathered(self, forces: Array) -> Any:
        if self._there is None:
            return super()._gathered(forces)
        dofs, unit = self._there
        return unit * self.arrays.xp.asarray(forces)[dofs]

    def reduce(self, load: Array) -> Array:
        """Load on all dofs, condensed onto the contact boundary's unknowns, shape (nb,)."""
        if self._there is None:
            return super().reduce(load)
        reduced: Array = self._factor.reduce(self._rest(load))
        return reduced

    def expand(self, load: Array, z_b: Array) -> Array:
        """Displacement of all dofs from the contact boundary's unknowns."""
        if self._there is None:
            return super().expand(load, z_b)
        u = self._spread(self._factor.expand(self._rest(load), z_b))
        return u if self._u0 is None else u + self._u0

    def _rest(self, load: Array) -> Any:
        """The load minus the forces of prescribed displacements, on the factors' unknowns."""
        gathered = self._gathered(load)
        return gathered if self._lifted is None else gathered - self._lifted

    def _spread(self, z: Any) -> Array:
        if self._there is None:
            return super()._spread(z)
        dofs, unit = self._there
        u = self.arrays.xp.zeros(self.body.ndofs)
        u[dofs] = unit * z
        return np.asarray(self.arrays.get(u))


def forces_of_supports(body: Any, u0: Array, on_device: bool) -> Array:
    """Internal forces of prescribed displacements u0, which are zero except at few dofs."""
    moved = np.flatnonzero(u0)
    # Copy the rows of the stiffness if these are few.
    if on_device or body.slender or 8 * moved.size > u0.size:
        return np.asarray(body.internal(u0))
    forces: Array = body.stiffness[moved].T @ u0[moved]
    return forces
