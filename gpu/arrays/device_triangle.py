r"""Triangular systems on a device by matrix products.

In the library's triangular solve each row waits for the one before. With the inverses
:math:`X_i = L_{ii}^{-1}` of diagonal blocks ([1]_, section 14.2, which shows that this is as stable
as substitution if the blocks are well conditioned), :math:`LU = R` is solved by

.. math:: U_i = X_iR_i, \quad R_j \leftarrow R_j - L_{ji}U_i \quad (j > i),

and :math:`L^TU = R` likewise from the last block to the first: two products per block, limited by
memory bandwidth for one column and by arithmetic for many. The inverses are built from those of
half the size,

.. math:: \begin{pmatrix} A & \\ C & D \end{pmatrix}^{-1} =
          \begin{pmatrix} A^{-1} & \\ -D^{-1}CA^{-1} & D^{-1} \end{pmatrix},

for all blocks at once, beginning with triangles of 32 rows.

References
----------
.. [1] N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd ed., SIAM (2002).
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from gpu.arrays.device_blas import MINUS, ONE, ZERO, DeviceBlas
from gpu.cuda.catalogue import kernel

Array = Any  # cupy.ndarray
SIDE = 32  # rows of the triangles where inversion begins, one for each warp of the kernel


class DeviceTriangle:
    """A lower triangular matrix with the inverses of its diagonal blocks."""

    def __init__(self, L: Array) -> None:
        assert L.flags.f_contiguous
        self.L, self.n = L, len(L)
        self.size = SIDE
        # Larger blocks cost more to invert than the products save.
        while self.size < min(self.n, 1024):
            self.size *= 2
        self.inverses = _inverses(self._blocks())

    def _blocks(self) -> Array:
        """Copies of the diagonal blocks, the last one padded with the identity."""
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

        n, size = self.n, self.size
        left = r.copy(order="F") if r.ndim == 2 else r.copy()
        u = cupy.empty_like(left)
        columns = 1 if r.ndim == 1 else r.shape[1]
        multiply = _one if columns == 1 else functools.partial(_many, columns)
        begins = range(0, n, size)
        with DeviceBlas() as (cublas, handle):
            for i in reversed(begins) if transposed else begins:
                rows = min(size, n - i)
                block = self.inverses.data.ptr + 8 * i * size
                here, there = left.data.ptr + 8 * i, u.data.ptr + 8 * i
                # Memory by rows is the transpose of memory by columns.
                multiply(
                    cublas, handle, not transposed, rows, rows, ONE, block, size,
                    here, ZERO, there, n,
                )  # fmt: skip
                if transposed and i:
                    multiply(
                        cublas, handle, True, rows, i, MINUS, self.L.data.ptr + 8 * i, n,
                        there, ONE, left.data.ptr, n,
                    )  # fmt: skip
                if not transposed and i + rows < n:
                    below = self.L.data.ptr + 8 * (i * (n + 1) + rows)
                    multiply(
                        cublas, handle, False, n - i - rows, rows, MINUS, below, n,
                        there, ONE, here + 8 * rows, n,
                    )  # fmt: skip
        return u

    def solve_both(self, r: Array) -> Array:
        """Solve ``L L' u = r``."""
        return self.solve(self.solve(r), transposed=True)


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
    """As `_one` for matrices x and y with leading dimension ld."""
    operation = cublas.CUBLAS_OP_T if transposed else cublas.CUBLAS_OP_N
    if transposed:
        m, n = n, m
    cublas.dgemm(
        handle, operation, cublas.CUBLAS_OP_N, m, columns, n, alpha, A, lda, x, ld, beta, y, ld
    )


def _inverses(blocks: Array) -> Array:
    """Inverses of lower triangles, shape (count, size, size); entries above are not read."""
    import cupy

    count, size, _ = blocks.shape
    inverses = cupy.zeros_like(blocks)
    invert = kernel("triangle", "triangle_invert")
    invert((count * size // SIDE,), (SIDE,), (blocks, inverses, np.int32(size)))
    with DeviceBlas() as (cublas, handle):
        multiply, keep = cublas.dgemmStridedBatched, cublas.CUBLAS_OP_N
        half = SIDE
        while half < size:
            # The pairs of triangles along the diagonal of a block have a constant stride in memory,
            # and so have the blocks. The loop runs over the fewer, the batch over the others.
            inner, outer = (size // (2 * half), 2 * half * (size + 1)), (count, size * size)
            (turns, jump), (batch, stride) = sorted((inner, outer))
            work = cupy.empty((batch, half, half))
            below, last = half * size, half * (size + 1)
            for begin in range(0, turns * jump, jump):
                first = inverses.data.ptr + 8 * begin
                # Memory by rows is the transpose of memory by columns: C A, then -D (C A).
                multiply(
                    handle, keep, keep, half, half, half, ONE, first, size, stride,
                    blocks.data.ptr + 8 * (begin + below), size, stride,
                    ZERO, work.data.ptr, half, half * half, batch,
                )  # fmt: skip
                multiply(
                    handle, keep, keep, half, half, half, MINUS, work.data.ptr, half, half * half,
                    first + 8 * last, size, stride,
                    ZERO, first + 8 * below, size, stride, batch,
                )  # fmt: skip
            half *= 2
    return inverses
