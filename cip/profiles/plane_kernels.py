r"""Direct two-dimensional updates with Adini's and the bicubic profile: kernels for CPU and device.

With the foot X of a node and G = dX/dx, the new field is :math:`\phi(X)` and its gradient
:math:`G^T \nabla\phi(X)` (King 2012, (3.11): his inverse is G^T); for advection both carry
E = det G and its derivatives ((3.14) and (3.19), where the printed y3 p is p / y3).

Adini's profile is the Boolean sum of cubic and linear interpolation, exact for cubics,
:math:`\phi = H_x L_y + L_x H_y - L_x L_y`; with the bubbles of the four edges
:math:`\beta = s (1-s) [(va - d)(1-s) - (vb - d) s]` it is the bilinear interpolant plus
:math:`(1-t) \beta_0 + t \beta_1 + (1-s) \beta_2 + s \beta_3`.

Moments u, u_x, u_y (, u_xy); feet X, Y, X_x, X_y, Y_x, Y_y (bicubic: X_xy, Y_xy), for advection
E, E_x, E_y (bicubic: E_xy).
"""

from __future__ import annotations

from cip.jit import Array, Index, Out, Real, Widths, kernel
from cip.profiles.line_profiles import cubic, cubic_second, locate, rough, tangents


@kernel
def bubble(d: Real, va: Real, vb: Real, s: Real) -> tuple[Real, Real]:
    """What the cubic with end slopes adds to the chord, and its derivative."""
    r = 1.0 - s
    p = va - d
    q = vb - d
    e = p * r - q * s
    return s * r * e, (r - s) * e - s * r * (p + q)


@kernel
def edge(
    m: Array, h: Widths, base: Index, stride: Index, n: Index, periodic: Index, k: Index, r: Index,
    a: Real, b: Real, va: Real, vb: Real, s: Real, d: Real,
) -> tuple[Real, Real, Index]:  # fmt: skip
    """The bubble of an edge, from the tangents where its line is rough (2); whether to clamp (1).

    A fifth of the roughness of a jump marks the wiggles beside it: there the cubic stays, within
    the values at the corners.
    """
    if rough(m, h, base, stride, n, periodic, k, r, a, b, va, vb, 0.1) == 1:
        value, slope = tangents(a, b, va, vb, s, d)
        return value - a - s * (b - a), slope - (b - a), 2
    value, slope = bubble(b - a, va, vb, s)
    clamped = rough(m, h, base, stride, n, periodic, k, r, a, b, va, vb, 0.02)
    return value, slope, clamped


@kernel
def adini_sum(
    u00: Real, d0: Real, d1: Real, e0: Real, e1: Real, b0: Real, db0: Real, b1: Real, db1: Real,
    b2: Real, db2: Real, b3: Real, db3: Real, a: Real, b: Real, s: Real, t: Real,
) -> tuple[Real, Real, Real]:  # fmt: skip
    """Value and gradient from the value at a corner, the jumps and bubbles of the edges."""
    value = u00 + s * d0 + t * (e0 + s * (d1 - d0)) + b0 + t * (b1 - b0) + b2 + s * (b3 - b2)
    fx = (1.0 / a) * (d0 + t * (d1 - d0) + db0 + t * (db1 - db0) + b3 - b2)
    fy = (1.0 / b) * (e0 + s * (e1 - e0) + db2 + s * (db3 - db2) + b1 - b0)
    return value, fx, fy


@kernel
def adini_profile(
    u00: Real, u10: Real, u01: Real, u11: Real, p0: Real, p1: Real, p2: Real, p3: Real,
    q0: Real, q1: Real, q2: Real, q3: Real, a: Real, b: Real, s: Real, t: Real,
) -> tuple[Real, Real, Real]:  # fmt: skip
    """Value and gradient from the corners of a cell of widths a, b: u, u_x, u_y."""
    d0 = u10 - u00
    d1 = u11 - u01
    e0 = u01 - u00
    e1 = u11 - u10
    b0, db0 = bubble(d0, a * p0, a * p1, s)
    b1, db1 = bubble(d1, a * p2, a * p3, s)
    b2, db2 = bubble(e0, b * q0, b * q2, t)
    b3, db3 = bubble(e1, b * q1, b * q3, t)
    return adini_sum(u00, d0, d1, e0, e1, b0, db0, b1, db1, b2, db2, b3, db3, a, b, s, t)


@kernel
def move_adini(
    value: Real, fx: Real, fy: Real, feet: Array, fs: Index, fo: Index, advect: Index,
    out: Out, size: Index, o: Index,
) -> None:  # fmt: skip
    """The new moments by the chain rule."""
    gx = feet[2 * fs + fo] * fx + feet[4 * fs + fo] * fy
    gy = feet[3 * fs + fo] * fx + feet[5 * fs + fo] * fy
    u = value
    if advect == 1:
        E = feet[6 * fs + fo]
        gx = E * gx + feet[7 * fs + fo] * value
        gy = E * gy + feet[8 * fs + fo] * value
        u = E * value
    out[o] = u
    out[size + o] = gx
    out[2 * size + o] = gy


@kernel
def adini_eno(
    m: Array, hx: Widths, hy: Widths, size: Index, k: Index, kr: Index, l: Index, lr: Index,
    nx: Index, ny: Index, px: Index, py: Index, s: Real, t: Real, dx: Real, dy: Real,
) -> tuple[Real, Real, Real, Real, Index]:  # fmt: skip
    """Value, gradient and cross derivative with the choice at each edge, and the worst edge."""
    a = hx[k]
    b = hy[l]
    c00 = k * ny + l
    c10 = kr * ny + l
    c01 = k * ny + lr
    c11 = kr * ny + lr
    u00 = m[c00]
    u10 = m[c10]
    u01 = m[c01]
    u11 = m[c11]
    x = size
    y = 2 * size
    b0, db0, r0 = edge(m, hx, l, ny, nx, px, k, kr, u00, u10, a * m[x + c00], a * m[x + c10], s, dx)
    b1, db1, r1 = edge(
        m, hx, lr, ny, nx, px, k, kr, u01, u11, a * m[x + c01], a * m[x + c11], s, dx
    )
    b2, db2, r2 = edge(
        m, hy, k * ny, 1, ny, py, l, lr, u00, u01, b * m[y + c00], b * m[y + c01], t, dy
    )
    b3, db3, r3 = edge(
        m, hy, kr * ny, 1, ny, py, l, lr, u10, u11, b * m[y + c10], b * m[y + c11], t, dy
    )
    value, fx, fy = adini_sum(
        u00, u10 - u00, u11 - u01, u01 - u00, u11 - u10,
        b0, db0, b1, db1, b2, db2, b3, db3, a, b, s, t,
    )  # fmt: skip
    fxy = (u11 - u01 - u10 + u00 + db1 - db0 + db3 - db2) / (a * b)
    worst = r0
    if r1 > worst:
        worst = r1
    if r2 > worst:
        worst = r2
    if r3 > worst:
        worst = r3
    return value, fx, fy, fxy, worst


@kernel
def adini(
    m: Array, out: Out, feet: Array, fs: Index, fo: Index, hx: Widths, hy: Widths,
    size: Index, o: Index,
    i: Index, j: Index, nx: Index, ny: Index, px: Index, py: Index, advect: Index, limiter: Index,
) -> None:  # fmt: skip
    """Adini's profile of u, u_x, u_y."""
    k, kr, s = locate(i, feet[fo], nx, px)
    l, lr, t = locate(j, feet[fs + fo], ny, py)
    c00 = k * ny + l
    c10 = kr * ny + l
    c01 = k * ny + lr
    c11 = kr * ny + lr
    a = hx[k]
    b = hy[l]
    u00 = m[c00]
    u10 = m[c10]
    u01 = m[c01]
    u11 = m[c11]
    ux = size
    uy = 2 * size
    p0 = m[ux + c00]
    p1 = m[ux + c10]
    p2 = m[ux + c01]
    p3 = m[ux + c11]
    q0 = m[uy + c00]
    q1 = m[uy + c10]
    q2 = m[uy + c01]
    q3 = m[uy + c11]
    cut = limiter
    if limiter == 2:
        value, fx, fy, _fxy, cut = adini_eno(
            m, hx, hy, size, k, kr, l, lr, nx, ny, px, py, s, t, feet[fo], feet[fs + fo]
        )
    else:
        value, fx, fy = adini_profile(
            u00, u10, u01, u11, p0, p1, p2, p3, q0, q1, q2, q3, a, b, s, t
        )
    if cut > 0:
        low = min(min(u00, u10), min(u01, u11))
        high = max(max(u00, u10), max(u01, u11))
        value = min(max(value, low), high)
    move_adini(value, fx, fy, feet, fs, fo, advect, out, size, o)


@kernel
def bicubic_profile(
    u00: Real, u10: Real, u01: Real, u11: Real, x0: Real, x1: Real, x2: Real, x3: Real,
    y0: Real, y1: Real, y2: Real, y3: Real, z0: Real, z1: Real, z2: Real, z3: Real,
    a: Real, b: Real, s: Real, t: Real,
) -> tuple[Real, Real, Real, Real, Real, Real]:  # fmt: skip
    """Value, gradient and second derivatives xx, xy, yy from the corners: u, u_x, u_y, u_xy."""
    ab = a * b
    p0 = a * x0
    p1 = a * x1
    p2 = a * x2
    p3 = a * x3
    q0 = b * y0
    q1 = b * y1
    q2 = b * y2
    q3 = b * y3
    w0 = ab * z0
    w1 = ab * z1
    w2 = ab * z2
    w3 = ab * z3
    low, low1 = cubic(u00, u10, p0, p1, s)
    top, top1 = cubic(u01, u11, p2, p3, s)
    lowt, lowt1 = cubic(q0, q1, w0, w1, s)
    topt, topt1 = cubic(q2, q3, w2, w3, s)
    value, ft = cubic(low, top, lowt, topt, t)
    ftt = cubic_second(low, top, lowt, topt, t)
    f1, fst = cubic(low1, top1, lowt1, topt1, t)
    low2 = cubic_second(u00, u10, p0, p1, s)
    top2 = cubic_second(u01, u11, p2, p3, s)
    lowt2 = cubic_second(q0, q1, w0, w1, s)
    topt2 = cubic_second(q2, q3, w2, w3, s)
    fss, _slope = cubic(low2, top2, lowt2, topt2, t)
    # Quotients of numbers that do not change from cell to cell are constants on the device.
    x = 1.0 / a
    y = 1.0 / b
    return value, x * f1, y * ft, x * x * fss, x * y * fst, y * y * ftt


@kernel
def move_bicubic(
    value: Real, fx: Real, fy: Real, fxx: Real, fxy: Real, fyy: Real,
    feet: Array, fs: Index, fo: Index, advect: Index, out: Out, size: Index, o: Index,
) -> None:  # fmt: skip
    """The new moments by the chain rule."""
    g11 = feet[2 * fs + fo]
    g12 = feet[3 * fs + fo]
    g21 = feet[4 * fs + fo]
    g22 = feet[5 * fs + fo]
    u = value
    vx = g11 * fx + g21 * fy
    vy = g12 * fx + g22 * fy
    vxy = (
        g11 * g12 * fxx + (g11 * g22 + g21 * g12) * fxy + g21 * g22 * fyy
        + feet[6 * fs + fo] * fx + feet[7 * fs + fo] * fy
    )  # fmt: skip
    if advect == 1:
        E = feet[8 * fs + fo]
        Ex = feet[9 * fs + fo]
        Ey = feet[10 * fs + fo]
        vxy = E * vxy + Ex * vy + Ey * vx + feet[11 * fs + fo] * value
        vx = E * vx + Ex * value
        vy = E * vy + Ey * value
        u = E * value
    out[o] = u
    out[size + o] = vx
    out[2 * size + o] = vy
    out[3 * size + o] = vxy


@kernel
def bicubic(
    m: Array, out: Out, feet: Array, fs: Index, fo: Index, hx: Widths, hy: Widths,
    size: Index, o: Index,
    i: Index, j: Index, nx: Index, ny: Index, px: Index, py: Index, advect: Index, limiter: Index,
) -> None:  # fmt: skip
    """Bicubic Hermite profile of u, u_x, u_y, u_xy: along x on both edges, then along y."""
    k, kr, s = locate(i, feet[fo], nx, px)
    l, lr, t = locate(j, feet[fs + fo], ny, py)
    c00 = k * ny + l
    c10 = kr * ny + l
    c01 = k * ny + lr
    c11 = kr * ny + lr
    ux = size
    uy = 2 * size
    w = 3 * size
    u00 = m[c00]
    u10 = m[c10]
    u01 = m[c01]
    u11 = m[c11]
    value, fx, fy, fxx, fxy, fyy = bicubic_profile(
        u00, u10, u01, u11, m[ux + c00], m[ux + c10], m[ux + c01], m[ux + c11],
        m[uy + c00], m[uy + c10], m[uy + c01], m[uy + c11],
        m[w + c00], m[w + c10], m[w + c01], m[w + c11], hx[k], hy[l], s, t,
    )  # fmt: skip
    cut = limiter
    if limiter == 2:
        other, other_x, other_y, other_xy, cut = adini_eno(
            m, hx, hy, size, k, kr, l, lr, nx, ny, px, py, s, t, feet[fo], feet[fs + fo]
        )
        if cut == 2:
            # Beside a jump no cross moment can be trusted: the profile of the tangents alone.
            value = other
            fx = other_x
            fy = other_y
            fxx = 0.0
            fxy = other_xy
            fyy = 0.0
    if cut > 0:
        low_end = min(min(u00, u10), min(u01, u11))
        high_end = max(max(u00, u10), max(u01, u11))
        value = min(max(value, low_end), high_end)
    move_bicubic(value, fx, fy, fxx, fxy, fyy, feet, fs, fo, advect, out, size, o)


@kernel
def node_adini(
    m: Array, out: Out, feet: Array, fs: Index, fo: Index, hx: Widths, hy: Widths,
    size: Index, o: Index,
    i: Index, j: Index, nx: Index, ny: Index, px: Index, py: Index, advect: Index, limiter: Index,
) -> None:  # fmt: skip
    """Adini's profile without limiter, which the compiler then drops."""
    adini(m, out, feet, fs, fo, hx, hy, size, o, i, j, nx, ny, px, py, advect, 0)


@kernel
def node_adini_limited(
    m: Array, out: Out, feet: Array, fs: Index, fo: Index, hx: Widths, hy: Widths,
    size: Index, o: Index,
    i: Index, j: Index, nx: Index, ny: Index, px: Index, py: Index, advect: Index, limiter: Index,
) -> None:  # fmt: skip
    """Adini's profile with a limiter."""
    adini(m, out, feet, fs, fo, hx, hy, size, o, i, j, nx, ny, px, py, advect, limiter)


@kernel
def node_bicubic(
    m: Array, out: Out, feet: Array, fs: Index, fo: Index, hx: Widths, hy: Widths,
    size: Index, o: Index,
    i: Index, j: Index, nx: Index, ny: Index, px: Index, py: Index, advect: Index, limiter: Index,
) -> None:  # fmt: skip
    """The bicubic profile without limiter, which the compiler then drops."""
    bicubic(m, out, feet, fs, fo, hx, hy, size, o, i, j, nx, ny, px, py, advect, 0)


@kernel
def node_bicubic_limited(
    m: Array, out: Out, feet: Array, fs: Index, fo: Index, hx: Widths, hy: Widths,
    size: Index, o: Index,
    i: Index, j: Index, nx: Index, ny: Index, px: Index, py: Index, advect: Index, limiter: Index,
) -> None:  # fmt: skip
    """The bicubic profile with a limiter."""
    bicubic(m, out, feet, fs, fo, hx, hy, size, o, i, j, nx, ny, px, py, advect, limiter)
