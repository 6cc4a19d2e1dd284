"""The lowest eigenpairs of a stiffness and a mass matrix."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from .errors import InputError, NotConverged
from .sparse_solve import Solver, factorize

Array = NDArray[np.float64]


def lowest_eigenpairs(
    K: Any,
    M: Any,
    count: int,
    fixed: ArrayLike | None = None,
    shift: float = -1.0,
    solver: Solver = "auto",
) -> tuple[Array, Array]:
    r"""Return the smallest eigenvalues of :math:`K x = \lambda M x`, by shift and invert.

    Lanczos' method is applied to :math:`(K - \sigma M)^{-1} M` with dofs scaled by the square
    roots of the diagonal of M; for Hermite elements these are u and h u_x up to constants, and the
    entries of K and M become numbers of order 1 and h^2 in 2-D.

    Parameters
    ----------
    K
        Symmetric positive semidefinite sparse matrix, shape (n, n).
    M
        Symmetric positive definite sparse matrix, shape (n, n).
    count
        Number of eigenpairs.
    fixed
        Dofs of homogeneous essential conditions, taken out of the problem.
    shift
        The number sigma, below all eigenvalues; best about as far below as they are apart. With a
        definite K it may be zero.
    solver
        For `factorize`.

    Returns
    -------
    values : ndarray
        Ascending, shape (count,). Rounding leaves errors of about 1e-16 times the largest
        eigenvalue of the mesh; `refine_eigenpair` removes them.
    vectors : ndarray
        Eigenvectors of unit M-norm, shape (n, count), zero at the fixed dofs.

    Raises
    ------
    InputError
        Shapes that do not fit, a count that is too large, or K - sigma M not definite.
    NotConverged
        The iteration does not converge.

    References
    ----------
    R. B. Lehoucq, D. C. Sorensen and C. Yang, ARPACK Users' Guide, SIAM 1998, section 3.2.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> from skfem.models.poisson import laplace, mass
    >>> from skfem_adini import ElementQuadAdini, essential_dofs
    >>> basis = Basis(MeshQuad().refined(3), ElementQuadAdini())
    >>> fixed = essential_dofs(basis, basis.mesh.boundary_facets())
    >>> K, M = laplace.assemble(basis), mass.assemble(basis)
    >>> values, _ = lowest_eigenpairs(K, M, 4, fixed)
    >>> print(np.round(values / np.pi**2, 3))
    [2.    5.    5.    8.001]
    """
    K, M = sparse.csr_array(K, dtype=float), sparse.csr_array(M, dtype=float)
    n = K.shape[0]
    if K.shape != (n, n) or M.shape != (n, n):
        raise InputError(f"K, M: expected square matrices of one size, got {K.shape}, {M.shape}")
    free = np.ones(n, dtype=bool)
    if fixed is not None:
        free[np.asarray(fixed)] = False
    kept = np.flatnonzero(free)
    if count not in range(1, kept.size):
        raise InputError(f"count: expected 1 to {kept.size - 1}, got {count!r}")
    if not np.isfinite(shift):
        raise InputError(f"shift: expected a finite number, got {shift!r}")
    K, M = K[kept][:, kept], M[kept][:, kept]
    diagonal = M.diagonal()
    if not (diagonal > 0).all():
        raise InputError("M: the matrix is not positive definite")
    scale = 1 / np.sqrt(diagonal)
    D = sparse.diags_array(scale)
    K, M = D @ K @ D, D @ M @ D
    factors = factorize(K - shift * M, definite=True, solver=solver)
    inverse = LinearOperator(K.shape, matvec=factors.solve, dtype=np.float64)
    start = np.random.default_rng(0).uniform(-1, 1, kept.size)
    try:
        values, z = eigsh(K, count, M, sigma=shift, OPinv=inverse, v0=start)
    except ArpackError as error:
        raise NotConverged(f"no convergence of the eigenvalues: {error}; change shift") from error
    order = np.argsort(values)
    vectors = np.zeros((n, count))
    vectors[kept] = scale[:, None] * z[:, order]
    return values[order], vectors
