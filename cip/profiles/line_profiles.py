r"""Profiles on one cell of a line from values and slopes; kernels for CPU and device.

A profile is the function in a cell that the moments at its ends determine. With s in [0, 1] across
the cell, end values a, b, d = b - a, and slopes times the width va, vb:

* cubic Hermite: :math:`F = a + d s + s (1-s) [(va - d)(1-s) - (vb - d) s]`;
* piecewise linear (King 2012, (2.17)-(2.21), signs and pairing of min and max corrected): the two
  end tangents if they cross inside the cell, else the chord;
* rational (Xiao, Yabe and Ito, Comput. Phys. Commun. 93, 1996, 1-12): convex or concave on the
  whole cell, used in cells whose end slopes differ in sign;
* quintic Hermite, from second derivatives too.
"""

from __future__ import annotations

from math import exp, floor

from cip.profiles.catalogue import Line
from skfem_adini.ground.jit import Array, Index, Real, kernel


@kernel
def locate(i: Index, d: Real, n: Index, periodic: Index) -> tuple[Index, Index, Real]:
    """The cell of the foot d cells from node i: left node, right node, local coordinate. Outside a
    line that is not periodic the nearest end is taken."""
    f = floor(d)
    s = d - f
    k = i + f
    if periodic == 1:
        if k < 0 or k >= n:
            # No integer division, which would prevent vectorization of the loop. In single
            # precision the quotient may be wrong by one, which the next lines correct.
            k = k - n * floor((k + 0.5) * (1.0 / n))
            if k < 0:
                k = k + n
            if k >= n:
                k = k - n
            if k < 0 or k >= n:
                k = 0  # d is not finite; then s is NaN, and so is the result
        r = k + 1
        if r == n:
            r = 0
    else:
        if k < 0:
            k = 0
            s = 0.0
        if k > n - 2:
            k = n - 2
            s = 1.0
        r = k + 1
    return k, r, s


@kernel
def cubic(a: Real, b: Real, va: Real, vb: Real, s: Real) -> tuple[Real, Real]:
    """Value and derivative in s of the cubic Hermite profile."""
    d = b - a
    r = 1.0 - s
    p = va - d
    q = vb - d
    e = p * r - q * s
    return a + s * (d + r * e), d + (r - s) * e - s * r * (p + q)


@kernel
def cubic_second(a: Real, b: Real, va: Real, vb: Real, s: Real) -> Real:
    """Second derivative in s of the cubic Hermite profile."""
    d = b - a
    return 6.0 * s * (va + vb - 2.0 * d) + 2.0 * (3.0 * d - 2.0 * va - vb)


@kernel
def tangents(a: Real, b: Real, va: Real, vb: Real, s: Real, d: Real) -> tuple[Real, Real]:
    """Value and slope in s of the piecewise linear profile: the lower envelope of the end tangents
    if the slopes decrease, else the upper one. At the kink itself the upstream tangent is taken:
    the left one for d < 0."""
    e0 = vb - (b - a)
    e1 = va - (b - a)
    if s <= 0.0:
        return a, va
    if s >= 1.0:
        return b, vb
    if e0 * e1 > 0.0 or (e0 == 0.0 and e1 == 0.0):
        return a + s * (b - a), b - a
    # Left minus right tangent, up to a factor that makes it positive before the kink.
    side = (e0 + s * (e1 - e0)) * e0
    if e0 != 0.0 and (side > 0.0 or (side == 0.0 and d < 0.0)):
        return a + va * s, va
    return b - vb * (1.0 - s), vb


@kernel
def smoothed(a: Real, b: Real, va: Real, vb: Real, s: Real, width: Real) -> tuple[Real, Real]:
    """As `tangents`, with the smooth weights of King 2012, (2.18), signs corrected. The width of
    the transition, c = 1e-6, has the unit of u for values and of u_x for slopes, as printed."""
    c = 1e-6
    left = a + va * s
    right = b - vb * (1.0 - s)
    concave = 1.0 / (1.0 + exp((vb - va) / (width * c)))
    upper = 1.0 / (1.0 + exp((left - right) / c))
    # Weight of the right tangent: the lower one where concave, the upper one where convex.
    weight = concave * (1.0 - upper) + (1.0 - concave) * upper
    return left + weight * (right - left), va + weight * (vb - va)


@kernel
def rational(a: Real, b: Real, va: Real, vb: Real, s: Real) -> tuple[Real, Real]:
    """Value and derivative in s of the rational profile, :math:`a + d s + s (1-s) [p Q (1-s) - q P
    s] / [Q (1-s) + P s]`, p = va - d, q = vb - d, P = |p|, Q = |q|, without cancellation of large
    numbers; the cubic if the slopes agree in sign."""
    d = b - a
    p = va - d
    q = vb - d
    if va * vb >= 0.0 or p == 0.0 or q == 0.0:
        return cubic(a, b, va, vb, s)
    r = 1.0 - s
    P = abs(p)
    Q = abs(q)
    bottom = Q * r + P * s
    e = (p * Q * r - q * P * s) / bottom
    change = (p * Q + q * P + e * (P - Q)) / bottom
    return a + s * (d + r * e), d + (r - s) * e - s * r * change


@kernel
def quintic(
    a: Real, b: Real, va: Real, vb: Real, wa: Real, wb: Real, s: Real
) -> tuple[Real, Real, Real, Real]:
    """Value and three derivatives in s; wa, wb are half the second derivatives in s at the ends."""
    A = b - a - va - wa
    B = vb - va - 2.0 * wa
    C = wb - wa
    c3 = 10.0 * A - 4.0 * B + C
    c4 = -15.0 * A + 7.0 * B - 2.0 * C
    c5 = 6.0 * A - 3.0 * B + C
    value = a + s * (va + s * (wa + s * (c3 + s * (c4 + s * c5))))
    # What is added to the ends vanishes at both: by the powers of s, digits are lost at the right.
    r = 1.0 - s
    first = va + s * (vb - va + r * (s * (3.0 * c3 - B - 5.0 * s * c5) - B))
    second = 2.0 * (wa + s * (C + r * (3.0 * c3 - C - 10.0 * s * c5)))
    third = 6.0 * c3 + s * (24.0 * c4 + s * 60.0 * c5)
    return value, first, second, third


@kernel
def rough(
    m: Array, line: Line, k: Index, r: Index, a: Real, b: Real, va: Real, vb: Real, factor: Real
) -> Index:
    """1 if the data of a cell are not smooth, else 0: the criterion of the limiter ``eno``. The
    third difference |va + vb - 2 d|, O(h^3), exceeds `factor` times the sum of differences in this
    cell and its neighbours, O(h); .1 is best for the profile of Jiang and Shu."""
    d = b - a
    left = d
    right = d
    n = line.n
    cells = n - 1 + line.periodic
    if k > 0 or line.periodic == 1:
        p = k - 1
        if p < 0:
            p = n - 1
        left = (a - m[line.first + p * line.stride]) * line.h[k] / line.h[p]
    if r < n - 1 or line.periodic == 1:
        q = r + 1
        if q >= n:
            q = 0
        right = (m[line.first + q * line.stride] - b) * line.h[k] / line.h[r % cells]
    if abs(va + vb - 2.0 * d) > factor * (abs(d) + abs(left) + abs(right)):
        return 1
    return 0


@kernel
def around(
    line: Line, k: Index
) -> tuple[Index, Index, Index, Index, Real, Real, Real, Real]:  # fmt: skip
    """Four nodes around a cell with left node k, and their coordinates relative to this node."""
    h = line.h
    n = line.n
    first = k - 1
    cells = n
    if line.periodic == 0:
        cells = n - 1
        if first < 0:
            first = 0
        if first > n - 4:
            first = n - 4
    x0 = 0.0
    for q in range(first, k):
        x0 = x0 - h[q % cells]
    x1 = x0 + h[first % cells]
    x2 = x1 + h[(first + 1) % cells]
    x3 = x2 + h[(first + 2) % cells]
    return first % n, (first + 1) % n, (first + 2) % n, (first + 3) % n, x0, x1, x2, x3


@kernel
def lagrange(m: Array, line: Line, moment: Index, k: Index, s: Real) -> tuple[Real, Real]:
    """Value and slope (per length) of the cubic through a moment at four nodes around a cell; `k`
    is the left node of the cell, `s` in [0, 1] the local coordinate."""
    base = moment + line.first
    stride = line.stride
    n0, n1, n2, n3, x0, x1, x2, x3 = around(line, k)
    x = s * line.h[k]
    f0 = m[base + n0 * stride]
    f1 = m[base + n1 * stride]
    f2 = m[base + n2 * stride]
    f3 = m[base + n3 * stride]
    # Newton's divided differences.
    f01 = (f1 - f0) / (x1 - x0)
    f12 = (f2 - f1) / (x2 - x1)
    f23 = (f3 - f2) / (x3 - x2)
    f012 = (f12 - f01) / (x2 - x0)
    f123 = (f23 - f12) / (x3 - x1)
    f0123 = (f123 - f012) / (x3 - x0)
    y0 = x - x0
    y1 = x - x1
    y2 = x - x2
    value = f0 + y0 * (f01 + y1 * (f012 + y2 * f0123))
    slope = f01 + (y0 + y1) * f012 + (y0 * y1 + y0 * y2 + y1 * y2) * f0123
    return value, slope
