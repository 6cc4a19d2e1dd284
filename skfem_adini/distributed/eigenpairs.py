"""The lowest eigenpairs of distributed matrices, by SLEPc."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skfem_adini.distributed.communicator import INSTALLING, any_of, petsc, total
from skfem_adini.distributed.distributed_matrix import DistributedMatrix, to_petsc
from skfem_adini.errors import InputError, MissingDependency, NotConverged
from skfem_adini.ground.arguments import dof_numbers, integer
from skfem_adini.solvers.lowest_eigenpairs import lowest_eigenpairs as on_one_process
from skfem_adini.solvers.lowest_eigenpairs import warn_of_negative

Array = NDArray[np.float64]


def lowest_eigenpairs(
    K: DistributedMatrix,
    M: DistributedMatrix,
    count: int,
    fixed: ArrayLike | None = None,
    shift: float = 0.0,
) -> tuple[Array, Array]:
    r"""Return the smallest eigenvalues of :math:`K x = \lambda M x` on many processes.

    Krylov-Schur's method is applied to :math:`(K - \sigma M)^{-1} M`, with MUMPS's factors; dofs
    are scaled by the square roots of the diagonal of M. One process without PETSc or SLEPc takes
    `skfem_adini.lowest_eigenpairs`.

    Parameters
    ----------
    K, M
        Symmetric, of one `DistributedBasis`; M positive definite.
    count
        Number of eigenpairs.
    fixed
        Local dofs of homogeneous essential conditions, the halo included.
    shift
        The number sigma, below all eigenvalues; below zero if K is singular.

    Returns
    -------
    values : ndarray
        Ascending, shape (count,).
    vectors : ndarray
        Of unit M-norm, local vectors as columns, shape (basis.N, count), zero at the fixed dofs.

    Raises
    ------
    InputError
        Matrices of different spaces, a count that is too large, or M or K - sigma M not
        definite, by the signs of the pivots.
    MissingDependency
        petsc4py or slepc4py is not installed, on several processes.
    NotConverged
        The iteration does not converge, or a recomputed residual is too large.

    Warns
    -----
    IndefiniteWarning
        An eigenvalue is negative beyond rounding, so that K is not semidefinite.

    References
    ----------
    V. Hernandez, J. E. Roman and V. Vidal, SLEPc: a scalable and flexible toolkit for the solution
    of eigenvalue problems, ACM Trans. Math. Software 31 (2005), 351-362.
    """
    space = K.space
    if M.space is not space:
        raise InputError("K, M: expected matrices of one DistributedBasis")
    free = np.ones(space.basis.N)
    if fixed is not None:
        free[dof_numbers("fixed", fixed, space.basis.N)] = 0.0
    unknowns = int(total(space.comm, free[space.owned].sum()))
    count = integer("count", count, 1, unknowns - 1)
    diagonal = M.diagonal()
    if any_of(space.comm, np.any(diagonal <= 0)):
        raise InputError("M: the matrix is not positive definite")
    try:
        PETSc, SLEPc = petsc(space.comm), _slepc()
    except MissingDependency:
        if space.comm.size > 1:
            raise
        return on_one_process(K.rows, M.rows, count, np.flatnonzero(free == 0), shift)
    scale = free / np.sqrt(diagonal)
    number = _numbers_of_free(space, free)
    stiffness, mass = (_scaled(A, scale, free, number, unknowns) for A in (K, M))
    _check_mass(PETSc, mass)
    solver = _shift_and_invert(PETSc, SLEPc, shift)
    solver.setOperators(stiffness, mass)
    solver.setDimensions(nev=count)
    try:
        solver.solve()
    except PETSc.Error as error:
        raise InputError(
            "shift: K - shift M is not positive definite; take a lower shift, or fix dofs "
            f"({str(error).strip().splitlines()[-1]})"
        ) from error
    if solver.getST().getKSP().getPC().getFactorMatrix().getMumpsInfog(12):
        raise InputError(
            "shift: K - shift M is not positive definite, a pivot is negative; take a lower shift"
        )
    if solver.getConverged() < count:
        raise NotConverged(
            f"eigenpairs: {solver.getConverged()} of {count} converged; ask for fewer, or take a "
            "shift nearer to them"
        )
    own = np.flatnonzero(free[space.owned] > 0)
    values, vectors = np.empty(count), np.zeros((space.basis.N, count))
    x = stiffness.createVecRight()
    for k in range(count):
        values[k] = solver.getEigenpair(k, x).real
        residual = solver.computeError(k, SLEPc.EPS.ErrorType.RELATIVE)
        if not residual <= 1e-9:
            raise NotConverged(f"eigenpairs: pair {k} has the relative residual {residual:.1e}")
        vectors[space.owned[own], k] = x.getArray()
    order = np.argsort(values, kind="stable")
    unit = float(stiffness.norm(PETSc.NormType.INFINITY)) or 1.0
    warn_of_negative(float(values[order[0]]) / unit, unit)
    local = space.update(scale[:, None] * vectors[:, order])
    norms = np.sqrt(total(space.comm, np.sum(local[space.owned] * (M.rows @ local), axis=0)))
    return values[order], local / norms


def _check_mass(PETSc: Any, mass: Any) -> None:
    """Raise unless the scaled mass matrix is definite, by the signs of MUMPS's pivots."""
    ksp = PETSc.KSP().create(comm=PETSc.COMM_WORLD)
    ksp.setOperators(mass)
    ksp.setType("preonly")
    pc = ksp.getPC()
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    pc.setFactorSetUpSolverType()
    factor = pc.getFactorMatrix()
    factor.setMumpsIcntl(13, 1)  # else the pivots of the root are missing on several processes
    try:
        ksp.setUp()
        refused = factor.getMumpsInfog(1) < 0 or factor.getMumpsInfog(12) > 0
    except PETSc.Error:
        refused = True
    if refused:
        raise InputError(
            "M: the matrix is not positive definite, though its diagonal is positive; check the "
            "signs of its coefficients"
        )


def _shift_and_invert(PETSc: Any, SLEPc: Any, shift: float) -> Any:
    """A solver for the eigenvalues next to the shift, by a factorisation of MUMPS."""
    solver = SLEPc.EPS().create(comm=PETSc.COMM_WORLD)
    solver.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    solver.setTolerances(tol=1e-13, max_it=1000)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    solver.setTarget(shift)
    transform = solver.getST()
    transform.setType("sinvert")
    transform.setShift(shift)
    ksp = transform.getKSP()
    ksp.setType("preonly")
    ksp.getPC().setType("cholesky")
    ksp.getPC().setFactorSolverType("mumps")
    return solver


def _slepc() -> Any:
    try:
        from slepc4py import SLEPc
    except ImportError as error:
        raise MissingDependency(f"slepc4py cannot be imported ({error}); {INSTALLING}") from None
    return SLEPc


def _numbers_of_free(space: Any, free: Array) -> NDArray[np.int64]:
    """Consecutive numbers of the free dofs, process by process, at all local dofs."""
    own = free[space.owned] > 0
    counts = space.comm.allgather(int(own.sum()))
    number = np.full(space.basis.N, -1, dtype=np.int64)
    number[space.owned[own]] = sum(counts[: space.comm.rank]) + np.arange(int(own.sum()))
    return space.update(number)


def _scaled(
    A: DistributedMatrix, scale: Array, free: Array, number: NDArray[np.int64], size: int
) -> Any:
    """The scaled matrix of the free dofs, for PETSc."""
    space, rows = A.space, A.rows.copy()
    rows.data = rows.data * np.repeat(scale[space.owned], np.diff(rows.indptr))
    rows.data *= scale[rows.indices]
    kept = rows[free[space.owned] > 0][:, free > 0]
    return to_petsc(kept, number[free > 0], (size, size), space.comm)
