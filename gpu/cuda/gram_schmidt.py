"""CUDA source of Gram-Schmidt steps by all blocks of a launch together.

Every block owns a range of rows of the vectors. For a sum over all rows, each block writes its
partial sum, all blocks synchronise, and each adds the partial sums in the same order: repeated runs
on one device agree bit by bit. After a synchronisation a block sees what the others wrote before it
(release and acquire of the PTX memory model), but must not read it through the read-only cache.
"""

SOURCE = r"""
#define WARPS 32   // of a block
#define TILE 256   // entries of a vector that are updated and projected together
#define GROUPS 4   // threads that share an entry
#define SUMS 2048  // shared numbers for partial sums
#define NUMBERS 3  // sums that a warp gathers together
#define AT_ONCE 5  // shares of each that a thread reads together

typedef long long index;

__device__ double over_warp(double s)
{
    for (int apart = 16; apart; apart >>= 1)
        s += __shfl_xor_sync(0xffffffffu, s, apart);
    return s;
}

// All blocks meet when the gate has counted `goal` arrivals; the count may wrap around.
__device__ void arrive(unsigned int* gate, unsigned int times)
{
    asm volatile("red.release.gpu.global.add.u32 [%0], %1;" :: "l"(gate), "r"(times) : "memory");
}

__device__ void meet(unsigned int* gate, unsigned int goal)
{
    __syncthreads();
    if (threadIdx.x == 0) {
        unsigned int seen;
        arrive(gate, 1);
        do
            asm volatile("ld.acquire.gpu.global.u32 %0, [%1];" : "=r"(seen) : "l"(gate) : "memory");
        while ((int)(seen - goal) < 0);
    }
    __syncthreads();
}

// dots <- V w of what this block owns.
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

// h <- sums over the blocks of what each wrote, number by number; every block adds up for itself.
__device__ __noinline__ void gather(const double* parts, int count, double* h)
{
    const int lane = threadIdx.x & 31, blocks = gridDim.x;
    for (int first = threadIdx.x >> 5; first < count; first += NUMBERS * WARPS) {
        double sum[NUMBERS] = {};
        for (int base = lane; base < blocks; base += AT_ONCE * 32) {
            double part[NUMBERS][AT_ONCE];
            #pragma unroll
            for (int q = 0; q < NUMBERS; ++q)
                #pragma unroll
                for (int b = 0; b < AT_ONCE; ++b) {
                    const int number = first + q * WARPS, block = base + 32 * b;
                    part[q][b] = number < count && block < blocks
                        ? __ldcg(parts + (index)number * blocks + block) : 0.0;
                }
            #pragma unroll
            for (int q = 0; q < NUMBERS; ++q)
                #pragma unroll
                for (int b = 0; b < AT_ONCE; ++b)
                    sum[q] += part[q][b];
        }
        #pragma unroll
        for (int q = 0; q < NUMBERS; ++q) {
            sum[q] = over_warp(sum[q]);
            if (lane == 0 && first + q * WARPS < count)
                h[first + q * WARPS] = sum[q];
        }
    }
    __syncthreads();
}

// Gram-Schmidt twice of w against the first j + 1 rows of V, into v; u = beta v. Here and below
// vectors begin with the first entry that this block owns.
__device__ __noinline__ void orthogonalise(const double* V, index stride, double* row,
                                           const double* w, double* u, double* v, double* parts,
                                           unsigned int* gate, unsigned int goal, int size, int j,
                                           index own, double* shared)
{
    double* h = shared + SUMS;
    double* dots = h + size + 2;
    const int count = j + 1, block = blockIdx.x, blocks = gridDim.x;
    // Sums of one meeting have a place of their own: who is ahead must not overwrite what others
    // still read.
    double* again = parts + (index)(size + 2) * blocks;
    double* last = again + (index)(size + 2) * blocks;

    project(V, stride, count, w, own, dots);
    for (int i = threadIdx.x; i < count; i += blockDim.x)
        parts[(index)i * blocks + block] = dots[i];
    meet(gate, goal += blocks);
    gather(parts, count, h);
    if (block == 0)
        for (int i = threadIdx.x; i < count; i += blockDim.x)
            row[i] = h[i];

    double square = update_and_project(V, stride, count, w, u, own, h, dots, shared);
    for (int i = threadIdx.x; i < count; i += blockDim.x)
        again[(index)i * blocks + block] = dots[i];
    if (threadIdx.x == 0)
        again[(index)count * blocks + block] = square;
    meet(gate, goal += blocks);
    gather(again, count + 1, h);
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
    if (known) {
        if (threadIdx.x == 0)
            arrive(gate, 1);  // the host counts on three arrivals
    } else {
        square = over_block(square, shared);
        if (threadIdx.x == 0)
            last[block] = square;
        meet(gate, goal += blocks);
        gather(last, 1, h);
        beta = sqrt(h[0]);
        for (index i = threadIdx.x; i < own; i += blockDim.x)
            v[i] = beta > 0.0 ? u[i] / beta : u[i];
    }
    if (block == 0 && threadIdx.x == 0)
        row[size + 1] = beta;
}
"""
