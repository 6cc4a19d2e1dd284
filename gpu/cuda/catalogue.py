"""All CUDA sources of this package, one or two kernels each, in one table, from which tests compile
them by NVRTC for each architecture, without a GPU or a driver.
"""

from __future__ import annotations

import functools
from typing import Any

from gpu.cuda import arnoldi, dual_active_set

OPTIONS = ("--std=c++17",)
ARCHITECTURES = ("sm_75", "sm_80", "sm_86", "sm_89", "sm_90", "sm_100", "sm_120")
SOURCES = {
    "arnoldi": arnoldi.SOURCE,
    "dual_active_set": dual_active_set.SOURCE,
    "dual_active_set_far": "#define FAR\n" + dual_active_set.SOURCE,
    # The largest modulus among real numbers.
    "modulus": r"""
// As whole numbers the moduli have the same order, and infinity and NaN come last. `largest` must
// be zero before.
extern "C" __global__ void modulus_largest(const double* __restrict__ a, long long size,
                                           unsigned long long* largest)
{
    unsigned long long most = 0;
    const long long step = (long long)gridDim.x * blockDim.x;
    #pragma unroll 8
    for (long long i = blockIdx.x * (long long)blockDim.x + threadIdx.x; i < size; i += step) {
        const unsigned long long bits = __double_as_longlong(fabs(a[i]));
        most = bits > most ? bits : most;
    }
    for (int apart = 16; apart; apart >>= 1) {
        const unsigned long long other = __shfl_xor_sync(0xffffffffu, most, apart);
        most = other > most ? other : most;
    }
    if ((threadIdx.x & 31) == 0)
        atomicMax(largest, most);
}
""",
    # Ritz vectors: in-place rotation of a basis, and residuals of pairs with their vectors.
    "ritz": r"""
typedef long long index;

// The columns of Q for the first `count` rows of V, in place, then the `residual`-th: one column
// of V a thread, `kept` by rows of the transposed Q.
extern "C" __global__ void ritz_rotate(double* V, const double* __restrict__ Q, index n,
                                       int count, int kept, int residual)
{
    extern __shared__ double tile[];
    const int width = 32, column = threadIdx.x % width;
    const int groups = blockDim.x / width, group = threadIdx.x / width;
    const index i = blockIdx.x * (index)width + column;
    double last = 0.0;
    if (i < n) {
        for (int j = group; j < count; j += groups)
            tile[j * width + column] = V[j * n + i];
        if (group == 0)
            last = V[residual * n + i];
    }
    __syncthreads();
    if (i >= n)
        return;
    for (int row = 4 * group; row < kept; row += 4 * groups) {
        double sum[4] = {0.0, 0.0, 0.0, 0.0};
        for (int j = 0; j < count; ++j) {
            const double value = tile[j * width + column];
            #pragma unroll
            for (int q = 0; q < 4; ++q)
                if (row + q < kept)
                    sum[q] += Q[(row + q) * count + j] * value;
        }
        #pragma unroll
        for (int q = 0; q < 4; ++q)
            if (row + q < kept)
                V[(row + q) * n + i] = sum[q];
    }
    if (group == 0)
        V[kept * n + i] = last;
}

// One block a pair (alpha + i beta, x + i sign y), where x and y are rows of X; no y where `second`
// is negative. left and right hold the rows A x and M x. Writes the vectors and the squares of
// |A z - (alpha + i beta) M z| and |A z|, z = x + i sign y.
extern "C" __global__ void __launch_bounds__(1024, 1)
ritz_residual(const double* left, const double* right, const double* X, const double* pairs,
              index n, int k, double2* vectors, double* squares)
{
    __shared__ double sums[2][32];
    const int pair = blockIdx.x;
    const double alpha = pairs[pair], beta = pairs[k + pair], sign = pairs[4 * k + pair];
    const index first = (index)pairs[2 * k + pair] * n, second = (index)pairs[3 * k + pair] * n;
    double error = 0.0, size = 0.0;
    for (index i = threadIdx.x; i < n; i += blockDim.x) {
        const bool two = second >= 0;
        const double x = right[first + i], y = two ? sign * right[second + i] : 0.0;
        const double u = left[first + i], v = two ? sign * left[second + i] : 0.0;
        const double real = u - alpha * x + beta * y, imaginary = v - beta * x - alpha * y;
        error += real * real + imaginary * imaginary;
        size += u * u + v * v;
        vectors[pair * n + i] = make_double2(X[first + i], two ? sign * X[second + i] : 0.0);
    }
    for (int apart = 16; apart; apart >>= 1) {
        error += __shfl_xor_sync(0xffffffffu, error, apart);
        size += __shfl_xor_sync(0xffffffffu, size, apart);
    }
    if ((threadIdx.x & 31) == 0) {
        sums[0][threadIdx.x >> 5] = error;
        sums[1][threadIdx.x >> 5] = size;
    }
    __syncthreads();
    if (threadIdx.x < 2) {
        double s = 0.0;
        for (int w = 0; w < 32; ++w)
            s += sums[threadIdx.x][w];
        squares[threadIdx.x * k + pair] = s;
    }
}
""",
    # Compares a matrix with its transpose, each entry read once.
    # A block compares a tile below the diagonal with its mirror image above, which is transposed in
    # shared memory, so that both are read along their rows.
    "symmetric": r"""
#define TILE 32

// wrong[0] = 1 where the n x n matrix M, row by row, is not its own transpose or not finite.
extern "C" __global__ void symmetric_check(const double* M, long long n, int* wrong)
{
    if (blockIdx.x > blockIdx.y) return;
    __shared__ double mirror[TILE][TILE + 1];
    const long long row = (long long)blockIdx.y * TILE, column = (long long)blockIdx.x * TILE;
    for (int k = threadIdx.y; k < TILE; k += blockDim.y) {
        const long long i = column + k, j = row + threadIdx.x;
        mirror[k][threadIdx.x] = i < n && j < n ? M[i * n + j] : 0.0;
    }
    __syncthreads();
    bool good = true;
    for (int k = threadIdx.y; k < TILE; k += blockDim.y) {
        const long long i = row + k, j = column + threadIdx.x;
        if (i < n && j < n) {
            const double a = M[i * n + j];
            good = good && a == mirror[threadIdx.x][k] && isfinite(a);
        }
    }
    if (!good) wrong[0] = 1;
}
""",
    # Inverts small triangles of one matrix, each by a warp: a thread takes a column of the inverse
    # and keeps it in registers; the triangle is in shared memory.
    "triangle": r"""
#define SIDE 32

// L and X: blocks of size x size, row by row; each SIDE x SIDE lower triangle on the diagonal of
// a block of L is inverted into X.
extern "C" __global__ void triangle_invert(const double* L, double* X, int size)
{
    const int a_block = size / SIDE;
    const long long block = blockIdx.x / a_block, corner = blockIdx.x % a_block;
    const long long first = block * size * size + corner * SIDE * (size + 1);
    const int j = threadIdx.x;
    __shared__ double triangle[SIDE][SIDE];
    for (int i = 0; i < SIDE; ++i)
        triangle[i][j] = L[first + (long long)i * size + j];
    __syncthreads();
    double x[SIDE];
#pragma unroll
    for (int i = 0; i < SIDE; ++i) {
        double sum = i == j ? 1.0 : 0.0;
#pragma unroll
        for (int k = 0; k < i; ++k)
            sum -= triangle[i][k] * x[k];
        x[i] = sum / triangle[i][i];
        X[first + (long long)i * size + j] = x[i];
    }
}
""",
}


@functools.cache
def kernel(source: str, name: str, **options: Any) -> Any:
    """A kernel of one of the sources, for launches; CuPy compiles it anew for each device."""
    import cupy

    return cupy.RawKernel(SOURCES[source], name, options=OPTIONS, **options)


@functools.cache
def limits(device: int, *names: str) -> tuple[int, ...]:
    """Attributes of a device, by CUDA's names."""
    import cupy

    attributes = cupy.cuda.Device(device).attributes
    return tuple(int(attributes[name]) for name in names)
