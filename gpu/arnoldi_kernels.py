"""Arnoldi steps on the device: one cooperative launch a step, or a sweep for a dense matrix.

A step is a product, two projections, two updates and a norm. As separate library calls these cost
some twenty launches; for matrices of a few thousand rows the launches take longer than the work.
Here all blocks of one launch, one a multiprocessor, own a range of rows each and meet three times
a step. Sums are taken in a fixed order, so that a run repeats bit by bit on one device.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from gpu.errors import InputError

THREADS = 1024
SHARED = 48 * 1024  # bytes a block may have on every device without asking

SOURCE = r"""
#define WARPS 32   // of a block
#define TILE 256   // entries of a vector that are updated and projected together
#define GROUPS 4   // threads that share an entry
#define SUMS 2048  // shared partial sums of the product

typedef long long index;

__device__ double over_warp(double s)
{
    for (int apart = 16; apart; apart >>= 1)
        s += __shfl_xor_sync(0xffffffffu, s, apart);
    return s;
}

// All blocks have arrived `goal` times in all; the count may wrap around.
__device__ void meet(unsigned int* gate, unsigned int goal)
{
    __syncthreads();
    if (threadIdx.x == 0) {
        __threadfence();
        atomicAdd(gate, 1u);
        while ((int)(*(volatile unsigned int*)gate - goal) < 0) { }
        __threadfence();
    }
    __syncthreads();
}

// u <- source - V' h on the rows of this block, then dots <- V u there and the sum of u^2.
__device__ __noinline__ double pass(const double* V, index n, int count, const double* source,
                                    double* u, index begin, index end, const double* h,
                                    double* dots, double* shared)
{
    double* tile = shared;
    double* share = shared + TILE;
    const int thread = threadIdx.x, lane = thread & 31, warp = thread >> 5;
    const int column = thread % TILE, group = thread / TILE;
    double square = 0.0;
    if (dots)
        for (int j = thread; j < count; j += blockDim.x)
            dots[j] = 0.0;
    for (index base = begin; base < end; base += TILE) {
        const index i = base + column;
        if (h) {
            double taken = 0.0;
            if (i < end) {
                #pragma unroll 8
                for (int j = group; j < count; j += GROUPS)
                    taken += h[j] * V[j * n + i];
            }
            share[thread] = taken;
        }
        __syncthreads();
        if (group == 0) {
            double value = 0.0;
            if (i < end) {
                value = source[i];
                if (h)
                    value -= (share[column] + share[column + TILE])
                        + (share[column + 2 * TILE] + share[column + 3 * TILE]);
                u[i] = value;
            }
            tile[column] = value;
            square += value * value;
        }
        __syncthreads();
        if (dots) {
            const int width = (int)(end - base < TILE ? end - base : TILE);
            for (int j = warp; j < count; j += WARPS) {
                double s = 0.0;
                #pragma unroll 8
                for (int c = lane; c < width; c += 32)
                    s += V[j * n + base + c] * tile[c];
                s = over_warp(s);
                if (lane == 0)
                    dots[j] += s;
            }
        }
    }
    __syncthreads();
    square = over_warp(square);
    if (lane == 0)
        share[warp] = square;
    __syncthreads();
    square = 0.0;
    for (int w = 0; w < TILE / 32; ++w)
        square += share[w];
    __syncthreads();
    return square;
}

// Sum over the blocks; every block does it for itself, in the same order.
__device__ double over_blocks(const double* part)
{
    double s = 0.0;
    for (int b = threadIdx.x & 31; b < gridDim.x; b += 32)
        s += __ldcg(part + b);
    return over_warp(s);
}

__device__ void gather(const double* part, int count, double* h)
{
    for (int j = threadIdx.x >> 5; j < count; j += WARPS) {
        const double s = over_blocks(part + (index)j * gridDim.x);
        if ((threadIdx.x & 31) == 0)
            h[j] = s;
    }
    __syncthreads();
}

// Gram-Schmidt twice of `source` against the first j + 1 rows of V, then row j + 1 of V.
// Returns 1 / beta, or 1 where beta is zero.
__device__ double orthogonalise(double* V, double* row, const double* source, double* u,
                                double* parts, unsigned int* gate, unsigned int* goal,
                                index n, int size, int j, index begin, index end, double* shared)
{
    double* h = shared + SUMS;
    double* dots = h + size;
    const int count = j + 1, block = blockIdx.x;
    // One buffer a meeting: who is ahead must not overwrite what others still read.
    double* part[3];
    for (int k = 0; k < 3; ++k)
        part[k] = parts + (index)k * size * gridDim.x;
    for (int k = 0; k < 2; ++k) {
        pass(V, n, count, k ? u : source, u, begin, end, k ? h : 0, dots, shared);
        for (int i = threadIdx.x; i < count; i += blockDim.x)
            part[k][(index)i * gridDim.x + block] = dots[i];
        meet(gate, *goal += gridDim.x);
        gather(part[k], count, h);
        if (block == 0)
            for (int i = threadIdx.x; i < count; i += blockDim.x)
                row[i] = k ? row[i] + h[i] : h[i];
    }
    const double square = pass(V, n, count, u, u, begin, end, h, 0, shared);
    if (threadIdx.x == 0)
        part[2][block] = square;
    meet(gate, *goal += gridDim.x);
    const double beta = sqrt(over_blocks(part[2]));
    const double inverse = beta > 0.0 ? 1.0 / beta : 1.0;
    for (index i = begin + threadIdx.x; i < end; i += blockDim.x)
        V[count * n + i] = u[i] * inverse;
    if (block == 0 && threadIdx.x == 0)
        row[size + 1] = beta;
    return inverse;
}

// u <- A (scale x) on the rows of this block.
__device__ void product(const double* __restrict__ A, const double* x, double scale, double* u,
                        index n, index begin, index end, double* sums)
{
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
    const int rows = (int)(end - begin);
    // Short tasks even out the load; neighbouring warps read the same piece of x.
    index pieces = (n + 1023) / 1024;
    if (n < 1024)
        pieces = rows < 32 ? (n + 127) / 128 : 1;
    if (pieces * rows > SUMS)
        pieces = SUMS / rows;
    const index width = (n + 2 * pieces - 1) / (2 * pieces) * 2;
    for (int task = warp; task < pieces * rows; task += WARPS) {
        const index low = task / rows * width;
        const index high = low + width < n ? low + width : n;
        const double* a = A + (begin + task % rows) * n;
        double s = 0.0, t = 0.0;
        if (n % 2 == 0) {
            #pragma unroll 4
            for (index i = low + 2 * lane; i < high; i += 64) {
                const double2 entry = __ldg((const double2*)(a + i));
                const double2 value = *(const double2*)(x + i);
                s += entry.x * (value.x * scale);
                t += entry.y * (value.y * scale);
            }
        } else {
            #pragma unroll 8
            for (index i = low + lane; i < high; i += 32)
                s += __ldg(a + i) * (x[i] * scale);
        }
        s = over_warp(s + t);
        if (lane == 0)
            sums[task] = s;
    }
    __syncthreads();
    for (int r = threadIdx.x; r < rows; r += blockDim.x) {
        double s = 0.0;
        for (int p = 0; p < pieces; ++p)
            s += sums[p * rows + r];
        u[begin + r] = s;
    }
    __syncthreads();
}

extern "C" __global__ void __launch_bounds__(1024, 1)
arnoldi_step(double* V, double* rows, const double* w, double* u, double* parts,
             unsigned int* gate, unsigned int goal, index n, int size, int j)
{
    extern __shared__ double shared[];
    const index chunk = (n + gridDim.x - 1) / gridDim.x;
    const index begin = blockIdx.x * chunk < n ? blockIdx.x * chunk : n;
    const index end = begin + chunk < n ? begin + chunk : n;
    orthogonalise(V, rows + (index)j * (size + 2), w, u, parts, gate, &goal, n, size, j, begin,
                  end, shared);
}

extern "C" __global__ void __launch_bounds__(1024, 1)
arnoldi_sweep(const double* __restrict__ A, double* V, double* rows, double* u, double* parts,
              unsigned int* gate, unsigned int goal, index n, int size, int first, int last)
{
    extern __shared__ double shared[];
    const index chunk = (n + gridDim.x - 1) / gridDim.x;
    const index begin = blockIdx.x * chunk < n ? blockIdx.x * chunk : n;
    const index end = begin + chunk < n ? begin + chunk : n;
    const index stride = (n + 1) / 2 * 2;
    double scale = 1.0;
    const double* x = V + first * n;
    for (int j = first; j < last; ++j) {
        // Other blocks still read what the last step left, so the two vectors take turns.
        double* next = u + (j & 1) * stride;
        for (index at = begin; at < end; at += SUMS / 2)
            product(A, x, scale, next, n, at, at + SUMS / 2 < end ? at + SUMS / 2 : end, shared);
        scale = orthogonalise(V, rows + (index)j * (size + 2), next, next, parts, gate, &goal, n,
                              size, j, begin, end, shared);
        x = next;
    }
}
"""


class FusedSteps:
    """Arnoldi steps in place on the rows of V, for real arrays of CuPy.

    Parameters
    ----------
    V : cupy.ndarray of float64, shape (size + 1, n)
        The basis.
    coefficients : cupy.ndarray of float64, shape (size, size + 2)
        Row j gets the coefficients of step j, and its beta in the last entry.

    Raises
    ------
    InputError
        The coefficients of a step do not fit into shared memory.
    """

    def __init__(self, V: Any, coefficients: Any) -> None:
        import cupy

        self._V, self._rows = V, coefficients
        self.size, self.n = len(coefficients), V.shape[1]
        attributes = cupy.cuda.Device().attributes
        self._blocks = int(attributes["MultiProcessorCount"])
        self._shared = 8 * (2048 + 2 * self.size)
        if self._shared > attributes["MaxSharedMemoryPerBlockOptin"]:
            raise InputError(f"ncv={self.size} is too large for the shared memory of this device")
        self._u = cupy.empty((2, (self.n + 1) // 2 * 2))
        self._parts = cupy.empty((3, self.size, self._blocks))
        self._gate = cupy.zeros(1, dtype=cupy.uint32)
        self._arrived = 0

    def __call__(self, w: Any, j: int) -> None:
        """Orthogonalise w, which is ``A V[j]``, into row j + 1."""
        import cupy

        self._launch(
            "arnoldi_step",
            1,
            lambda goal: (
                self._V,
                self._rows,
                cupy.ascontiguousarray(w, dtype=float),
                self._u,
                self._parts,
                self._gate,
                goal,
                np.int64(self.n),
                np.int32(self.size),
                np.int32(j),
            ),
        )

    @staticmethod
    def multiplies(A: Any) -> bool:
        """Whether `sweep` can read this matrix: real, dense, rows together, entries in pairs."""
        dense = hasattr(A, "flags") and A.dtype == np.float64 and A.flags.c_contiguous
        return bool(dense and A.data.ptr % 16 == 0)

    def sweep(self, A: Any, first: int, last: int) -> None:
        """All steps from row `first` up to row `last` with a dense matrix, in one launch.

        Parameters
        ----------
        A : cupy.ndarray of float64, shape (n, n)
            One that `multiplies` accepts.
        first, last : int
        """
        if first >= last:
            return
        self._launch(
            "arnoldi_sweep",
            last - first,
            lambda goal: (
                A,
                self._V,
                self._rows,
                self._u,
                self._parts,
                self._gate,
                goal,
                np.int64(self.n),
                np.int32(self.size),
                np.int32(first),
                np.int32(last),
            ),
        )

    def _launch(self, name: str, steps: int, arguments: Any) -> None:
        kernel = _kernel(name)
        if self._shared > SHARED:
            kernel.max_dynamic_shared_size_bytes = self._shared
        goal = np.uint32(self._arrived % 2**32)
        kernel((self._blocks,), (THREADS,), arguments(goal), shared_mem=self._shared)
        self._arrived += 3 * steps * self._blocks


@functools.cache
def _kernel(name: str) -> Any:
    """The compiled kernel; CuPy compiles it anew for each device.

    A cooperative launch is refused unless all blocks run at once, without which they could not
    meet.
    """
    import cupy

    return cupy.RawKernel(SOURCE, name, options=("--std=c++17",), enable_cooperative_groups=True)
