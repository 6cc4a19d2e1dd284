"""The lowest eigenpairs of a stiffness and a mass matrix."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg, sparse
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from skfem_adini.errors import IndefiniteWarning, InputError, NotConverged
from skfem_adini.ground.arguments import dof_numbers, finite_number, integer, real_matrix
from skfem_adini.ground.errors import warn
from skfem_adini.solvers.factorize import Factorization, Solver, factorize, require_definite

Array = NDArray[np.float64]


class _Limits(NamedTuple):  # shifts of the pencil scaled to a unit diagonal of M, and tolerances
    zero: float = 1e-9  # first shift over the largest eigenvalue: below a fine mesh's lowest
    step: float = 100.0  # factor from one trial shift to the next: five pass the largest eigenvalue
    spread: float = 1e3  # ratio of distances from the shift up to which the mesh costs more digits
    rounding: float = 1e-11  # negative eigenvalue of M that rounding may cause in slivers of cells
    residual: float = 1e-6  # of a recomputed pair, relative to lambda M x
    noise: float = 1e4 * np.finfo(float).eps  # residual by rounding, relative to K x


LIMITS = _Limits()


def lowest_eigenpairs(
    K: Any,
    M: Any,
    count: int,
    fixed: ArrayLike | None = None,
    shift: float | None = None,
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
        Dofs of homogeneous essential conditions, taken out of the problem: numbers, a mask, or what
        ``basis.get_dofs`` gives.
    shift
        The number sigma, below all eigenvalues, in their unit; best below them by about their
        spacing. By default it is found from K and M: zero if K is definite, else such a number.
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
        Shapes that do not fit, complex numbers, a count that is too large or no whole number, fixed
        dofs that do not exist, M not definite (by its factors), or K - sigma M not definite.
    NotConverged
        The iteration does not converge, or the residual of a pair, recomputed, is too large.

    Warns
    -----
    IndefiniteWarning
        An eigenvalue is negative beyond rounding, so that K is not semidefinite.

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
    K, M = real_matrix("K", K), real_matrix("M", M)
    n = K.shape[0]
    if K.shape != (n, n) or M.shape != (n, n):
        raise InputError(f"K, M: expected square matrices of one size, got {K.shape}, {M.shape}")
    if not (np.isfinite(K.data).all() and np.isfinite(M.data).all()):
        raise InputError("K, M: the matrices hold NaN or infinity")
    free = np.ones(n, dtype=bool)
    if fixed is not None:
        free[dof_numbers("fixed", fixed, n)] = False
    kept = np.flatnonzero(free)
    count = integer("count", count, 1, kept.size - 1)
    if shift is not None:
        shift = finite_number("shift", shift)
    K, M = K[kept][:, kept], M[kept][:, kept]
    diagonal = M.diagonal()
    if not (diagonal > 0).all():
        raise InputError("M: the matrix is not positive definite")
    lumped = bool((abs(M).sum(axis=1) <= (2 + LIMITS.rounding) * diagonal).all())  # or as for P1
    scale = 1 / np.sqrt(diagonal)
    K, M = _scaled(K, scale), _scaled(M, scale)
    # In units in which the largest eigenvalue is about 1, whatever the unit of length.
    unit = float(abs(K).sum(axis=1).max()) or 1.0
    K = K / unit
    pencil = _Pencil(K, M, solver, lumped)
    if shift is None:
        values, z = _shifted_twice(pencil, count)
    else:
        values, z = pencil.nearest(count, shift / unit)
    _check_pairs(K, M, values, z)
    order = np.argsort(values)
    warn_of_negative(float(values[order[0]]), unit)
    vectors = np.zeros((n, count))
    vectors[kept] = scale[:, None] * z[:, order]
    return unit * values[order], vectors


def warn_of_negative(lowest: float, unit: float) -> None:
    """Warn of an eigenvalue below zero beyond rounding; `unit` is about the largest of all."""
    if lowest < -LIMITS.rounding:
        warn(
            f"K: the eigenvalue {unit * lowest:.6g} is negative, so K is not "
            "semidefinite; raise the penalty of its conditions, or check the signs of the form",
            IndefiniteWarning,
        )


def _scaled(A: Any, scale: Array) -> Any:
    """Return D A D, where D is the diagonal matrix `scale`."""
    data = np.repeat(scale, np.diff(A.indptr)) * A.data * scale[A.indices]
    return sparse.csr_array((data, A.indices, A.indptr), shape=A.shape)


class _Pencil:
    """K and M of unit diagonal, with the factors of K - sigma M for one sigma at a time.

    M is definite, up to rounding: dominated by its diagonal, or else by its factors.
    """

    def __init__(self, K: Any, M: Any, solver: Solver, dominated: bool) -> None:
        self.K, self.M, self._solver = K, M, solver
        self._sigma: float | None = None
        self._factors: Factorization | None = None
        if dominated:
            return
        try:
            self._factor(M + LIMITS.rounding * sparse.eye_array(M.shape[0]))
        except InputError as error:
            raise InputError(
                "M: the matrix is not symmetric and positive definite, though its diagonal is "
                "positive; integrate its form by a rule with enough points and positive weights, "
                "and check the signs of its coefficients"
            ) from error

    def _factor(self, A: Any) -> Factorization:
        self._sigma = None
        self._factors = factorize(A, definite=True, solver=self._solver)
        require_definite(self._factors)
        return self._factors

    def factors(self, sigma: float) -> Factorization:
        """Return the factors of K - sigma M, or raise unless that is definite."""
        if self._factors is not None and sigma == self._sigma:
            return self._factors
        factors = self._factor(self.K - sigma * self.M)
        self._sigma = sigma
        return factors

    def nearest(self, count: int, sigma: float) -> tuple[Array, Array]:
        """Return the pairs next to sigma, by Lanczos' method."""
        K, M = self.K, self.M
        solve = self.factors(sigma).solve
        inverse = LinearOperator(K.shape, matvec=solve, dtype=np.float64)
        start = np.random.default_rng(0).uniform(-1, 1, K.shape[0])
        try:
            values, z = eigsh(K, count, M, sigma=sigma, OPinv=inverse, v0=start)
        except ArpackError as error:
            raise NotConverged(
                f"no convergence of the eigenvalues: {error}; change shift"
            ) from error
        return values, z

    def improved(self, z: Array, sigma: float) -> tuple[Array, Array]:
        """Return the pairs after a step of subspace iteration, which damps distant eigenvectors."""
        z = self.factors(sigma).solve(self.M @ z)
        z = z / np.linalg.norm(z, axis=0)
        values, y = linalg.eigh(z.T @ (self.K @ z), z.T @ (self.M @ z))
        return values, z @ y


def _shifted_twice(pencil: _Pencil, count: int) -> tuple[Array, Array]:
    """Compute with a first shift below all eigenvalues, then if needed with a better one.
    The second lies below the lowest eigenvalue by their mean spacing: if distances from the
    shift differ by many orders of magnitude, the farthest eigenvalue loses as many digits."""
    shift = _first_shift(pencil)
    values, z = pencil.nearest(count, shift)
    low, high = float(values.min()), float(values.max())
    if count == 1 and shift < 0:  # the spacing follows from the next eigenvalues
        high = float(pencil.nearest(min(4, pencil.K.shape[0] - 1), shift)[0].max())
    near = high - shift > LIMITS.spread * (low - shift)
    far = shift < 0 and low - shift > LIMITS.spread * (high - low) > LIMITS.spread * LIMITS.zero
    if not (near or far):
        return pencil.improved(z, shift) if shift < 0 else (values, z)
    better = low - max((high - low) / max(count - 1, 1), LIMITS.zero)
    try:
        again, better_z = pencil.nearest(count, better)
    except InputError:  # the matrix with this shift is not definite, up to rounding
        return pencil.improved(z, shift)
    # Lanczos' method may miss copies of a multiple eigenvalue.
    if again.max() - shift > (1 + 1e-3) * (values.max() - shift) + LIMITS.zero:
        return pencil.improved(z, shift)
    return again, better_z


def _first_shift(pencil: _Pencil) -> float:
    """Return zero if K is definite, else a small negative number."""
    shift = 0.0
    while True:
        try:
            pencil.factors(shift)
            return shift
        except InputError:
            if shift < -1.0:
                raise
        shift = min(-LIMITS.zero, LIMITS.step * shift)


def _check_pairs(K: Any, M: Any, values: Array, z: Array) -> None:
    """Raise unless K z = lambda M z, up to the rounding of K, whose norm is at most one. Residuals
    of the inverse are not used: near a shift their rounding is amplified."""
    Mz = M @ z
    residuals = np.linalg.norm(K @ z - Mz * values, axis=0)
    sizes = np.linalg.norm(Mz, axis=0)
    rounding = LIMITS.noise * (np.linalg.norm(z, axis=0) + np.abs(values) * sizes)
    allowed = LIMITS.residual * np.abs(values) * sizes + rounding
    if not (residuals <= allowed).all():
        worst = int(np.argmax(residuals / allowed))
        raise NotConverged(
            f"eigenpairs: the residual of K x = lambda M x for lambda number {worst} is "
            f"{residuals[worst] / allowed[worst]:.1e} times what is allowed; take a shift below "
            "the eigenvalues by about their spacing"
        )
