"""The dense Schur complement of the contact boundary by one sparse factorisation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.errors import ContactError, InputError, MissingDependency
from skfem_adini.ground.arguments import choice
from skfem_adini.ground.pardiso import DEFINITE, Pardiso, SolverError, has_pardiso
from skfem_adini.solvers.factorize import SuperLUFactor

Vector = NDArray[np.float64]


class SchurFactor(Protocol):
    """A factorisation of S with inner unknowns I and boundary unknowns b; `schur` is S_bb - S_bI
    S_II^-1 S_Ib, shape (nb, nb). Only S_II must be definite: the S of a floating body is singular,
    but its complement exists."""

    schur: Vector

    def reduce(self, load: Vector) -> Vector:
        """f_b - S_bI S_II^-1 f_I, shape (nb,)."""
        ...

    def expand(self, load: Vector, z_b: Vector) -> Vector:
        """All unknowns, shape (n,): z_I = S_II^-1 (f_I - S_Ib z_b) and the given z_b."""
        ...


def schur_factor(
    stiffness: sparse.csr_array,
    boundary: NDArray[np.int64],
    order: Callable[[], NDArray[np.int64]],
    solver: str = "auto",
) -> SchurFactor:
    """Factor S once and keep the complement of the ascending unknowns `boundary`, shape (nb,).
    `order` is a fill-reducing order for SuperLU; "auto" uses PARDISO if installed. Raises
    InputError (unknown solver, not definite) or MissingDependency."""
    choice("solver", solver, ("auto", "pardiso", "superlu"))
    if solver == "pardiso" and not has_pardiso():
        raise MissingDependency("PARDISO needs pypardiso: pip install 'skfem-adini[mkl]'")
    # S may be singular (floating body). A shift of the boundary block makes it definite; the same
    # shift is subtracted from the Schur complement.
    shift = np.abs(stiffness.diagonal()[boundary])
    nothing_inside = boundary.size == stiffness.shape[0]  # PARDISO would report lack of memory
    if solver == "superlu" or nothing_inside or not has_pardiso():
        return SuperLUSchur(stiffness, boundary, order(), shift)
    return PardisoSchur(stiffness, boundary, shift)


def not_definite() -> InputError:
    """The error for a stiffness whose inner block has a pivot that is not positive."""
    return InputError(
        "stiffness: the part inside the contact boundary is not positive definite; cells are too "
        "slender for the digits of the matrix, parts of the mesh hang together by a hinge alone, "
        "or E or nu is not admissible"
    )


class ForwardCache:
    """Cache of the forward elimination of the last loads, which `reduce` and `expand` both need.
    Only identical loads match, so that no result depends on earlier solves; for thread safety pairs
    are never modified and the tuple is replaced as a whole."""

    _known: tuple[tuple[Vector, Vector], ...] = ()

    def _eliminate(self, load: Vector) -> Vector:
        raise NotImplementedError

    def _forward(self, load: Vector) -> Vector:
        known = self._known
        for before, eliminated in known:
            some = slice(None, None, 101)  # tells most others apart
            if np.array_equal(before[some], load[some]) and np.array_equal(before, load):
                return eliminated
        found = self._eliminate(load)
        if isinstance(found, np.ndarray):
            found.setflags(write=False)
        self._known = ((load.copy(), found), *known[:5])  # six loads are kept
        return found


class SuperLUSchur(ForwardCache):
    """SuperLU in a given order, boundary last: the trailing block of L U is the complement."""

    def __init__(
        self,
        stiffness: sparse.csr_array,
        boundary: NDArray[np.int64],
        order: NDArray[np.int64],
        shift: Vector,
    ) -> None:
        n, nb = stiffness.shape[0], boundary.size
        on_boundary = np.zeros(n, dtype=bool)
        on_boundary[boundary] = True
        self._order = np.concatenate((order[~on_boundary[order]], boundary))
        self._boundary = boundary
        permuted = sparse.csc_matrix(stiffness[self._order][:, self._order])
        diagonal = permuted.diagonal()
        diagonal[n - nb :] += shift
        permuted.setdiag(diagonal)
        try:
            self._lu = SuperLUFactor(permuted, "NATURAL", 0.0)
        except RuntimeError as error:  # SuperLU: exactly singular
            raise not_definite() from error
        tail = np.arange(n - nb, n)
        if not (
            np.array_equal(self._lu.factors.perm_c[tail], tail)
            and np.array_equal(self._lu.factors.perm_r[tail], tail)
        ):
            raise ContactError("SuperLU moved the contact boundary; please report the mesh")
        upper = self._lu.factors.U  # SciPy copies the whole factor
        block = upper[:, n - nb :][n - nb :].toarray()
        pivots = upper.diagonal()  # pivots below 1e-14 of the largest are rounding
        if not np.all(pivots > 1e-14 * np.abs(pivots).max(initial=0.0)):
            raise not_definite()
        # L = U^T D^-1 for a symmetric matrix factored without row exchanges.
        self._shifted = block.T @ (block / np.diag(block)[:, None])
        self._shifted = 0.5 * (self._shifted + self._shifted.T)
        self.schur = self._shifted - np.diag(shift)

    def _eliminate(self, load: Vector) -> Vector:
        """S_bI S_II^-1 f_I, from a solve without load on the boundary."""
        inner = load[self._order]
        inner[load.size - self._boundary.size :] = 0.0
        carried: Vector = -self._shifted @ self._lu.solve(inner)[load.size - self._boundary.size :]
        return carried

    def reduce(self, load: Vector) -> Vector:
        """Reduce a load to the boundary: f_b - S_bI S_II^-1 f_I."""
        carried: Vector = load[self._boundary] - self._forward(load)
        return carried

    def expand(self, load: Vector, z_b: Vector) -> Vector:
        """Return all unknowns from the boundary's."""
        inner = load[self._order]
        inner[load.size - z_b.size :] = self._shifted @ z_b + self._forward(load)
        z = np.empty_like(load)
        z[self._order] = self._lu.solve(inner)
        z[self._boundary] = z_b
        return z


class PardisoSchur(ForwardCache):
    """MKL PARDISO's partial factorisation, Schur complement control (oneMKL, iparm[35])."""

    def __init__(
        self, stiffness: sparse.csr_array, boundary: NDArray[np.int64], shift: Vector
    ) -> None:
        shifted, diagonal = stiffness.copy(), stiffness.diagonal()
        diagonal[boundary] += shift
        shifted.setdiag(diagonal)
        # iparm, counted from 0: parallel nested dissection (faster analysis with a Schur block);
        # two-level factorisation; solves by one thread, as several vary the order of sums and so
        # the rounding; Schur complement, with factors kept for partial solves.
        parameters = {1: 3, 23: 1, 24: 1, 35: 2}
        self._boundary = boundary
        block = np.zeros((boundary.size, boundary.size))
        try:
            self._pardiso = Pardiso(shifted, DEFINITE, parameters, chosen=boundary)
            self._pardiso(11)
            self._pardiso(22, x=block)
        except SolverError as error:
            if error.pivot:
                raise not_definite() from error
            raise
        self.schur = 0.5 * (block + block.T) - np.diag(shift)

    def _forward(self, load: Vector) -> Vector:
        if self._pardiso.pending:
            # The cache belongs to the factors of the original object or of the parent process.
            self._known = ()
        return super()._forward(load)

    def _eliminate(self, load: Vector) -> Vector:
        halfway = np.zeros_like(load)
        self._pardiso(331, np.ascontiguousarray(load), halfway)
        return halfway

    def reduce(self, load: Vector) -> Vector:
        """Reduce a load to the boundary: f_b - S_bI S_II^-1 f_I."""
        carried: Vector = self._forward(load)[self._boundary]
        return carried

    def expand(self, load: Vector, z_b: Vector) -> Vector:
        """Return all unknowns from the boundary's."""
        halfway = self._forward(load).copy()
        halfway[self._boundary] = z_b
        z = np.zeros_like(load)
        self._pardiso(333, halfway, z)
        z[self._boundary] = z_b
        return z
