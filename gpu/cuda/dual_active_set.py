"""CUDA source of the dual active set method for small dense quadratic programs, one block each.

The method is that of D. Goldfarb and A. Idnani (A numerically stable dual method for solving
strictly convex quadratic programs, Math. Program. 27 (1983) 1-33): the violated constraint a enters
an active set A, whose matrix is factored by J with J'PJ = I and J'A' = [R; 0],

    d = J'a,  r = R^-1 d_1,  z = J_2 d_2,   x <- x - s t z,  y <- y - s t r,  y_a <- y_a + s t,

where s is the side and t the step that reaches it, or that first makes a multiplier vanish, whose
constraint leaves. Chains of plane rotations would leave the threads of a block waiting for each
other. One reflection of d_2 takes their place where a constraint enters, M = R^-1 is kept instead
of R, and needs not be triangular: where constraint i leaves, one reflection of row i of M makes
its other columns and those of J again a pair for the rest. J' is stored by rows.

Units are powers of two, so that no rounding depends on them: D near diag(P)^-1/2 of the variables,
and of a row c near 1/|cD|. After the last step, and for a first active set, one step of Newton's
method to the solution with that set removes the rounding of the updates. What counts is the
certificate, in the units of the data and against sizes as in `gpu.qp.data.standard_qp.residuals`.
"""

SOURCE = r"""
typedef long long index;

#define DEPENDENT 1e-22   // of |d|^2, times n: a smaller |d_2|^2 is rounding
#define TOUCHED 1e-13     // of the largest |r_i|: smaller ones are rounding
#define WRONG 1e-14       // of the largest multiplier: a smaller one of the wrong sign is rounding
#define PASSED 1e-12      // of its terms: by so much a dependent row may be violated
#define VANISHING 1e-13   // of its terms: a smaller entry of C'y is rounding in a Farkas vector
#define NEAR 1e-6         // of the lengths that follow from the data: a smaller x is rounding
#define SIDE 1e-14        // of those lengths: a smaller side is rounding of a difference
#define SHARP 1e-2        // of the tolerance: what the residuals must not exceed
#define PASSED_BY 2       // state of a dependent row that is left alone

struct Choice {  // the largest value and its place; -1: none
    double value;
    int place;
};

__device__ double larger(double a, double b)  // or not a number, if one of them is not
{
    return a > b || a != a ? a : b;
}

__device__ double ratio(double value, double size)
{
    return value == 0.0 ? 0.0 : value / size;
}

template <bool SUM> __device__ double over_block(double a, double* share)
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

// The largest value of all threads; of equal ones the first.
__device__ Choice best(Choice mine, double* share)
{
    const double most = over_block<false>(mine.value, share);
    const bool found = mine.place >= 0 && mine.value == most;
    const double place = over_block<false>(found ? -(double)mine.place : -1e300, share);
    return {most, place == -1e300 ? -1 : (int)-place};
}

__device__ double dot(const double* a, const double* b, int size)
{
    double s = 0.0;
    #pragma unroll 4
    for (int i = 0; i < size; ++i)
        s += a[i] * b[i];
    return s;
}

// The power of two near 1 / sqrt(square).
__device__ double unit_of(double square)
{
    return square > 0.0 && isfinite(square) ? scalbn(1.0, -((ilogb(square) + 1) >> 1)) : 1.0;
}

#define FOR(i, size) for (int i = threadIdx.x; i < (size); i += blockDim.x)

// A problem and the memory of its block. Constraint c < m is row c, the others are the variables.
struct Program {
    const int n, m, stride;  // odd: entries of a column of J or M lie in different banks
    const double *P, *q, *C, *low, *high, *lb, *ub;
    double *J, *M, *D, *x, *y, *a, *d, *r, *step, *unit, *value, *share;
    int* active;         // constraints of the active set, y their multipliers
    signed char* state;  // of all constraints: the side that they are held at
    int k, steps;
    double spread, reach;  // |J|^2 and |x| without constraints, in units of D

    __device__ Program(int n, int m, double* memory) : n(n), m(m), stride(n | 1), k(0), steps(0)
    {
        double** const vectors[] = {&D, &x, &y, &a, &d, &r, &step};
        J = memory;
        M = J + (index)n * stride;
        memory = M + (index)n * stride;
        for (double** vector : vectors) {
            *vector = memory;
            memory += n;
        }
        unit = memory;
        value = unit + m;
        share = value + m;
        active = (int*)(share + 32);
        state = (signed char*)(active + n);
    }

    __device__ double side(int c, int sign) const
    {
        return c < m ? unit[c] * (sign > 0 ? high : low)[c]
                     : (sign > 0 ? ub : lb)[c - m] / D[c - m];
    }

    __device__ bool tied(int c) const
    {
        return c < m ? low[c] == high[c] : lb[c - m] == ub[c - m];
    }

    __device__ double at(int c) const
    {
        return c < m ? value[c] : x[c - m];
    }

    // out <- sums over j of term(C_rj, j) for all rows r, eight threads each.
    template <class Term> __device__ void over_rows(double* out, Term term) const
    {
        const int place = threadIdx.x & 7;
        for (int first = 0; first < m; first += blockDim.x / 8) {
            const int row = first + threadIdx.x / 8;
            double s = 0.0;
            if (row < m)
                #pragma unroll 4
                for (int j = place; j < n; j += 8)
                    s += term(C[(index)row * n + j], j);
            for (int apart = 4; apart; apart >>= 1)
                s += __shfl_xor_sync(0xffffffffu, s, apart);
            if (row < m && place == 0)
                out[row] = s;
        }
        __syncthreads();
    }

    // Units of variables and rows.
    __device__ void scale()
    {
        FOR(j, n) {
            D[j] = unit_of(P[(index)j * n + j]);
            x[j] = 0.0;
        }
        __syncthreads();
        over_rows(unit, [this](double c, int j) { return c * D[j] * (c * D[j]); });
        FOR(row, m)
            unit[row] = unit_of(unit[row]);
        __syncthreads();
    }

    // J' = L^-1 of DPD = LL' by elimination in place; false where P is not definite.
    __device__ bool factor()
    {
        for (int i = 0; i < n; ++i)
            FOR(l, n)
                J[i * stride + l] = D[i] * P[(index)i * n + l] * D[l];
        __syncthreads();
        for (int j = 0; j < n; ++j) {
            const double pivot = J[j * stride + j];
            if (!(pivot > 8 * n * 0x1p-52))
                return false;
            for (int i = j + 1 + threadIdx.x; i < n; i += blockDim.x)
                r[i] = J[i * stride + j] / pivot;
            __syncthreads();
            FOR(l, n) {
                const double top = l == j ? 1.0 : J[j * stride + l];
                #pragma unroll 4
                for (int i = j + 1; i < n; ++i)
                    J[i * stride + l] = (l == j ? 0.0 : J[i * stride + l]) - r[i] * top;
            }
            __syncthreads();
        }
        FOR(i, n)
            r[i] = 1.0 / sqrt(J[i * stride + i]);
        __syncthreads();
        double squares = 0.0;
        FOR(l, n)
            for (int i = 0; i < n; ++i) {
                double& entry = J[i * stride + l];
                entry = l > i ? 0.0 : l == i ? r[i] : entry * r[i];
                squares += entry * entry;
            }
        spread = over_block<true>(squares, share);
        __syncthreads();
        return true;
    }

    // Rows at x.
    __device__ void measure()
    {
        over_rows(value, [this](double c, int j) { return c * (D[j] * x[j]); });
        FOR(row, m)
            value[row] *= unit[row];
        __syncthreads();
    }

    __device__ double length_of_x() const
    {
        double squares = 0.0;
        FOR(j, n)
            squares += x[j] * x[j];
        return sqrt(over_block<true>(squares, share));
    }

    // The constraint that is violated most, beyond rounding.
    __device__ Choice violated()
    {
        measure();
        const double size = larger(length_of_x(), reach), rounding = 8 * n * 0x1p-52;
        Choice most = {0.0, -1};
        FOR(c, m + n) {
            if (state[c])
                continue;
            const double above = at(c) - side(c, 1), below = side(c, -1) - at(c);
            const double excess = fmax(above, below);
            const double terms = fabs(side(c, above > below ? 1 : -1)) + size;
            if (excess > rounding * terms && excess > most.value)
                most = {excess, c};
        }
        return best(most, share);
    }

    // a <- row of c, d <- J'a, r <- M d_1, step <- J_2 d_2; |d_2|^2, or zero for rounding.
    __device__ double project(int c)
    {
        if (c < m)
            FOR(j, n)
                a[j] = unit[c] * C[(index)c * n + j] * D[j];
        __syncthreads();
        double whole = 0.0, rest = 0.0;
        FOR(i, n) {
            d[i] = c < m ? dot(J + i * stride, a, n) : J[i * stride + c - m];
            whole += d[i] * d[i];
            rest += i < k ? 0.0 : d[i] * d[i];
        }
        __syncthreads();
        whole = over_block<true>(whole, share);
        rest = over_block<true>(rest, share);
        FOR(j, n) {
            if (j < k)
                r[j] = dot(M + j * stride, d, k);
            double s = 0.0;
            #pragma unroll 4
            for (int i = k; i < n; ++i)
                s += J[i * stride + j] * d[i];
            step[j] = s;
        }
        __syncthreads();
        return rest > DEPENDENT * n * whole && rest > 64 * 0x1p-104 * spread ? rest : 0.0;
    }

    // c enters after `project`: d_2 is reflected into its first entry.
    __device__ void enter(int c, int sign, double multiplier, double square)
    {
        const double first = d[k], corner = first > 0.0 ? -sqrt(square) : sqrt(square);
        const double head = first - corner, weight = -1.0 / (corner * head);
        FOR(j, n) {
            const double w = weight * (step[j] - corner * J[k * stride + j]);
            J[k * stride + j] -= head * w;
            #pragma unroll 4
            for (int i = k + 1; i < n; ++i)
                J[i * stride + j] -= d[i] * w;
            if (j <= k) {
                M[j * stride + k] = j < k ? -r[j] / corner : 1.0 / corner;
                if (j < k)
                    M[k * stride + j] = 0.0;
            }
        }
        if (threadIdx.x == 0) {
            active[k] = c;
            y[k] = multiplier;
            state[c] = sign;
        }
        ++k;
        __syncthreads();
    }

    // The i-th of the active set leaves: row i of M is reflected into its last entry.
    __device__ void leave(int i)
    {
        const int last = k - 1;
        double square = 0.0;
        FOR(l, k) {
            d[l] = M[i * stride + l];
            square += d[l] * d[l];
        }
        square = over_block<true>(square, share);
        __syncthreads();
        const double end = d[last], corner = end > 0.0 ? -sqrt(square) : sqrt(square);
        const double weight = -1.0 / (corner * (end - corner));
        __syncthreads();
        if (threadIdx.x == 0) {
            d[last] = end - corner;
            state[active[i]] = 0;
            active[i] = active[last];
            y[i] = y[last];
        }
        __syncthreads();
        FOR(j, n) {
            double s = 0.0;
            for (int l = 0; l < k; ++l)
                s += d[l] * J[l * stride + j];
            s *= weight;
            for (int l = 0; l < k; ++l)
                J[l * stride + j] -= s * d[l];
            if (j < k) {
                double* const row = M + j * stride;
                s = weight * dot(row, d, k);
                for (int l = 0; l < k; ++l)
                    row[l] -= s * d[l];
            }
        }
        __syncthreads();
        FOR(l, last)
            M[i * stride + l] = M[last * stride + l];
        k = last;
        __syncthreads();
    }

    // Newton's step to the solution with the active set: with r_1 = -(Px + q + A'y) and
    // r_2 = sides - Ax, dx = J [M'r_2; J_2'r_1] and dy = M (J_1'r_1 - M'r_2).
    __device__ void settle()
    {
        measure();
        FOR(i, k)
            r[i] = side(active[i], state[active[i]]) - at(active[i]);
        FOR(j, n) {
            double force = q[j], push = 0.0;
            #pragma unroll 4
            for (int l = 0; l < n; ++l)
                force += P[(index)l * n + j] * (D[l] * x[l]);
            for (int i = 0; i < k; ++i) {
                const int c = active[i];
                if (c < m)
                    force += C[(index)c * n + j] * (unit[c] * y[i]);
                else if (c - m == j)
                    push = y[i];
            }
            a[j] = -(D[j] * force + push);
        }
        __syncthreads();
        FOR(i, n) {
            const double free = dot(J + i * stride, a, n);
            double held = 0.0;
            if (i < k)
                for (int p = 0; p < k; ++p)
                    held += M[p * stride + i] * r[p];
            step[i] = i < k ? held : free;
            d[i] = free - held;
        }
        __syncthreads();
        FOR(j, n) {
            if (j < k)
                y[j] += dot(M + j * stride, d, k);
            double s = x[j];
            #pragma unroll 4
            for (int i = 0; i < n; ++i)
                s += J[i * stride + j] * step[i];
            x[j] = s;
        }
        __syncthreads();
    }

    // The solution with those of the active set whose multipliers have the right sign.
    __device__ void settle_signs()
    {
        for (;;) {
            settle();
            Choice wrong = {0.0, -1};
            double size = 0.0;
            FOR(i, k) {
                const double push = -state[active[i]] * y[i];
                if (push > wrong.value && !tied(active[i]))
                    wrong = {push, i};
                size = larger(size, fabs(y[i]));
            }
            size = over_block<false>(size, share);
            wrong = best(wrong, share);
            if (!(wrong.value > WRONG * size))
                return;
            leave(wrong.place);
        }
    }

    // Equalities, then what is wanted of the others, as far as they are independent.
    __device__ void begin(const signed char* wanted)
    {
        FOR(c, m + n)
            state[c] = tied(c) ? 3 : wanted && isfinite(side(c, wanted[c])) ? wanted[c] : 0;
        __syncthreads();
        settle();
        reach = length_of_x();
        for (int pass = 0; pass < 2; ++pass)
            for (int c = 0; c < m + n; ++c) {
                const int sign = state[c];
                if (pass ? sign == 0 || tied(c) : sign != 3)
                    continue;
                const double square = project(c);
                if (square > 0.0)
                    enter(c, pass ? sign : 1, 0.0, square);
                else if (threadIdx.x == 0)
                    state[c] = 0;
                __syncthreads();
            }
        if (k)
            settle_signs();
    }

    // Brings c to its side; false where no step does: then r makes a Farkas vector.
    __device__ bool push(Choice c, int sign, int most)
    {
        double multiplier = 0.0, excess = c.value;
        while (steps < most) {
            ++steps;
            const double square = project(c.place), full = square > 0.0 ? excess / square : 1e300;
            double size = 0.0;
            FOR(i, k)
                size = larger(size, fabs(r[i]));
            size = over_block<false>(size, share);
            Choice first = {-1e300, -1};
            FOR(i, k) {
                const double rate = sign * r[i], towards = rate * state[active[i]];
                if (towards > TOUCHED * size && !tied(active[i])) {
                    const double time = fmax(y[i] / rate, 0.0);
                    if (-time > first.value)
                        first = {-time, i};
                }
            }
            first = best(first, share);
            if (square == 0.0 && first.place < 0)
                return pass_by(c, multiplier);
            const double time = fmin(full, -first.value);
            __syncthreads();
            FOR(i, n) {
                if (i < k)
                    y[i] -= sign * time * r[i];
                if (square > 0.0)
                    x[i] -= sign * time * step[i];
            }
            multiplier += time;
            excess -= time * square;
            __syncthreads();
            if (full <= -first.value) {
                enter(c.place, sign, sign * multiplier, square);
                return true;
            }
            leave(first.place);
        }
        return true;
    }

    // Leaves a dependent constraint alone where only rounding violates it.
    __device__ bool pass_by(Choice c, double multiplier)
    {
        const double sides = fmin(fabs(side(c.place, 1)), fabs(side(c.place, -1)));
        if (c.value > PASSED * (sides + larger(length_of_x(), reach)))
            return false;
        if (threadIdx.x == 0)
            state[c.place] = PASSED_BY;
        __syncthreads();
        if (multiplier > 0.0)
            settle_signs();
        return true;
    }

    // 0: solved, 1: infeasible by r and c, 2: too many steps. Two steps of Newton's method follow.
    __device__ int solve(const signed char* wanted, int most, Choice* c, int* sign)
    {
        begin(wanted);
        int settled = 0;
        while (steps < most) {
            *c = violated();
            if (c->place < 0) {
                if (settled == 2)
                    return 0;
                settle_signs();
                ++settled;
                continue;
            }
            settled = 0;
            *sign = at(c->place) > side(c->place, 1) ? 1 : -1;
            if (!push(*c, *sign, most))
                return 1;
        }
        return 2;
    }

    // Whether max (C'y)'x over the box is below min y'(Cx) over the sides, by more than `tol` of
    // the terms, for y = -s (a - A'r) in the units of the data, scaled; z = -C'y.
    __device__ bool farkas(int c, int sign, double tol, double* multipliers, double* z)
    {
        FOR(row, m)
            multipliers[row] = row == c ? -sign * unit[row] : 0.0;
        __syncthreads();
        FOR(i, k) {
            const int row = active[i];
            if (row < m && (tied(row) || sign * r[i] * state[row] < 0.0))
                multipliers[row] = sign * r[i] * unit[row];
        }
        __syncthreads();
        double size = 0.0;
        FOR(row, m)
            size = larger(size, fabs(multipliers[row]));
        size = over_block<false>(size, share);
        double sum = 0.0, terms = 0.0;
        FOR(row, m) {
            const double v = multipliers[row] /= size;
            const double part = v == 0.0 ? 0.0 : v * (v > 0.0 ? low : high)[row];
            sum += part;
            terms += fabs(part);
        }
        __syncthreads();
        FOR(j, n) {
            double force = 0.0, moduli = 0.0;
            for (int row = 0; row < m; ++row) {
                const double part = C[(index)row * n + j] * multipliers[row];
                force -= part;
                moduli += fabs(part);
            }
            const double bound = (force > 0.0 ? lb : ub)[j];
            if (isinf(bound) && fabs(force) <= VANISHING * moduli)
                force = 0.0;
            const double part = force == 0.0 ? 0.0 : force * bound;
            z[j] = force;
            sum += part;
            terms += fabs(part);
        }
        sum = over_block<true>(sum, share);
        terms = over_block<true>(terms, share);
        return sum > tol * terms;
    }

    // x, multipliers and states in the units of the data, in x as well; `unit` is the row sums of
    // |C| D and `value` is Cx after that.
    __device__ void publish(double* x_out, double* multipliers, double* z, signed char* states)
    {
        FOR(row, m)
            multipliers[row] = 0.0;
        FOR(j, n) {
            const int s = state[m + j];
            const double inside = fmin(fmax(D[j] * x[j], lb[j]), ub[j]);
            x[j] = x_out[j] = s == -1 ? lb[j] : s == 1 ? ub[j] : inside;
            z[j] = 0.0;
        }
        __syncthreads();
        FOR(i, k) {
            const int c = active[i];
            double v = y[i];
            if (tied(c))
                state[c] = v < 0.0 ? -1 : 1;
            else if (v * state[c] < 0.0)
                v = 0.0;
            if (c < m)
                multipliers[c] = unit[c] * v;
            else
                z[c - m] = v / D[c - m];
        }
        __syncthreads();
        FOR(c, m + n)
            states[c] = state[c] == PASSED_BY ? 0 : state[c];
        over_rows(value, [this](double c, int j) { return c * x[j]; });
        over_rows(unit, [this](double c, int j) { return fabs(c) * D[j]; });
    }

    // Residuals (primal, dual, gap, complementarity) of what was published, from the data.
    __device__ bool certify(double tol, const double* multipliers, const double* z, double* out)
    {
        enum { OUTSIDE, ROWS, DUAL, FORCE, PAIR, BOX, LENGTH, WIDE, LONG, SIDES, LINEAR, MOST };
        enum { QUADRATIC, SLOPE, SIDED, TERMS, SUMS };
        double most[MOST] = {}, sum[SUMS] = {};
        const auto raise = [&most](int i, double v) { most[i] = larger(most[i], fabs(v)); };
        // What a multiplier pushes against, and how far the sides of a constraint are.
        const auto pair = [&](int kind, double v, double at, double down, double up, double width) {
            const double to = v > 0.0 ? up : v < 0.0 ? down : 0.0;
            sum[SIDED] += v == 0.0 ? 0.0 : v * to;
            raise(kind, v == 0.0 ? 0.0 : v * (at - to));
            if (width > 0.0) {
                raise(SIDES, isinf(down) ? 0.0 : down / width);
                raise(SIDES, isinf(up) ? 0.0 : up / width);
            }
        };
        FOR(row, m) {
            const double v = value[row], near = fmin(fmax(v, low[row]), high[row]);
            raise(OUTSIDE, v - near);
            raise(ROWS, larger(fabs(v), fabs(near)));
            raise(WIDE, unit[row]);
            pair(PAIR, multipliers[row], v, low[row], high[row], unit[row]);
        }
        FOR(j, n) {
            double Px = 0.0, Cy = 0.0;
            #pragma unroll 4
            for (int l = 0; l < n; ++l)
                Px += P[(index)l * n + j] * x[l];
            #pragma unroll 4
            for (int row = 0; row < m; ++row)
                Cy += C[(index)row * n + j] * multipliers[row];
            raise(DUAL, Px + q[j] + Cy + z[j]);
            raise(FORCE, larger(larger(fabs(Px), fabs(q[j])), larger(fabs(Cy), fabs(z[j]))));
            raise(LENGTH, x[j]);
            raise(LONG, D[j]);
            raise(LINEAR, D[j] * q[j]);
            pair(BOX, z[j], x[j], lb[j], ub[j], D[j]);
            sum[QUADRATIC] += x[j] * Px;
            sum[SLOPE] += q[j] * x[j];
            sum[TERMS] += D[j] * fabs(q[j]);
        }
        for (double& v : most)
            v = over_block<false>(v, share);
        for (double& v : sum)
            v = over_block<true>(v, share);
        const double linear = most[LINEAR], sides = most[SIDES];
        const double near = NEAR * (SIDE * linear < sides && sides < linear ? sides : linear);
        const double objective = larger(fabs(sum[QUADRATIC]), fabs(sum[SLOPE]));
        double length = most[LENGTH], rows = larger(length, most[ROWS]);
        if (length <= near * most[LONG]) {
            length = near * most[LONG];
            rows = larger(larger(length, rows), near * most[WIDE]);
        }
        const double gap = sum[QUADRATIC] + sum[SLOPE] + sum[SIDED];
        const double found[] = {
            ratio(most[OUTSIDE], larger(most[ROWS], near * most[WIDE])),
            ratio(most[DUAL], most[FORCE]),
            ratio(fabs(gap), larger(objective, near * sum[TERMS])),
            larger(ratio(ratio(most[PAIR], most[FORCE]), rows),
                   ratio(ratio(most[BOX], most[FORCE]), length)),
        };
        bool good = true;
        for (int i = 0; i < 4; ++i) {
            good = good && found[i] <= SHARP * tol;
            if (threadIdx.x == 0)
                out[i] = found[i];
        }
        return good;
    }
};

// One problem a block, in shared memory, or in `memory` with `size` numbers a block. A stride of
// zero: all problems share the data. Codes: 0 solved, 1 infeasible, 2 not decided.
extern "C" __global__ void __launch_bounds__(256)
dual_active_set_solve(const double* P, index P_stride, const double* q, index q_stride,
                      const double* C, index C_stride, const double* low, index low_stride,
                      const double* high, index high_stride, const double* lb, index lb_stride,
                      const double* ub, index ub_stride, const signed char* wanted,
                      index problems, int n, int m, int most, double tol, double* memory,
                      index size, double* x, double* y, double* z, signed char* states,
                      signed char* codes, int* steps, double* residuals)
{
    extern __shared__ double shared[];
    for (index i = blockIdx.x; i < problems; i += gridDim.x) {
        Program p(n, m, memory ? memory + blockIdx.x * size : shared);
        p.P = P + i * P_stride;
        p.q = q + i * q_stride;
        p.C = C + i * C_stride;
        p.low = low + i * low_stride;
        p.high = high + i * high_stride;
        p.lb = lb + i * lb_stride;
        p.ub = ub + i * ub_stride;
        double *const x_i = x + i * n, *const y_i = y + i * m, *const z_i = z + i * n;
        Choice c;
        int code = 2, sign;
        p.scale();
        if (p.factor()) {
            code = p.solve(wanted ? wanted + i * (m + n) : nullptr, most, &c, &sign);
            if (code == 1 && !p.farkas(c.place, sign, tol, y_i, z_i))
                code = 2;
            if (code == 0) {
                p.publish(x_i, y_i, z_i, states + i * (m + n));
                if (!p.certify(tol, y_i, z_i, residuals + 4 * i))
                    code = 2;
            }
        }
        if (threadIdx.x == 0) {
            codes[i] = code;
            steps[i] = p.steps;
        }
        __syncthreads();
    }
}
"""
