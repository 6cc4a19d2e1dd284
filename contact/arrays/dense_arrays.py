"""Dense factorisations and products on NumPy or CuPy arrays, by the same names for both."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
from scipy.linalg.blas import dgemm, dsyrk
from scipy.linalg.lapack import dgetrf, dgetrs

from contact.arrays.sparse_rows import DeviceRows, SparseRows
from contact.errors import InputError, MissingDependency
from skfem_adini.ground.arguments import choice
from skfem_adini.ground.arrays import cholesky, lower_solve


class HostArrays:
    """NumPy arrays in column-major order, SciPy's BLAS (see `ground.arrays`)."""

    xp: Any = np

    def room(self) -> int | None:
        """Free memory of the device in bytes; None for the host."""
        return None

    def put(self, x: Any) -> Any:
        """A column-major copy on the device; x lives on the host or the device."""
        return np.array(x, dtype=np.float64, order="F")

    def get(self, x: Any) -> Any:
        """The array on the host."""
        return x

    def dense(self, matrix: Any) -> Any:
        """A sparse matrix of the host as a dense one."""
        return matrix.toarray(order="F")

    def rows(self, matrix: Any) -> SparseRows:
        """A sparse host matrix for products with vectors on the device of these arrays."""
        return SparseRows(matrix)

    def matrix(self, W: Any) -> Any:
        """A symmetric matrix in a form that NumPy code can use."""
        return W

    def values(self, W: Any) -> Any:
        """The array of the output of `matrix`."""
        return W

    def cholesky(self, A: Any) -> Any:
        """Lower factor of a symmetric A, which is overwritten; the upper triangle is undefined.
        Raises LinAlgError if a pivot is not positive."""
        return cholesky(A)

    def solve(self, L: Any, B: Any, transposed: bool = False) -> Any:
        """Solve ``L X = B`` or ``L^T X = B`` for a matrix B, which is overwritten if it can be."""
        return lower_solve(L, B, transposed, overwrite=True)

    def product(self, A: Any, B: Any, transposed: bool = False) -> Any:
        """``A B`` or ``A^T B`` for column-major matrices."""
        if not (A.size and B.size):
            return (A.T if transposed else A) @ B
        return dgemm(1.0, A, B, trans_a=int(transposed))

    def gram(self, A: Any) -> Any:
        """``A^T A``, both triangles."""
        if not A.size:
            return A.T @ A
        lower = dsyrk(1.0, A, trans=1, lower=1)
        return mirrored(lower)

    def congruent(self, B: Any, A: Any) -> Any:
        """``B A B^T`` for a sparse matrix B of the host and a symmetric A on the device."""
        half = np.asarray(B @ A)
        return symmetric(B @ half.T)

    def bordered(self, W: Any, rows: Any, added: Any, border: Any) -> Any:
        """``[[W[rows, rows] + diag(added), border], [0, 0]]``, a new square matrix.
        W as `matrix` returned it, rows and added of shape (n,), border (n, k)."""
        xp: Any = self.xp
        n, k = border.shape
        A = xp.zeros((n + k, n + k), order="F")  # column-major for LAPACK
        at, i = xp.asarray(rows), xp.arange(n)
        # W is column-major: gather entries column by column.
        A[:n, :n] = self.values(W).T[at[:, None], at].T
        A[i, i] += xp.asarray(added)
        A[:n, n:] = xp.asarray(border)
        return A

    def shifted(self, W: Any, shift: float) -> Any:
        """``W + shift I`` for the output of `matrix`, in the same form."""
        W = self.values(W).copy()
        i = self.xp.arange(W.shape[0])
        W[i, i] += shift
        return self.matrix(W)

    def solve_square(self, A: Any, b: Any, definite: bool = False) -> Any:
        """Solve ``A x = b`` for a square A, which may be overwritten; b and x are on the host.
        `definite`: symmetric positive definite up to rounding. Raises LinAlgError if singular."""
        return self.solve_factored(self.factored(A), b)

    def factored(self, A: Any, overwrite: bool = True) -> tuple[Any, Any]:
        """Factors of a square A of the host for `solve_factored`; LinAlgError if singular."""
        factor, pivots, info = dgetrf(A, overwrite_a=overwrite)
        return factor, regular(pivots, info)

    def solve_factored(self, factors: tuple[Any, Any], b: Any) -> Any:
        """Solve by the factors of the host; b is overwritten."""
        return regular(*dgetrs(*factors, b, overwrite_b=True))

    def synchronize(self) -> None:
        """Wait until all operations have finished."""


class DeviceArrays(HostArrays):
    """CuPy arrays, cuBLAS and cuSOLVER.
    Raises MissingDependency without CuPy, InputError without a CUDA device."""

    def __init__(self) -> None:
        try:
            import cupy
            from cupyx.scipy.linalg import (  # type: ignore[import-not-found, unused-ignore]
                solve_triangular,
            )
        except ImportError as error:
            raise MissingDependency(
                "device='cuda' needs CuPy: pip install 'skfem-adini[cuda13]' (or [cuda12])"
            ) from error
        try:
            cupy.cuda.runtime.getDeviceCount()
        except cupy.cuda.runtime.CUDARuntimeError as error:
            raise InputError(f"device='cuda': no CUDA device answers ({error})") from error
        self.xp, self._solve = cupy, solve_triangular

    def room(self) -> int | None:
        """Free memory of the device in bytes, including CuPy's memory pool."""
        free = self.xp.cuda.runtime.memGetInfo()[0]
        return int(free + self.xp.get_default_memory_pool().free_bytes())

    def put(self, x: Any) -> Any:
        """A copy on the device; x lives on the host or the device."""
        return self.xp.array(x, dtype=np.float64)

    def get(self, x: Any) -> Any:
        """The array on the host."""
        return self.xp.asnumpy(x)

    def dense(self, matrix: Any) -> Any:
        """A sparse matrix of the host as a dense one, column-major."""
        xp, entries = self.xp, matrix.tocoo()
        columns, rows = matrix.shape[1], matrix.shape[0]
        flat = xp.zeros(rows * columns)
        flat[xp.asarray(entries.row + rows * entries.col.astype(np.int64))] = xp.asarray(
            entries.data
        )
        return flat.reshape((rows, columns), order="F")

    def rows(self, matrix: Any) -> SparseRows:
        """A sparse matrix of the host for products with vectors on the device."""
        return DeviceRows(matrix, self.xp)

    def matrix(self, W: Any) -> Any:
        """A symmetric matrix in a form that NumPy code can use."""
        return DeviceMatrix(self, W)

    def values(self, W: Any) -> Any:
        """The array of the output of `matrix`."""
        return W.values

    def cholesky(self, A: Any) -> Any:
        """Lower factor of a symmetric A.
        Raises LinAlgError if a pivot is not positive: CuPy then returns NaN."""
        if not A.size:
            return A
        L = self.xp.asfortranarray(self.xp.linalg.cholesky(A))
        if not bool(self.xp.isfinite(L.diagonal()).all()):
            raise np.linalg.LinAlgError("a pivot is not positive")
        return L

    def solve(self, L: Any, B: Any, transposed: bool = False) -> Any:
        """Solve ``L X = B`` or ``L^T X = B`` for a matrix B, which is overwritten if it can be."""
        if not B.size:
            return B
        return self._solve(L, B, trans=int(transposed), lower=True, overwrite_b=True)

    def product(self, A: Any, B: Any, transposed: bool = False) -> Any:
        """``A B`` or ``A^T B``."""
        return (A.T if transposed else A) @ B

    def gram(self, A: Any) -> Any:
        """``A^T A``, both triangles."""
        return A.T @ A

    def congruent(self, B: Any, A: Any) -> Any:
        """``B A B^T`` for a sparse matrix B of the host and a symmetric A on the device."""
        return symmetric(self._rows_times(B, self._rows_times(B, A).T))

    def _rows_times(self, B: Any, A: Any) -> Any:
        """``B A`` for a sparse B of the host, entry after entry of its rows.
        Products of cuSPARSE may differ in the last bits from call to call."""
        put, counts = self.xp.asarray, np.diff(B.indptr)
        product = self.xp.zeros((B.shape[0], A.shape[1]))
        for k in range(int(counts.max(initial=0))):
            rows = np.flatnonzero(counts > k)
            at = B.indptr[rows] + k
            product[put(rows)] += put(B.data[at])[:, None] * A[put(B.indices[at])]
        return product

    def bordered(self, W: Any, rows: Any, added: Any, border: Any) -> Any:
        """``[[W[rows, rows] + diag(added), border], [0, 0]]``, a new square matrix."""
        xp: Any = self.xp
        n, k = border.shape
        A = xp.zeros((n + k, n + k))
        at, i = xp.asarray(rows), xp.arange(n)
        A[:n, :n] = self.values(W)[at[:, None], at]
        A[i, i] += xp.asarray(added)
        A[:n, n:] = xp.asarray(border)
        return A

    def solve_square(self, A: Any, b: Any, definite: bool = False) -> Any:
        """Solve ``A x = b`` for a square A; b and x are on the host."""
        right = self.put(b)
        if definite:
            with suppress(np.linalg.LinAlgError):
                L = self.cholesky(A)
                half = self.solve(L, right[:, None])
                return regular(self.get(self.solve(L, half, transposed=True))[:, 0])
        return regular(self.get(self.xp.linalg.solve(A, right)))

    def synchronize(self) -> None:
        """Wait until all operations have finished."""
        self.xp.cuda.runtime.deviceSynchronize()


class DeviceMatrix:
    """A symmetric matrix on the device for code that is written for NumPy arrays.
    Products with vectors of the host run on the device; a submatrix is copied to the host."""

    __array_ufunc__ = None  # leave products with an array on the left to __rmatmul__

    def __init__(self, arrays: DeviceArrays, values: Any) -> None:
        self.arrays, self.values = arrays, values
        self.shape = values.shape

    def __matmul__(self, x: Any) -> Any:
        return self.arrays.get(self.values @ self.arrays.put(x))

    __rmatmul__ = __matmul__

    def __getitem__(self, index: Any) -> Any:
        xp = self.arrays.xp
        return self.arrays.get(self.values[tuple(xp.asarray(i) for i in index)])

    def __add__(self, other: Any) -> Any:
        return self.arrays.get(self.values) + other

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        return np.asarray(self.arrays.get(self.values), dtype=dtype)

    def take(self, index: Any, axis: int) -> Any:
        """Rows or columns, on the host."""
        return self.arrays.get(self.values.take(self.arrays.xp.asarray(index), axis=axis))

    def diagonal(self) -> Any:
        """The diagonal, on the host."""
        return self.arrays.get(self.values.diagonal())


def symmetric(A: Any) -> Any:
    """Mean of a matrix and its transpose, which differ by rounding."""
    return 0.5 * (A + A.T)


def mirrored(lower: Any) -> Any:
    """Complete a symmetric matrix from its lower triangle, in place."""
    n, width = lower.shape[0], 256  # block size that fits the cache
    for i in range(0, n, width):
        block = slice(i, i + width)
        corner = lower[block, block]
        corner[...] = np.tril(corner) + np.tril(corner, -1).T
        lower[block, i + width :] = lower[i + width :, block].T
    return lower


def regular(x: Any, info: int = 0) -> Any:
    """Check the solution of a linear system.
    Raises LinAlgError if the solver reports a zero pivot, or entries are not finite."""
    if info != 0 or not np.all(np.isfinite(x)):
        raise np.linalg.LinAlgError("singular linear system")
    return x


def arrays_of(W: Any) -> HostArrays:
    """`HostArrays` or `DeviceArrays` of a matrix that `HostArrays.matrix` returned."""
    return getattr(W, "arrays", None) or HostArrays()


def arrays_on(device: str) -> HostArrays:
    """The arrays of ``device="cpu"`` or ``"cuda"``.
    Raises InputError for another name or no CUDA device, MissingDependency without CuPy."""
    return DeviceArrays() if choice("device", device, ("cpu", "cuda")) == "cuda" else HostArrays()
