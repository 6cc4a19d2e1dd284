"""CUDA source that inverts small triangles of one matrix, each by a warp.

A thread takes a column of the inverse and keeps it in registers; the triangle is in shared memory.
"""

SOURCE = r"""
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
"""
