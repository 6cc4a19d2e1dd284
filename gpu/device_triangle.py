r"""Triangular systems on a device by matrix products.

The library's triangular solve waits for one row after the other. With the inverses
:math:`X_i = L_{ii}^{-1}` of diagonal blocks ([1]_, section 14.2, which shows that this is as stable
as substitution where the blocks are well conditioned), :math:`LU = R` is

.. math:: U_i = X_iR_i, \quad R_j \leftarrow R_j - L_{ji}U_i \quad (j > i),

and :math:`L^TU = R` the same from below: two products a block, at the speed of memory for one
column and of arithmetic for many. The inverses follow from those of half the size,

.. math:: \begin{pmatrix} A & \\ C & D \end{pmatrix}^{-1} =
          \begin{pmatrix} A^{-1} & \\ -D^{-1}CA^{-1} & D^{-1} \end{pmatrix},

all blocks at once, beginning with triangles of 32 rows.

References
----------
.. [1] N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd ed., SIAM (2002).
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from gpu.triangle_source import SOURCE

Array = Any  # cupy.ndarray
LARGEST_BLOCK, SIDE = 1024, 32


class DeviceTriangle:
    """A lower triangular matrix with the inverses of its diagonal blocks."""

    def __init__(self, L: Array) -> None:
        assert L.flags.f_contiguous
        self.L, self.n = L, len(L)
        self.size = SIDE
        while self.size < min(self.n, LARGEST_BLOCK):
            self.size *= 2
        self.inverses = _inverses(self._blocks())

    def _blocks(self) -> Array:
        """Copies of the diagonal blocks, the last one filled up with the identity."""
        import cupy

        n, size = self.n, self.size
        blocks = cupy.zeros((-(-n // size), size, size))
        whole, step = n // size, 8 * size * (n + 1)
        diagonal = cupy.lib.stride_tricks.as_strided(
            self.L, (whole, size, size), (step, *self.L.strides)
        )
        blocks[:whole] = diagonal
        rest = n - whole * size
        if rest:
            blocks[-1, :rest, :rest] = self.L[n - rest :, n - rest :]
            i = cupy.arange(rest, size)
            blocks[-1, i, i] = 1.0
        return blocks

    def solve(self, r: Array, transposed: bool = False) -> Array:
        """Solve ``L u = r`` or ``L' u = r``, r with one column or many."""
        import cupy
        from cupy.cuda import device
        from cupy_backends.cuda.libs import cublas

        n, size = self.n, self.size
        left = r.copy(order="F") if r.ndim == 2 else r.copy()
        u = cupy.empty_like(left)
        columns = 1 if r.ndim == 1 else r.shape[1]
        one, minus, zero = np.ones(1), -np.ones(1), np.zeros(1)
        scalars = tuple(value.ctypes.data for value in (one, minus, zero))
        handle = device.get_cublas_handle()
        mode = cublas.getPointerMode(handle)
        cublas.setPointerMode(handle, cublas.CUBLAS_POINTER_MODE_HOST)
        multiply = _one if columns == 1 else functools.partial(_many, columns)
        begins = range(0, n, size)
        try:
            for i in reversed(begins) if transposed else begins:
                rows = min(size, n - i)
                block = self.inverses.data.ptr + 8 * i * size
                here, there = left.data.ptr + 8 * i, u.data.ptr + 8 * i
                # Memory by rows is the transpose of memory by columns.
                multiply(
                    cublas, handle, not transposed, rows, rows, scalars[0], block, size,
                    here, scalars[2], there, n,
                )  # fmt: skip
                if transposed and i:
                    multiply(
                        cublas, handle, True, rows, i, scalars[1], self.L.data.ptr + 8 * i, n,
                        there, scalars[0], left.data.ptr, n,
                    )  # fmt: skip
                if not transposed and i + rows < n:
                    below = self.L.data.ptr + 8 * (i * (n + 1) + rows)
                    multiply(
                        cublas, handle, False, n - i - rows, rows, scalars[1], below, n,
                        there, scalars[0], here + 8 * rows, n,
                    )  # fmt: skip
        finally:
            cublas.setPointerMode(handle, mode)
        return u


def _one(
    cublas: Any, handle: int, transposed: bool, m: int, n: int, alpha: int, A: int, lda: int,
    x: int, beta: int, y: int, ld: int,
) -> None:  # fmt: skip
    """``y = alpha A x + beta y`` or the same with A'; A has m rows and n columns."""
    operation = cublas.CUBLAS_OP_T if transposed else cublas.CUBLAS_OP_N
    cublas.dgemv(handle, operation, m, n, alpha, A, lda, x, 1, beta, y, 1)


def _many(
    columns: int, cublas: Any, handle: int, transposed: bool, m: int, n: int, alpha: int,
    A: int, lda: int, x: int, beta: int, y: int, ld: int,
) -> None:  # fmt: skip
    """The same for matrices x and y with leading dimension ld."""
    operation = cublas.CUBLAS_OP_T if transposed else cublas.CUBLAS_OP_N
    if transposed:
        m, n = n, m
    cublas.dgemm(
        handle, operation, cublas.CUBLAS_OP_N, m, columns, n, alpha, A, lda, x, ld, beta, y, ld
    )


def _inverses(blocks: Array) -> Array:
    """Inverses of lower triangles, shape (count, size, size); what is above them is not read."""
    import cupy

    count, size, _ = blocks.shape
    inverses = cupy.zeros_like(blocks)
    invert = _inversion()
    invert((count * size // SIDE,), (SIDE,), (blocks, inverses, np.int32(size)))
    half = SIDE
    while half < size:
        shape = (count, size // (2 * half), half, half)
        strides = (8 * size * size, 16 * half * (size + 1), 8 * size, 8)

        def part(
            M: Array, row: int, column: int, shape: Any = shape, strides: Any = strides
        ) -> Any:
            corner = M[:, row:, column:]
            return cupy.lib.stride_tricks.as_strided(corner, shape, strides)

        A, D = part(inverses, 0, 0), part(inverses, half, half)
        part(inverses, half, 0)[...] = -(D @ (part(blocks, half, 0) @ A))
        half *= 2
    return inverses


@functools.cache
def _inversion() -> Any:
    import cupy

    return cupy.RawKernel(SOURCE, "triangle_invert", options=("--std=c++17",))
