"""A few singular values of a large matrix, on the host or on a device."""

from __future__ import annotations

from typing import Any

import numpy as np

from gpu.eigenvalues.eigs import LIMITS, drawn, eigs, start_vector
from gpu.eigenvalues.krylov.krylov_schur import room_for
from gpu.eigenvalues.operator import as_matrix
from gpu.errors import InputError, NotConverged
from skfem_adini.ground.arguments import choice, flag, integer
from skfem_adini.ground.arrays import to_host


def svds(
    A: Any,
    k: int = 6,
    ncv: int | None = None,
    tol: float = 0.0,
    which: str = "LM",
    v0: Any = None,
    maxiter: int | None = None,
    return_singular_vectors: bool | str = True,
    solver: str = "arpack",
    rng: Any = None,
) -> Any:
    r"""Find k singular triplets, ``A v = s u`` and ``A^* u = s v``.

    `eigs` finds the wanted eigenvectors of the smaller of :math:`A^* A` and :math:`A A^*`; the
    singular values are those of A on the space that they span, not square roots of eigenvalues,
    which would lose half of the digits. Both residuals of every returned triplet are recomputed.

    Parameters
    ----------
    A : array or sparse matrix, shape (m, n), or LinearOperator with matvec and rmatvec
        Of NumPy and SciPy, or of CuPy; real or complex, computed in double precision.
    k : int
        From 1 to min(m, n).
    ncv, maxiter
        See `eigs`.
    tol : float
        Relative residual of the eigenpairs of the square, see `eigs`; 0 means the smallest that
        rounding allows.
    which : {"LM", "SM"}
        Largest or smallest.
    v0 : array, shape (min(m, n),), optional
        Start vector; by default one drawn from `rng`.
    return_singular_vectors : bool or {"u", "vh"}
        "u" or "vh": None stands for the other ones.
    solver : {"arpack", "lobpcg", "propack"}
        SciPy's names; here all mean the same iteration.
    rng : Generator or seed, optional
        Of NumPy, for the start vector; by default this is fixed.

    Returns
    -------
    u : ndarray, shape (m, k)
    s : ndarray, shape (k,)
        In ascending order, as SciPy returns them.
    vh : ndarray, shape (k, n)
        Without singular vectors `s` alone is returned.

    Raises
    ------
    InputError
        An argument is malformed, or an operator has no ``rmatvec``.
    NotConverged
        Fewer than k triplets converged, or one failed its certificate.
    MissingDependency
        A is on a device and CuPy cannot be imported.

    Notes
    -----
    Singular values below 1e-7 of the largest cannot be found from the square, whose eigenvalues are
    then rounding. If these are wanted, stored matrices with min(m, n) up to 4096 are decomposed
    fully; operators and larger matrices raise `NotConverged`. Matrices with min(m, n) up to 256
    (operators: 128) are always decomposed.

    References
    ----------
    G. W. Stewart, A Krylov-Schur algorithm for large eigenproblems, SIAM J. Matrix Anal. Appl. 23
    (2001), 601-614.

    Examples
    --------
    >>> import numpy as np
    >>> from gpu import svds
    >>> svds(np.diag(np.arange(1.0, 301.0)), k=2, return_singular_vectors=False).round(10)
    array([299., 300.])
    """
    factors = _Factors(A)
    small = min(factors.shape)
    integer("k", k, 1, small)
    choice("which", which, ("LM", "SM"))
    for name, value in (("ncv", ncv), ("maxiter", maxiter)):
        if value is not None:
            integer(name, value, 1)
    choice("solver", solver, ("arpack", "lobpcg", "propack"))
    if isinstance(return_singular_vectors, str):
        choice("return_singular_vectors", return_singular_vectors, ("u", "vh"))
    else:
        return_singular_vectors = flag("return_singular_vectors", return_singular_vectors)
    if not isinstance(tol, int | float | np.floating) or not 0 <= tol < 1:
        raise InputError(f"tol={tol!r}: expected a number from 0, below 1")
    xp, real = factors.xp, factors.dtype.kind == "f"
    v0 = drawn(rng, small, real, xp) if v0 is None else start_vector(v0, small, xp)
    explicit = factors.explicit is not None
    most = LIMITS.dense if explicit else LIMITS.products
    if explicit and which == "SM":
        most = LIMITS.fallback
    elif maxiter is not None:  # then only where a Krylov space would be as large as A
        most = room_for(k, max(2 * k + 20, 40) if ncv is None else max(ncv, k + 3))
    if small <= most:
        triplets = _decomposed(factors, k, which)
        _certify(factors, *triplets)
    else:
        try:
            triplets = _iterated(factors, k, ncv, tol, which, v0, maxiter)
            _certify(factors, *triplets)
        except NotConverged:
            if not explicit or small > LIMITS.fallback or maxiter is not None:
                raise
            triplets = _decomposed(factors, k, which)
            _certify(factors, *triplets)
    u, s, vh = triplets
    s = s / factors.unit
    if not return_singular_vectors:
        return s
    left, right = return_singular_vectors != "vh", return_singular_vectors != "u"
    return u if left else None, s, vh if right else None


class _Factors:
    """Products with A and A^*, times a power of two if the entries are huge or tiny."""

    def __init__(self, A: Any) -> None:
        self.matrix = matrix = as_matrix("A", A, square=False)
        self.shape, self.dtype, self.xp = matrix.shape, matrix.dtype, matrix.xp
        self.explicit, self.unit = matrix.explicit, 1.0
        self._left: Any = matrix.apply
        self._right: Any = matrix.adjoint
        if self.explicit is None:
            try:
                A.rmatvec(self.xp.zeros(self.shape[0], dtype=self.dtype))
            except (AttributeError, NotImplementedError):
                raise InputError("A has no rmatvec: pass one, of its adjoint") from None
            return
        self.unit = matrix.unit
        if self.unit != 1.0:
            self.explicit = self.explicit * self.unit
        A = self.explicit
        adjoint = A.T if matrix.real else A.conj().T
        if hasattr(adjoint, "tocsr"):
            adjoint = adjoint.tocsr()
        self._left, self._right = A.__matmul__, adjoint.__matmul__

    def times(self, X: Any, adjoint: bool = False) -> Any:
        """``A X`` or ``A^* X`` for a vector or a matrix of columns."""
        multiply = self._right if adjoint else self._left
        if X.ndim == 1 or self.explicit is not None:
            return multiply(X)
        return self.xp.stack([multiply(x.copy()) for x in X.T], axis=1)


def _iterated(
    factors: _Factors, k: int, ncv: Any, tol: float, which: str, v0: Any, maxiter: Any
) -> tuple[Any, Any, Any]:
    """Triplets by `eigs` for the smaller of A^* A and A A^*, then the SVD of A on their space."""
    xp, (m, n) = factors.xp, factors.shape
    wide = m < n
    if v0 is None:
        v0 = xp.asarray(np.random.default_rng(0).standard_normal(min(m, n)), dtype=factors.dtype)
    elif factors.dtype.kind == "c":
        v0 = xp.asarray(v0, dtype=factors.dtype)

    def square(x: Any) -> Any:
        return factors.times(factors.times(x, wide), not wide)

    _, vectors = eigs(square, k, v0=v0, which=which, ncv=ncv, maxiter=maxiter, tol=tol)
    if factors.dtype.kind == "f":
        # Real vectors span the same space: take the real part of each vector after multiplication
        # by the phase that makes this part largest.
        turn = xp.exp(-1j * xp.angle(xp.sum(vectors * vectors, axis=0)) / 2)
        vectors = (vectors * turn).real
    basis, _ = xp.linalg.qr(vectors)
    u, s, vh = xp.linalg.svd(factors.times(basis, wide), full_matrices=False)
    u, s, v = u[:, ::-1], s[::-1], basis @ vh.conj().T[:, ::-1]
    return (v, s, u.conj().T) if wide else (u, s, v.conj().T)


def _decomposed(factors: _Factors, k: int, which: str) -> tuple[Any, Any, Any]:
    """The wanted ones of all singular triplets, computed by LAPACK on the host."""
    if factors.explicit is None:
        full = factors.times(factors.xp.eye(factors.shape[1], dtype=factors.dtype))
    else:
        full = factors.explicit
        full = full.toarray() if hasattr(full, "toarray") else full
    u, s, vh = np.linalg.svd(to_host(full), full_matrices=False)
    wanted = slice(0, k) if which == "LM" else slice(s.size - k, s.size)
    xp = factors.xp
    return (
        xp.asarray(u[:, wanted][:, ::-1]),
        xp.asarray(s[wanted][::-1]),
        xp.asarray(vh[wanted][::-1]),
    )


def _certify(factors: _Factors, u: Any, s: Any, vh: Any) -> None:
    """Raise `NotConverged` unless every triplet satisfies both of its equations."""
    xp, v = factors.xp, vh.conj().T
    left, right = factors.times(v), factors.times(u, adjoint=True)
    error = xp.maximum(xp.linalg.norm(left - u * s, axis=0), xp.linalg.norm(right - v * s, axis=0))
    # A lower bound of |A|: the largest singular value and, if entries are stored, column norm.
    size = float(s.max())
    size = max(size, factors.matrix.norm * factors.unit)
    # More than rounding: the vectors come from the square of A and have lost some digits.
    good = xp.isfinite(s) & (error <= 1e-10 * size)
    if not bool(good.all()):
        raise NotConverged(
            f"{int((~good).sum())} of {len(s)} triplets fail their certificate: the residual "
            f"reaches {float(error.max()) / size if size else np.inf:.1e} |A|; smaller singular "
            "values than 1e-7 of the largest need stored entries",
            eigenvalues=s[good] / factors.unit,
            eigenvectors=v[:, good],
        )
