"""Solution of symmetric systems on many processes, by PETSc."""

from __future__ import annotations

import logging
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from skfem_adini.distributed.communicator import any_of, has_petsc, largest, petsc
from skfem_adini.distributed.distributed_matrix import DistributedMatrix, to_petsc
from skfem_adini.distributed.smooth_modes import smooth_modes
from skfem_adini.errors import InputError, NotConverged
from skfem_adini.ground.arguments import choice, dof_numbers
from skfem_adini.solvers.factorize import factorize

Array = NDArray[np.float64]
Method = Literal["auto", "mumps", "gamg", "hypre"]
_log = logging.getLogger(__name__)


class DistributedSolver:
    """A symmetric positive definite system, factored or preconditioned once for many loads.

    Unknowns are scaled to a unit diagonal, by powers of two. Fixed dofs keep their place in the
    matrix, with a diagonal entry of one, so that the unknowns of a node stay together.

    Parameters
    ----------
    A : DistributedMatrix
    fixed : array of local dofs, optional
        Those with prescribed values, the halo included, as `DistributedBasis.boundary_dofs` gives.
    solver : {"auto", "mumps", "gamg", "hypre"}
        MUMPS factors; "gamg" is PETSc's smoothed aggregation and "hypre" BoomerAMG, either with
        conjugate gradients. "auto" takes "gamg" in space beyond 50,000 unknowns and "mumps"
        otherwise, and logs its choice.
    near_null : ndarray, shape (basis.N, k), optional
        Functions of little energy at the local dofs; default: `smooth_modes`.
    tol : float
        Largest residual relative to the load, in the scaled unknowns, recomputed from A.
    max_iterations : int

    Raises
    ------
    InputError
        An unknown solver, fixed dofs out of range, or A is not positive definite.
    MissingDependency
        petsc4py is not installed. On one process without it "auto" takes
        `skfem_adini.factorize`.

    References
    ----------
    P. R. Amestoy, I. S. Duff, J. Koster and J.-Y. L'Excellent, A fully asynchronous multifrontal
    solver using distributed dynamic scheduling, SIAM J. Matrix Anal. Appl. 23 (2001), 15-41.

    Examples
    --------
    >>> from skfem import MeshQuad, ElementQuad1
    >>> from skfem.models.poisson import laplace, unit_load
    >>> from skfem_adini.distributed import DistributedBasis, DistributedSolver
    >>> space = DistributedBasis(MeshQuad().refined(4).with_defaults(), ElementQuad1())
    >>> fixed = space.boundary_dofs("left", "right", "top", "bottom")
    >>> solver = DistributedSolver(space.assemble(laplace), fixed)
    >>> x = solver.solve(space.assemble(unit_load))
    >>> print(f"{x.max():.4f}")
    0.0739
    """

    def __init__(
        self,
        A: DistributedMatrix,
        fixed: ArrayLike | None = None,
        solver: Method = "auto",
        near_null: Array | None = None,
        tol: float = 1e-10,
        max_iterations: int = 500,
    ) -> None:
        choice("solver", solver, ("auto", "mumps", "gamg", "hypre"))
        self.space, self.matrix, self.tol = A.space, A, tol
        self.iterations, self.max_iterations = 0, max_iterations
        space = self.space
        self._free = np.ones(space.basis.N)
        if fixed is not None:
            self._free[dof_numbers("fixed", fixed, space.basis.N)] = 0.0
        diagonal = A.diagonal()
        if any_of(space.comm, np.any(diagonal[self._free > 0] <= 0)):
            raise InputError("A: an entry of the diagonal is not positive, so A is not definite")
        exponent = np.round(-0.5 * np.log2(np.where(self._free > 0, diagonal, 1.0)))
        self._unit = np.ldexp(1.0, exponent.astype(np.int64))
        self._scaled = self._scale_rows()
        self.method = self._chosen(solver)
        self._near_null = near_null
        self._prepare()

    def __repr__(self) -> str:
        return f"DistributedSolver({self.space.N} dofs, {self.method})"

    def _chosen(self, solver: Method) -> str:
        if solver != "auto":
            return solver
        size, dim = self.space.N, self.space.mesh.dim()
        if self.space.comm.size == 1 and not has_petsc():
            return "factorize"
        # In space multigrid beats MUMPS beyond 50,000 unknowns (benchmarks/distributed.py).
        method = "gamg" if dim == 3 and size > 50_000 else "mumps"
        _log.info("%s for %d unknowns in %d-D", method, size, dim)
        return method

    def _scale_rows(self) -> sparse.csr_array:
        """Scaled rows of free dofs without the columns of fixed ones; the others are unit rows."""
        space, rows = self.space, self.matrix.rows.copy()
        left, right = self._unit * self._free, self._unit * self._free
        rows.data = rows.data * np.repeat(left[space.owned], np.diff(rows.indptr))
        rows.data *= right[rows.indices]
        own = np.arange(space.owned.size)
        held = 1.0 - self._free[space.owned]
        ones = sparse.csr_array((held, (own, space.owned)), shape=rows.shape)
        return sparse.csr_array(rows + ones)

    def _prepare(self) -> None:
        space = self.space
        if self.method == "factorize":
            matrix = self._scaled[:, space.owned]
            self._factor: Any = factorize(0.5 * (matrix + matrix.T))
            return
        PETSc = petsc(space.comm)
        size = _block_size(space) if self.method == "gamg" else 1
        shape = space.N, space.N
        self._petsc = to_petsc(self._scaled, space.numbers, shape, space.comm, size)
        for option in (PETSc.Mat.Option.SYMMETRIC, PETSc.Mat.Option.SPD):
            self._petsc.setOption(option, True)
        self._ksp = PETSc.KSP().create(comm=PETSc.COMM_WORLD)
        self._ksp.setOperators(self._petsc)
        self._b, self._x = self._petsc.createVecs()
        if self.method == "mumps":
            self._ksp.setType("preonly")
            pc = self._ksp.getPC()
            pc.setType("cholesky")
            pc.setFactorSolverType("mumps")
        else:
            self._precondition(PETSc)
        try:
            self._ksp.setUp()
        except PETSc.Error as error:
            raise InputError(
                "A: the matrix is singular or not positive definite; are essential conditions "
                f"missing? ({str(error).strip().splitlines()[-1]})"
            ) from error

    def _precondition(self, PETSc: Any) -> None:
        space = self.space
        modes = smooth_modes(space) if self._near_null is None else self._near_null
        modes = (modes * (self._free / self._unit)[:, None])[space.owned]
        self._ksp.setType("cg")
        self._ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        self._ksp.setTolerances(rtol=0.3 * self.tol, max_it=self.max_iterations)
        precondition(self._ksp, self._petsc, modes, self.method)

    def solve(self, b: Array, prescribed: Array | None = None) -> Array:
        """The solution for a load.

        Parameters
        ----------
        b : ndarray, shape (basis.N,)
            Load as a local vector.
        prescribed : ndarray, shape (basis.N,), optional
            Values at the fixed dofs; zero by default.

        Returns
        -------
        ndarray, shape (basis.N,)
            The local vector of the solution.

        Raises
        ------
        InputError
            Another shape, or NaN.
        NotConverged
            The recomputed residual is above the tolerance.
        """
        space = self.space
        b = np.asarray(b, dtype=np.float64)
        wrong = b.shape != (space.basis.N,) or not np.all(np.isfinite(b[space.owned]))
        if any_of(space.comm, wrong):
            raise InputError(
                f"b: expected a local vector of {space.basis.N} finite numbers, got shape {b.shape}"
            )
        x = np.zeros(space.basis.N)
        if prescribed is not None:
            x = np.where(self._free > 0, 0.0, np.asarray(prescribed, dtype=np.float64))
        own = space.owned
        load = (b[own] - self.matrix.rows @ x) * self._unit[own] * self._free[own]
        z = np.zeros(space.basis.N)
        left, size = load, largest(space.comm, float(np.abs(load).max(initial=0.0)))
        self.iterations = 0
        for _ in range(3):  # runs of conjugate gradients, each from the true residual
            z += space.extended(self._apply(left))
            left = load - self._scaled @ z
            error = self._norm(left) / (self._norm(load) or 1.0)
            if error <= self.tol or size == 0.0:
                return x + self._unit * self._free * z
        advice = (
            "A may be singular; are essential conditions missing?"
            if self.method in ("mumps", "factorize")
            else "raise tol or max_iterations, or take solver='mumps'"
        )
        raise NotConverged(
            f"{self.method}: relative residual {error:.1e} after {self.iterations} iterations, "
            f"asked for {self.tol:.1e}; {advice}"
        )

    def _norm(self, own: Array) -> float:
        return float(np.sqrt(sum(self.space.comm.allgather(float(own @ own)))))

    def _apply(self, load: Array) -> Array:
        """The inverse, or the preconditioner of the iteration, applied to values of owned dofs."""
        if self.method == "factorize":
            found: Array = self._factor.solve(load)
            return found
        self._b.setArray(load)
        self._ksp.solve(self._b, self._x)
        self.iterations += int(self._ksp.getIterationNumber())
        return np.array(self._x.getArray())


def _block_size(space: Any) -> int:
    """Number of consecutive dofs at each vertex, if all dofs are at complete vertices; else 1."""
    nodal = space.basis.dofs.nodal_dofs
    if nodal.size != space.basis.N:
        return 1
    own = np.zeros(space.basis.N, dtype=bool)
    own[space.owned] = True
    whole = own[nodal].all(axis=0) | ~own[nodal].any(axis=0)
    return int(nodal.shape[0]) if all(space.comm.allgather(bool(whole.all()))) else 1


OPTIONS: dict[str, dict[str, Any]] = {
    "gamg": {
        "pc_type": "gamg",
        "pc_gamg_threshold": 0.01,
        "mg_levels_ksp_type": "chebyshev",
        "mg_levels_pc_type": "jacobi",
    },
    "hypre": {"pc_type": "hypre", "pc_hypre_type": "boomeramg"},
}


def precondition(ksp: Any, matrix: Any, near_null: Array, method: str) -> None:
    """Give a PETSc Krylov method a multigrid ("gamg" or "hypre") of a matrix.
    The near-null space (own unknowns, modes), functions of little energy, is made orthonormal."""
    from petsc4py import PETSc

    v = matrix.createVecRight()
    vectors: list[Any] = []
    for mode in near_null.T:
        v.setArray(np.ascontiguousarray(mode))
        before = v.norm()
        for earlier in vectors:
            v.axpy(-v.dot(earlier), earlier)
        if v.norm() > 1e-8 * before:
            v.normalize()
            vectors.append(v.copy())
    matrix.setNearNullSpace(PETSc.NullSpace().create(vectors=vectors, comm=PETSc.COMM_WORLD))
    prefix = f"skfem_adini_{id(ksp)}_"
    ksp.setOptionsPrefix(prefix)
    options = PETSc.Options()
    for name, value in OPTIONS[method].items():
        options[prefix + name] = value
    ksp.setFromOptions()
    for name in OPTIONS[method]:
        options.delValue(prefix + name)
