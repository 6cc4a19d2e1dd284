"""The arguments A and M of `eigs` as linear maps with one interface, and their LU factors."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg, sparse
from scipy.linalg.blas import dasum
from scipy.sparse import csgraph
from scipy.sparse import linalg as sparse_linalg

from gpu.arrays.dense import device_lu
from gpu.arrays.sparse_factor import structurally_regular
from gpu.cuda.catalogue import kernel
from gpu.errors import InputError
from skfem_adini.ground.arguments import unmasked
from skfem_adini.ground.arrays import cupy, namespace, to_host


class _Limits(NamedTuple):  # tolerances of operators and of shifts
    counted: int = 1 << 30  # most entries for one call: the library counts them in 32 bits
    imaginary: float = 1e-10  # of a product, relative to its largest entry: less is rounding
    drowned: float = 1e-6  # rounding of the inverse over its least wanted value: order lost above
    apart: float = 1e3  # factor: a shift is nearer to sigma than the wanted, or farther
    uneven: float = 1e-6  # base 2 logarithm: moduli that differ by more are different
    unit: float = 400.0  # base 2 logarithm of the largest unit
    parts: int = 100  # most unconnected parts of a matrix for which units are sought


LIMITS = _Limits()


@dataclass(frozen=True)
class Matrix:
    """A linear map on the host or on a device; square but for singular values."""

    shape: tuple[int, int]
    real: bool
    xp: Any  # numpy or cupy
    apply: Callable[[Any], Any]
    explicit: Any  # array or sparse matrix with the entries, if they are stored
    name: str = "A"  # of the argument, in messages
    assumed: float | None = None  # if given, used as `magnitude`, so that the entries are not read
    adjoint: Callable[[Any], Any] | None = None  # y -> A^* y, where it is known

    @property
    def n(self) -> int:
        """The order; of a map that is not square, the number of columns."""
        return self.shape[1]

    @property
    def dtype(self) -> Any:
        """float64 or complex128."""
        return np.dtype(float if self.real else complex)

    @functools.cached_property
    def magnitude(self) -> float:
        """A number between the largest modulus of the entries and twice the sum of all moduli.
        Raises `InputError` if entries are not finite.
        """
        if self.assumed is not None:
            return self.assumed
        A = self.explicit
        size = _magnitude(A.data if hasattr(A, "tocsr") else A, self.xp)
        if not np.isfinite(size):
            raise InputError(f"{self.name} holds NaN or infinity")
        return size

    @functools.cached_property
    def norm(self) -> float:
        """Largest norm of a column, a lower bound of the spectral norm; 0 for operators."""
        if self.explicit is None:
            return 0.0
        scaled = abs(self.explicit) * self.unit
        squares = scaled.multiply(scaled) if hasattr(scaled, "tocsr") else scaled * scaled
        return float(np.sqrt(float(squares.sum(axis=0).max()))) / self.unit

    @functools.cached_property
    def unit(self) -> float:
        """Power of two that scales huge or tiny entries so that their squares are in range."""
        if self.explicit is None:
            probe = self.apply(self.xp.asarray(np.ones(self.n, dtype=self.dtype)))
            size = float(self.xp.abs(probe).max())
        else:
            size = self.magnitude
        if not np.isfinite(size) or ordinary(size):
            return 1.0
        return float(2.0 ** min(-np.floor(np.log2(size)), 1000.0))

    def dense(self) -> np.ndarray:
        """All entries on the host, shape (n, n); computed by n products if they are not stored."""
        if self.explicit is None:
            identity = self.xp.eye(self.n, dtype=self.dtype)
            columns = [to_host(self.apply(column)) for column in identity]
            return np.array(columns).reshape(self.n, self.n).T
        full = self.explicit.toarray() if hasattr(self.explicit, "toarray") else self.explicit
        return to_host(full)


def ordinary(size: float) -> bool:
    """Whether squares of numbers of this size neither overflow nor underflow."""
    return size == 0 or 1e-100 < size < 1e100


def as_matrix(name: str, A: Any, start: Any = None, square: bool = True) -> Matrix:
    """Check an argument, except for its entries, and make it a `Matrix`. The order, array module
    and dtype of a callable are those of `start`, shape (n,)."""
    unmasked(name, A)
    if callable(A) and not hasattr(A, "shape"):
        xp = namespace(start)
        start = xp.asarray([] if start is None else start)
        if start.ndim != 1 or not start.size or start.dtype.kind not in "buifc":
            raise InputError(
                f"{name}: a callable has no shape; pass v0, numbers of shape (n,), to give it one"
            )
        real = start.dtype.kind != "c" and _real_result(name, A, start * 1.0)
        apply = _real_products(name, A) if real else A
        return Matrix((start.size, start.size), real, xp, apply, None)
    shape = getattr(A, "shape", None)
    if shape is None:
        A = np.asarray(A)
        shape = A.shape
    shape = tuple(int(size) for size in shape)
    if len(shape) != 2 or 0 in shape or (square and shape[0] != shape[1]):
        kind = "square" if square else "a matrix"
        raise InputError(f"{name} has shape {shape}: it must be {kind} and not empty")
    kind = np.dtype(A.dtype).kind if A.dtype is not None else "f"
    if kind not in "buifc":
        raise InputError(f"{name} holds {A.dtype}: expected numbers")
    dtype = complex if kind == "c" else float
    if hasattr(A, "matvec"):
        xp, apply, adjoint = namespace(A), A.matvec, getattr(A, "rmatvec", None)
        if kind != "c":
            apply = _real_products(name, apply)
            adjoint = adjoint and _real_products(name, adjoint)
        return Matrix(shape, kind != "c", xp, apply, None, name, None, adjoint)
    if hasattr(A, "tocsr"):
        xp = np if sparse.issparse(A) else cupy()
        A = A.tocsr().astype(dtype)
    else:
        xp = namespace(A)
        A = xp.ascontiguousarray(A, dtype=dtype)
    adjoint = lambda y: (y.conj() @ A).conj()  # noqa: E731
    return Matrix(shape, kind != "c", xp, lambda x: A @ x, A, name, None, adjoint)


def _magnitude(entries: Any, xp: Any) -> float:
    """See `Matrix.magnitude`; NaN or infinite if an entry is. The entries are read once only, as a
    pass over A takes as long as a product.
    """
    if not entries.size:
        return 0.0
    if xp is np:
        parts = entries.reshape(-1).view(float)
        most = LIMITS.counted
        total = sum(dasum(parts[i : i + most]) for i in range(0, parts.size, most))
        return total if np.isfinite(total) else float(np.abs(entries).max())
    if entries.dtype.kind == "c":
        return float(xp.abs(entries).max())
    bits = xp.zeros(1, dtype=xp.uint64)
    blocks = min(-(-entries.size // 1024), 1024)
    largest = kernel("modulus", "modulus_largest")
    largest((blocks,), (1024,), (entries, np.int64(entries.size), bits))
    return float(bits.get().view(float)[0])


def _real_result(name: str, A: Callable[[Any], Any], x: Any) -> bool:
    y = A(x)
    if getattr(y, "shape", None) != x.shape:
        raise InputError(
            f"{name}: maps a vector of shape {x.shape} to {getattr(y, 'shape', type(y).__name__)}"
        )
    return bool(y.dtype.kind != "c")


def _real_products(name: str, apply: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """The products of an operator that says it is real; `InputError` where one is not."""

    def product(x: Any) -> Any:
        y = apply(x)
        if getattr(y, "dtype", np.dtype(float)).kind != "c" or x.dtype.kind == "c":
            return y
        # A transform and its inverse leave rounding in the imaginary part.
        if not float(abs(y.imag).max()) <= LIMITS.imaginary * float(abs(y).max()):
            raise InputError(
                f"{name} says that it is real, and maps a real vector to a complex one: give the "
                "operator dtype=complex"
            )
        return y.real

    return product


class Factors(NamedTuple):
    """Solves with a stored matrix and, on the host, with its adjoint."""

    solve: Callable[[Any], Any]
    adjoint: Callable[[Any], Any] | None = None


def factorized(A: Any, xp: Any) -> Factors | None:
    """Solves with a stored matrix by its LU factors; None if it is singular."""
    if xp is np:
        if hasattr(A, "tocsr"):
            if not structurally_regular(A):
                return None
            try:
                factors: Any = sparse_linalg.splu(sparse.csc_matrix(A))
            except RuntimeError:
                return None
            U = factors.U
            if _singular(U.diagonal(), abs(U).max(axis=0).toarray()):
                return None
            return Factors(factors.solve, lambda y: factors.solve(y, "H"))
        lapack: Any = linalg.get_lapack_funcs(("getrf", "getrs"), (A,))
        getrf, getrs = lapack
        lu, pivots, _ = getrf(A)
        if _singular(np.diag(lu), np.abs(np.triu(lu)).max(axis=0)):
            return None
        return Factors(
            lambda x: getrs(lu, pivots, x)[0], lambda y: getrs(lu, pivots, y, trans=2)[0]
        )
    if hasattr(A, "tocsr"):
        from cupyx.scipy.sparse import csc_matrix
        from cupyx.scipy.sparse.linalg import splu

        try:
            return Factors(splu(csc_matrix(A)).solve)
        except RuntimeError:
            return None
    from cupyx.scipy.linalg import lu_solve

    device = device_lu(A)
    U = xp.triu(device[0])
    if _singular(to_host(xp.diag(U)), to_host(xp.abs(U).max(axis=0))):
        return None
    return Factors(lambda x: lu_solve(device, x, check_finite=False))


def _singular(pivots: np.ndarray, columns: np.ndarray) -> bool:
    """Whether a pivot is rounding relative to its column of U, so that solves are meaningless."""
    limit = len(pivots) * np.finfo(float).eps * columns
    return not bool(np.all(np.abs(pivots) > limit))


def shifts(matrix: Matrix, mass: Matrix | None, sigma: Any) -> Iterator[Any]:
    """Sigma, then shifts close to it, in case it is an eigenvalue."""
    yield sigma
    if sigma is not None:
        yield from (sigma * (1.0 + step) for step in (1e-9, 1e-7) if sigma)
        size = (matrix.norm or 1.0) / (1.0 if mass is None else mass.norm or 1.0)
        yield from (sigma + step * size for step in (1e-9, 1e-8, 1e-7))


@dataclass(frozen=True)
class EigenProblem:
    """The operator of the iteration: A, M^-1 A or (A - shift M)^-1 M."""

    apply: Callable[[Any], Any]
    dtype: Any
    values: Callable[[np.ndarray], np.ndarray]  # maps its eigenvalues to those of the pencil
    matrix: Any = None  # its entries, if it is A and they are stored
    adjoint: Callable[[Any], Any] | None = None  # of the operator, where it is known

    @classmethod
    def of(cls, matrix: Matrix, mass: Matrix | None, shift: Any) -> EigenProblem | None:
        """The operator for this shift, with its factors; None if ``A - shift M`` is singular.
        Raises `InputError` if M is singular or if a matrix to be factored is given as an operator.
        """
        real = matrix.real and (mass is None or mass.real) and np.isrealobj(shift)
        dtype = np.dtype(float if real else complex)
        unit = matrix.unit
        if shift is None and mass is None:
            adjoint = matrix.adjoint
            if unit == 1.0:
                return cls(matrix.apply, dtype, lambda theta: theta, matrix.explicit, adjoint)
            turned = adjoint and (lambda y: adjoint(y * unit))
            return cls(
                lambda x: matrix.apply(x * unit), dtype, lambda theta: theta / unit, None, turned
            )
        if mass is not None and mass.explicit is None:
            raise InputError("M: an operator cannot be factored; pass its entries")
        if shift is None:
            assert mass is not None
            # Real factors drop the imaginary part of right-hand sides, or refuse it.
            entries = mass.explicit if mass.dtype == dtype else mass.explicit.astype(dtype)
            of_mass = factorized(entries, matrix.xp)
            if of_mass is None:
                raise InputError("M is singular: give sigma, so that A - sigma M is factored")
            by_mass = of_mass.solve
            return cls(lambda x: by_mass(matrix.apply(x * unit)), dtype, lambda t: t / unit)
        if matrix.explicit is None:
            raise InputError(
                "sigma: A is an operator and cannot be factored; pass eigs an operator of "
                "(A - sigma)^-1 and take sigma + 1 / w"
            )
        factors = factorized(_shifted(matrix, mass, shift * unit, unit), matrix.xp)
        if factors is None:
            return None
        if mass is None:
            values = lambda theta: shift + 1.0 / (theta * unit)  # noqa: E731
            return cls(factors.solve, dtype, values, None, factors.adjoint)
        weigh, inverse = mass.apply, factors.solve
        return cls(lambda x: inverse(weigh(x)), dtype, lambda theta: shift + 1.0 / (theta * unit))


def even_units(matrix: Matrix) -> Any:
    """Units d, powers of two, with :math:`|a_{ij}| d_j / d_i = |a_{ji}| d_i / d_j` up to a factor
    of two, or None if none exist or they change nothing. They make a matrix of convection and
    diffusion on a line or grid nearly normal."""
    A = matrix.explicit
    if A is None or matrix.xp is not np or matrix.n < 2:
        return None
    A = abs(sparse.csr_array(A))
    A.eliminate_zeros()
    twin = sparse.csr_array(A.T)
    A.sort_indices()
    twin.sort_indices()
    if not np.array_equal(A.indptr, twin.indptr) or not np.array_equal(A.indices, twin.indices):
        return None
    half = sparse.csr_array((0.5 * np.log2(A.data / twin.data), A.indices, A.indptr), A.shape)
    if not np.abs(half.data).max(initial=0.0) > LIMITS.uneven:
        return None
    log = np.zeros(matrix.n)
    count, label = csgraph.connected_components(A, directed=False)
    for first in np.unique(label, return_index=True)[1] if count <= LIMITS.parts else ():
        order, before = csgraph.breadth_first_order(A, first)
        step = half[order[1:], before[order[1:]]]
        for i, j, change in zip(order[1:].tolist(), before[order[1:]].tolist(), step, strict=True):
            log[i] = log[j] + change
        log[order] -= (log[order].max() + log[order].min()) / 2.0
    rows = np.repeat(np.arange(matrix.n), np.diff(A.indptr))
    wrong = np.abs(log[rows] - log[A.indices] - half.data).max()
    if not wrong <= LIMITS.uneven or not 1.0 <= np.abs(log).max() <= LIMITS.unit:
        return None
    return np.exp2(np.round(log))


def told_apart(theta: np.ndarray, rounding: float, away: np.ndarray, moved: float) -> bool:
    """Whether the largest eigenvalues `theta` of an inverse are surely those nearest to sigma.
    `rounding` is the error of the inverse, `away` the distances of the pencil's eigenvalues from
    sigma, `moved` that of the shift."""
    reach = float(away.max())
    return bool(
        rounding <= LIMITS.drowned * np.abs(theta).min()
        and not (moved and moved < LIMITS.apart * reach < LIMITS.apart**2 * moved)
    )


def _shifted(matrix: Matrix, mass: Matrix | None, sigma: Any, unit: float) -> Any:
    """``unit A - sigma M``, sparse only if both are."""
    A, xp = matrix.explicit * unit, matrix.xp
    if hasattr(A, "tocsr"):
        if xp is np:
            from scipy import sparse
        else:
            from cupyx.scipy import sparse  # type: ignore[no-redef]
        B = sparse.identity(matrix.n, format="csr") if mass is None else mass.explicit
        if not hasattr(B, "tocsr"):
            return A.toarray() - sigma * B
        return A - sigma * B
    if mass is not None and hasattr(mass.explicit, "tocsr"):
        return A - sigma * mass.explicit.toarray()
    if mass is not None:
        return A - sigma * mass.explicit
    shifted = A.astype(np.result_type(A.dtype, type(sigma)))
    places = xp.arange(matrix.n)
    shifted[places, places] -= sigma
    return shifted
