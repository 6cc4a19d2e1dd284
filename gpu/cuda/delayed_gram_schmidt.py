"""CUDA source of a Gram-Schmidt step whose second pass is delayed, so that one reduction suffices.

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

from gpu.cuda.gram_schmidt import SOURCE as GRAM_SCHMIDT

SOURCE = (
    GRAM_SCHMIDT
    + r"""
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
)
