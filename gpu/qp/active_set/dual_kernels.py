"""Compiled parts of `gpu.qp.active_set.dual`, which explains the letters.

Import it inside functions only: it imports numba.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gpu.qp.data.qp_problem import EMPTY, SOLVED, UNDECIDED
from skfem_adini.ground.jit import Array, Index, Real, summing, summing_part

EPS = 2.220446049250313e-16
NONE = np.inf
HUGE = 1e20  # numbers from here on count as infinite


@summing
def factor(P: Array, D: Array, J: Array) -> bool:
    """D = diag(P)^-1/2 in powers of two, and J = L^-1 of LL' = DPD; whether P is symmetric,
    finite and definite beyond rounding."""
    n = P.shape[0]
    for i in range(n):
        if not 0.0 < P[i, i] < NONE:
            return False
        D[i] = 2.0 ** -np.floor(0.5 * np.log2(P[i, i]) + 0.5)
        for j in range(i):
            if P[i, j] != P[j, i]:
                return False
    L = np.empty((n, n))
    for i in range(n):
        for j in range(i):
            s = P[i, j] * D[i] * D[j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            L[i, j] = s / L[j, j]
        s = P[i, i] * D[i] * D[i]
        for k in range(i):
            s -= L[i, k] * L[i, k]
        if not s > 10 * n * EPS:
            return False
        L[i, i] = np.sqrt(s)
    invert(L, J)
    return True


@summing_part
def invert(L: Array, J: Array) -> None:
    """J = L^-1 of a lower triangle, row by row."""
    n = L.shape[0]
    for i in range(n):
        for j in range(n):
            J[i, j] = 0.0
        for k in range(i):
            s = L[i, k]
            for j in range(k + 1):
                J[i, j] -= s * J[k, j]
        J[i, i] = 1.0
        s = 1.0 / L[i, i]
        for j in range(i + 1):
            J[i, j] *= s


@summing
def scale_rows(C: Array, D: Array, S: Array, size: Array) -> bool:
    """S = CD and the norms of its rows; whether C is finite."""
    m, n = C.shape
    good = True
    for i in range(m):
        s = 0.0
        for j in range(n):
            v = C[i, j] * D[j]
            S[i, j] = v
            s += v * v
        size[i] = np.sqrt(s)
        good &= size[i] < NONE
    return good


@summing_part
def project(J: Array, S: Array, c: Index, side: Real, d: Array) -> None:
    """d = J a of the row a = side S[c], or of the bound c - m."""
    n, m = J.shape[0], S.shape[0]
    if c >= m:
        for i in range(n):
            d[i] = side * J[i, c - m]
        return
    for i in range(n):
        s = 0.0
        for j in range(n):
            s += J[i, j] * S[c, j]
        d[i] = side * s


@summing_part
def add(
    J: Array, R: Array, d: Array, z: Array, k: Index, rest: Real,
) -> None:  # fmt: skip
    """Make d column k of R: reflect the rows of J from k on, where z = J[k:]'d[k:]; rest is
    |d[k:]|^2."""
    n = J.shape[0]
    size = -np.sqrt(rest) if d[k] > 0.0 else np.sqrt(rest)
    for i in range(k):
        R[k, i] = d[i]
    R[k, k] = size
    beta = 1.0 / (rest - size * d[k])
    for j in range(n):
        z[j] = (z[j] - size * J[k, j]) * beta  # of the reflection 1 - beta v v', v'J
    for i in range(k, n):
        s = d[i] - size if i == k else d[i]
        for j in range(n):
            J[i, j] -= s * z[j]


@summing_part
def drop(J: Array, R: Array, d: Array, k: Index, l: Index) -> None:
    """Take column l of k out of R (kept by columns) and rotate J, and d = J a, with it."""
    n = J.shape[0]
    for q in range(l, k - 1):
        for i in range(q + 2):
            R[q, i] = R[q + 1, i]
    for q in range(l, k - 1):
        a, b = R[q, q], R[q, q + 1]
        h = np.sqrt(a * a + b * b)
        c, s = a / h, b / h
        R[q, q] = h
        for p in range(q + 1, k - 1):
            a, b = R[p, q], R[p, q + 1]
            R[p, q], R[p, q + 1] = c * a + s * b, c * b - s * a
        for j in range(n):
            a, b = J[q, j], J[q + 1, j]
            J[q, j], J[q + 1, j] = c * a + s * b, c * b - s * a
        a, b = d[q], d[q + 1]
        d[q], d[q + 1] = c * a + s * b, c * b - s * a


@summing_part
def back(R: Array, r: Array, k: Index) -> None:
    """r <- R^-1 r."""
    for j in range(k - 1, -1, -1):
        r[j] /= R[j, j]
        s = r[j]
        for i in range(j):
            r[i] -= s * R[j, i]


@summing_part
def forward(R: Array, r: Array, k: Index) -> None:
    """r <- R^-T r."""
    for j in range(k):
        s = r[j]
        for i in range(j):
            s -= R[j, i] * r[i]
        r[j] = s / R[j, j]


@summing_part
def combine(J: Array, w: Array, first: Index, last: Index, z: Array) -> None:
    """z = J[first:last]' w[first:last]."""
    n = J.shape[0]
    for j in range(n):
        z[j] = 0.0
    for i in range(first, last):
        s = w[i]
        for j in range(n):
            z[j] += s * J[i, j]


@summing_part
def norm(x: Array) -> Real:
    """Euclidean norm."""
    s = 0.0
    for i in range(x.shape[0]):
        s += x[i] * x[i]
    return np.sqrt(s)


@summing
def begin(
    J: Array, R: Array, S: Array, low: Array, high: Array, state: Array, act: Array, side: Array,
) -> Index:  # fmt: skip
    """Factor the rows of a given state and equalities, but those that depend on others; their
    number."""
    n, m = J.shape[0], S.shape[0]
    d, z, k = np.empty(n), np.empty(n), 0
    for c in range(m + n):
        if (state[c] == 0 and low[c] != high[c]) or k == n:
            continue
        s = -1.0 if state[c] > 0 else 1.0
        if not abs(high[c] if s < 0.0 else low[c]) < NONE:
            continue
        project(J, S, c, s, d)
        rest = total = 0.0
        for i in range(n):
            total += d[i] * d[i]
            rest += d[i] * d[i] if i >= k else 0.0
        if rest <= 1e-20 * total:
            continue
        combine(J, d, k, n, z)
        add(J, R, d, z, k, rest)
        act[k], side[k] = c, s
        k += 1
    return k


@summing_part
def leave(
    J: Array, R: Array, act: Array, side: Array, w: Array, k: Index, l: Index,
) -> Index:  # fmt: skip
    """Take entry l out of an active set of k; the new k."""
    drop(J, R, w, k, l)
    for i in range(l, k - 1):
        act[i], side[i] = act[i + 1], side[i + 1]
    return k - 1


@summing_part
def point(
    J: Array, R: Array, act: Array, side: Array, low: Array, high: Array, w: Array, k: Index, x:
    Array, u: Array,
) -> Index:  # fmt: skip
    """x and multipliers u of an active set, where J'w is the free minimum; drops what pulls."""
    n, v = J.shape[0], np.empty(J.shape[0])
    while True:
        l = -1
        for i in range(k):
            c = act[i]
            v[i] = low[c] if side[i] > 0.0 else -high[c]
            if not abs(v[i]) < NONE:
                l = i
        if l >= 0:  # of another problem: there is no such side
            k = leave(J, R, act, side, w, k, l)
            continue
        forward(R, v, k)
        for i in range(n):
            if i < k:
                u[i] = v[i] - w[i]
            else:
                v[i] = w[i]
        combine(J, v, 0, n, x)
        back(R, u, k)
        worst, l = 0.0, -1
        for i in range(k):
            if u[i] < worst and low[act[i]] != high[act[i]]:
                worst, l = u[i], i
        if l < 0:
            return k
        k = leave(J, R, act, side, w, k, l)


@summing_part
def value_of(S: Array, x: Array, c: Index) -> Real:
    """Row c, or variable c - m, at x."""
    m, n = S.shape
    if c >= m:
        return x[c - m]
    s = 0.0
    for j in range(n):
        s += S[c, j] * x[j]
    return s


@summing_part
def choose(
    S: Array, size: Array, low: Array, high: Array, x: Array, length: Real, place: Array, safe:
    Array, path: Real,
) -> tuple[Index, Real, Index]:  # fmt: skip
    """The most violated row or bound (equal sides first), its side and the number of violated ones;
    what has more room than x moved since (by the Cauchy inequality) is not looked at."""
    m, n = S.shape
    best, found, where, count, equal = 0.0, -1, 1.0, 0, False
    for c in range(m + n):
        if place[c] >= 0 or path < safe[c]:
            continue
        value, unit = value_of(S, x, c), size[c] if c < m else 1.0
        below, above = low[c] - value, value - high[c]
        e, s, limit = (below, 1.0, low[c]) if below > above else (above, -1.0, high[c])
        if e > 8 * n * EPS * (abs(limit) + unit * length):
            count += 1
            e /= unit
            first = low[c] == high[c]
            if (first and not equal) or (first == equal and e > best):
                best, found, where, equal = e, c, s, first
        elif e < 0.0:
            safe[c] = path - e / unit
    return found, where, count


@summing_part
def ratio(
    u: Array, r: Array, act: Array, low: Array, high: Array, k: Index,
) -> tuple[Real, Index]:  # fmt: skip
    """The largest step of the multipliers u - t r, and what is dropped there."""
    t, l = NONE, -1
    for i in range(k):
        if r[i] > 0.0 and u[i] < t * r[i] and low[act[i]] != high[act[i]]:
            t, l = u[i] / r[i], i
    return t, l


@summing_part
def iterate(
    J: Array, R: Array, S: Array, size: Array, low: Array, high: Array, w: Array, act: Array,
    side: Array, k: Index, x: Array, u: Array, steps: Array,
) -> tuple[Index, Index, Index, Index, Real]:  # fmt: skip
    """From a dual feasible point to the code, the number of active rows and of steps, and, where
    rows contradict each other, the last one (whose multiplier is 1) and its side; those of the
    others are then in u."""
    m, n = S.shape
    d, r, z, free = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    combine(J, w, 0, n, free)
    least, path = norm(free), 0.0
    place, safe = np.full(m + n, -1), np.zeros(m + n)
    for i in range(k):
        place[act[i]] = i
    for step in range(steps.shape[0]):
        length = max(norm(x), least)
        c, s, count = choose(S, size, low, high, x, length, place, safe, path)
        steps[step, 0], steps[step, 1] = k, count
        if c < 0:
            return SOLVED, k, step + 1, -1, s
        project(J, S, c, s, d)
        new = 0.0
        while True:
            rest = total = 0.0
            for i in range(n):
                total += d[i] * d[i]
                rest += d[i] * d[i] if i >= k else 0.0
            for i in range(k):
                r[i] = d[i]
            back(R, r, k)
            t, l = ratio(u, r, act, low, high, k)
            whole = NONE
            if rest > 1e-22 * n * total:
                value = value_of(S, x, c)
                whole = ((low[c] - value) if s > 0.0 else (value - high[c])) / rest
            if t == NONE and whole == NONE:
                for i in range(k):
                    u[i] = -r[i]
                return EMPTY, k, step + 1, c, s
            t = max(min(t, whole), 0.0)
            if whole < NONE:
                combine(J, d, k, n, z)
                moved = 0.0
                for j in range(n):
                    x[j] += t * z[j]
                    moved += z[j] * z[j]
                path += t * np.sqrt(moved) * (1.0 + 1e-12)
            for i in range(k):
                u[i] -= t * r[i]
            new += t
            if (k == n and t >= whole) or (l < 0 and not t >= whole):  # the latter with NaN only
                return UNDECIDED, k, step + 1, -1, s
            if t >= whole:
                add(J, R, d, z, k, rest)
                act[k], side[k], u[k], place[c] = c, s, new, k
                k += 1
                break
            place[act[l]] = -1
            safe[act[l]] = 0.0
            drop(J, R, d, k, l)
            k -= 1
            for i in range(l, k):
                act[i], side[i], u[i] = act[i + 1], side[i + 1], u[i + 1]
                place[act[i]] = i
    return UNDECIDED, k, steps.shape[0], -1, 1.0


@summing_part
def gradient(
    P: Array, C: Array, q: Array, x: Array, y: Array, box: Array, Px: Array, Cy: Array,
) -> Real:  # fmt: skip
    """Px, C'y and the largest of their entries, of q and of the box's multipliers."""
    m, n = C.shape
    for i in range(n):
        s = 0.0
        for j in range(n):
            s += P[i, j] * x[j]
        Px[i], Cy[i] = s, 0.0
    for i in range(m):
        if y[i] != 0.0:
            s = y[i]
            for j in range(n):
                Cy[j] += s * C[i, j]
    force = 0.0
    for i in range(n):
        force = max(force, abs(Px[i]), abs(q[i]), abs(Cy[i]), abs(box[i]))
    return force


@summing_part
def refine(
    P: Array, C: Array, J: Array, R: Array, S: Array, D: Array, low: Array, high: Array, q:
    Array, act: Array, side: Array, k: Index, x: Array, u: Array, y: Array, box: Array,
) -> None:  # fmt: skip
    """A step of refinement of x and u by residuals in the units of the problem."""
    m, n = C.shape
    whole, Px, Cy = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        whole[i] = D[i] * x[i]
    spread(act, side, u, D, k, m, y, box)
    gradient(P, C, q, whole, y, box, Px, Cy)
    t, v, z = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        z[i] = -D[i] * (Px[i] + q[i] + Cy[i] + box[i])
    for i in range(n):
        s = 0.0
        for j in range(n):
            s += J[i, j] * z[j]
        t[i] = s
    for i in range(k):
        c, value = act[i], value_of(S, x, act[i])
        v[i] = low[c] - value if side[i] > 0.0 else value - high[c]
    forward(R, v, k)
    for i in range(n):
        if i < k:
            t[i] = v[i] - t[i]
        else:
            v[i] = t[i]
    combine(J, v, 0, n, z)
    back(R, t, k)
    for i in range(n):
        x[i] += z[i]
    for i in range(k):
        u[i] += t[i]
        c = act[i]
        if c >= m:
            x[c - m] = low[c] if side[i] > 0.0 else high[c]
        if u[i] < 0.0 and low[c] != high[c]:
            u[i] = 0.0


@summing_part
def spread(
    act: Array, side: Array, u: Array, D: Array, k: Index, m: Index, y: Array, box: Array,
) -> None:  # fmt: skip
    """Multipliers of all rows and bounds, in the units and with the signs of the problem."""
    y[:] = 0.0
    box[:] = 0.0
    for i in range(k):
        c = act[i]
        if c < m:
            y[c] = -side[i] * u[i]
        else:
            box[c - m] = -side[i] * u[i] / D[c - m]


@summing_part
def certify(
    P: Array, C: Array, q: Array, low: Array, high: Array, x: Array, y: Array, box: Array, kkt:
    Array,
) -> None:  # fmt: skip
    """Residuals as in `gpu.qp.data.standard_qp.residuals`, without their smaller sizes."""
    m, n = C.shape
    Px, Cy = np.empty(n), np.empty(n)
    force = gradient(P, C, q, x, y, box, Px, Cy)
    off = curved = linear = sides = length = pushed = held = outside = size = near = 0.0
    for i in range(n):
        off = max(off, abs(Px[i] + q[i] + Cy[i] + box[i]))
        curved += x[i] * Px[i]
        linear += q[i] * x[i]
        length = max(length, abs(x[i]))
        if box[i] != 0.0:
            s = high[m + i] if box[i] > 0.0 else low[m + i]
            sides += box[i] * s
            held = max(held, abs(box[i] * (x[i] - s)))
    for i in range(m):
        value = 0.0
        for j in range(n):
            value += C[i, j] * x[j]
        s = min(max(value, low[i]), high[i])
        size, near = max(size, abs(value)), max(near, abs(s))
        outside = max(outside, abs(value - s))
        if y[i] != 0.0:
            s = high[i] if y[i] > 0.0 else low[i]
            sides += y[i] * s
            pushed = max(pushed, abs(y[i] * (value - s)))
    kkt[0] = over(off, force)
    kkt[1] = over(outside, max(size, near))
    kkt[2] = 0.0
    kkt[3] = max(over(pushed, force * max(size, length)), over(held, force * length))
    kkt[4] = over(abs(curved + linear + sides), max(abs(curved), abs(linear)))


@summing_part
def certify_box(
    P: Array, C: Array, q: Array, low: Array, high: Array, x: Array, y: Array, box: Array, kkt:
    Array,
) -> None:  # fmt: skip
    """Residuals as in `gpu.qp.data.qp_result.kkt_residuals`, for bounds and equality rows."""
    m, n = C.shape
    Px, Cy, terms, root = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    gradient(P, C, q, x, y, box, Px, Cy)
    phi = length = 0.0
    for i in range(n):
        s = abs(q[i])
        for j in range(n):
            s += abs(P[i, j]) * abs(x[j])
        for j in range(m):
            s += abs(C[j, i]) * abs(y[j])
        terms[i], root[i] = s, np.sqrt(P[i, i])
        phi = max(phi, s / root[i])
        length = max(length, root[i] * abs(x[i]))
    off = outside = pairs = gap = all_terms = 0.0
    for i in range(n):
        off = max(off, abs(Px[i] + q[i] + Cy[i] + box[i]) / root[i])
        gap += x[i] * (Px[i] + q[i])
        all_terms += abs(x[i]) * terms[i]
        if box[i] != 0.0:
            s = high[m + i] if box[i] > 0.0 else low[m + i]
            distance = root[i] * max(high[m + i] - x[i] if box[i] > 0.0 else x[i] - low[m + i], 0.0)
            if distance > 0.0:
                pairs = max(pairs, min(abs(box[i]) / root[i] / phi, distance / length))
            gap += box[i] * s
            all_terms += abs(box[i] * s)
    unseen = 0.0
    for i in range(m):
        value = moved = size = 0.0
        for j in range(n):
            value += C[i, j] * x[j]
            size += abs(C[i, j] * x[j])
            moved += abs(C[i, j]) / root[j]
        moved *= 64 * EPS * phi
        rest = abs(value - low[i]) - moved
        if rest > 0.0:
            outside = max(outside, over(rest, size + abs(low[i])))
        gap += y[i] * low[i]
        all_terms += abs(y[i] * low[i])
        unseen += abs(y[i]) * moved
    kkt[0], kkt[1], kkt[2], kkt[3] = over(off, phi), outside, 0.0, pairs
    kkt[4] = over(max(abs(gap) - unseen, 0.0), all_terms)


@summing_part
def over(value: Real, size: Real) -> Real:
    """value / size, zero where value is."""
    return value / size if value != 0.0 else 0.0


@summing_part
def states(
    low: Array, high: Array, x: Array, y: Array, box: Array, m: Index, active: Array,
) -> bool:  # fmt: skip
    """Signed states of rows and bounds; whether one that is held, of unequal sides, is idle."""
    idle = False
    for i in range(m):
        active[i] = 1 if y[i] > 0.0 else -1 if y[i] < 0.0 else 0
    for i in range(x.shape[0]):
        c, state = m + i, 0
        if low[c] == high[c]:
            state = -1 if box[i] < 0.0 else 1
        elif x[i] == low[c] or x[i] == high[c]:
            state = -1 if x[i] == low[c] else 1
            idle |= box[i] == 0.0
        active[c] = state
    return idle


@summing
def solve(
    P: Array, C: Array, q: Array, low: Array, high: Array, D: Array, J: Array, S: Array, size:
    Array, R: Array, act: Array, side: Array, k: Index, boxes: bool, x: Array, y: Array, box:
    Array, active: Array, steps: Array, kkt: Array,
) -> tuple[Index, Index, Index, bool]:  # fmt: skip
    """Solve the problem whose sides are those of the rows, then of the bounds, from the factored
    active set of k entries; returns a code, the new k, the number of steps and whether idle rows
    are held."""
    m, n = C.shape
    lo, hi, w, u = low.copy(), high.copy(), np.empty(n), np.empty(n)
    for i in range(n):
        lo[m + i] /= D[i]
        hi[m + i] /= D[i]
    for i in range(n):
        s = 0.0
        for j in range(n):
            s -= J[i, j] * D[j] * q[j]
        w[i] = s
    k = point(J, R, act, side, lo, hi, w, k, x, u)
    code, k, count, last, s = iterate(J, R, S, size, lo, hi, w, act, side, k, x, u, steps)
    if code == EMPTY:  # the contradiction, with the signs of multipliers
        spread(act, side, u, D, k, m, y, box)
        if last < m:
            y[last] = -s
    if code != SOLVED:
        return code, k, count, False
    refine(P, C, J, R, S, D, lo, hi, q, act, side, k, x, u, y, box)
    for i in range(n):
        x[i] = min(max(D[i] * x[i], low[m + i]), high[m + i])
    spread(act, side, u, D, k, m, y, box)
    if boxes:
        certify_box(P, C, q, low, high, x, y, box, kkt)
    else:
        certify(P, C, q, low, high, x, y, box, kkt)
    return code, k, count, states(low, high, x, y, box, m, active)


@summing
def plain(q: Array, low: Array, high: Array) -> bool:
    """Whether q is finite and sides are numbers in order; huge ones become infinite."""
    good = True
    for i in range(q.shape[0]):
        good &= abs(q[i]) < NONE
    for i in range(low.shape[0]):
        if low[i] <= -HUGE:
            low[i] = -NONE
        if high[i] >= HUGE:
            high[i] = NONE
        good &= low[i] <= high[i] and low[i] < HUGE and high[i] > -HUGE
    return good


@summing
def solve_one(
    P: Array, C: Array, q: Array, low: Array, high: Array, boxes: bool, most: Index,
) -> tuple[Any, ...]:  # fmt: skip
    """Solve one problem with everything that is made of it: a code (UNDECIDED also where a number
    is none), whether idle rows are held, x, multipliers of rows and bounds, signed states,
    residuals and steps."""
    m, n = C.shape
    D, J, R = np.empty(n), np.empty((n, n)), np.empty((n, n))
    S, size, act, side = np.empty((m, n)), np.empty(m), np.empty(n, np.int64), np.empty(n)
    x, y, box, kkt = np.empty(n), np.empty(m), np.empty(n), np.empty(5)
    active, steps = np.zeros(m + n, np.int8), np.empty((most, 2), np.int64)
    code, k, count, idle = UNDECIDED, 0, 0, False
    if plain(q, low, high) and factor(P, D, J) and scale_rows(C, D, S, size):
        k = begin(J, R, S, low, high, active, act, side)
        code, k, count, idle = solve(
            P, C, q, low, high, D, J, S, size, R, act, side, k, boxes, x, y, box, active, steps, kkt
        )
    return code, idle, x, y, box, active, kkt, steps[:count]


@summing
def solve_many(
    P: Array, C: Array, q: Array, low: Array, high: Array, state: Array, boxes: bool, chain:
    bool, first: Index, last: Index, most: Index, out: tuple[Array, ...],
) -> None:  # fmt: skip
    """Solve problems first:last of a batch, see `gpu.qp.batch`; arrays of leading size 1 are shared
    by all. With `chain` a problem begins at the active set of the one before."""
    x, y, box, active, kkt, code, idle, count = out
    m, n = C.shape[1], C.shape[2]
    D, J, R = np.empty(n), np.empty((n, n)), np.empty((n, n))
    S, size = np.empty((m, n)), np.empty(m)
    steps = np.empty((most, 2), np.int64)
    start, act, side = np.empty((n, n)), np.empty(n, np.int64), np.empty(n)
    good, k = False, 0
    for b in range(first, last):
        Pb, Cb = P[b % P.shape[0]], C[b % C.shape[0]]
        qb, lo, hi = q[b % q.shape[0]], low[b % low.shape[0]].copy(), high[b % high.shape[0]].copy()
        new = b == first or P.shape[0] > 1 or C.shape[0] > 1
        if new:
            good = factor(Pb, D, start) and scale_rows(Cb, D, S, size)
        code[b], count[b] = UNDECIDED, 0
        if not good or not plain(qb, lo, hi):
            continue
        if new or not chain or k == 0:
            J[:] = start
            k = begin(J, R, S, lo, hi, state[b % state.shape[0]], act, side)
        code[b], k, count[b], idle[b] = solve(
            Pb, Cb, qb, lo, hi, D, J, S, size, R, act, side, k, boxes, x[b], y[b], box[b],
            active[b], steps, kkt[b],
        )  # fmt: skip
        if code[b] != SOLVED:
            k = 0
