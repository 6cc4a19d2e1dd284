"""A few eigenvalues of a large symmetric or hermitian matrix, on the host or on a device."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gpu.eigenvalues.eigs import Effort, Task, drawn, prepared, product, solved, stored
from gpu.eigenvalues.operator import Matrix
from gpu.errors import InputError, NotConverged
from skfem_adini.ground.arguments import choice, flag, keywords_named


class _Limits(NamedTuple):  # tolerances of what is symmetric and orthonormal
    asymmetry: float = 1e-12  # |A - A^*| over the largest entry: rounding of an assembly
    probe: float = 1e-10  # |x^* A y - conj(y^* A x)| over |x| |A y| + |y| |A x|, of an operator
    orthonormal: float = 1e-8  # |V^* M V - I| that vectors may show


LIMITS = _Limits()

# The order of `eigs` that each of SciPy's names means for real eigenvalues.
ORDERS = {"LM": "LM", "SM": "SM", "LA": "LR", "SA": "SR"}


@keywords_named
def eigsh(
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
) -> Any:
    r"""Find k eigenvalues and eigenvectors of ``A x = lambda x`` or ``A x = lambda M x``.

    A and M are symmetric or hermitian. The signature is that of `scipy.sparse.linalg.eigsh`, the
    iteration, with its search for missed copies of repeated eigenvalues, that of `eigs`. Its
    operator is self-adjoint in the inner product of M: Rayleigh-Ritz values on the Schur vectors
    are real, and the vectors M-orthonormal, also those of a repeated eigenvalue.

    Parameters
    ----------
    A : array, sparse matrix or LinearOperator, shape (n, n), or callable x -> A x
        Real symmetric or complex hermitian; see `eigs`. Stored entries are checked, an operator is
        tried on two random vectors.
    k : int
        From 1 to n.
    M : array or sparse matrix, shape (n, n), optional
        Symmetric or hermitian, positive definite; with `sigma` positive semidefinite.
    sigma : float, optional
        Eigenvalues nearest to sigma, by factors of ``A - sigma M``.
    which : {"LM", "SM", "LA", "SA", "BE"}
        Largest or smallest modulus, largest or smallest value, or half from either end (of an odd k
        one more from the upper). With `sigma` it refers to 1 / (lambda - sigma). "SM" with stored
        entries means ``sigma=0``.
    v0 : array, shape (n,), optional
        Start vector; by default one drawn from `rng`.
    ncv, maxiter, tol
        See `eigs`.
    return_eigenvectors : bool
    rng : Generator or seed, optional
        Of NumPy, for the start vector; by default this is fixed.

    Returns
    -------
    w : ndarray of float, shape (k,)
        Ascending.
    v : ndarray, shape (n, k)
        ``v^* M v = I``; not returned with ``return_eigenvectors=False``.

    Raises
    ------
    InputError
        An argument is malformed, A or M is not symmetric, or M not positive (semi)definite as far
        as its diagonal and the vectors that were found show it; see also `eigs`.
    NotConverged
        Fewer than k eigenvalues converged, or a pair failed its certificate; its attributes
        ``eigenvalues`` and ``eigenvectors`` hold those that converged.
    MissingDependency
        A is on a device and CuPy cannot be imported.

    Notes
    -----
    See `eigs` for the orders up to which all eigenvalues are computed.

    References
    ----------
    G. W. Stewart, A Krylov-Schur algorithm for large eigenproblems, SIAM J. Matrix Anal. Appl. 23
    (2001), 601-614.

    Examples
    --------
    The lowest frequencies of a string, whose squares are nearly (j pi)^2:

    >>> import numpy as np
    >>> from scipy import sparse
    >>> from gpu import eigsh
    >>> n = 500
    >>> A = sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n)) * (n + 1) ** 2
    >>> w, v = eigsh(A, k=2, sigma=0)
    >>> np.sqrt(w).round(3)
    array([3.142, 6.283])
    """
    matrix, mass, k, sigma, effort = prepared(A, k, M, sigma, v0, ncv, maxiter, tol, rng)
    choice("which", which, (*ORDERS, "BE"))
    return_eigenvectors = flag("return_eigenvectors", return_eigenvectors)
    if not np.isrealobj(sigma) and sigma is not None:
        raise InputError(f"sigma={sigma}: eigenvalues of a symmetric matrix are real")
    _check_symmetric(matrix)
    if mass is not None:
        _check_symmetric(mass)
        shifted = sigma is not None or (which == "SM" and stored(matrix, mass))
        _check_positive(mass, shifted)
    if which == "BE":
        halves = [("LA", k - k // 2), ("SA", k // 2)][: min(k, 2)]
        ends = [_found(matrix, mass, sigma, *half, effort) for half in halves]
        values, vectors = (matrix.xp.concatenate(M, axis=-1) for M in zip(*ends, strict=True))
    else:
        values, vectors = _found(matrix, mass, sigma, which, k, effort)
    order = matrix.xp.argsort(values)
    values, vectors = values[order], vectors[:, order]
    _check_orthonormal(matrix, mass, values, vectors)
    return (values, vectors) if return_eigenvectors else values


def _found(
    matrix: Matrix, mass: Matrix | None, sigma: Any, which: str, k: int, effort: Effort
) -> tuple[Any, Any]:
    if sigma is None and which == "SM" and stored(matrix, mass):
        sigma, which = 0.0, "LM"
    return solved(Task(matrix, mass, sigma, ORDERS[which], k, hermitian=True), effort)


def _check_symmetric(matrix: Matrix) -> None:
    """Raise `InputError` unless a matrix equals its adjoint up to rounding."""
    A, xp, name = matrix.explicit, matrix.xp, matrix.name
    if A is not None:
        _ = matrix.magnitude  # raises InputError if entries are not finite
        apart = A - A.conj().T
        entries, size = ((M.data if hasattr(M, "tocsr") else M) for M in (apart, A))
        wrong = float(abs(entries).max()) if entries.size else 0.0
        if not wrong <= LIMITS.asymmetry * (float(abs(size).max()) if size.size else 0.0):
            raise InputError(
                f"{name} is not symmetric, |{name} - {name}'| reaches {wrong:.1e}: pass ({name} + "
                f"{name}.T) / 2 if that is what is meant, or use gpu.eigs"
            )
        return
    norm = xp.linalg.norm
    x, y = (drawn(seed, matrix.n, matrix.real, xp) for seed in (7, 8))
    Ax, Ay = (xp.array(matrix.apply(v.copy())) for v in (x, y))
    apart = abs(complex(x.conj() @ Ay) - complex(y.conj() @ Ax).conjugate())
    size = float(norm(x) * norm(Ay) + norm(y) * norm(Ax))
    if apart > LIMITS.probe * size:
        raise InputError(f"{name} is not symmetric on two random vectors: use gpu.eigs")


def _check_positive(mass: Matrix, semidefinite: bool) -> None:
    if mass.explicit is None:
        return
    diagonal = mass.explicit.diagonal().real
    if not bool((diagonal >= 0.0 if semidefinite else diagonal > 0.0).all()):
        raise InputError("M is not positive definite: an entry of its diagonal is not positive")


def _check_orthonormal(matrix: Matrix, mass: Matrix | None, values: Any, vectors: Any) -> None:
    xp = matrix.xp
    weighed = vectors if mass is None else product(mass, vectors)
    wrong = float(abs(vectors.conj().T @ weighed - xp.eye(len(values))).max())
    if not wrong <= LIMITS.orthonormal:
        message = f"the vectors are orthonormal to {wrong:.1e} only"
        raise NotConverged(message, eigenvalues=values, eigenvectors=vectors)
