"""Ritz vectors and their residuals on a device in few launches, for real arrays of CuPy."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gpu.arrays.device_blas import ONE, ZERO, DeviceBlas
from gpu.cuda.catalogue import kernel


class _Turn(NamedTuple):  # sizes of a launch of `ritz_rotate`
    threads: int = 256  # threads of a block
    columns: int = 32  # vectors that a block rotates
    vectors: int = 192  # most vectors whose columns fit into the 48 KiB that every block may use


TURN = _Turn()


def turns(count: int) -> bool:
    """Whether `rotate` accepts this number of vectors."""
    return count <= TURN.vectors


def rotate(V: Any, Q: np.ndarray, residual: int) -> None:
    """Replace the first rows of V by combinations with Q's columns, the next by row `residual`."""
    n, (count, kept) = V.shape[1], Q.shape
    turned = _moved(np.ascontiguousarray(Q.T))
    blocks = -(-n // TURN.columns)
    sizes = np.int64(n), np.int32(count), np.int32(kept), np.int32(residual)
    kernel("ritz", "ritz_rotate")(
        (blocks,), (TURN.threads,), (V, turned, *sizes), shared_mem=8 * TURN.columns * count
    )


def pairs_with_residuals(
    V: Any, Y: np.ndarray, values: np.ndarray, A: Any, M: Any
) -> tuple[Any, Any, Any]:
    """Values, vectors ``V^T Y``, shape (n, k), and |A x - lambda M x|^2, |A x|^2, shape (2, k). V
    has basis rows, Y conjugate columns for conjugate values: A multiplies at most k + 1 real
    vectors. The device may still compute the squares on return."""
    import cupy

    k, (c, n) = len(values), V.shape
    columns, places = _real_columns(Y)
    count = len(columns)
    numbers = np.concatenate(
        [values.view(float), columns.ravel(), values.real, values.imag, places.ravel()]
    )
    moved = _moved(numbers)
    turned, pairs = moved[2 * k : 2 * k + count * c], moved[2 * k + count * c :]
    X = _multiplied(V, turned, count, c, False)
    left = _rows(A, X)
    right = X if M is None else _rows(M, X)
    vectors, squares = cupy.empty((k, n), dtype=complex), cupy.empty((2, k))
    kernel("ritz", "ritz_residual")(
        (k,), (1024,), (left, right, X, pairs, np.int64(n), np.int32(k), vectors, squares)
    )
    return moved[: 2 * k].view(complex), vectors.T, squares


def _real_columns(Y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The real columns that make up those of Y, as rows, and for each column of Y, shape (3, k):
    index of the real part, index of the imaginary part (-1: none), sign of the latter.
    """
    k = Y.shape[1]
    places = np.array([np.arange(k), np.full(k, -1), np.ones(k)], dtype=float)
    if Y.dtype.kind != "c" or not Y.imag.any():
        return np.ascontiguousarray(Y.real.T), places
    two = [*np.any(Y.imag, axis=0)]
    conjugate = [False, *np.all(Y[:, 1:] == Y[:, :-1].conj(), axis=0)]
    columns: list[np.ndarray] = []
    taken = False  # whether column j is the conjugate of the one before
    for j in range(k):
        taken = two[j] and conjugate[j] and not taken
        if taken:
            places[:, j] = places[0, j - 1], places[1, j - 1], -1.0
            continue
        places[:2, j] = len(columns), len(columns) + 1 if two[j] else -1.0
        columns += [Y[:, j].real, Y[:, j].imag] if two[j] else [Y[:, j].real]
    return np.array(columns), places


def _rows(A: Any, X: Any) -> Any:
    """``X A^T``, row-major."""
    import cupy

    if hasattr(A, "tocsr"):
        return cupy.ascontiguousarray((A @ X.T).T)
    return _multiplied(A, X, len(X), len(A), True)


def _multiplied(B: Any, X: Any, rows: int, inner: int, transposed: bool) -> Any:
    """``X B`` or ``X B^T``."""
    import cupy

    n = B.shape[1]
    product = cupy.empty((rows, n))
    with DeviceBlas() as (cublas, handle):
        # The library is column-major: it sees the transposes of all three matrices.
        operation = cublas.CUBLAS_OP_T if transposed else cublas.CUBLAS_OP_N
        cublas.dgemm(
            handle, operation, cublas.CUBLAS_OP_N, n, rows, inner, ONE, B.data.ptr, n, X.data.ptr,
            inner, ZERO, product.data.ptr, n,
        )  # fmt: skip
    return product


def _moved(values: np.ndarray) -> Any:
    """An asynchronous copy on the device; the host array may be changed after the call."""
    import cupy

    moved = cupy.empty(values.shape)
    moved.data.copy_from_host_async(
        values.ctypes.data, values.nbytes, cupy.cuda.get_current_stream()
    )
    return moved
