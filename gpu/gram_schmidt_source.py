"""CUDA source of Gram-Schmidt steps by all blocks of a launch together.

Every block owns a range of rows of the vectors. Where sums over all rows are due the blocks write
theirs, meet, and add up what the others wrote, all in the same order: a run repeats bit by bit on
one device. A block that has met the others sees what they wrote before (release and acquire of
the PTX memory model), but never reads it through the path for constant data.
"""

SOURCE = r"""
#define WARPS 32   // of a block
#define TILE 256   // entries of a vector that are updated and projected together
#define GROUPS 4   // threads that share an entry
#define SUMS 2048  // shared numbers for partial sums
#define ENTRIES 64 // sums that are gathered together
#define AT_ONCE 5  // blocks whose sums a warp reads together

typedef long long index;

__device__ double over_warp(double s)
{
    for (int apart = 16; apart; apart >>= 1)
        s += __shfl_xor_sync(0xffffffffu, s, apart);
    return s;
}

// All blocks meet when the gate has counted `goal` arrivals; the count may wrap around.
__device__ void arrive(unsigned int* gate)
{
    asm volatile("red.release.gpu.global.add.u32 [%0], 1;" :: "l"(gate) : "memory");
}

__device__ void meet(unsigned int* gate, unsigned int goal)
{
    __syncthreads();
    if (threadIdx.x == 0) {
        unsigned int seen;
        arrive(gate);
        do
            asm volatile("ld.acquire.gpu.global.u32 %0, [%1];" : "=r"(seen) : "l"(gate) : "memory");
        while ((int)(seen - goal) < 0);
    }
    __syncthreads();
}

// dots <- V w. Here and below V, w, u, v begin with the first entry that this block owns.
__device__ void project(const double* V, index stride, int count, const double* w, index own,
                        double* dots)
{
    const int lane = threadIdx.x & 31;
    for (int j = threadIdx.x >> 5; j < count; j += WARPS) {
        double s = 0.0;
        #pragma unroll 4
        for (index i = lane; i < own; i += 32)
            s += V[j * stride + i] * w[i];
        s = over_warp(s);
        if (lane == 0)
            dots[j] = s;
    }
    __syncthreads();
}

// Thread (group, column) takes its share of (V' h)[i]; share[column], ... hold the shares.
__device__ double remove(const double* V, index stride, int count, const double* source, index i,
                         index own, const double* h, double* share)
{
    const int column = threadIdx.x % TILE, group = threadIdx.x / TILE;
    double taken = 0.0, value = 0.0;
    if (i < own) {
        if (group == 0)
            value = source[i];
        #pragma unroll 4
        for (int j = group; j < count; j += GROUPS)
            taken += h[j] * V[j * stride + i];
    }
    share[threadIdx.x] = taken;
    __syncthreads();
    if (group == 0)
        value -= (share[column] + share[column + TILE])
            + (share[column + 2 * TILE] + share[column + 3 * TILE]);
    return value;  // of group 0; zero past the end
}

__device__ double over_block(double s, double* share)
{
    __syncthreads();
    s = over_warp(s);
    if ((threadIdx.x & 31) == 0)
        share[threadIdx.x >> 5] = s;
    __syncthreads();
    s = over_warp(share[threadIdx.x & 31]);
    __syncthreads();
    return s;
}

// u <- source - V' h, dots <- V u, tile by tile, so that V is read from memory once; |u|^2.
__device__ double update_and_project(const double* V, index stride, int count,
                                     const double* source, double* u, index own, const double* h,
                                     double* dots, double* shared)
{
    double* tile = shared;
    double* share = shared + TILE;
    const int lane = threadIdx.x & 31;
    double square = 0.0;
    for (int j = threadIdx.x; j < count; j += blockDim.x)
        dots[j] = 0.0;
    for (index base = 0; base < own; base += TILE) {
        const index i = base + threadIdx.x % TILE;
        const double value = remove(V, stride, count, source, i, own, h, share);
        if (threadIdx.x < TILE) {
            if (i < own)
                u[i] = value;
            tile[threadIdx.x] = value;
            square += value * value;
        }
        __syncthreads();
        const int width = (int)(own - base < TILE ? own - base : TILE);
        for (int j = threadIdx.x >> 5; j < count; j += WARPS) {
            double s = 0.0;
            #pragma unroll 4
            for (int c = lane; c < width; c += 32)
                s += V[j * stride + base + c] * tile[c];
            s = over_warp(s);
            if (lane == 0)
                dots[j] += s;
        }
    }
    return over_block(square, share);
}

// u <- u - V' h, v <- scale u; what this thread adds to |u|^2.
__device__ double update(const double* V, index stride, int count, double* u, double* v,
                         double scale, index own, const double* h, double* share)
{
    double square = 0.0;
    if (own > 2 * TILE) {
        for (index i = threadIdx.x; i < own; i += blockDim.x) {
            double taken = 0.0;
            #pragma unroll 4
            for (int j = 0; j < count; ++j)
                taken += h[j] * V[j * stride + i];
            const double value = u[i] - taken;
            u[i] = value;
            v[i] = value * scale;
            square += value * value;
        }
    } else {
        for (index base = 0; base < own; base += TILE) {
            const index i = base + threadIdx.x % TILE;
            const double value = remove(V, stride, count, u, i, own, h, share);
            if (threadIdx.x < TILE && i < own) {
                u[i] = value;
                v[i] = value * scale;
                square += value * value;
            }
            __syncthreads();
        }
    }
    return square;
}

// Sums over the blocks of what each wrote, `size` apart; every block adds up for itself.
__device__ __noinline__ void gather(const double* parts, int size, int count, double* h,
                                    double* shared)
{
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5, blocks = gridDim.x;
    for (int first = 0; first < count; first += ENTRIES) {
        const int left = count - first;
        double low = 0.0, high = 0.0;
        for (int base = warp; base < blocks; base += AT_ONCE * WARPS) {
            double part[2][AT_ONCE];
            #pragma unroll
            for (int q = 0; q < AT_ONCE; ++q) {
                const int block = base + q * WARPS;
                const double* from = parts + (index)block * size + first + lane;
                part[0][q] = block < blocks && lane < left ? __ldcg(from) : 0.0;
                part[1][q] = block < blocks && lane + 32 < left ? __ldcg(from + 32) : 0.0;
            }
            #pragma unroll
            for (int q = 0; q < AT_ONCE; ++q) {
                low += part[0][q];
                high += part[1][q];
            }
        }
        shared[warp * ENTRIES + lane] = low;
        shared[warp * ENTRIES + lane + 32] = high;
        __syncthreads();
        if (threadIdx.x < ENTRIES && threadIdx.x < left) {
            double s[4] = {0.0, 0.0, 0.0, 0.0};
            #pragma unroll
            for (int w = 0; w < WARPS; ++w)
                s[w % 4] += shared[w * ENTRIES + threadIdx.x];
            h[first + threadIdx.x] = (s[0] + s[1]) + (s[2] + s[3]);
        }
        __syncthreads();
    }
}

// Gram-Schmidt twice of w against the first j + 1 rows of V, into v; u = beta v. Returns 1 / beta,
// or 1 where beta is zero. Where the blocks go on from u, all of it is in `open` on return.
__device__ __noinline__ double orthogonalise(const double* V, index stride, double* row,
                                             const double* w, double* u, double* v, double* open,
                                             double* parts, unsigned int* gate, unsigned int* goal,
                                             int size, int j, index own, double* shared)
{
    double* h = shared + SUMS;
    double* dots = h + size + 2;
    const int count = j + 1, block = blockIdx.x;
    // One buffer a meeting: who is ahead must not overwrite what others still read.
    const index all = (index)(size + 2) * gridDim.x, mine = (index)(size + 2) * block;

    project(V, stride, count, w, own, dots);
    for (int i = threadIdx.x; i < count; i += blockDim.x)
        parts[mine + i] = dots[i];
    meet(gate, *goal += gridDim.x);
    gather(parts, size + 2, count, h, shared);
    if (block == 0)
        for (int i = threadIdx.x; i < count; i += blockDim.x)
            row[i] = h[i];

    double square = update_and_project(V, stride, count, w, u, own, h, dots, shared);
    for (int i = threadIdx.x; i < count; i += blockDim.x)
        parts[all + mine + i] = dots[i];
    if (threadIdx.x == 0)
        parts[all + mine + count] = square;
    meet(gate, *goal += gridDim.x);
    gather(parts + all, size + 2, count + 1, h, shared);
    if (block == 0)
        for (int i = threadIdx.x; i < count; i += blockDim.x)
            row[i] += h[i];

    // What the second projection takes away is round-off, unless w was nearly in the space:
    // only then is the norm not known without another meeting.
    double taken = 0.0;
    for (int i = threadIdx.x & 31; i < count; i += 32)
        taken += h[i] * h[i];
    const double rest = h[count] - over_warp(taken);
    const bool known = rest > 0.5 * h[count];
    double beta = known ? sqrt(rest) : 1.0;
    square = update(V, stride, count, u, v, 1.0 / beta, own, h, shared);
    __syncthreads();
    if (open)
        for (index i = threadIdx.x; i < own; i += blockDim.x)
            open[i] = u[i];
    *goal += gridDim.x;
    if (!known) {
        square = over_block(square, shared);
        if (threadIdx.x == 0)
            parts[2 * all + mine] = square;
        meet(gate, *goal);
        gather(parts + 2 * all, size + 2, 1, h, shared);
        beta = sqrt(h[0]);
        for (index i = threadIdx.x; i < own; i += blockDim.x)
            v[i] = beta > 0.0 ? u[i] / beta : u[i];
    } else if (open) {
        meet(gate, *goal);
    } else if (threadIdx.x == 0) {
        arrive(gate);  // the host counts on three arrivals
    }
    if (block == 0 && threadIdx.x == 0)
        row[size + 1] = beta;
    return beta > 0.0 ? 1.0 / beta : 1.0;
}
"""
