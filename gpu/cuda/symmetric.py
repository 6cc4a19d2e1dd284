"""CUDA source that compares a matrix with its transpose, each entry read once.

A block compares a tile below the diagonal with its mirror image above. The latter is transposed in
shared memory, so that both are read along their rows.
"""

SOURCE = r"""
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
"""
