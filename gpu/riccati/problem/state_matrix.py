"""The matrices A and E of a linear system, however they are stored: products and shifted solves."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator, splu

from gpu.arrays.dense import device_lu
from gpu.arrays.sparse_factor import structurally_regular
from gpu.errors import InputError
from skfem_adini.ground.arguments import unmasked
from skfem_adini.ground.arrays import cupy, namespace, to_host

EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Factors:
    """Solves with a factored matrix and with its transpose (never its conjugate transpose)."""

    solve: Callable[[Any], Any]
    solve_transposed: Callable[[Any], Any]


class StateMatrix:
    """A pencil :math:`A - s E`, A a diagonal (1-D, as then E may be), dense, sparse, or an operator
    with its `inverse`. `explicit` stores the inverse of a dense A on a device, so that a solve is
    one product instead of two sequences of small kernels."""

    def __init__(self, A: Any, E: Any = None, inverse: Any = None, explicit: bool = False) -> None:
        self.inverse, self.explicit = inverse, explicit
        if inverse is not None and not (hasattr(inverse, "matvec") and hasattr(inverse, "shape")):
            raise InputError(
                f"inverse is of type {type(inverse).__name__}: expected a LinearOperator of A^-1"
            )
        if hasattr(A, "matvec") and not hasattr(A, "tocsr"):
            if inverse is None:
                raise InputError(
                    "A is an operator: pass inverse, a LinearOperator of A^-1 with rmatvec"
                )
            self.kind, self.A, self.E = "operator", A, None if E is None else stored("E", E)
            self.n = int(A.shape[0])
            _check_transposes(A, inverse)
        else:
            self.A = stored("A", A)
            if self.A.ndim not in (1, 2):
                raise InputError(f"A has shape {self.A.shape}: expected (n, n), or (n,)")
            self.n = int(self.A.shape[0])
            E = None if E is None else stored("E", E)
            if self.A.ndim == 1 and E is not None and E.ndim == 2:
                self.A = _diagonal(self.A, E)
            if self.A.ndim == 2 and E is not None and E.ndim == 1:
                E = _diagonal(E, self.A)
            if E is not None and hasattr(self.A, "tocsr") and not hasattr(E, "tocsr"):
                self.A = self.A.toarray()
            if E is not None and hasattr(E, "tocsr") and not hasattr(self.A, "tocsr"):
                E = E.toarray()
            self.E = E
            self.kind = (
                "diagonal"
                if self.A.ndim == 1
                else "sparse"
                if hasattr(self.A, "tocsr")
                else "dense"
            )
        for name, value in (("A", self.A), ("E", self.E), ("inverse", inverse)):
            if value is None:
                continue
            expected = {(self.n, self.n)} | ({(self.n,)} if self.kind == "diagonal" else set())
            if tuple(value.shape) not in expected or self.n == 0:
                raise InputError(f"{name} has shape {tuple(value.shape)}: expected n x n, n > 0")

    @property
    def xp(self) -> Any:
        """numpy or cupy."""
        return namespace(self.A)

    def apply(self, x: Any) -> Any:
        """``A x`` for a vector or a matrix of columns."""
        return times(self.A, x)

    def apply_transposed(self, x: Any) -> Any:
        """``A^T x``."""
        return _times_transposed(self.A, x)

    def mass(self, x: Any) -> Any:
        """``E x``."""
        return x if self.E is None else times(self.E, x)

    def mass_transposed(self, x: Any) -> Any:
        """``E^T x``."""
        return x if self.E is None else _times_transposed(self.E, x)

    def size(self) -> float:
        """Largest modulus of an entry of A; NaN for an operator."""
        return _largest(self.A) if self.kind != "operator" else np.nan

    def is_symmetric(self) -> bool:
        """Whether A and E are symmetric up to rounding; False for an operator."""
        if self.kind == "operator":
            return False
        return symmetric(self.A) and (self.E is None or symmetric(self.E))

    def factor(self, shift: complex = 0.0, explicit: bool | None = None) -> Factors | None:
        """Factor ``A - shift E``; None if a pivot is not larger than rounding."""
        if self.kind == "operator":
            if shift != 0.0:
                raise InputError(f"A is an operator: it cannot be shifted by {shift}")
            return Factors(columnwise(self.inverse.matvec), columnwise(self.inverse.rmatvec))
        return factor(self.shifted(shift), self.explicit if explicit is None else explicit)

    def factor_updated(self, U: Any, V: Any) -> Factors | None:
        """Solves with ``A - U V^T`` for a singular A; None if the difference is singular too."""
        xp, n = self.xp, self.n
        if self.kind == "dense":
            return factor(self.A - U @ V.T, self.explicit)
        if self.kind == "sparse":
            return factor_bordered(self.A, U, V)
        # Replace zeros of the diagonal by a number, which becomes part of the low-rank update.
        zero = vanishing(self.A)
        places, others = xp.flatnonzero(zero), xp.abs(self.A[~zero])
        unit = float(others.min()) if others.size else 1.0
        D = self.A.copy()
        D[places] = -unit
        picked = xp.zeros((n, len(places)))
        picked[places, xp.arange(len(places))] = 1.0
        U, V = xp.concatenate([U, -unit * picked], axis=1), xp.concatenate([V, picked], axis=1)
        return woodbury(Factors(*(lambda x: x / (D if x.ndim == 1 else D[:, None]),) * 2), U, V)

    def shifted(self, shift: complex) -> Any:
        """``A - shift E``, stored in the format of A."""
        if shift == 0.0:
            return self.A
        if self.kind == "diagonal":
            return self.A - shift * (1.0 if self.E is None else self.E)
        if self.E is not None:
            return self.A - shift * self.E
        if self.kind == "sparse":
            return self.A - shift * sparse_of(self.xp).identity(self.n, format="csr")
        moved = self.A.astype(np.result_type(self.A.dtype, type(shift)))
        places = self.xp.arange(self.n)
        moved[places, places] -= shift
        return moved


def factor(A: Any, explicit: bool = False) -> Factors | None:
    """Solves with a diagonal, dense or sparse matrix; None if a pivot is as small as rounding.
    `explicit` as for `StateMatrix`.
    """
    xp = namespace(A)
    if A.ndim == 1:
        if _singular(to_host(xp.abs(A))):
            return None
        divide = lambda x: x / (A if x.ndim == 1 else A[:, None])  # noqa: E731
        return Factors(divide, divide)
    if hasattr(A, "tocsr"):
        return _factor_sparse(A, xp)
    if xp is np:
        lapack: Any = linalg.get_lapack_funcs(("getrf", "getrs"), (A,))
        getrf, getrs = lapack
        lu, pivots, _ = getrf(A)
        if _singular(np.abs(np.diag(lu))):
            return None
        return _by_parts(
            A, lambda x: getrs(lu, pivots, x)[0], lambda x: getrs(lu, pivots, x, trans=1)[0]
        )
    from cupyx.scipy.linalg import lu_solve

    device = device_lu(A)
    if _singular(to_host(xp.abs(xp.diag(device[0])))):
        return None
    if explicit:
        inverse = lu_solve(device, xp.eye(len(A), dtype=A.dtype), check_finite=False)
        return Factors(lambda x: inverse @ x, lambda x: inverse.T @ x)
    return _by_parts(
        A,
        lambda x: lu_solve(device, x, check_finite=False),
        lambda x: lu_solve(device, x, trans=1, check_finite=False),
    )


def _by_parts(A: Any, *solves: Callable[[Any], Any]) -> Factors:
    """Solves that take complex right-hand sides part by part if A is real, since LAPACK's wrappers
    would drop their imaginary parts.
    """
    if A.dtype.kind == "c":
        return Factors(*solves)

    def split(solve: Callable[[Any], Any]) -> Callable[[Any], Any]:
        return lambda x: solve(x.real) + 1j * solve(x.imag) if x.dtype.kind == "c" else solve(x)

    return Factors(*(split(solve) for solve in solves))


def _factor_sparse(A: Any, xp: Any) -> Factors | None:
    build: Any
    options: dict[str, Any] = {}
    if xp is np:
        A = sparse.csc_array(A)
        if not structurally_regular(A):
            return None
        build = splu
        if symmetric(A):
            # SuperLU's default order is for unsymmetric patterns and fills in more.
            options = {"permc_spec": "MMD_AT_PLUS_A"}
    else:
        from cupyx.scipy.sparse import csc_matrix
        from cupyx.scipy.sparse.linalg import splu as device_splu

        build = device_splu
        A = csc_matrix(A)
    try:
        lu = build(A, **options)
    except RuntimeError:
        return None
    if xp is np and _singular(np.abs(lu.U.diagonal())):
        return None
    kind = A.dtype

    def solve(x: Any, trans: str = "N") -> Any:
        # SuperLU needs right-hand sides of the type of its factors, and contiguous ones.
        if x.dtype.kind == "c" and kind.kind != "c":
            return solve(x.real.copy(), trans) + 1j * solve(x.imag.copy(), trans)
        x = xp.asarray(x, dtype=kind)
        if x.size == 0:
            return x
        return lu.solve(x, trans)

    return Factors(solve, lambda x: solve(x, "T"))


def factor_bordered(A: Any, U: Any, V: Any) -> Factors | None:
    """Solves with ``A - U V^T``, A sparse, by factors of ``[[A, -U], [V^T, -I]]``."""
    xp, n, d = namespace(A), A.shape[0], U.shape[1]
    block = sparse_of(xp)
    rows = [[A, block.csr_matrix(-U)], [block.csr_matrix(V.T), -block.identity(d)]]
    whole = factor(block.bmat(rows).tocsr())
    if whole is None:
        return None

    def embed(x: Any) -> Any:
        return xp.concatenate([x, xp.zeros((d, *x.shape[1:]))])

    return Factors(
        lambda x: whole.solve(embed(x))[:n], lambda x: whole.solve_transposed(embed(x))[:n]
    )


def woodbury(factors: Factors, U: Any, V: Any, most: float = 1e12) -> Factors | None:
    """Solves with ``M - U V^T`` from those with M (Sherman-Morrison-Woodbury); None if the
    condition of the small matrix ``I - V^T M^-1 U`` is above `most`."""
    xp, MU = namespace(U), factors.solve(U)
    small = to_host(xp.eye(U.shape[1]) - V.T @ MU)
    if not np.isfinite(small).all() or np.linalg.cond(small) > most:
        return None
    core = xp.asarray(np.linalg.inv(small))
    MV = functools.cache(lambda: factors.solve_transposed(V))

    def solve(x: Any) -> Any:
        y = factors.solve(x)
        return y + MU @ (core @ (V.T @ y))

    def solve_transposed(x: Any) -> Any:
        y = factors.solve_transposed(x)
        return y + MV() @ (core.T @ (U.T @ y))

    return Factors(solve, solve_transposed)


def vanishing(d: Any) -> Any:
    """A mask of the entries of a diagonal that are rounding relative to the largest."""
    xp = namespace(d)
    return xp.abs(d) <= 4 * len(d) * EPS * float(xp.abs(d).max())


def stored(name: str, A: Any) -> Any:
    """The checked matrix in float64, a sparse one as CSR."""
    unmasked(name, A)
    if hasattr(A, "tocsr"):
        on_host = sparse.issparse(A)
        A = sparse.csr_array(A) if on_host else A.tocsr()
        entries, xp = A.data, np if on_host else cupy()
    else:
        xp = namespace(A)
        A = entries = xp.asarray(A)
    if entries.dtype.kind not in "buif":
        raise InputError(f"{name} holds {entries.dtype}: expected real numbers")
    if not bool(xp.all(xp.isfinite(entries))):
        raise InputError(f"{name} holds NaN or infinity")
    return A.astype(float)


def _check_transposes(A: Any, inverse: Any) -> None:
    for name, operator in (("A", A), ("inverse", inverse)):
        try:
            operator.rmatvec(namespace(A).zeros(operator.shape[0]))
        except NotImplementedError:
            raise InputError(f"{name} has no rmatvec: pass one, of its transpose") from None


def _diagonal(d: Any, like: Any) -> Any:
    """A 1-D diagonal as a matrix, sparse or dense like another one."""
    xp = namespace(like)
    return as_sparse(d, xp) if hasattr(like, "tocsr") else xp.diag(d)


def as_sparse(M: Any, xp: Any) -> Any:
    """A 1-D diagonal as a sparse matrix; a sparse matrix, or None, as it is."""
    if M is None or M.ndim == 2:
        return M
    return sparse_of(xp).diags(M).tocsr() if xp is not np else sparse.csr_array(sparse.diags(M))


def sparse_of(xp: Any) -> Any:
    """The module of sparse matrices that belongs to numpy or cupy."""
    if xp is np:
        return sparse
    from cupyx.scipy import sparse as device

    return device


def linear_operator(xp: Any, n: int, product: Any, transposed: Any) -> Any:
    """A LinearOperator of SciPy or CuPy, of order n, from products with vectors and matrices."""
    if xp is np:
        more = {"matmat": product, "rmatmat": transposed}
        return LinearOperator((n, n), product, transposed, dtype=float, **more)
    from cupyx.scipy.sparse import linalg as device

    return device.LinearOperator((n, n), matvec=product, rmatvec=transposed, dtype=float)


def times(A: Any, x: Any) -> Any:
    """``A x`` for a diagonal, matrix or operator A and a vector or matrix x."""
    if hasattr(A, "matvec") and not hasattr(A, "tocsr"):
        return columnwise(A.matvec)(x)
    if A.ndim == 1:
        return A * x if x.ndim == 1 else A[:, None] * x
    return A @ x


def _times_transposed(A: Any, x: Any) -> Any:
    if hasattr(A, "matvec") and not hasattr(A, "tocsr"):
        return columnwise(A.rmatvec)(x)
    return times(A, x) if A.ndim == 1 else A.T @ x


def columnwise(product: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Extend a product with vectors to matrices, column by column."""

    def apply(x: Any) -> Any:
        if x.ndim == 1:
            return product(x)
        xp = namespace(x)
        return xp.stack([product(column) for column in x.T], axis=1) if x.shape[1] else x

    return apply


def _largest(A: Any) -> float:
    entries = A.data if hasattr(A, "tocsr") else A
    return float(abs(entries).max()) if entries.size else 0.0


def symmetric(A: Any) -> bool:
    """Whether a matrix equals its transpose up to rounding."""
    if A.ndim == 1:
        return True
    return _largest(A - A.T) <= 10 * EPS * _largest(A)


def _singular(pivots: np.ndarray) -> bool:
    return not bool(np.all(pivots > 4 * len(pivots) * EPS * pivots.max(initial=0.0)))
