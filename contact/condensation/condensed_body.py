"""One body, condensed onto its unknowns that occur in contact rows."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.dense_arrays import HostArrays
from contact.arrays.sparse_rows import transpose
from contact.body.free_motions import not_held
from contact.body.rigid_modes import describe_motion
from contact.body.supports import few_times
from contact.condensation.strain_factor import STRAIN_UNKNOWNS
from contact.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BodyRows:
    """The columns of one body in the contact rows."""

    normal: sparse.csr_array  # shape (k, ndofs)
    tangential: sparse.csr_array  # shape (l, ndofs)
    keep: sparse.csr_array | None = None  # (1, ndofs), nonzero at dofs kept for later rows

    @property
    def count(self) -> int:
        """Number of rows, k + l."""
        return int(self.normal.shape[0] + self.tangential.shape[0])


class CondensedBody:
    """The Schur complement S_b of a body's unknowns in contact rows, factored once.
    A subclass computes the complement, sets the attributes and calls `_hold`."""

    arrays: HostArrays = HostArrays()  # device of the dense matrices
    body: Any
    B: sparse.csr_array  # contact rows on the boundary unknowns, shape (n, nb)
    N: Array  # orthonormal free rigid motions of these unknowns, shape (nb, k)
    modes: Array  # the same motions of all unknowns
    slender: bool = False  # cells so thin that digits are lost
    thin: bool  # body so thin that digits are lost
    path = "sparse"  # how the complement is computed: "sparse", "slabs" or "fourier"
    always_refined = True  # False: refine only displacements out of balance
    serial = True  # a second BLAS thread gains nothing, see `CondensedContact.blas_threads`
    _P: sparse.csr_array
    _factor: Any
    _boundary: NDArray[np.int64]
    _u0: Array | None
    _lifted: Array | None
    _looked_at: Any = None
    _of_all: Array | None = None

    def _prescribe(self, body: Any) -> None:
        """Store the body with its prescribed displacements."""
        u0 = body.constraint[1]
        self.body, self._u0 = body, u0
        self._lifted = body.internal(u0) if u0.any() else None

    def under(self, body: Any) -> CondensedBody:
        """The same factorisation for a body that `ElasticBody.under` made of this one."""
        other = copy(self)
        other._prescribe(body)
        return other

    def _touch(self, rows: BodyRows) -> sparse.csr_array:
        """Stack normal and tangential rows on all unknowns, and set the boundary unknowns."""
        B = self._in_unknowns(rows)
        kept = [] if rows.keep is None else [(rows.keep @ self._P).indices]
        self._boundary = np.unique(np.concatenate([B.indices, *kept])).astype(np.int64)
        return B

    def _in_unknowns(self, rows: BodyRows) -> sparse.csr_array:
        normal, tangential = (few_times(part, self._P) for part in (rows.normal, rows.tangential))
        tangential.eliminate_zeros()
        return sparse.csr_array(sparse.vstack([normal, tangential], format="csr"))

    def touched_by(self, rows: BodyRows) -> CondensedBody:
        """The same factorisation for other rows on dofs that were kept."""
        other, B = copy(self), self._in_unknowns(rows)
        if np.setdiff1d(B.indices, self._boundary).size:
            raise AssertionError("rows: they touch unknowns that were eliminated")
        other.B = sparse.csr_array(B[:, self._boundary])
        return other

    def _hold(self, N: Array, modes: Array) -> None:
        """Factor S_b with springs on the free rigid motions, on its unknowns (N) and all
        (modes)."""
        if N.shape[1]:
            N, R = np.linalg.qr(N)
            modes = np.linalg.solve(R.T, modes.T).T
        self.N, self.modes = N, modes
        self._invert()

    def _invert(self) -> None:
        """Prepare products with the inverse of the stiffness plus springs on free motions."""
        self._L, self.thin = held_factor(self.arrays, self.scaled_schur, self.N)

    @property
    def order(self) -> int:
        """Order of the largest dense matrix."""
        return max(self.B.shape)

    def compliance(self) -> Any:
        """``B S_b^-1 B^T`` on the device, shape (n, n)."""
        arrays = self.arrays
        return arrays.gram(arrays.solve(self._L, arrays.dense(self.B.T)))

    def flexed(self, r: Array) -> Array:
        """Displacement of the boundary's unknowns under forces r on them."""
        arrays = self.arrays
        half = arrays.solve(self._L, arrays.put(r[:, None]))
        return np.asarray(arrays.get(arrays.solve(self._L, half, transposed=True)))[:, 0]

    def resultants(self, load: Array) -> Array:
        """Work of a load on the rigid motions, from the load before condensation."""
        if not self.modes.shape[1]:
            return np.zeros(0)
        work: Array = self.modes.T @ (self._P.T @ load)
        return work

    def scaled_schur(self) -> Any:
        """S_b on the device, a copy."""
        return self.arrays.put(self._factor.schur)

    @property
    def stiffness(self) -> Array:
        """Schur complement S_b of the contact boundary's unknowns, shape (nb, nb)."""
        return np.asarray(self.arrays.get(self.scaled_schur()))

    def placed(self, v: Any) -> Any:
        """Move a vector of all dofs to the device of this condensation."""
        return v

    def prescribed(self) -> Array:
        """The prescribed displacements on all dofs, zero elsewhere."""
        return np.zeros(self.body.ndofs) if self._u0 is None else self._u0

    def reduce(self, load: Array) -> Array:
        """Load on all dofs, condensed onto the contact boundary's unknowns, shape (nb,)."""
        return self.carried(self._from_rest(load))

    def carried(self, forces: Array) -> Array:
        """Forces on all dofs, condensed with zero supports onto the boundary's unknowns, (nb,)."""
        carried: Array = self._factor.reduce(self._gathered(forces))
        return carried

    def _gathered(self, forces: Array) -> Any:
        """``P^T f`` on the device of the factors."""
        diagonal = self._only_diagonal
        return transpose(self._P) @ forces if diagonal is None else diagonal * forces

    def _spread(self, z: Any) -> Array:
        """``P z`` of a solution of the factors."""
        diagonal = self._only_diagonal
        return np.asarray(self._P @ z if diagonal is None else diagonal * z)

    @property
    def _only_diagonal(self) -> Array | None:
        """That of P, where no dof is supported or tied; else None."""
        P = self._P
        if self._looked_at is not P:
            n = P.shape[0]
            alone = P.nnz == n == P.shape[1] and all(
                np.array_equal(part, np.arange(part.size)) for part in (P.indices, P.indptr)
            )
            self._looked_at, self._of_all = P, P.data if alone else None
        return self._of_all

    @property
    def boundary_columns(self) -> sparse.csr_array:
        """Displacement of all dofs for unit boundary unknowns, with zero inner ones."""
        return sparse.csr_array(self._P[:, self._boundary])

    def restrict(self, rows: sparse.csr_array) -> Array:
        """Rows of all dofs in the contact boundary's unknowns, shape (nrows, nb)."""
        reduced: Array = (rows @ self._P)[:, self._boundary].toarray()
        return reduced

    def expand(self, load: Array, z_b: Array) -> Array:
        """Displacement of all dofs from the contact boundary's unknowns."""
        u = self.moved(self._from_rest(load), z_b)
        return u if self._u0 is None else u + self._u0

    def moved(self, forces: Array, z_b: Array) -> Array:
        """Displacement of all dofs under forces, with zero supports."""
        return self._spread(self._factor.expand(self._gathered(forces), z_b))

    def unbalanced(self, rest: Array, u: Array) -> Array | None:
        """Residual forces on free dofs; None if refinement gains nothing.
        `rest` is the load minus the contact forces, shape (ndofs,)."""
        return None

    def motion_of(self, motion: Array) -> tuple[str, Array]:
        """Name, and displacement of all dofs, of a rigid motion given on free unknowns."""
        u: Array = self._P @ motion
        return describe_motion(self.body, u), u

    def _from_rest(self, load: Array) -> Array:
        """The load minus the internal forces of the prescribed displacements."""
        return load if self._lifted is None else load - self._lifted

    def _refuse(self, motion: Array | None) -> None:
        """Raise the error for a motion that neither supports nor contact rows resist."""
        if motion is not None:
            raise not_held(self.body, *self.motion_of(motion))


def held_factor(arrays: HostArrays, stiffness: Callable[[], Any], N: Array) -> tuple[Any, bool]:
    """Factor of ``S_b + rho N N^T``, and whether bending is far softer than compression.
    `stiffness` returns a new copy of S_b (nb, nb); N (nb, k) are the free rigid motions. Raises
    InputError if the matrix is indefinite by more than rounding."""
    on_device = arrays.put(N)
    # Multiples of the mean stiffness to add to the diagonal, since rounding may make S_b of a thin
    # body indefinite. Shifted solutions only start `contact.problem.stiffness_form`.
    for shift in (0.0, 1e-14, 1e-13, 1e-12, 1e-11, 1e-10, 1e-9):
        S = stiffness()
        mean = S.diagonal().mean()
        S = S + mean * (on_device @ on_device.T) if N.shape[1] else S
        if shift:
            i = arrays.xp.arange(S.shape[0])
            S[i, i] += shift * mean
        with suppress(np.linalg.LinAlgError):
            L = arrays.cholesky(S)
            pivots = arrays.get(L.diagonal()) ** 2
            # Below this stiffness ratio of bending to compression, compression loses digits.
            return L, bool(pivots.size and pivots.min() < 1e-6 * pivots.max())
    raise InputError(
        "stiffness: the condensed stiffness is not positive definite; the material or the mesh is "
        "not admissible, or cells are too slender for its digits: make them squarer, or fewer (up "
        f"to {STRAIN_UNKNOWNS} unknowns the strains are factored instead, with twice the digits)"
    )
