"""Products of a sparse matrix and vectors on host or device, and of the moduli of both."""

from __future__ import annotations

import weakref
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.ranges import diagonal

Array = NDArray[np.float64]


class SparseRows:
    """A sparse matrix (n, m) in the memory of the host."""

    placed: tuple[Any, Any, Any] | None = None  # row starts, columns, values on a device

    def __init__(self, matrix: Any) -> None:
        self._matrix = matrix

    def __matmul__(self, x: Any) -> Any:
        """``A x`` for a vector, shape (n,)."""
        return self._matrix @ x

    def diagonal(self) -> Any:
        """Diagonal of a square matrix, shape (n,), on the device of products."""
        return diagonal(self._matrix)

    def moduli(self, x: Any) -> Any:
        """``|A| |x|`` for a vector, shape (n,)."""
        return self._absolute @ np.abs(x)

    @cached_property
    def _absolute(self) -> Any:
        """|A|, sharing the pattern of A."""
        A = self._matrix
        return type(A)((np.abs(A.data), A.indices, A.indptr), shape=A.shape)

    @staticmethod
    def bytes(matrix: Any) -> int:
        """Memory that the matrix takes on a device."""
        return int(matrix.data.nbytes + 4 * (matrix.indices.size + matrix.indptr.size))


class AllRows(SparseRows):
    """The identity, on host or device."""

    def __matmul__(self, x: Any) -> Any:
        """x itself."""
        return x


_transposes: dict[int, tuple[Any, Any]] = {}


def transpose(matrix: Any) -> Any:
    """``A^T``, sharing the arrays of A, made once: SciPy's takes longer than a small product."""
    known = _transposes.get(id(matrix))
    if known is None or known[0]() is not matrix:
        forget = partial(_forget, id(matrix))
        known = _transposes[id(matrix)] = weakref.ref(matrix, forget), matrix.T
    return known[1]


def _forget(number: int, gone: Any) -> None:
    if _transposes.get(number, (None,))[0] is gone:
        del _transposes[number]


class DeviceRows(SparseRows):
    """A sparse matrix, x and products on a CUDA device (xp: CuPy), with 32-bit indices."""

    def __init__(self, matrix: Any, xp: Any) -> None:
        rows = sparse.csr_array(matrix) if isinstance(matrix.data, np.ndarray) else matrix
        starts = xp.asarray(rows.indptr.astype(np.int32, copy=False))
        columns = xp.asarray(rows.indices.astype(np.int32, copy=False))
        self.placed = starts, columns, xp.asarray(rows.data)
        self._arguments = starts[:-1], starts[1:], *self.placed[1:]

    def __matmul__(self, x: Any) -> Any:
        """``A x`` for a vector, shape (n,)."""
        return _kernel()(*self._arguments, x, 0)

    def diagonal(self) -> Any:
        """Diagonal of a square matrix, shape (n,), on the device."""
        return _of_diagonal()(*self._arguments)

    def moduli(self, x: Any) -> Any:
        """``|A| |x|`` for a vector, shape (n,)."""
        return _kernel()(*self._arguments, x, 1)


@cache
def _kernel() -> Any:
    import cupy

    # Sum each row in the order of its columns, for bitwise reproducibility.
    code = """
    double sum = 0.0;
    for (int k = start; k < end; ++k) {
        const double term = data[k] * x[columns[k]];
        sum += moduli ? fabs(term) : term;
    }
    y = sum;
    """
    return cupy.ElementwiseKernel(
        "int32 start, int32 end, raw int32 columns, raw float64 data, raw float64 x, int32 moduli",
        "float64 y",
        code,
        "contact_sparse_rows",
    )


@cache
def _of_diagonal() -> Any:
    import cupy

    code = """
    double sum = 0.0;
    for (int k = start; k < end; ++k) {
        sum += columns[k] == i ? data[k] : 0.0;
    }
    y = sum;
    """
    return cupy.ElementwiseKernel(
        "int32 start, int32 end, raw int32 columns, raw float64 data",
        "float64 y",
        code,
        "contact_diagonal",
    )
