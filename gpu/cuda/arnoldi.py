"""CUDA source of Arnoldi steps: a product with A, or a random vector, then Gram-Schmidt.

In a sweep each block keeps on its multiprocessor its rows of the basis and, of its rows of A, as
many of the first columns as fit. While the blocks wait for each other, the next columns are
prefetched from memory into the second-level cache.
"""

from gpu.cuda.gram_schmidt import SOURCE as GRAM_SCHMIDT

SOURCE = (
    GRAM_SCHMIDT
    + r"""
#define UNIT 64  // entries of a row of A that a warp takes at once
#define BATCH 4  // units whose loads are under way together

// How the warps of a block share the rows of a matrix: units in the order of memory, the same
// number to each.
struct Shares {
    int units, most;  // of a row, of a warp

    __device__ Shares(int rows, int width)
        : units((width + UNIT - 1) / UNIT), most((rows * units + WARPS - 1) / WARPS)
    {
    }

    // Sum of a row of what `multiply` wrote; from one place to the next warp or row grow.
    __device__ double sum(const double* sums, int row) const
    {
        double s = 0.0;
        if (units)
            for (int w = row * units / most; w <= ((row + 1) * units - 1) / most; ++w)
                s += sums[row + w];
        return s;
    }
};

// sums <- shares of the warps in a x, for `rows` rows of which `width` entries count; the first
// `stay` of each are read so that they stay in the common cache, the others pass through it.
template <bool NEAR>  // a is in shared memory
__device__ void multiply(const double* a, index stride, int rows, int width, int stay,
                         const double* x, double* sums)
{
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
    const Shares shares(rows, width);
    int unit = warp * shares.most, row = shares.units ? unit / shares.units : 0;
    const int stop = unit + shares.most < rows * shares.units ? unit + shares.most
                                                              : rows * shares.units;
    int place = unit - row * shares.units;
    double s = 0.0;
    for (; unit < stop; unit += BATCH) {
        double entry[2 * BATCH];
        int ahead_row = row, ahead = place;
        #pragma unroll
        for (int q = 0; q < BATCH; ++q) {
            const int column = ahead * UNIT + lane;
            const double* line = a + ahead_row * stride + column;
            #pragma unroll
            for (int half = 0; half < 2; ++half, line += 32)
                entry[2 * q + half] = unit + q >= stop || column + 32 * half >= width ? 0.0
                    : NEAR || column < stay ? *line : __ldcs(line);
            if (++ahead == shares.units) {
                ahead = 0;
                ++ahead_row;
            }
        }
        #pragma unroll
        for (int q = 0; q < BATCH; ++q) {
            if (unit + q >= stop)
                break;
            const int column = place * UNIT + lane;
            if (column < width)
                s += entry[2 * q] * x[column];
            if (column + 32 < width)
                s += entry[2 * q + 1] * x[column + 32];
            if (++place == shares.units) {
                s = over_warp(s);
                if (lane == 0)
                    sums[row + warp] = s;
                s = 0.0;
                place = 0;
                ++row;
            }
        }
    }
    s = over_warp(s);
    if (place && lane == 0)
        sums[row + warp] = s;
}

// Splitmix64 (Steele, Lea and Flood 2014): the same numbers on every device.
__device__ double uniform(unsigned long long seed, unsigned long long place)
{
    unsigned long long z = seed + (place + 1) * 0x9e3779b97f4a7c15ull;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return ((z ^ (z >> 31)) >> 11) * 0x1p-53 + 0x1p-54;
}

// One step from a product w; without one, from normally distributed numbers by Box and Muller.
// Without vectors before it, j = -1, w is only made a unit vector.
extern "C" __global__ void __launch_bounds__(1024, 1)
arnoldi_step(double* V, double* rows, const double* w, unsigned long long seed, double* u,
             double* parts, unsigned int* gate, unsigned int goal, index n, int size, int j)
{
    extern __shared__ double shared[];
    const index chunk = (n + gridDim.x - 1) / gridDim.x;
    const index begin = blockIdx.x * chunk < n ? blockIdx.x * chunk : n;
    const index own = begin + chunk < n ? chunk : n - begin;
    u += begin;
    if (w) {
        w += begin;
    } else {
        for (index i = threadIdx.x; i < own; i += blockDim.x)
            u[i] = sqrt(-2.0 * log(uniform(seed, 2 * (begin + i))))
                * cospi(2.0 * uniform(seed, 2 * (begin + i) + 1));
        __syncthreads();
        w = u;
    }
    orthogonalise(V + begin, n, rows + (index)(j < 0 ? 0 : j) * 2 * (size + 2), w, u,
                  V + (j + 1) * n + begin, parts, gate, goal, size, j, own, shared);
}

// Steps with a dense matrix. Shared memory holds the vector that is multiplied, the first `near`
// columns of this block's rows of A, and what it owns of the basis and of the product. The next
// `stay` columns stay in the common cache; or, while the blocks orthogonalise, `ahead` columns are
// brought there: memory need not rest.
extern "C" __global__ void __launch_bounds__(1024, 1)
arnoldi_sweep(const double* __restrict__ A, double* V, double* rows, double* u, double* parts,
              unsigned int* gate, unsigned int goal, index n, int size, int first, int last,
              int near, int stay, int ahead)
{
    extern __shared__ double shared[];
    const int chunk = (int)((n + gridDim.x - 1) / gridDim.x);
    const index begin = (index)blockIdx.x * chunk < n ? (index)blockIdx.x * chunk : n;
    const int own = (int)(begin + chunk < n ? chunk : n - begin);
    const int stride = chunk | 1;  // odd: entries of a column lie in different banks
    double* h = shared + SUMS;
    double* x = h + 2 * size + 4;
    double* kept = x + n;
    double* slice = kept + (index)near * chunk;
    double* w = slice + (size + 1) * stride;
    Basis basis = {slice, stride, own, n, begin, size, V, rows, u, parts, gate, goal, h, shared};
    A += begin * n;
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    for (int j = warp; j <= first; j += WARPS)
        for (int i = lane; i < own; i += 32)
            slice[j * stride + i] = V[j * n + begin + i];
    for (int r = warp; r < own; r += WARPS)
        #pragma unroll 4
        for (int i = lane; i < near; i += 32)
            kept[r * near + i] = __ldcs(A + r * n + i);
    const int rest = (int)n - near;
    const Shares inner(own, near), outer(own, rest);
    double* far = shared + SUMS / 2;
    double scale = 1.0;
    const double* source = V + first * n;
    int extra = 0;
    for (int j = first; j <= last; ++j) {
        if (j < last) {
            for (index i = threadIdx.x; i < n; i += blockDim.x)
                x[i] = __ldcg(source + i) * scale;
            __syncthreads();
            multiply<false>(A + near, n, own, rest, stay, x + near, far);
            multiply<true>(kept, near, own, near, 0, x, shared);
            __syncthreads();
            if (j + 1 < last)
                for (int r = warp; r < own; r += WARPS)
                    for (int i = 4 * lane; i < ahead; i += 128)
                        asm volatile("prefetch.global.L2 [%0];" :: "l"(A + r * n + near + i));
            for (int r = threadIdx.x; r < own; r += blockDim.x)
                w[r] = inner.sum(shared, r) + outer.sum(far, r);
            __syncthreads();
        }
        scale = delayed_step(basis, j < last ? w : nullptr, j, j == first, scale, &extra);
        source = u;
    }
    if (threadIdx.x == 0)
        arrive(gate, last - first - extra);  // the host counts on three a step, and one
}
"""
)
