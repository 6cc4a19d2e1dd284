"""CUDA source of Gram-Schmidt steps by all blocks of a launch together.

Every block owns a range of rows of the vectors. For a sum over all rows, each block writes its
partial sum, all blocks synchronise, and each adds the partial sums in the same order: repeated runs
on one device agree bit by bit. After a synchronisation a block sees what the others wrote before it
(release and acquire of the PTX memory model), but must not read it through the read-only cache.

In the second kind of step the second pass is delayed, so that one reduction suffices.
A vector u that has been orthogonalised once is multiplied by A immediately. Its remaining
components along the basis V,

    s = V^* u,   u = V s + alpha v,   alpha^2 = |u|^2 - |s|^2,

are summed in the same reduction as the projections of A u, and only then subtracted from u: v is
orthogonal to working precision, as after two passes. A step then needs two synchronisations of all
blocks, for the sums and for the next vector, instead of three for two successive passes. Since not
v but

    u / alpha = v + V r,   r = s / alpha,

was multiplied by A, the step gives r and the coefficients of A (v + V r). If u lies almost in the
span of V, r is not small: `gpu.eigenvalues.krylov.arnoldi` converts the coefficients into
those of A v.

K. Swirydowicz, J. Langou, S. Ananthan, U. Yang and S. Thomas, Low synchronization Gram-Schmidt and
generalized minimal residual algorithms, Numer. Linear Algebra Appl. 28 (2021), algorithm 3;
D. Bielich, J. Langou, S. Thomas, K. Swirydowicz, I. Yamazaki and E. Boman, Low-synch Gram-Schmidt
with delayed reorthogonalization for Krylov solvers, Parallel Comput. 112 (2022).
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

// Of this block: its share of the basis, row by row `stride` apart, and the numbers of a sweep.
struct Basis {
    double* slice;       // in shared memory
    int stride, own;     // the rows of A that this block owns
    index n, begin;      // of the first of them
    int size;            // most vectors
    double* V;           // all of the basis, in memory
    double* rows;        // of every step: `size` + 2 coefficients, and as many numbers r
    double* open;        // all of the vector that is multiplied next
    double* parts;       // sums of the blocks
    unsigned int* gate;
    unsigned int goal;   // arrivals at the gate before the next meeting is over
    double* h;           // 2 size + 4 sums in shared memory
    double* shared;

    // V_r h of the first `count` vectors, for row r; a warp a row.
    __device__ double combined(int count, const double* h, int r) const
    {
        double sum = 0.0;
        for (int k = threadIdx.x & 31; k < count; k += 32)
            sum += h[k] * slice[k * stride + r];
        return over_warp(sum);
    }
};

// Row j of the slice, u, becomes v. With w = scale A u row j + 1 becomes what is left of A u /
// alpha after one pass, all of it in `open` on return; without w the sweep ends. The first vector
// of a sweep is a unit vector orthogonal to those before it. `extra` counts meetings beside two,
// or one without w. Returns a scale that brings the next vector to at most one.
__device__ __forceinline__ double delayed_step(Basis& basis, const double* w, int j, bool first,
                                               double scale, int* extra)
{
    const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5, count = j + 1;
    const int block = blockIdx.x, blocks = gridDim.x, own = basis.own, stride = basis.stride;
    double* u = basis.slice + j * stride;
    double* next = u + stride;
    double* h = basis.h;  // s, |u|^2, then V^* w, u^* w, |w|^2
    const double* p = h + count;

    for (int i = warp; i <= count; i += WARPS) {
        const double* row = i < count ? basis.slice + i * stride : w;
        double s = 0.0, t = 0.0;
        if (row)
            for (int c = lane; c < own; c += 32) {
                s += row[c] * u[c];
                t += w ? row[c] * w[c] : 0.0;
            }
        s = over_warp(s);
        t = over_warp(t);
        if (lane == 0) {
            if (i < count)
                basis.parts[(index)i * blocks + block] = s;
            if (w)
                basis.parts[(index)(count + i) * blocks + block] = t;
        }
    }
    meet(basis.gate, basis.goal += blocks);
    gather(basis.parts, w ? 2 * count + 1 : count, h);

    const int known = first ? 0 : j;  // entries of s that are not zero
    double ss = 0.0, sp = 0.0;
    for (int k = lane; k < known; k += 32) {
        ss += h[k] * h[k];
        sp += w ? h[k] * p[k] : 0.0;
    }
    ss = over_warp(ss);
    sp = over_warp(sp);
    const double square = first ? 1.0 : h[j], rest = square - ss;
    double alpha;
    int left = known;  // of these is still something in u
    if (rest > 0.5 * square) {
        alpha = sqrt(rest);
    } else {
        // Next to nothing is left: its norm has to be asked for.
        double* share = basis.parts + (index)(2 * basis.size + 4) * blocks;
        double mine = 0.0;
        for (int r = warp; r < own; r += WARPS) {
            const double value = u[r] - basis.combined(known, h, r);
            __syncwarp();
            if (lane == 0) {
                u[r] = value;
                mine += value * value;
            }
        }
        mine = over_block(mine, basis.shared);
        if (threadIdx.x == 0)
            share[block] = mine;
        meet(basis.gate, basis.goal += blocks);
        double* sum = h + 2 * basis.size + 3;
        gather(share, 1, sum);
        alpha = sqrt(*sum);
        left = 0;
        ++*extra;
    }
    const double inverse = alpha > 0.0 ? 1.0 / alpha : 1.0;
    const double by = inverse / scale;  // A u / alpha = by w
    const double diagonal = w ? (p[j] - sp) * inverse * by : 0.0;
    for (int r = warp; r < own; r += WARPS) {
        const double off = basis.combined(left, h, r), in = w ? basis.combined(j, p, r) : 0.0;
        const double v = (u[r] - off) * inverse;
        const double value = w ? (w[r] - in) * by - diagonal * v : 0.0;
        __syncwarp();
        if (lane == 0) {
            u[r] = v;
            basis.V[j * basis.n + basis.begin + r] = v;
            if (w) {
                next[r] = value;
                basis.open[basis.begin + r] = value;
            }
        }
    }
    if (block == blocks - 1) {
        const index width = basis.size + 2;
        double* row = basis.rows + j * 2 * width;
        for (int k = threadIdx.x; k < count; k += blockDim.x) {
            if (!first && k < j)
                row[k - 2 * width] += h[k];
            if (w) {
                row[k] = k < j ? p[k] * by : diagonal;
                row[width + k] = k < known ? h[k] * inverse : 0.0;
            }
        }
        if (!first && threadIdx.x == 0)
            row[-width - 1] = alpha;
    }
    if (!w)
        return 1.0;
    meet(basis.gate, basis.goal += blocks);
    const double largest = sqrt(p[count]) * by;
    return largest > 0.0 ? 1.0 / largest : 1.0;
}
"""
