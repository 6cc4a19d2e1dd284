"""CUDA source of the dual active set method for small dense quadratic programs, one block each.

The method is that of D. Goldfarb and A. Idnani (A numerically stable dual method for solving
strictly convex quadratic programs, Math. Program. 27 (1983) 1-33): the constraint a that is
violated most enters an active set A, whose matrix is factored by J with J'PJ = I, J'A' = [R; 0],

    d = J'a,  r = R^-1 d_1,  z = J_2 d_2,   x <- x - s t z,  y <- y - s t r,  y_a <- y_a + s t,

where s = 1 at upper and -1 at lower sides, and t is the step that reaches the side, or that first
makes a multiplier vanish, whose constraint leaves. In chains of plane rotations the threads of a
block would wait for each other, so reflections take their place: one of d_2 where a constraint
enters, and where the i-th leaves, one of the columns of J_1 and of M = R^-1 that brings row i of M
to a multiple of the last unit row, which is then left out. So M is kept instead of R, and needs not
be triangular; J' is stored by rows.

Units are powers of two, on which no rounding depends: D near diag(P)^-1/2 for the variables, and
for a row c near 1/|cD|. Steps of Newton's method with the last active set remove the rounding of
the updates. What counts is the certificate, in the units of the data, against the sizes of
`gpu.qp.data.standard_qp.residuals`, or smaller ones.
"""

SOURCE = r"""
typedef long long index;

#define EPS 0x1p-52
#define DEPENDENT 1e-22  // of |d|^2, times n: a smaller |d_2|^2 is rounding
#define TOUCHED 1e-13    // of the largest |r_i|: smaller ones are rounding
#define WRONG 1e-14      // of the largest multiplier: a smaller one of the wrong sign is rounding
#define PASSED 1e-12     // of its terms: by so much a dependent constraint may be violated
#define VANISHING 1e-13  // of its terms: a smaller entry of C'y is rounding, in a Farkas vector
#define NEAR 1e-6        // of the lengths that follow from the data: a smaller x is rounding
#define SIDE 1e-14       // of those lengths: smaller sides are rounding of a difference
#define PART 1e-3        // of the terms of a row: no less counts as its size
#define SHARP 1e-2       // of the tolerance: most that residuals of a solution may be
#define BATCH 4          // rows of C that a thread reads at once
#define FOR(i, size) for (int i = threadIdx.x; i < (size); i += blockDim.x)

enum State : signed char { LOWER = -1, FREE, UPPER, PASSED_BY, EQUAL };
enum Code : signed char { SOLVED, INFEASIBLE, UNDECIDED };

#ifdef FAR
#define NAME dual_active_set_far_solve
typedef double* Place;
#else
#define NAME dual_active_set_solve
typedef int Place;
#endif

// In the memory of the block: shared memory, of which the compiler must know, or global memory.
template <class T> struct Array {
    Place place;

    __device__ operator T*() const
    {
#ifdef FAR
        return (T*)place;
#else
        extern __shared__ double shared[];
        return (T*)(shared + place);
#endif
    }
};

struct Choice {  // the largest positive value and its place; none: 0 and -1
    double value;
    int place;
};

// Not a number if one of them is not.
__device__ double larger(double a, double b)
{
    return a > b || a != a ? a : b;
}

__device__ double ratio(double value, double size)
{
    return value == 0.0 ? 0.0 : value / size;
}

// The power of two near 1 / sqrt(square).
__device__ double unit_of(double square)
{
    return square > 0.0 && isfinite(square) ? scalbn(1.0, -((ilogb(square) + 1) >> 1)) : 1.0;
}

__device__ double dot(const double* a, int stride, const double* b, int size)
{
    double s = 0.0;
    #pragma unroll 4
    for (int i = 0; i < size; ++i, a += stride)
        s += *a * b[i];
    return s;
}

// a <- a - s b
__device__ void subtract(double* __restrict__ a, int stride, double s,
                         const double* __restrict__ b, int size)
{
    #pragma unroll 4
    for (int i = 0; i < size; ++i, a += stride)
        *a -= s * b[i];
}

template <bool SUM> __device__ __noinline__ double over_block(double a, double* share)
{
    for (int apart = 16; apart; apart >>= 1) {
        const double b = __shfl_xor_sync(0xffffffffu, a, apart);
        a = SUM ? a + b : larger(a, b);
    }
    if (blockDim.x == 32)
        return a;
    if ((threadIdx.x & 31) == 0)
        share[threadIdx.x >> 5] = a;
    __syncthreads();
    a = share[0];
    for (int w = 1; w < blockDim.x / 32; ++w)
        a = SUM ? a + share[w] : larger(a, share[w]);
    __syncthreads();
    return a;
}

// A problem and the memory of its block, in shared memory, where its first thread alone writes the
// members. Constraint c < m is row c, the others are the variables; x, y and sides are in the units
// until `to_data`.
struct Program {
    int n, m, padded, stride;  // odd: entries of a column of J or M lie in different banks
    const double *P, *q, *C, *low, *high, *lb, *ub;
    Array<double> J, M, D, w, y, a, d, r, step, unit, value, x, share;  // value = (Cx, x)
    Array<int> active;  // constraints of the active set, whose multipliers are y, in its order
    Array<signed char> state;  // of all constraints
    int k, steps;
    double spread, reach, least[3];  // |J|^2, |x| without constraints, `StandardQP.least_sizes`

    __device__ void lay_out(int n, int m, Place next)
    {
        this->n = n;
        this->m = m;
        stride = n | 1;
        padded = (n + 31) & ~31;
        Array<double>* const arrays[] = {&J, &M, &D, &w, &y, &a, &d, &r, &step, &unit, &value};
        for (int i = 0; i < 11; ++i) {
            arrays[i]->place = next;
            next += i < 2 ? n * stride : i < 9 ? padded : m + n;
        }
        x.place = next - n;
        share.place = next;
        active.place = next + 32;
        state.place = next + 32 + (n + 1) / 2;
    }

    // What the first thread does, and the others wait for.
    template <class Work> __device__ static void alone(Work work)
    {
        if (threadIdx.x == 0)
            work();
        __syncthreads();
    }

    template <class Term> __device__ double sum_of(int size, Term term) const
    {
        double s = 0.0;
        FOR(i, size)
            s += term(i);
        return over_block<true>(s, share);
    }

    template <class Term> __device__ double most_of(int size, Term term) const
    {
        double s = 0.0;
        FOR(i, size)
            s = larger(s, fabs(term(i)));
        return over_block<false>(s, share);
    }

    // Of equal values the first.
    template <class Term> __device__ Choice best_of(int size, Term term) const
    {
        Choice mine = {0.0, -1};
        FOR(i, size) {
            const double v = term(i);
            if (v > mine.value)
                mine = {v, i};
        }
        const double most = over_block<false>(mine.value, share), none = -1e300;
        const bool found = mine.place >= 0 && mine.value == most;
        const double place = over_block<false>(found ? -(double)mine.place : none, share);
        return {most, place == none ? -1 : (int)-place};
    }

    // out <- sums over j of term(C_cj w_j) for all rows c, eight threads each; w is padded.
    template <class Term> __device__ void over_rows(double* out, const double* w, Term term) const
    {
        const int lane = threadIdx.x & 7, groups = blockDim.x / 8;
        for (int base = 0; base < m; base += BATCH * groups) {
            const int first = base + threadIdx.x / 8;
            double s[BATCH] = {};
            for (int start = lane; start < n + lane; start += 32)
                #pragma unroll
                for (int i = 0; i < BATCH; ++i) {
                    const double* const row = C + min(first + i * groups, m - 1) * n;
                    #pragma unroll
                    for (int j = start; j < start + 32; j += 8)
                        s[i] += term(__ldg(row + min(j, n - 1)) * w[j]);
                }
            #pragma unroll
            for (int i = 0; i < BATCH; ++i) {
                for (int apart = 4; apart; apart >>= 1)
                    s[i] += __shfl_xor_sync(0xffffffffu, s[i], apart);
                if (first + i * groups < m && lane == 0)
                    out[first + i * groups] = s[i];
            }
        }
        __syncthreads();
    }

    __device__ double side(int c, int sign) const
    {
        return unit[c] * __ldg(c < m ? (sign > 0 ? high : low) + c : (sign > 0 ? ub : lb) + c - m);
    }

    __device__ bool tied(int c) const
    {
        return c < m ? low[c] == high[c] : lb[c - m] == ub[c - m];
    }

    __device__ __noinline__ void measure()
    {
        FOR(j, padded)
            w[j] = j < n ? D[j] * x[j] : 0.0;
        __syncthreads();
        over_rows(value, w, [](double t) { return t; });
        FOR(c, m)
            value[c] *= unit[c];
        __syncthreads();
    }

    __device__ double length_of_x() const
    {
        return larger(reach, sqrt(sum_of(n, [this](int j) { return x[j] * x[j]; })));
    }

    // Units and least sizes.
    __device__ void scale()
    {
        FOR(j, padded)
            D[j] = j < n ? unit_of(P[j * n + j]) : 0.0;
        FOR(j, n) {
            unit[m + j] = 1.0 / D[j];
            x[j] = 0.0;
        }
        __syncthreads();
        over_rows(value, D, [](double t) { return fabs(t); });
        FOR(c, m)
            unit[c] = 1.0 / value[c];
        __syncthreads();
        const double rows = most_of(m, [this](int c) { return value[c]; });
        const double lengths = most_of(n, [this](int j) { return D[j]; });
        const double objective = sum_of(n, [this](int j) { return fabs(D[j] * q[j]); });
        const double linear = most_of(n, [this](int j) { return D[j] * q[j]; });
        const double sides = most_of(2 * (m + n), [this](int i) {
            const double s = side(i >> 1, i & 1);
            return isfinite(s) ? s : 0.0;
        });
        const double near = NEAR * (SIDE * linear < sides && sides < linear ? sides : linear);
        alone([&] {
            least[0] = near * rows;
            least[1] = near * objective;
            least[2] = near * lengths;
        });
        over_rows(unit, D, [](double t) { return t * t; });
        FOR(c, m)
            unit[c] = unit_of(unit[c]);
        __syncthreads();
    }

    // J' = L^-1 of DPD = LL' by elimination in place; false where P is not definite.
    __device__ bool factor()
    {
        for (int i = 0; i < n; ++i)
            FOR(l, n)
                J[i * stride + l] = D[i] * __ldg(P + i * n + l) * D[l];
        __syncthreads();
        for (int j = 0; j < n; ++j) {
            const double pivot = J[j * stride + j];
            if (!(pivot > 8 * n * EPS))
                return false;
            FOR(i, n)
                r[i] = i > j ? J[i * stride + j] / pivot : 0.0;
            __syncthreads();
            FOR(l, n)
                if (l != j)
                    subtract(J + j * stride + l, stride, J[j * stride + l], r + j, n - j);
            __syncthreads();
            for (int i = j + 1 + threadIdx.x; i < n; i += blockDim.x)
                J[i * stride + j] = -r[i];
            __syncthreads();
        }
        FOR(i, n)
            r[i] = 1.0 / sqrt(J[i * stride + i]);
        __syncthreads();
        const double squares = sum_of(n * n, [this](int place) {
            const int i = place / n, l = place % n;
            double& entry = J[i * stride + l];
            entry = l > i ? 0.0 : l == i ? r[i] : entry * r[i];
            return entry * entry;
        });
        alone([&] { spread = squares; });
        return true;
    }

    // The constraint that is violated most, beyond rounding.
    __device__ __noinline__ Choice violated()
    {
        measure();
        const double size = length_of_x();
        return best_of(m + n, [=](int c) {
            const double up = side(c, 1), down = side(c, -1), v = value[c];
            const double excess = fmax(v - up, down - v), end = v > up ? up : down;
            return state[c] == FREE && excess > 8 * n * EPS * (fabs(end) + size) ? excess : 0.0;
        });
    }

    // d <- J'a of constraint c, r <- M d_1, step <- J_2 d_2; |d_2|^2, or zero for rounding.
    __device__ __noinline__ double project(int c)
    {
        if (c < m)
            FOR(j, n)
                a[j] = unit[c] * __ldg(C + c * n + j) * D[j];
        __syncthreads();
        FOR(i, n)
            d[i] = c < m ? dot(J + i * stride, 1, a, n) : J[i * stride + c - m];
        __syncthreads();
        const double whole = sum_of(n, [this](int i) { return d[i] * d[i]; });
        const double rest = sum_of(n, [this](int i) { return i < k ? 0.0 : d[i] * d[i]; });
        FOR(j, n) {
            if (j < k)
                r[j] = dot(M + j * stride, 1, d, k);
            step[j] = dot(J + k * stride + j, stride, d + k, n - k);
        }
        __syncthreads();
        return rest > DEPENDENT * n * whole && rest > 64 * EPS * EPS * spread ? rest : 0.0;
    }

    // c enters after `project`: d_2 is reflected into its first entry.
    __device__ __noinline__ void enter(int c, int sign, double multiplier, double square)
    {
        const double first = d[k], corner = first > 0.0 ? -sqrt(square) : sqrt(square);
        const double head = first - corner, weight = -1.0 / (corner * head);
        FOR(j, n) {
            double* const column = J + k * stride + j;
            const double w = weight * (step[j] - corner * *column);
            *column -= head * w;
            subtract(column + stride, stride, w, d + k + 1, n - k - 1);
            if (j < k) {
                M[j * stride + k] = -r[j] / corner;
                M[k * stride + j] = 0.0;
            }
        }
        __syncthreads();
        alone([&] {
            M[k * stride + k] = 1.0 / corner;
            active[k] = c;
            y[k] = multiplier;
            state[c] = sign;
            ++k;
            ++steps;
        });
    }

    // The i-th of the active set leaves: row i of M is reflected into its last entry, and the last
    // constraint takes the place.
    __device__ __noinline__ void leave(int i)
    {
        const int last = k - 1;
        const double square = sum_of(k, [=](int l) {
            d[l] = M[i * stride + l];
            return d[l] * d[l];
        });
        __syncthreads();
        const double end = d[last], corner = end > 0.0 ? -sqrt(square) : sqrt(square);
        const double weight = -1.0 / (corner * (end - corner));
        __syncthreads();
        alone([&] {
            d[last] = end - corner;
            state[active[i]] = FREE;
            active[i] = active[last];
            y[i] = y[last];
        });
        FOR(j, n) {
            subtract(J + j, stride, weight * dot(J + j, stride, d, k), d, k);
            if (j < k)
                subtract(M + j * stride, 1, weight * dot(M + j * stride, 1, d, k), d, k);
        }
        __syncthreads();
        FOR(l, last)
            M[i * stride + l] = M[last * stride + l];
        __syncthreads();
        alone([&] {
            k = last;
            ++steps;
        });
    }

    // Newton's step to the solution with the active set: with f = -(Px + q + A'y) and the
    // distances e to the sides, dx = J [M'e; J_2'f] and dy = M (J_1'f - M'e).
    __device__ __noinline__ void settle()
    {
        measure();
        FOR(i, k)
            r[i] = side(active[i], state[active[i]]) - value[active[i]];
        FOR(j, n) {
            double force = q[j] + dot(P + j, n, w, n), push = 0.0;
            for (int i = 0; i < k; ++i) {
                const int c = active[i];
                if (c < m)
                    force += __ldg(C + c * n + j) * (unit[c] * y[i]);
                else if (c - m == j)
                    push = y[i];
            }
            a[j] = -(D[j] * force + push);
        }
        __syncthreads();
        FOR(i, n) {
            const double free = dot(J + i * stride, 1, a, n);
            const double held = i < k ? dot(M + i, stride, r, k) : 0.0;
            step[i] = i < k ? held : free;
            d[i] = free - held;
        }
        __syncthreads();
        FOR(j, n) {
            if (j < k)
                y[j] += dot(M + j * stride, 1, d, k);
            x[j] += dot(J + j, stride, step, n);
        }
        __syncthreads();
    }

    // The solution with those of the active set whose multipliers have the right sign.
    __device__ __noinline__ void settle_signs()
    {
        for (;;) {
            settle();
            const double size = most_of(k, [this](int i) { return y[i]; });
            const Choice wrong = best_of(k, [this](int i) {
                return tied(active[i]) ? 0.0 : -state[active[i]] * y[i];
            });
            if (!(wrong.value > WRONG * size))
                return;
            leave(wrong.place);
        }
    }

    // Equalities, then what is wanted of the others, as far as they are independent.
    __device__ void begin(const signed char* wanted)
    {
        FOR(c, m + n)
            state[c] = tied(c) ? EQUAL : wanted && isfinite(side(c, wanted[c])) ? wanted[c] : FREE;
        alone([&] {
            k = 0;
            reach = 0.0;
        });
        settle();
        const double size = length_of_x();
        alone([&] { reach = size; });
        for (int equal = 1; equal >= 0; --equal)
            for (int c = 0; c < m + n; ++c) {
                const int sign = state[c];
                if (sign == FREE || equal != (sign == EQUAL) || (!equal && tied(c)))
                    continue;
                const double square = project(c);
                if (square > 0.0)
                    enter(c, equal ? UPPER : sign, 0.0, square);
                else
                    alone([&] { state[c] = FREE; });
            }
        if (k)
            settle_signs();
        alone([&] { steps = 0; });
    }

    // Brings c to its side; false where no step does: then r makes a Farkas vector.
    __device__ bool bring(Choice c, int sign, int most)
    {
        for (double multiplier = 0.0; steps < most;) {
            const double square = project(c.place), full = square > 0.0 ? c.value / square : 1e300;
            const double size = most_of(k, [this](int i) { return r[i]; });
            const Choice first = best_of(k, [=](int i) {
                const double rate = sign * state[active[i]] * r[i], push = state[active[i]] * y[i];
                const bool falls = rate > TOUCHED * size && !tied(active[i]);
                return falls ? rate / fmax(push, 1e-300) : 0.0;
            });
            if (square == 0.0 && first.place < 0)
                return pass_by(c, multiplier);
            const double time = first.place < 0 ? full : fmin(full, 1.0 / first.value);
            __syncthreads();
            FOR(i, n) {
                if (i < k)
                    y[i] -= sign * time * r[i];
                if (square > 0.0)
                    x[i] -= sign * time * step[i];
            }
            multiplier += time;
            c.value -= time * square;
            __syncthreads();
            if (time == full) {
                enter(c.place, sign, sign * multiplier, square);
                break;
            }
            leave(first.place);
        }
        return true;
    }

    // Leaves a dependent constraint alone where only rounding violates it.
    __device__ bool pass_by(Choice c, double multiplier)
    {
        const double end = fmin(fabs(side(c.place, 1)), fabs(side(c.place, -1)));
        if (c.value > PASSED * (end + length_of_x()))
            return false;
        alone([&] { state[c.place] = PASSED_BY; });
        if (multiplier > 0.0)
            settle_signs();
        return true;
    }

    // INFEASIBLE: by r, c and sign.
    __device__ Code solve(const signed char* wanted, int most, int* c, int* sign)
    {
        begin(wanted);
        for (int settled = 0; steps < most;) {
            const Choice worst = violated();
            if (worst.place < 0) {
                if (settled++ == 2)
                    return SOLVED;
                settle_signs();
                continue;
            }
            settled = 0;
            *c = worst.place;
            *sign = value[*c] > side(*c, 1) ? 1 : -1;
            if (!bring(worst, *sign, most))
                return INFEASIBLE;
        }
        return UNDECIDED;
    }

    // From here on sides are those of the data.
    __device__ void to_data()
    {
        __syncthreads();
        FOR(c, m + n)
            unit[c] = 1.0;
        FOR(j, n)
            D[j] = 1.0;
        __syncthreads();
    }

    // Whether max (C'y)'x over the box is below min y'(Cx) over the sides, by more than `tol` of
    // the terms, for y = -s (a - A'r) in the units of the data, the largest 1; z = -C'y.
    __device__ bool farkas(int c, int sign, double tol, double* y, double* z)
    {
        FOR(row, m)
            y[row] = row == c ? -sign * unit[row] : 0.0;
        __syncthreads();
        FOR(i, k) {
            const int row = active[i];
            if (row < m && (tied(row) || sign * r[i] * state[row] < 0.0))
                y[row] = sign * r[i] * unit[row];
        }
        to_data();
        const double size = most_of(m, [=](int row) { return y[row]; });
        FOR(row, m)
            y[row] /= size;
        __syncthreads();
        FOR(j, n) {
            double force = 0.0, moduli = 0.0;
            for (int row = 0; row < m; ++row) {
                force -= C[row * n + j] * y[row];
                moduli += fabs(C[row * n + j] * y[row]);
            }
            const bool open = isinf((force > 0.0 ? lb : ub)[j]);
            z[j] = open && fabs(force) <= VANISHING * moduli ? 0.0 : force;
        }
        __syncthreads();
        const auto term = [=](int c) {
            const double v = c < m ? y[c] : z[c - m];
            return v == 0.0 ? 0.0 : v * side(c, v > 0.0 ? -1 : 1);
        };
        const double terms = sum_of(m + n, [=](int c) { return fabs(term(c)); });
        return sum_of(m + n, term) > tol * terms;
    }

    // x, multipliers and states in the units of the data.
    __device__ void publish(double* x_out, double* y_out, double* z, signed char* states)
    {
        FOR(c, m)
            y_out[c] = 0.0;
        FOR(j, n) {
            const int s = state[m + j];
            const double inside = fmin(fmax(D[j] * x[j], lb[j]), ub[j]);
            x[j] = x_out[j] = s == LOWER ? lb[j] : s == UPPER ? ub[j] : inside;
            z[j] = 0.0;
        }
        __syncthreads();
        FOR(i, k) {
            const int c = active[i];
            if (tied(c))
                state[c] = y[i] < 0.0 ? LOWER : UPPER;
            const double v = y[i] * state[c] > 0.0 ? y[i] : 0.0;
            (c < m ? y_out[c] : z[c - m]) = unit[c] * v;
        }
        to_data();
        FOR(c, m + n)
            states[c] = state[c] == PASSED_BY ? FREE : state[c];
        FOR(j, padded)
            w[j] = j < n ? x[j] : 0.0;
        __syncthreads();
        over_rows(value, w, [](double t) { return fabs(t); });
        const double terms = most_of(m, [this](int c) { return value[c]; });
        alone([&] { least[0] = larger(least[0], PART * terms); });
        measure();
    }

    // Residuals (primal, dual, gap, complementarity) of what was published.
    __device__ bool certify(double tol, const double* y, const double* z, double* found)
    {
        double *const Px = step, *const Cy = d;
        FOR(j, n) {
            Px[j] = dot(P + j, n, x, n);
            Cy[j] = dot(C + j, n, y, m);
        }
        __syncthreads();
        const auto push = [=](int c) { return c < m ? y[c] : z[c - m]; };
        const auto end = [=](int c) { return side(c, push(c) > 0.0 ? 1 : -1); };
        const auto sided = [=](int c) { return push(c) == 0.0 ? 0.0 : push(c) * end(c); };
        const auto pair = [=](int c) {
            return push(c) == 0.0 ? 0.0 : push(c) * (value[c] - end(c));
        };
        const double outside = most_of(m + n, [=](int c) {
            return larger(larger(side(c, -1) - value[c], value[c] - side(c, 1)), 0.0);
        });
        const double sizes = most_of(m, [=](int c) {
            return larger(fabs(value[c]), fabs(fmin(fmax(value[c], side(c, -1)), side(c, 1))));
        });
        const double dual = most_of(n, [=](int j) { return Px[j] + q[j] + Cy[j] + z[j]; });
        const double force = most_of(n, [=](int j) {
            return larger(larger(fabs(Px[j]), fabs(q[j])), larger(fabs(Cy[j]), fabs(z[j])));
        });
        const double quadratic = sum_of(n, [=](int j) { return x[j] * Px[j]; });
        const double linear = sum_of(n, [=](int j) { return x[j] * q[j]; });
        const double held = sum_of(m + n, sided);
        const double row_pair = most_of(m, pair);
        const double box_pair = most_of(n, [=](int j) { return pair(m + j); });
        double length = most_of(n, [=](int j) { return x[j]; }), rows = larger(length, sizes);
        if (length <= least[2]) {
            length = least[2];
            rows = larger(larger(length, rows), least[0]);
        }
        const double objective = larger(fabs(quadratic), fabs(linear));
        const double values[] = {
            ratio(outside, larger(sizes, least[0])), ratio(dual, force),
            ratio(fabs(quadratic + linear + held), larger(objective, least[1])),
            larger(ratio(ratio(row_pair, force), rows), ratio(ratio(box_pair, force), length))};
        bool good = true;
        for (int i = 0; i < 4; ++i) {
            good = good && values[i] <= SHARP * tol;
            found[i] = values[i];
        }
        return good;
    }
};

// One problem a block, in shared memory, or in `memory` with `size` numbers a block. Where a stride
// of the data is zero, all problems share them.
extern "C" __global__ void __launch_bounds__(256, 1)
NAME(const double* P, index P_stride, const double* q, index q_stride, const double* C,
     index C_stride, const double* low, index low_stride, const double* high, index high_stride,
     const double* lb, index lb_stride, const double* ub, index ub_stride,
     const signed char* wanted, index problems, int n, int m, int most, double tol,
     double* memory, index size, double* x, double* y, double* z, signed char* states,
     signed char* codes, int* steps, double* residuals)
{
    __shared__ Program p;
    if (threadIdx.x == 0)
#ifdef FAR
        p.lay_out(n, m, memory + blockIdx.x * size);
#else
        p.lay_out(n, m, 0);
#endif
    for (index i = blockIdx.x; i < problems; i += gridDim.x) {
        if (threadIdx.x == 0) {
            p.P = P + i * P_stride;
            p.q = q + i * q_stride;
            p.C = C + i * C_stride;
            p.low = low + i * low_stride;
            p.high = high + i * high_stride;
            p.lb = lb + i * lb_stride;
            p.ub = ub + i * ub_stride;
        }
        __syncthreads();
        p.scale();
        int c, sign, code = UNDECIDED;
        const bool definite = p.factor();
        if (definite)
            code = p.solve(wanted ? wanted + i * (m + n) : nullptr, most, &c, &sign);
        if (code == SOLVED) {
            p.publish(x + i * n, y + i * m, z + i * n, states + i * (m + n));
            code = p.certify(tol, y + i * m, z + i * n, residuals + 4 * i) ? SOLVED : UNDECIDED;
        } else if (code == INFEASIBLE) {
            const bool proved = p.farkas(c, sign, tol, y + i * m, z + i * n);
            code = proved ? INFEASIBLE : UNDECIDED;
        }
        codes[i] = code;
        steps[i] = definite ? p.steps : 0;
        __syncthreads();
    }
}
"""
