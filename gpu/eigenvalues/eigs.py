"""A few eigenvalues of a large general matrix, on the host or on a device."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg, sparse

from gpu.eigenvalues.krylov.arnoldi import Arnoldi
from gpu.eigenvalues.krylov.krylov_schur import LIMITS as KRYLOV
from gpu.eigenvalues.krylov.krylov_schur import (
    Limits,
    Wanted,
    krylov_schur,
    room_for,
)
from gpu.eigenvalues.operator import (
    EigenProblem,
    Matrix,
    as_matrix,
    even_units,
    ordinary,
    shifts,
    told_apart,
)
from gpu.eigenvalues.schur import ORDERS, Rank, best_first, edge_of, rank_of
from gpu.errors import GpuError, InputError, NotConverged
from skfem_adini.ground.arguments import (
    choice,
    flag,
    integer,
    is_finite_number,
    keywords_named,
    shown,
    unmasked,
)
from skfem_adini.ground.arrays import namespace, to_host
from skfem_adini.ground.errors import warn


class _Limits(NamedTuple):  # orders up to which all eigenvalues are computed, and tolerances
    dense: int = 256  # up to this order all eigenvalues are computed: none can be missed
    products: int = 128  # the same for operators: a product for each column of entries
    fallback: int = 4096  # the same if the iteration fails and the entries are stored
    normal: float = 1e-6  # part of a Schur form off its diagonal: below, vectors are orthogonal
    beyond: float = 1e6  # by which an adjoint step may raise the condition of an eigenvalue
    few: int = 10  # adjoint steps: one for each of the eigenvalues of worst condition
    visible: float = 1e-3  # error over the largest |lambda - sigma| that a warning is worth
    pair: float = 1e-11  # |A x - lambda M x| over |A| + |lambda| |M|: 4e4 roundings


LIMITS = _Limits()


logger = logging.getLogger(__name__)


@keywords_named
def eigs(
    A: Any,
    k: int = 6,
    M: Any = None,
    sigma: Any = None,
    which: str = "LM",
    v0: Any = None,
    ncv: int | None = None,
    maxiter: int | None = None,
    tol: float = 0.0,
    return_eigenvectors: bool = True,
    *,
    rng: Any = None,
    restart: str = "krylov-schur",
) -> Any:
    r"""Find k eigenvalues and eigenvectors of ``A x = lambda x`` or ``A x = lambda M x``.

    The signature is that of `scipy.sparse.linalg.eigs`; results are on the side of A. Krylov-Schur
    iteration with thick restarts. Before converged pairs are returned, a search from random vectors
    looks for better ones, so that copies of repeated eigenvalues are found too (see
    `gpu.eigenvalues.krylov.krylov_schur.unbeaten` for the probability of missing one), and the
    residual of every returned pair is recomputed.

    Parameters
    ----------
    A : array, sparse matrix or LinearOperator, shape (n, n), or callable x -> A x
        Of NumPy and SciPy, or of CuPy; real or complex, computed in double precision. A callable
        takes its order from `v0`.
    k : int
        From 1 to n.
    M : array or sparse matrix, shape (n, n), optional
        Must be invertible unless `sigma` is given.
    sigma : number, optional
        Eigenvalues nearest to sigma: the iteration runs with ``(A - sigma M)^-1 M``, whose
        factors are computed once. Needs the entries of A.
    which : {"LM", "SM", "LR", "SR", "LI", "SI"}
        Largest or smallest modulus, real part, imaginary part (for real A its modulus). With
        `sigma` it refers to 1 / (lambda - sigma). "SM" with stored entries means ``sigma=0``.
    v0 : array, shape (n,), optional
        Start vector; by default one drawn from `rng`.
    ncv : int, optional
        Dimension of the Krylov space, at least k + 3; default ``max(2 k + 20, 40)``, and half as
        much again if the first restarts do not suffice. The search for missed eigenvalues needs
        about half as many further vectors, or k.
    maxiter : int, optional
        Most restarts, each of at least two products; by default enough for about 40 n products. If
        it is given, all eigenvalues are computed only where a Krylov space would be as large as A.
    tol : float
        Residual relative to \|lambda\|. The default, 0, means the smallest one that rounding
        allows: 100 machine epsilons times \|A\|, or with `sigma` times the norm of the inverse.
    return_eigenvectors : bool
    rng : Generator or seed, optional
        Of NumPy, for the start vector; by default this is fixed.
    restart : {"krylov-schur", "implicit"}
        "implicit" restarts by explicitly shifted QR steps on the Hessenberg matrix (Sorensen 1992,
        Algorithm 6 of the dissertation): the same spaces in exact arithmetic, kept for comparison.

    Returns
    -------
    w : ndarray, shape (k,)
        Complex, best first; conjugate pairs are adjacent. If only one of a pair is among the k, it
        is the member of positive imaginary part.
    v : ndarray, shape (n, k)
        Columns of unit length; not returned with ``return_eigenvectors=False``.

    Raises
    ------
    InputError
        An argument is malformed; M is singular and no `sigma` given; `sigma` is given and A or M
        has no stored entries, or ``A - sigma M`` is singular for it and all shifts tried beside it.
    NotConverged
        Fewer than k eigenvalues converged, or a pair failed its certificate; its attributes
        ``eigenvalues`` and ``eigenvectors`` hold those that converged.
    MissingDependency
        A is on a device and CuPy cannot be imported.

    Notes
    -----
    Matrices of order up to 256 (operators: 128) are decomposed fully. So are matrices of order up
    to 4096 with stored entries if the iteration does not converge, unless `maxiter` was given; and,
    without an iteration, if the wanted values lie inside the spectrum, where Krylov methods
    converge slowly: "SI", and with `sigma` "SM" and "LI". For operators, "SM" and "SI" may raise
    `NotConverged` for this reason.

    Eigenvalues of a matrix far from normal, such as a convection operator at large cell Peclet
    numbers, are determined only up to the residual times their condition number. The returned
    values are then eigenvalues of a matrix within `tol` of A, and an eigenvalue that is better by
    less than this uncertainty does not count as missed. With `sigma`, stored entries of the host
    whose moduli across the diagonal can be made alike by other units of the unknowns, as for
    convection and diffusion on a line or grid, are solved in such units, where they are nearly
    normal. Where all eigenvalues are computed because an iteration does not converge, a
    `RuntimeWarning` tells where the condition of the wanted ones leaves them few digits. Of values
    that an iteration finds the residuals alone are checked: their conditions would take the left
    eigenvectors, which products with A do not give.

    References
    ----------
    G. W. Stewart, A Krylov-Schur algorithm for large eigenproblems, SIAM J. Matrix Anal. Appl. 23
    (2001). R. B. Lehoucq, D. C. Sorensen and C. Yang, ARPACK Users' Guide, SIAM 1998.

    Examples
    --------
    >>> import numpy as np
    >>> from gpu import eigs
    >>> w, v = eigs(np.diag(np.arange(1.0, 301.0)), k=2)
    >>> w.real.round(10)
    array([300., 299.])
    """
    given = (A, k, M, sigma, v0, ncv, maxiter, tol, rng, restart)
    matrix, mass, k, sigma, effort = prepared(*given)
    choice("which", which, ORDERS)
    return_eigenvectors = flag("return_eigenvectors", return_eigenvectors)
    if sigma is None and which == "SM" and stored(matrix, mass):
        sigma, which = 0.0, "LM"
    units = even_units(matrix) if sigma is not None and mass is None else None
    if units is not None:
        try:
            start = None if effort.start is None else effort.start / units
            found = _in_units(matrix, units, k, sigma, which, effort._replace(start=start))
            return found if return_eigenvectors else found[0]
        except NotConverged as error:
            logger.debug("eigenvalues in the units given, as in even ones %s", error)
    values, vectors = solved(Task(matrix, mass, sigma, which, k), effort)
    return (values, vectors) if return_eigenvectors else values


class Effort(NamedTuple):
    """The checked arguments of `eigs` that tell how to search."""

    start: Any
    ncv: int | None
    maxiter: int | None
    tol: float
    restart: str


def prepared(
    A: Any,
    k: Any,
    M: Any,
    sigma: Any,
    v0: Any,
    ncv: Any,
    maxiter: Any,
    tol: Any,
    rng: Any,
    restart: str = "krylov-schur",
) -> tuple[Matrix, Matrix | None, int, Any, Effort]:
    """A, M, k, sigma and the effort, checked."""
    matrix, mass = as_matrix("A", A, v0), None if M is None else as_matrix("M", M)
    n, xp = matrix.n, matrix.xp
    k = integer("k", k, 1, n)
    if mass is not None:
        _matching(matrix, mass)
        if mass.explicit is not None:
            _ = mass.magnitude  # raises InputError if entries are not finite
    choice("restart", restart, ("krylov-schur", "implicit"))
    if not isinstance(tol, int | float | np.floating) or not 0 <= tol < 1:
        raise InputError(f"tol={tol!r}: expected a number from 0, below 1")
    if maxiter is not None:
        maxiter = integer("maxiter", maxiter, 1, np.inf)
    if ncv is not None:
        ncv = integer("ncv", ncv, k + 2, np.inf)
    if sigma is not None and not is_finite_number(sigma):
        raise InputError(f"sigma={shown(sigma)}: expected a finite number")
    sigma = float(np.real(sigma)) if sigma is not None and np.imag(sigma) == 0 else sigma
    real = matrix.real and (mass is None or mass.real) and np.isrealobj(sigma)
    start = drawn(rng, n, real, xp) if v0 is None else start_vector(v0, n, xp)
    if start is not None and start.dtype.kind == "c" and real:
        raise InputError("v0 is complex, but A, M and sigma are real: pass its real part")
    return matrix, mass, k, sigma, Effort(start, ncv, maxiter, float(tol), restart)


def solved(task: Task, effort: Effort) -> tuple[Any, Any]:
    """The certified values and vectors."""
    n, k, tol, maxiter = task.matrix.n, task.k, effort.tol, effort.maxiter
    size = max(2 * k + 20, 40) if effort.ncv is None else max(effort.ncv, k + 3)
    # Whether all eigenvalues may be computed if the iteration does not find the wanted ones.
    spare = maxiter is None and task.decomposable
    small = LIMITS.dense if stored(task.matrix, task.mass) else LIMITS.products
    scale = 0.0
    if maxiter is not None:
        small = 0
    if n <= max(small, room_for(k, size)) or (task.inner and task.decomposable):
        pairs = _decomposed(task)
    else:
        grown = size + size // 2
        limits = Limits(
            size,
            grown if effort.ncv is None and room_for(k, grown) < n else size,
            maxiter or max(20, n // 6 if spare else 40 * n // max(3, (size - k) // 3)),
            effort.restart,
        )
        task, pairs, scale = _by_iteration(task, limits, tol, effort.start, spare)
    try:
        return _certified(task, pairs, tol, scale)
    except NotConverged:
        # Shift-and-invert loses digits if sigma is much closer to one eigenvalue than to others.
        if not spare:
            raise
        return _certified(task, _decomposed(task), tol, scale)


def _in_units(
    matrix: Matrix, units: Any, k: int, sigma: Any, which: str, effort: Effort
) -> tuple[Any, Any]:
    """The certified result for A, from the similar matrix D^-1 A D, D the units of the unknowns."""
    D = sparse.diags_array(units)
    similar = sparse.csr_array(sparse.diags_array(1.0 / units) @ matrix.explicit @ D)
    values, vectors = solved(Task(as_matrix("A", similar), None, sigma, which, k), effort)
    vectors = units[:, None] * vectors
    vectors /= np.abs(vectors).max(axis=0)
    vectors /= np.linalg.norm(vectors, axis=0)
    certify(matrix, None, values, vectors, effort.tol, 0.0)
    return values, vectors


@dataclass(frozen=True)
class Task:
    """The checked arguments of `eigs` and `eigsh` that define the problem and the wanted values."""

    matrix: Matrix
    mass: Matrix | None
    sigma: Any
    which: str
    k: int
    hermitian: bool = False  # then vectors are M-orthonormal

    @property
    def real(self) -> bool:
        """Whether eigenvalues come as conjugate pairs."""
        real = self.matrix.real and (self.mass is None or self.mass.real)
        return bool(real and np.isrealobj(self.sigma))

    @property
    def rank(self) -> Rank:
        """Rank function of eigenvalues, or with sigma of those of the inverse."""
        return rank_of(self.which, self.real)

    @property
    def plain(self) -> bool:
        """Whether the iteration runs with A itself."""
        return self.mass is None and self.sigma is None

    @property
    def inner(self) -> bool:
        """Whether wanted values may lie inside the spectrum, where Krylov methods are slow."""
        transformed = self.which == "LI" and self.real and self.sigma is not None
        return self.which in ("SM", "SI") or transformed

    @property
    def decomposable(self) -> bool:
        """Whether computing all eigenvalues from stored entries takes reasonable time."""
        return self.matrix.n <= LIMITS.fallback and stored(self.matrix, self.mass)


def _by_iteration(
    task: Task, limits: Limits, tol: float, start: Any, spare: bool
) -> tuple[Task, Pairs, float]:
    """The task as it was solved, its eigenpairs, and a lower bound of |A| (zero if none is known).
    With `spare`, all eigenvalues may be computed if the iteration fails.
    """
    # Checking the entries takes as long as a product. First try without: if some are not finite or
    # badly scaled, the coefficients of the iteration show it.
    unseen = task.plain and task.matrix.explicit is not None
    trial = replace(task, matrix=replace(task.matrix, assumed=1.0)) if unseen else task
    found, pairs, reason = _iterated(trial, limits, tol, start)
    if unseen and reason is None and found.scale and ordinary(found.scale):
        task = trial
    elif unseen and task.matrix.unit != 1.0:
        found, pairs, reason = _iterated(task, limits, tol, start)
    if spare and (reason or not found.complete):
        return task, _decomposed(task, judged=True), 0.0
    if reason:
        raise reason
    scale = found.scale / task.matrix.unit if task.plain else 0.0
    made: Pairs = pairs.of(found.T, found.basis)
    if not found.complete:
        raise NotConverged(
            f"{len(made.values)} of {task.k} eigenvalues converged in {found.restarts} restarts "
            f"({found.matvecs} products) with ncv={limits.ncv}; raise maxiter or ncv, loosen "
            "tol, or use sigma",
            eigenvalues=made.there,
            eigenvectors=made.vectors,
        )
    if task.mass is None:
        _judge(task, made.values, pairs, found, scale or task.matrix.norm)
    return task, made, scale


def _judge(task: Task, values: np.ndarray, pairs: Eigenpairs, found: Any, size: float) -> None:
    """Warn as `_warn_of` does where the condition of eigenvalues found by iteration, estimated from
    below, leaves them few digits; `size` is a lower bound of the norm of A."""
    whole, diagonal = float(np.linalg.norm(found.T)), float(np.linalg.norm(found.values))
    if whole**2 - diagonal**2 <= (LIMITS.normal * whole) ** 2:
        return
    sigma = 0.0 if task.sigma is None else task.sigma
    reach = float(np.abs(values - sigma).max())
    enough = LIMITS.visible * reach / (np.finfo(float).eps * size) if size else np.inf
    condition = pairs.conditions(found.T, found.basis, enough)
    _warn_of(condition, reach, size)


def _certified(task: Task, pairs: Pairs, tol: float, scale: float) -> tuple[Any, Any]:
    """Values and unit vectors in the array module of A, certified by recomputed residuals."""
    xp, vectors = task.matrix.xp, pairs.vectors
    made = vectors = xp.asarray(vectors)
    if pairs.squares is None:
        vectors = vectors / xp.linalg.norm(vectors, axis=0)
    certify(task.matrix, task.mass, pairs.values, vectors, tol, scale, pairs.squares)
    values = xp.asarray(pairs.values) if pairs.there is None else pairs.there
    return values, made if task.hermitian else vectors


def _iterated(
    task: Task, limits: Limits, tol: float, start: Any
) -> tuple[Any, Any, GpuError | None]:
    """Outcome of the iteration, its eigenpairs, and an error if they cannot be used. If sigma is an
    eigenvalue, the rounding error of its huge image under the inverse exceeds the images of the
    others: then the iteration is repeated with a shift next to sigma."""
    matrix, mass, sigma, k, rank = task.matrix, task.mass, task.sigma, task.k, task.rank
    wanted = Wanted(k, rank, tol, edge_of(task.which, task.real), task.inner)
    found = pairs = None
    reason: GpuError = InputError(
        f"A - sigma M cannot be factored for sigma={sigma} and values beside it: take another sigma"
    )
    for shift in shifts(matrix, mass, sigma):
        problem = EigenProblem.of(matrix, mass, shift)
        if problem is None:
            continue
        pairs = Eigenpairs(matrix, mass, problem, rank, k, task.hermitian)
        try:
            with np.errstate(all="ignore"):  # overflow shows in the coefficients
                found = krylov_schur(
                    problem.apply,
                    matrix.n,
                    wanted,
                    limits,
                    dtype=problem.dtype,
                    xp=matrix.xp,
                    start=start,
                    matrix=problem.matrix,
                    meanwhile=pairs.of,
                )
                if sigma is None or not found.complete:
                    return found, pairs, None
                theta = found.values[:k]
                away = np.abs(problem.values(theta) - sigma)
            if told_apart(theta, KRYLOV.residual * found.scale, away, abs(shift - sigma)):
                return found, pairs, None
            reason = NotConverged(
                f"sigma={sigma} lies too close to an eigenvalue to tell the next {k} apart, or "
                "fewer are finite: move it by a small part of their distance, or ask for fewer"
            )
        except FloatingPointError as error:
            reason = InputError(f"A: {error}")  # it may also be an overflow of an inverse
    return found, pairs, reason


def _decomposed(task: Task, judged: bool = False) -> Pairs:
    """The k best of all eigenvalues, computed by LAPACK on the host. If `judged`, warn where the
    condition of the eigenvalues of A leaves them few correct digits.
    """
    matrix, mass, sigma, k = task.matrix, task.mass, task.sigma, task.k
    unit = matrix.unit
    full = matrix.dense() * unit  # LAPACK scales too, but does not scale all eigenvalues back
    if not np.all(np.isfinite(full)):
        raise InputError("A: A v is not finite")
    if sigma is not None:
        sigma = sigma * unit
    condition = None
    if task.hermitian:
        values, vectors = hermitian_pencil(full, None if mass is None else mass.dense())
        if len(values) < k:
            raise InputError(f"M is singular: {len(values)} eigenvalues are finite, and k is {k}")
    elif mass is None:
        if judged:
            decompose: Any = linalg.eig
            values, left, vectors = decompose(full, left=True)
            cosines = np.abs(np.vecdot(left.T, vectors.T))
            condition = 1.0 / np.maximum(cosines, np.finfo(float).eps ** 2)
        else:
            values, vectors = linalg.eig(full)
        finite = np.ones(values.size, dtype=bool)
    else:
        (alpha, beta), vectors = linalg.eig(full, mass.dense(), homogeneous_eigvals=True)
        finite = np.abs(beta) > 1e-14 * np.abs(beta).max()  # a smaller beta is zero by rounding
        if matrix.real and mass.real:  # keep conjugate pairs whole
            first = (alpha.imag > 0).nonzero()[0]
            finite[first] = finite[first + 1] = finite[first] & finite[first + 1]
        if finite.sum() < k or (sigma is None and not finite.all()):
            raise InputError(
                f"M is singular: {int(finite.sum())} eigenvalues are finite; give sigma and k <= "
                f"{int(finite.sum())}"
            )
        values = alpha[finite] / beta[finite]
        vectors = vectors[:, finite]
    key = values
    if sigma is not None:
        distance = values - sigma
        # A distance below rounding counts as this, so that its inverse stays finite.
        tiny = 1e-300 + 1e-15 * np.abs(values).max(initial=0.0)
        key = 1.0 / np.where(np.abs(distance) < tiny, tiny, distance)
    order = best_first(key, task.rank, k, task.real and not task.hermitian, values)
    if condition is not None:
        reach = float(np.abs(values[order] - (0.0 if sigma is None else sigma)).max())
        _warn_of(condition[order], reach, float(np.linalg.norm(full)))
    return Pairs(values[order] / unit, None, vectors[:, order], None)


def _warn_of(condition: np.ndarray, reach: float, size: float) -> None:
    """Warn if rounding of A, of norm `size`, may move the wanted eigenvalues visibly beside their
    largest distance `reach` from sigma."""
    moved = min(float(condition.max()) * np.finfo(float).eps, 1.0) * size
    # Values that are sigma itself have no other digits.
    if moved > LIMITS.visible * reach > LIMITS.visible * 1e-10 * size:
        warn(
            f"A is far from normal: its eigenvalues have condition numbers up to "
            f"{condition.max():.0e}, and its rounding alone moves them by up to {moved:.0e}; trust "
            "no digits below that, and measure unknowns in units that make A more nearly normal",
            RuntimeWarning,
        )


def hermitian_pencil(A: np.ndarray, M: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """All finite eigenvalues of ``A x = lambda M x``, ascending, and M-orthonormal vectors, M
    positive definite or semidefinite; `InputError` if it is neither."""
    try:
        return linalg.eigh(A, M)
    except np.linalg.LinAlgError:
        assert M is not None
    weights, U = linalg.eigh(M)
    some = np.abs(weights) > len(M) * np.finfo(float).eps * np.abs(weights).max()
    if not some.any() or weights[some].min() < 0.0:
        raise InputError("M is not positive semidefinite: a vector has a negative norm")
    # What M does not see is eliminated, x = X y + Z z with Z^* A (X y + Z z) = 0.
    X, Z = U[:, some] / np.sqrt(weights[some]), U[:, ~some]
    try:
        X = X - Z @ np.linalg.solve(Z.conj().T @ A @ Z, Z.conj().T @ A @ X)
    except np.linalg.LinAlgError:
        raise InputError("A and M are singular for the same vector") from None
    reduced = X.conj().T @ A @ X
    values, Y = linalg.eigh((reduced + reduced.conj().T) / 2)
    return values, X @ Y


def stored(matrix: Matrix, mass: Matrix | None) -> bool:
    """Whether all entries are."""
    return matrix.explicit is not None and (mass is None or mass.explicit is not None)


def _matching(matrix: Matrix, mass: Matrix) -> None:
    if mass.n != matrix.n:
        raise InputError(f"M has order {mass.n}, A has {matrix.n}")
    if mass.xp is not matrix.xp:
        raise InputError("M and A live on different sides: move one of them")


def start_vector(v0: Any, n: int, xp: Any) -> Any:
    """The checked start vector in the array module of A."""
    if namespace(v0) is not xp:
        raise InputError("v0 and A live on different sides: move one of them")
    unmasked("v0", v0)
    vector = xp.asarray(v0)
    if vector.shape != (n,) or vector.dtype.kind not in "buifc":
        raise InputError(f"v0 has shape {vector.shape}: expected ({n},)")
    if not bool(xp.all(xp.isfinite(vector))) or not bool(xp.any(vector != 0)):
        raise InputError("v0: expected finite numbers, not all zero")
    return vector


def drawn(rng: Any, n: int, real: bool, xp: Any) -> Any:
    """A random start vector; None, for the fixed one, without `rng`."""
    if rng is None:
        return None
    try:
        generator = np.random.default_rng(rng)
    except (TypeError, ValueError) as error:
        raise InputError(f"rng: {error}") from None
    parts = generator.standard_normal((1 if real else 2, n))
    return xp.asarray(parts[0] if real else parts[0] + 1j * parts[1])


class Pairs(NamedTuple):
    """Eigenvalues, best first, with their vectors."""

    values: np.ndarray  # shape (k,), on the host
    there: Any  # the same in the array module of the matrix, or None
    vectors: Any  # shape (n, k)
    squares: Any  # (2, k) or None: |A x - lambda M x|^2 and |A x|^2


@dataclass
class Eigenpairs:
    """Eigenpairs from a partial Schur form and its basis; the last result is cached."""

    matrix: Matrix
    mass: Matrix | None  # M, None for the identity
    problem: EigenProblem  # T has the eigenvalues of its operator
    rank: Rank  # the larger, the more wanted
    k: int  # number of pairs
    hermitian: bool = False
    _T: Any = None
    _made: Pairs | None = None

    def of(self, T: np.ndarray, basis: Arnoldi) -> Pairs:
        """The pairs of T, the k best first; for the same T again, the cached ones."""
        if T is self._T and self._made is not None:
            return self._made
        if self.hermitian:
            self._T, self._made = T, self._orthonormal(T, basis)
            return self._made
        theta, Y = np.linalg.eig(T)
        theta = theta.astype(complex)
        values = self.problem.values(theta)
        order = best_first(theta, self.rank, self.k, self.problem.dtype.kind == "f", values)
        values, Y = values[order], Y[:, order]
        if len(order) == self.k and self._fused():
            from gpu.eigenvalues.krylov.ritz_pairs import pairs_with_residuals

            mass = self.mass and self.mass.explicit
            V = basis.V[: len(Y)]
            made = Pairs(values, *pairs_with_residuals(V, Y, values, self.matrix.explicit, mass))
        else:
            made = Pairs(values, self.matrix.xp.asarray(values), basis.combine(Y), None)
        self._T, self._made = T, made
        return made

    def _orthonormal(self, T: np.ndarray, basis: Arnoldi) -> Pairs:
        """The M-orthonormal pairs of an operator that is self-adjoint in the inner product of M,
        from the Schur vectors V: of the pencil ``V^* M V T``, ``V^* M V``."""
        V = basis.combine(np.eye(len(T), dtype=T.dtype))
        G = np.eye(len(T)) if self.mass is None else to_host(V.conj().T @ product(self.mass, V))
        H = G @ T
        theta, Y = hermitian_pencil((H + H.conj().T) / 2, (G + G.conj().T) / 2)
        order = np.argsort(-self.rank(theta), kind="stable")[: self.k]
        values = self.problem.values(theta[order])
        return Pairs(values, self.matrix.xp.asarray(values), basis.combine(Y[:, order]), None)

    def conditions(self, T: np.ndarray, basis: Arnoldi, enough: float) -> np.ndarray:
        r"""Lower estimates of the condition :math:`|x| |y| / |y^*x|` of the k best eigenvalues.

        The left vectors of T are those of the operator in the space that was found. Where a step
        :math:`y \leftarrow B^*y / \bar\theta` with its adjoint may raise them to `enough`, it adds
        what y has outside of it (an adjoint inverse iteration if B is an inverse).
        """
        theta, left, right = linalg.eig(T, left=True)
        theta = theta.astype(complex)
        real = self.problem.dtype.kind == "f"
        order = best_first(theta, self.rank, self.k, real, self.problem.values(theta))
        overlap = np.maximum(np.abs(np.vecdot(left.T, right.T))[order], np.finfo(float).eps ** 2)
        condition: np.ndarray = 1.0 / overlap
        adjoint, xp = self.problem.adjoint, self.matrix.xp
        if adjoint is None or not LIMITS.beyond * condition.max() > enough:
            return condition
        for place in np.argsort(-condition)[: LIMITS.few]:
            y = basis.combine(left[:, order[place], None])[:, 0]
            try:
                parts = [adjoint(part) for part in ((y.real, y.imag) if real else (y,))]
                length = float(xp.linalg.norm(xp.stack(parts))) / abs(theta[order[place]])
            except Exception:  # without a usable `rmatvec` the lower estimate has to do
                break
            if np.isfinite(length):
                condition[place] = max(condition[place], length / overlap[place])
        return condition

    def _fused(self) -> bool:
        """Whether vectors and residuals can be computed together, by real products on a device."""
        matrix, mass = self.matrix, self.mass
        return (
            matrix.xp is not np
            and matrix.explicit is not None
            and (mass is None or mass.explicit is not None)
            and self.problem.dtype.kind == "f"
            and matrix.unit == 1.0
        )


def certify(
    matrix: Matrix,
    mass: Matrix | None,
    values: Any,
    vectors: Any,
    tol: float,
    scale: float,
    squares: Any = None,
) -> None:
    """Raise `NotConverged`, with the pairs that pass, unless every pair satisfies its equation.
    `scale` is a lower bound of |A| (zero if unknown); `squares`, shape (2, k), holds |A x - lambda
    M x|^2 and |A x|^2 if they are known already."""
    unit = matrix.unit
    scale = (scale or matrix.norm) * unit
    # All numbers are copied to the host at once, as each copy waits for the device.
    if squares is None:
        xp = matrix.xp
        left = product(matrix, vectors * unit)
        right = vectors if mass is None else product(mass, vectors)
        error = xp.linalg.norm(left - right * (xp.asarray(values) * unit), axis=0)
        error, size = to_host(xp.stack([error, xp.linalg.norm(left, axis=0)]))
    else:
        error, size = np.sqrt(to_host(squares))
    modulus = np.abs(values) * unit
    allowed = (
        LIMITS.pair
        * (max(float(size.max()), scale) + modulus * (1.0 if mass is None else mass.norm))
        + 10 * tol * modulus
    )
    good = np.isfinite(allowed) & (error <= allowed)
    if not good.all():
        with np.errstate(invalid="ignore"):  # some may be NaN
            worst = LIMITS.pair * float((error[~good] / allowed[~good]).max())
        kept = np.flatnonzero(good)
        raise NotConverged(
            f"{int((~good).sum())} of {len(values)} pairs fail their certificate: |A x - lambda x| "
            f"reaches {worst:.1e} |A|",
            eigenvalues=matrix.xp.asarray(values)[kept],
            eigenvectors=vectors[:, kept],
        )


def product(matrix: Matrix, X: Any) -> Any:
    """``A X``; a real A is multiplied by the real and the nonzero imaginary parts of X instead."""
    xp = matrix.xp
    if not matrix.real or X.dtype.kind != "c":
        return _multiplied(matrix, X)
    imaginary = to_host(xp.any(X.imag != 0, axis=0))
    parts = _multiplied(matrix, xp.concatenate((X.real, X.imag[:, imaginary]), axis=1))
    product = parts[:, : X.shape[1]].astype(complex)
    product[:, imaginary] += 1j * parts[:, X.shape[1] :]
    return product


def _multiplied(matrix: Matrix, X: Any) -> Any:
    if matrix.explicit is not None:
        return matrix.explicit @ X
    product = matrix.xp.empty_like(X, dtype=matrix.dtype)
    for j, x in enumerate(X.T):  # of copies: an operator may return its argument or reuse an array
        product[:, j] = matrix.apply(x.copy())
    return product
