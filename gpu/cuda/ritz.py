"""CUDA source for Ritz vectors: turning a basis in place, residuals of pairs with their vectors."""

SOURCE = r"""
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
"""
