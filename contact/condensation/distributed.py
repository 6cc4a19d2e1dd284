"""Condensation of a body on many processes by one parallel factorisation."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import reverse_cuthill_mckee

from contact.arrays.blas_threads import one_blas_thread
from contact.body.distributed_body import DistributedBody
from contact.body.free_motions import RIGID, unseen_motion
from contact.body.multipoint import picked_by
from contact.body.rigid_modes import describe_motion, reduced_echelon
from contact.condensation.condensed_body import BodyRows, CondensedBody
from contact.condensation.scaled_stiffness import unit_of
from contact.condensation.schur import schur_factor
from skfem_adini.distributed import MumpsSchur, has_petsc

Array = NDArray[np.float64]


class CondensedDistributed(CondensedBody):
    """A `DistributedBody`, condensed by MUMPS onto the unknowns that contact rows touch.
    Every process has the Schur complement and solves the same boundary problem. Raises Unbounded if
    neither supports nor contact rows resist a motion, InputError if not definite."""

    def __init__(self, body: DistributedBody, rows: BodyRows, solver: str = "auto") -> None:
        z = body.unknowns
        # Scale the unknowns to unit stiffness, by powers of two.
        diagonal = self._diagonal(body)
        self._unit = unit_of(diagonal, np)
        of_known = z.known(self._unit)
        S = sparse.csr_array(z.own.T @ body.rows @ z.all)
        S.data *= np.repeat(self._unit, np.diff(S.indptr)) * of_known[S.indices]
        strip = z.collected(z.strip_numbers, self._unit)
        self._P = sparse.csr_array(z.strip @ sparse.diags_array(strip))
        self._strip = body.trace.basis.N
        self._prescribe(body)
        B = self._touch(rows)
        self.B = sparse.csr_array(B[:, self._boundary])
        self._at = z.strip_numbers[self._boundary]
        modes = self._free_motions()
        on_boundary = z.collected(self._at, modes)
        self._refuse(unseen_motion(modes, on_boundary))
        self._factor = self._schur(S, solver)
        with one_blas_thread(max(self.B.shape)):
            self._hold(on_boundary, modes)

    def _schur(self, S: sparse.csr_array, solver: str) -> Any:
        """The factor by MUMPS; on one process also by the solvers for a single machine."""
        body, z = self.body, self.body.unknowns
        if body.comm.size == 1 and (solver != "mumps" and not (solver == "auto" and has_petsc())):
            return schur_factor(S, self._at, partial(_banded, S), solver)
        return MumpsSchur(S, z.numbers, z.first, z.total, self._at, body.comm)

    @staticmethod
    def _diagonal(body: DistributedBody) -> Array:
        """Diagonal of the stiffness in the own unknowns."""
        z = body.unknowns
        product = sparse.csr_array(body.rows @ z.all)
        own = np.searchsorted(z.numbers, z.first + np.arange(z.own.shape[1]))
        sums = z.own.multiply(product[:, own]).sum(axis=0)
        return np.asarray(sums, dtype=np.float64).ravel()

    def _prescribe(self, body: Any) -> None:
        u0 = body.constraint[1]
        self.body, self._u0 = body, u0
        moved = any(body.comm.allgather(bool(u0.any())))
        self._lifted = body.internal(u0) if moved else None

    def _in_unknowns(self, rows: BodyRows) -> sparse.csr_array:
        strip = (
            sparse.csr_array(part[:, : self._strip]) for part in (rows.normal, rows.tangential)
        )
        return super()._in_unknowns(BodyRows(*strip))

    def rigid_in_unknowns(self) -> Array:
        """All rigid motions, supported or not, in the own unknowns."""
        z, owned = self.body.unknowns, self.body.space.owned
        picked = picked_by(z.own, self.body.lengths[0][owned])
        return np.asarray(picked.T @ self.body.rigid[owned]) / self._unit[:, None]

    def _free_motions(self) -> Array:
        """Rigid motions that no support resists, in the own unknowns, shape (own, k)."""
        body = self.body
        z, owned = body.unknowns, body.space.owned
        of_dof = body.lengths[0][owned][:, None]
        modes, picked = body.rigid[owned], picked_by(z.own, of_dof[:, 0])
        size = np.linalg.norm(body.stacked(of_dof * modes), axis=0)
        held = body.stacked(of_dof * (modes - z.own @ (picked.T @ modes)) / size)
        _, singular, V = np.linalg.svd(held, full_matrices=False)
        plain = reduced_echelon(V[singular < 10 * RIGID] / size)
        self._rigid = plain.T
        free: Array = picked.T @ (modes @ plain.T) / self._unit[:, None]
        return free

    def resultants(self, load: Array) -> Array:
        """Work of a load on the rigid motions, from the load before condensation."""
        here = self.modes.T @ self._to_own(load)
        return np.asarray(sum(self.body.comm.allgather(here)))

    def _to_own(self, forces: Array) -> Array:
        """Restrict forces on the dofs to the own unknowns."""
        own: Array = self._unit * (self.body.unknowns.own.T @ self.body.counted(forces))
        return own

    def carried(self, forces: Array) -> Array:
        """Forces on all dofs, condensed with zero supports onto the boundary's unknowns, (nb,)."""
        carried: Array = self._factor.reduce(self._to_own(forces))
        return carried

    def moved(self, forces: Array, z_b: Array) -> Array:
        """Displacement of all dofs under forces, with zero supports."""
        body = self.body
        z_b = body.comm.bcast(z_b)  # bitwise equal on all processes
        own = self._unit * self._factor.expand(self._to_own(forces), z_b)
        return self._of_own(own)

    def _of_own(self, own: Array) -> Array:
        body = self.body
        x = np.zeros(body.space.basis.N)
        x[body.space.owned] = body.unknowns.own @ own
        u: Array = body.of_owned(x)
        return u

    def restrict(self, rows: sparse.csr_array) -> Array:
        """Rows of all dofs in the contact boundary's unknowns, shape (nrows, nb)."""
        return super().restrict(sparse.csr_array(rows[:, : self._strip]))

    def motion_of(self, motion: Array) -> tuple[str, Array]:
        """Name, and displacement of all dofs, of a rigid motion given on own unknowns."""
        u = self._of_own(self._unit * motion)
        strip = u[: self._strip]
        return describe_motion(self.body.trace, strip), u


def _banded(S: sparse.csr_array) -> NDArray[np.int64]:
    """An elimination order computed from the matrix only."""
    return reverse_cuthill_mckee(S, symmetric_mode=True).astype(np.int64)
