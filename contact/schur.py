"""One sparse factorisation that leaves the dense Schur complement of the contact boundary."""

from __future__ import annotations

import ctypes
import importlib.util
import sys
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from contact.errors import ContactError, InputError, MissingDependency

Vector = NDArray[np.float64]


class SchurFactor(Protocol):
    """A factorisation of S with the unknowns split into inner ones I and boundary ones b.

    ``schur`` is S_bb - S_bI S_II^-1 S_Ib, shape (nb, nb). `reduce` carries a load to the boundary,
    `expand` returns all unknowns from the boundary's. Only S_II must be positive definite: a body
    that is held by contact alone has a singular S and a sound Schur complement.
    """

    schur: Vector

    def reduce(self, load: Vector) -> Vector:
        """f_b - S_bI S_II^-1 f_I, shape (nb,)."""
        ...

    def expand(self, load: Vector, z_b: Vector) -> Vector:
        """All unknowns, shape (n,): z_I = S_II^-1 (f_I - S_Ib z_b) beside the given z_b."""
        ...


def has_pardiso() -> bool:
    """Whether pypardiso can be imported."""
    return importlib.util.find_spec("pypardiso") is not None


def schur_factor(
    stiffness: sparse.csr_array,
    boundary: NDArray[np.int64],
    order: NDArray[np.int64],
    solver: str = "auto",
) -> SchurFactor:
    """Factor once and keep the boundary's Schur complement.

    Parameters
    ----------
    stiffness : csr_array, shape (n, n)
        Symmetric; its block without the boundary must be positive definite.
    boundary : ndarray, shape (nb,)
        Ascending indices of the unknowns to keep.
    order : ndarray, shape (n,)
        Fill-reducing elimination order; the boundary is moved to its end (SuperLU only).
    solver : {"auto", "pardiso", "superlu"}
        "auto" takes PARDISO when pypardiso is importable.

    Raises
    ------
    InputError
        Unknown solver, or the inner block is not positive definite.
    MissingDependency
        PARDISO asked for and not installed.
    """
    if solver not in ("auto", "pardiso", "superlu"):
        raise InputError(f"solver={solver!r}: expected 'auto', 'pardiso' or 'superlu'")
    if solver == "pardiso" and not has_pardiso():
        raise MissingDependency("PARDISO needs pypardiso: pip install 'skfem-adini[mkl]'")
    # S may be singular (a floating body). The shift makes it definite; the Schur complement
    # carries it along unchanged and gives it back.
    shift = float(np.mean(np.abs(stiffness.diagonal()[boundary])))
    ramp = np.zeros(stiffness.shape[0])
    ramp[boundary] = shift
    shifted = sparse.csr_array(stiffness + sparse.diags_array(ramp, format="csr"))
    if solver == "superlu" or not has_pardiso():
        return SuperLUSchur(shifted, boundary, order, shift)
    return PardisoSchur(shifted, boundary, shift)


def _singular() -> InputError:
    return InputError(
        "stiffness: the part inside the contact boundary is not positive definite; a piece of the "
        "mesh is neither fixed nor connected to the contact boundary, or E or nu is not admissible"
    )


class SuperLUSchur:
    """SuperLU in a given order, boundary last: the trailing block of L U is the complement."""

    def __init__(
        self,
        stiffness: sparse.csr_array,
        boundary: NDArray[np.int64],
        order: NDArray[np.int64],
        shift: float,
    ) -> None:
        n, nb = stiffness.shape[0], boundary.size
        on_boundary = np.zeros(n, dtype=bool)
        on_boundary[boundary] = True
        self._order = np.concatenate((order[~on_boundary[order]], boundary))
        self._boundary = boundary
        permuted = sparse.csc_matrix(stiffness[self._order][:, self._order])
        try:
            self._lu: SuperLU = splu(
                permuted,
                permc_spec="NATURAL",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:  # SuperLU: exactly singular
            raise _singular() from error
        tail = np.arange(n - nb, n)
        if not (
            np.array_equal(self._lu.perm_c[tail], tail)
            and np.array_equal(self._lu.perm_r[tail], tail)
        ):
            raise ContactError("SuperLU moved the contact boundary; please report the mesh")
        upper = self._lu.U  # a copy of the whole factor, the price of SciPy's interface
        block = upper[:, n - nb :][n - nb :].toarray()
        pivots = upper.diagonal()
        if not np.all(pivots > 1e-14 * np.abs(pivots).max(initial=0.0)):
            raise _singular()
        # L = U^T D^-1 for a symmetric matrix factored without row exchanges.
        self._shifted = block.T @ (block / np.diag(block)[:, None])
        self._shifted = 0.5 * (self._shifted + self._shifted.T)
        self.schur = self._shifted - shift * np.eye(nb)

    def _inner(self, load: Vector) -> tuple[Vector, Vector]:
        """The permuted load without its boundary part, and S_bI S_II^-1 f_I."""
        nb = self._boundary.size
        inner = load[self._order]
        inner[inner.size - nb :] = 0.0
        return inner, -self._shifted @ self._lu.solve(inner)[inner.size - nb :]

    def reduce(self, load: Vector) -> Vector:
        """Carry a load to the boundary: f_b - S_bI S_II^-1 f_I."""
        carried: Vector = load[self._boundary] - self._inner(load)[1]
        return carried

    def expand(self, load: Vector, z_b: Vector) -> Vector:
        """Return all unknowns from the boundary's."""
        inner, carried = self._inner(load)
        inner[inner.size - z_b.size :] = self._shifted @ z_b + carried
        z = np.empty_like(load)
        z[self._order] = self._lu.solve(inner)
        z[self._boundary] = z_b
        return z


class PardisoSchur:
    """MKL PARDISO's own partial factorisation (Schur complement control).

    Reference: Intel oneMKL developer reference, ``pardiso`` parameter iparm[35].
    """

    def __init__(
        self, stiffness: sparse.csr_array, boundary: NDArray[np.int64], shift: float
    ) -> None:
        from pypardiso.pardiso_wrapper import PyPardisoSolver

        n, nb = stiffness.shape[0], boundary.size
        upper = sparse.triu(stiffness, format="csr")
        upper.sort_indices()
        self._matrix = upper
        self._ia = (upper.indptr + 1).astype(np.int32)
        self._ja = (upper.indices + 1).astype(np.int32)
        self._boundary = boundary
        self._mkl = PyPardisoSolver(mtype=2)  # real symmetric positive definite
        self._mkl.iparm[:] = 0
        self._mkl.iparm[0] = 1  # the values below, not the defaults
        self._mkl.iparm[1] = 2  # nested dissection
        self._mkl.iparm[23] = 1  # two-level parallel factorisation
        self._mkl.iparm[35] = 2  # Schur complement, and factors for partial solves
        self._mkl.perm = np.zeros(n, dtype=np.int32)
        self._mkl.perm[boundary] = 1
        nothing = np.zeros(n)
        block = np.zeros((nb, nb))
        self._call(11, nothing, nothing)
        self._call(22, nothing, block)
        self.schur = 0.5 * (block + block.T) - shift * np.eye(nb)

    def _call(self, phase: int, b: Vector, x: Vector) -> None:
        solver = self._mkl
        error = ctypes.c_int32(0)
        int_p = ctypes.POINTER(ctypes.c_int32)

        def value(i: int) -> object:
            return ctypes.byref(ctypes.c_int32(i))

        solver._mkl_pardiso(
            solver.pt.ctypes.data_as(ctypes.POINTER(solver._pt_type[0])),
            value(1),
            value(1),
            value(solver.mtype),
            value(phase),
            value(self._matrix.shape[0]),
            self._matrix.data.ctypes.data_as(ctypes.c_void_p),
            self._ia.ctypes.data_as(int_p),
            self._ja.ctypes.data_as(int_p),
            solver.perm.ctypes.data_as(int_p),
            value(1),
            solver.iparm.ctypes.data_as(int_p),
            value(0),
            b.ctypes.data_as(ctypes.c_void_p),
            x.ctypes.data_as(ctypes.c_void_p),
            ctypes.byref(error),
        )
        if error.value == -4:  # zero or negative pivot
            raise _singular()
        if error.value == -2:
            raise MemoryError("PARDISO: not enough memory for the factorisation")
        if error.value != 0:
            raise ContactError(f"PARDISO phase {phase} failed with code {error.value}")

    def _forward(self, load: Vector) -> Vector:
        halfway = np.zeros_like(load)
        self._call(331, np.ascontiguousarray(load), halfway)
        return halfway

    def reduce(self, load: Vector) -> Vector:
        """Carry a load to the boundary: f_b - S_bI S_II^-1 f_I."""
        carried: Vector = self._forward(load)[self._boundary]
        return carried

    def expand(self, load: Vector, z_b: Vector) -> Vector:
        """Return all unknowns from the boundary's."""
        halfway = self._forward(load)
        halfway[self._boundary] = z_b
        z = np.zeros_like(load)
        self._call(333, halfway, z)
        z[self._boundary] = z_b
        return z

    def __del__(self) -> None:
        solver = getattr(self, "_mkl", None)
        if solver is not None and solver.pt.any() and not sys.is_finalizing():
            nothing = np.zeros(1)
            self._call(-1, nothing, nothing)
            solver.pt[:] = 0
