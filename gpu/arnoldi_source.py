"""CUDA source of the Arnoldi steps.

Every block owns a range of rows of the vectors. Where sums over all rows are due the blocks write
theirs, meet, and add up what the others wrote, all in the same order: a run repeats bit by bit on
one device. A block that has met the others sees what they wrote before (release and acquire of
the PTX memory model), but never reads it through the path for constant data.
"""

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

// dots <- V w on the rows of this block.
__device__ void project(const double* V, index n, int count, const double* w, index begin,
                        index end, double* dots)
{
    const int lane = threadIdx.x & 31;
    for (int j = threadIdx.x >> 5; j < count; j += WARPS) {
        double s = 0.0;
        #pragma unroll 8
        for (index i = begin + lane; i < end; i += 32)
            s += V[j * n + i] * w[i];
        s = over_warp(s);
        if (lane == 0)
            dots[j] = s;
    }
    __syncthreads();
}

// Thread (group, column) takes its share of (V' h)[i]; shared[column], ... hold the shares.
__device__ double remove(const double* V, index n, int count, const double* source, index i,
                         index end, const double* h, double* share)
{
    const int column = threadIdx.x % TILE, group = threadIdx.x / TILE;
    double taken = 0.0, value = 0.0;
    if (i < end) {
        if (group == 0)
            value = source[i];
        #pragma unroll 8
        for (int j = group; j < count; j += GROUPS)
            taken += h[j] * V[j * n + i];
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
    s = 0.0;
    for (int w = 0; w < WARPS; ++w)
        s += share[w];
    __syncthreads();
    return s;
}

// u <- source - V' h, dots <- V u, tile by tile, so that V is read from memory once; |u|^2.
__device__ double update_and_project(const double* V, index n, int count, const double* source,
                                     double* u, index begin, index end, const double* h,
                                     double* dots, double* shared)
{
    double* tile = shared;
    double* share = shared + TILE;
    const int lane = threadIdx.x & 31;
    double square = 0.0;
    for (int j = threadIdx.x; j < count; j += blockDim.x)
        dots[j] = 0.0;
    for (index base = begin; base < end; base += TILE) {
        const index i = base + threadIdx.x % TILE;
        const double value = remove(V, n, count, source, i, end, h, share);
        if (threadIdx.x < TILE) {
            if (i < end)
                u[i] = value;
            tile[threadIdx.x] = value;
            square += value * value;
        }
        __syncthreads();
        const int width = (int)(end - base < TILE ? end - base : TILE);
        for (int j = threadIdx.x >> 5; j < count; j += WARPS) {
            double s = 0.0;
            #pragma unroll 8
            for (int c = lane; c < width; c += 32)
                s += V[j * n + base + c] * tile[c];
            s = over_warp(s);
            if (lane == 0)
                dots[j] += s;
        }
    }
    return over_block(square, share);
}

// u <- u - V' h, v <- scale u; |u|^2.
__device__ double update(const double* V, index n, int count, double* u, double* v, double scale,
                         index begin, index end, const double* h, double* share)
{
    double square = 0.0;
    if (end - begin > 2 * TILE) {
        for (index i = begin + threadIdx.x; i < end; i += blockDim.x) {
            double taken = 0.0;
            #pragma unroll 8
            for (int j = 0; j < count; ++j)
                taken += h[j] * V[j * n + i];
            const double value = u[i] - taken;
            u[i] = value;
            v[i] = value * scale;
            square += value * value;
        }
    } else {
        for (index base = begin; base < end; base += TILE) {
            const index i = base + threadIdx.x % TILE;
            const double value = remove(V, n, count, u, i, end, h, share);
            if (threadIdx.x < TILE && i < end) {
                u[i] = value;
                v[i] = value * scale;
                square += value * value;
            }
            __syncthreads();
        }
    }
    return over_block(square, share);
}

// Sum over the blocks; every block does it for itself, in the same order.
__device__ double over_blocks(const double* part)
{
    double s = 0.0;
    #pragma unroll 4
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

// Gram-Schmidt twice of w against the first j + 1 rows of V, into row j + 1 of V; u = beta times
// that row. Returns 1 / beta, or 1 where beta is zero. With `stay` all of u is there on return.
__device__ double orthogonalise(double* V, double* row, const double* w, double* u, double* parts,
                                unsigned int* gate, unsigned int* goal, index n, int size, int j,
                                index begin, index end, bool stay, double* shared)
{
    double* h = shared + SUMS;
    double* dots = h + size + 1;
    const int count = j + 1, block = blockIdx.x;
    // One buffer a meeting: who is ahead must not overwrite what others still read.
    double* part[3];
    for (int k = 0; k < 3; ++k)
        part[k] = parts + (index)k * (size + 1) * gridDim.x;

    project(V, n, count, w, begin, end, dots);
    for (int i = threadIdx.x; i < count; i += blockDim.x)
        part[0][(index)i * gridDim.x + block] = dots[i];
    meet(gate, *goal += gridDim.x);
    gather(part[0], count, h);
    if (block == 0)
        for (int i = threadIdx.x; i < count; i += blockDim.x)
            row[i] = h[i];

    double square = update_and_project(V, n, count, w, u, begin, end, h, dots, shared);
    if (threadIdx.x == 0)
        dots[count] = square;
    __syncthreads();
    for (int i = threadIdx.x; i < count + 1; i += blockDim.x)
        part[1][(index)i * gridDim.x + block] = dots[i];
    meet(gate, *goal += gridDim.x);
    gather(part[1], count + 1, h);
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
    double* v = V + count * n;
    double beta = known ? sqrt(rest) : 1.0;
    square = update(V, n, count, u, v, 1.0 / beta, begin, end, h, shared);
    *goal += gridDim.x;
    if (!known) {
        if (threadIdx.x == 0)
            part[2][block] = square;
        meet(gate, *goal);
        beta = sqrt(over_blocks(part[2]));
        for (index i = begin + threadIdx.x; i < end; i += blockDim.x)
            v[i] = beta > 0.0 ? u[i] / beta : u[i];
    } else if (stay) {
        meet(gate, *goal);
    } else if (threadIdx.x == 0) {
        arrive(gate);  // the host counts on three arrivals
    }
    if (block == 0 && threadIdx.x == 0)
        row[size + 1] = beta;
    return beta > 0.0 ? 1.0 / beta : 1.0;
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
    // Shorter ones where the last round of tasks would leave many warps idle.
    for (index more = pieces + 1; n >= 1024 && more <= 2 * pieces; ++more)
        if ((more * rows + WARPS - 1) / WARPS * pieces * 10
            < (pieces * rows + WARPS - 1) / WARPS * more * 9) {
            pieces = more;
            break;
        }
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

// Splitmix64 (Steele, Lea and Flood 2014): the same numbers on every device.
__device__ double uniform(unsigned long long seed, unsigned long long place)
{
    unsigned long long z = seed + (place + 1) * 0x9e3779b97f4a7c15ull;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return ((z ^ (z >> 31)) >> 11) * 0x1p-53 + 0x1p-54;
}

// Normally distributed numbers by Box and Muller.
extern "C" __global__ void normal(double* w, index n, unsigned long long seed)
{
    for (index i = blockIdx.x * (index)blockDim.x + threadIdx.x; i < n;
         i += gridDim.x * (index)blockDim.x)
        w[i] = sqrt(-2.0 * log(uniform(seed, 2 * i))) * cospi(2.0 * uniform(seed, 2 * i + 1));
}

// Without vectors before it, j = -1, w is only made a unit vector.
extern "C" __global__ void __launch_bounds__(1024, 1)
arnoldi_step(double* V, double* rows, const double* w, double* u, double* parts,
             unsigned int* gate, unsigned int goal, index n, int size, int j)
{
    extern __shared__ double shared[];
    const index chunk = (n + gridDim.x - 1) / gridDim.x;
    const index begin = blockIdx.x * chunk < n ? blockIdx.x * chunk : n;
    const index end = begin + chunk < n ? begin + chunk : n;
    orthogonalise(V, rows + (index)(j < 0 ? 0 : j) * (size + 2), w, u, parts, gate, &goal, n, size,
                  j, begin, end, false, shared);
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
                              size, j, begin, end, true, shared);
        x = next;
    }
}
"""
