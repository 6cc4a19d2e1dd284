"""Dense kernels: SciPy's on the host (see `ground.arrays`), cuBLAS and cuSOLVER on a device.

On a device the libraries are called directly: `cupy.linalg.cholesky` copies the matrix, clears the
other triangle and waits for the device, which takes twice the time of the factorisation.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.linalg.blas import dsymv, dsyrk, ssyrk
from scipy.linalg.lapack import dpotrs

from gpu.arrays.device_blas import MINUS, ONE, ZERO, DeviceBlas
from gpu.cuda.catalogue import kernel
from skfem_adini.ground import arrays

Array = Any  # numpy.ndarray or cupy.ndarray


def symmetric_product(P: Array, x: Array) -> Array:
    """``P x`` for a symmetric P in row-major order."""
    return dsymv(1.0, P.T, x, lower=1) if isinstance(P, np.ndarray) else P @ x


def cholesky(M: Array) -> Array:
    """Lower Cholesky factor of the symmetric M, which is overwritten, or `LinAlgError` if M is not
    positive definite. What is above the diagonal is undefined."""
    L, check = cholesky_begun(M)
    check()
    return L


def cholesky_begun(M: Array) -> tuple[Array, Callable[[], None]]:
    """As `cholesky` without waiting for the device: the factor, and a function that waits and
    raises `LinAlgError`; on the host the error is raised at once."""
    if not M.size:
        return M, lambda: None
    if isinstance(M, np.ndarray):
        return arrays.cholesky(M.T), lambda: None
    L, minor = _device_cholesky(M)

    def check() -> None:
        if int(minor):
            raise np.linalg.LinAlgError(f"leading minor {int(minor)} is not positive")

    return L, check


def cholesky_solve(L: Array, r: Array) -> Array:
    """Solve ``L L' u = r``."""
    if not isinstance(L, np.ndarray):
        return lower_solve(L, lower_solve(L, r), transposed=True)
    return dpotrs(L, r, lower=1)[0] if r.size else r


def lower_solve(L: Array, r: Array, transposed: bool = False) -> Array:
    """Solve ``L u = r`` or ``L' u = r``."""
    if not r.size:
        return r
    if not isinstance(L, np.ndarray):
        return _device_lower_solve(L, r, transposed)
    return arrays.lower_solve(L, r, transposed)


def _device_cholesky(M: Array) -> tuple[Array, Array]:
    import cupy
    from cupy.cuda import device
    from cupy_backends.cuda.libs import cublas, cusolver

    M = cupy.ascontiguousarray(M)
    n, handle = len(M), device.get_cusolver_handle()
    # Row-major memory is the column-major transpose, which is the same symmetric matrix.
    size = cusolver.dpotrf_bufferSize(handle, cublas.CUBLAS_FILL_MODE_LOWER, n, M.data.ptr, n)
    work, info = cupy.empty(size), cupy.empty((), dtype=cupy.int32)
    cusolver.dpotrf(
        handle, cublas.CUBLAS_FILL_MODE_LOWER, n, M.data.ptr, n, work.data.ptr, size, info.data.ptr
    )
    return M.T, info


def _device_lower_solve(L: Array, r: Array, transposed: bool) -> Array:
    import cupy

    u = r.copy(order="F") if r.ndim == 2 else r.copy()
    n, columns = len(L), 1 if r.ndim == 1 else r.shape[1]
    assert L.flags.f_contiguous
    # With few columns the solve is limited by memory bandwidth: products with the rows below a
    # diagonal block have fewer dependencies than the triangular solve of the library.
    block = 2048 if 1 < columns <= 16 and not transposed else n
    with DeviceBlas() as (cublas, handle):
        operation = cublas.CUBLAS_OP_T if transposed else cublas.CUBLAS_OP_N
        for i in range(0, n, block):
            size = min(block, n - i)
            corner, top, rest = L.data.ptr + 8 * i * (n + 1), u.data.ptr + 8 * i, n - i - size
            cublas.dtrsm(
                handle, cublas.CUBLAS_SIDE_LEFT, cublas.CUBLAS_FILL_MODE_LOWER, operation,
                cublas.CUBLAS_DIAG_NON_UNIT, size, columns, ONE, corner, n, top, n,
            )  # fmt: skip
            if rest:
                cublas.dgemm(
                    handle, cublas.CUBLAS_OP_N, cublas.CUBLAS_OP_N, rest, columns, size,
                    MINUS, corner + 8 * size, n, top, n, ONE, top + 8 * size, n,
                )  # fmt: skip
    return cupy.asarray(u)


def gram(Y: Array) -> Array:
    """``Y Y'`` for Y in row-major order; on a device only one triangle is computed and mirrored."""
    if isinstance(Y, np.ndarray):
        return Y @ Y.T
    import cupy

    Y = cupy.ascontiguousarray(Y)
    rows, n = Y.shape
    M = cupy.empty((rows, rows))
    with DeviceBlas() as (cublas, handle):
        cublas.dsyrk(
            handle, cublas.CUBLAS_FILL_MODE_LOWER, cublas.CUBLAS_OP_T, rows, n, ONE, Y.data.ptr, n,
            ZERO, M.data.ptr, rows,
        )  # fmt: skip
    # The lower triangle in column-major order is the upper one in row-major order.
    return cupy.triu(M) + cupy.triu(M, 1).T


def add_gram(H: Array, Y: Array) -> Array:
    """``H + Y'Y`` in place of H, for H and Y in row-major order; on the host what is below the
    diagonal is left as it was."""
    if not isinstance(H, np.ndarray):
        H += Y.T @ Y
        return H
    syrk = dsyrk if H.dtype == np.float64 else ssyrk
    return syrk(1.0, Y.T, beta=1.0, c=H.T, lower=1, overwrite_c=1).T


def symmetric_and_finite(M: Array) -> bool:
    """Whether a device matrix is its own transpose and has no NaN or infinity, in one pass."""
    import cupy

    M = cupy.ascontiguousarray(M)
    wrong = cupy.zeros(1, dtype=cupy.int32)
    tile = 32  # as in the kernel
    blocks = -(-len(M) // tile)
    check = kernel("symmetric", "symmetric_check")
    check((blocks, blocks), (tile, 8), (M, np.int64(len(M)), wrong))
    return not int(wrong[0])


def scaled_symmetric(M: Array, scale: Array) -> Array:
    """``D M D`` with the diagonal D of `scale`, for a device matrix, in one pass."""
    import cupy

    product = cupy.ElementwiseKernel(
        "float64 m, float64 row, float64 column", "float64 out", "out = m * row * column",
        "gpu_scaled_symmetric",
    )  # fmt: skip
    return product(M, scale[:, None], scale)


_filters = threading.Lock()  # the filters of warnings are shared by all threads


def device_lu(A: Any) -> Any:
    """LU factors and pivots of a CuPy array, without CuPy's warning about zero pivots: callers
    check them and raise an error in terms of their problem."""
    from cupyx.scipy.linalg import lu_factor

    with _filters, warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return lu_factor(A, check_finite=False)


def device_solver(M: Any) -> Callable[[Any], Any]:
    """The function ``x -> M^-1 x``; raises `LinAlgError` if M is exactly singular."""
    from cupyx.scipy.linalg import lu_solve

    device = device_lu(M)
    if not bool(device[0].diagonal().all()):
        raise np.linalg.LinAlgError("singular matrix")
    return lambda x: lu_solve(device, x, check_finite=False)
