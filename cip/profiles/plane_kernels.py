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

from cip.profiles.catalogue import Cell, Corners, Edges, Foot, Limits, Line, Update
from cip.profiles.line_profiles import cubic, cubic_second, locate, rough, tangents
from skfem_adini.ground.jit import Array, Index, Out, Real, kernel


@kernel
def bubble(d: Real, va: Real, vb: Real, s: Real) -> tuple[Real, Real]:
    """The cubic with given end slopes minus the chord, and its derivative."""
    r = 1.0 - s
    p = va - d
    q = vb - d
    e = p * r - q * s
    return s * r * e, (r - s) * e - s * r * (p + q)


@kernel
def edge(
    m: Array, line: Line, k: Index, r: Index,
    a: Real, b: Real, va: Real, vb: Real, s: Real, d: Real,
) -> tuple[Real, Real, Index]:  # fmt: skip
    """The bubble of an edge, its slope, and 2 at a jump (`rough`; then piecewise linear),
    1 next to a jump, else 0. With a fifth of the threshold, `rough` detects oscillations next to a
    jump: the cubic is kept, and the value in the cell clamped to those at its corners."""
    if rough(m, line, k, r, a, b, va, vb, 0.1) == 1:
        value, slope = tangents(a, b, va, vb, s, d)
        return value - a - s * (b - a), slope - (b - a), 2
    value, slope = bubble(b - a, va, vb, s)
    clamped = rough(m, line, k, r, a, b, va, vb, 0.02)
    return value, slope, clamped


@kernel
def adini_sum(
    u00: Real, jump: Edges, bubble: Edges, slope: Edges, a: Real, b: Real, s: Real, t: Real
) -> tuple[Real, Real, Real]:
    """Value and gradient of Adini's profile in a cell of widths a, b, from the value at its lower
    left corner and, for each edge, the difference of end values, the bubble and its slope."""
    d0 = jump.bottom
    d1 = jump.top
    e0 = jump.left
    e1 = jump.right
    b0 = bubble.bottom
    b1 = bubble.top
    b2 = bubble.left
    b3 = bubble.right
    value = u00 + s * d0 + t * (e0 + s * (d1 - d0)) + b0 + t * (b1 - b0) + b2 + s * (b3 - b2)
    turn = slope.top - slope.bottom
    fx = (1.0 / a) * (d0 + t * (d1 - d0) + slope.bottom + t * turn + b3 - b2)
    turn = slope.right - slope.left
    fy = (1.0 / b) * (e0 + s * (e1 - e0) + slope.left + s * turn + b1 - b0)
    return value, fx, fy


@kernel
def adini_profile(
    u: Corners, ux: Corners, uy: Corners, a: Real, b: Real, s: Real, t: Real
) -> tuple[Real, Real, Real]:
    """Value and gradient of Adini's profile from the moments at the corners; cell widths a, b."""
    d0 = u.c10 - u.c00
    d1 = u.c11 - u.c01
    e0 = u.c01 - u.c00
    e1 = u.c11 - u.c10
    b0, db0 = bubble(d0, a * ux.c00, a * ux.c10, s)
    b1, db1 = bubble(d1, a * ux.c01, a * ux.c11, s)
    b2, db2 = bubble(e0, b * uy.c00, b * uy.c01, t)
    b3, db3 = bubble(e1, b * uy.c10, b * uy.c11, t)
    jumps = Edges(d0, d1, e0, e1)
    bubbles = Edges(b0, b1, b2, b3)
    slopes = Edges(db0, db1, db2, db3)
    return adini_sum(u.c00, jumps, bubbles, slopes, a, b, s, t)


@kernel
def move_adini(
    value: Real, fx: Real, fy: Real, foot: Foot, advect: Index, out: Out, size: Index, o: Index
) -> None:
    """The new moments by the chain rule."""
    feet = foot.feet
    fs = foot.stride
    fo = foot.first
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
def at_corners(m: Array, moment: Index, ny: Index, cell: Cell) -> Corners:
    """A moment at the corners of a cell; it begins at index `moment` of the array."""
    low = moment + cell.k * ny
    high = moment + cell.kr * ny
    return Corners(m[low + cell.l], m[high + cell.l], m[low + cell.lr], m[high + cell.lr])


@kernel
def within(value: Real, u: Corners) -> Real:
    """Clamp a value to those at the corners."""
    low = min(min(u.c00, u.c10), min(u.c01, u.c11))
    high = max(max(u.c00, u.c10), max(u.c01, u.c11))
    return min(max(value, low), high)


@kernel
def adini_eno(
    m: Array, x: Line, y: Line, size: Index, cell: Cell, dx: Real, dy: Real
) -> tuple[Real, Real, Real, Real, Index]:
    """Value, gradient, cross derivative with the limited bubbles of `edge`; its largest code."""
    k = cell.k
    kr = cell.kr
    l = cell.l
    lr = cell.lr
    a = x.h[k]
    b = y.h[l]
    u = at_corners(m, 0, y.n, cell)
    ux = at_corners(m, size, y.n, cell)
    uy = at_corners(m, 2 * size, y.n, cell)
    bottom = Line(x.h, l, y.n, x.n, x.periodic)
    top = Line(x.h, lr, y.n, x.n, x.periodic)
    left = Line(y.h, k * y.n, 1, y.n, y.periodic)
    right = Line(y.h, kr * y.n, 1, y.n, y.periodic)
    b0, db0, r0 = edge(m, bottom, k, kr, u.c00, u.c10, a * ux.c00, a * ux.c10, cell.s, dx)
    b1, db1, r1 = edge(m, top, k, kr, u.c01, u.c11, a * ux.c01, a * ux.c11, cell.s, dx)
    b2, db2, r2 = edge(m, left, l, lr, u.c00, u.c01, b * uy.c00, b * uy.c01, cell.t, dy)
    b3, db3, r3 = edge(m, right, l, lr, u.c10, u.c11, b * uy.c10, b * uy.c11, cell.t, dy)
    jumps = Edges(u.c10 - u.c00, u.c11 - u.c01, u.c01 - u.c00, u.c11 - u.c10)
    bubbles = Edges(b0, b1, b2, b3)
    slopes = Edges(db0, db1, db2, db3)
    value, fx, fy = adini_sum(u.c00, jumps, bubbles, slopes, a, b, cell.s, cell.t)
    fxy = (u.c11 - u.c01 - u.c10 + u.c00 + db1 - db0 + db3 - db2) / (a * b)
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
    m: Array, out: Out, foot: Foot, x: Line, y: Line, update: Update,
    o: Index, i: Index, j: Index, limiter: Index,
) -> None:  # fmt: skip
    """Adini's profile of u, u_x, u_y."""
    dx = foot.feet[foot.first]
    dy = foot.feet[foot.stride + foot.first]
    k, kr, s = locate(i, dx, x.n, x.periodic)
    l, lr, t = locate(j, dy, y.n, y.periodic)
    cell = Cell(k, kr, l, lr, s, t)
    size = update.size
    u = at_corners(m, 0, y.n, cell)
    cut = limiter
    if limiter == 2:
        value, fx, fy, _fxy, cut = adini_eno(m, x, y, size, cell, dx, dy)
    else:
        ux = at_corners(m, size, y.n, cell)
        uy = at_corners(m, 2 * size, y.n, cell)
        value, fx, fy = adini_profile(u, ux, uy, x.h[k], y.h[l], s, t)
    if cut > 0:
        value = within(value, u)
    move_adini(value, fx, fy, foot, update.advect, out, size, o)


@kernel
def bicubic_profile(
    u: Corners, ux: Corners, uy: Corners, uxy: Corners, a: Real, b: Real, s: Real, t: Real
) -> tuple[Real, Real, Real, Real, Real, Real]:
    """Value, gradient, derivatives xx, xy, yy of the bicubic from the moments at the corners."""
    ab = a * b
    p0 = a * ux.c00
    p1 = a * ux.c10
    p2 = a * ux.c01
    p3 = a * ux.c11
    q0 = b * uy.c00
    q1 = b * uy.c10
    q2 = b * uy.c01
    q3 = b * uy.c11
    w0 = ab * uxy.c00
    w1 = ab * uxy.c10
    w2 = ab * uxy.c01
    w3 = ab * uxy.c11
    low, low1 = cubic(u.c00, u.c10, p0, p1, s)
    top, top1 = cubic(u.c01, u.c11, p2, p3, s)
    lowt, lowt1 = cubic(q0, q1, w0, w1, s)
    topt, topt1 = cubic(q2, q3, w2, w3, s)
    value, ft = cubic(low, top, lowt, topt, t)
    ftt = cubic_second(low, top, lowt, topt, t)
    f1, fst = cubic(low1, top1, lowt1, topt1, t)
    low2 = cubic_second(u.c00, u.c10, p0, p1, s)
    top2 = cubic_second(u.c01, u.c11, p2, p3, s)
    lowt2 = cubic_second(q0, q1, w0, w1, s)
    topt2 = cubic_second(q2, q3, w2, w3, s)
    fss, _slope = cubic(low2, top2, lowt2, topt2, t)
    # On a uniform grid these quotients are constants on the device.
    x = 1.0 / a
    y = 1.0 / b
    return value, x * f1, y * ft, x * x * fss, x * y * fst, y * y * ftt


@kernel
def move_bicubic(
    value: Real, fx: Real, fy: Real, fxx: Real, fxy: Real, fyy: Real,
    foot: Foot, advect: Index, out: Out, size: Index, o: Index,
) -> None:  # fmt: skip
    """The new moments by the chain rule."""
    feet = foot.feet
    fs = foot.stride
    fo = foot.first
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
    m: Array, out: Out, foot: Foot, x: Line, y: Line, update: Update,
    o: Index, i: Index, j: Index, limiter: Index,
) -> None:  # fmt: skip
    """Bicubic Hermite profile of u, u_x, u_y, u_xy: along x on both edges, then along y."""
    dx = foot.feet[foot.first]
    dy = foot.feet[foot.stride + foot.first]
    k, kr, s = locate(i, dx, x.n, x.periodic)
    l, lr, t = locate(j, dy, y.n, y.periodic)
    cell = Cell(k, kr, l, lr, s, t)
    size = update.size
    u = at_corners(m, 0, y.n, cell)
    ux = at_corners(m, size, y.n, cell)
    uy = at_corners(m, 2 * size, y.n, cell)
    uxy = at_corners(m, 3 * size, y.n, cell)
    value, fx, fy, fxx, fxy, fyy = bicubic_profile(u, ux, uy, uxy, x.h[k], y.h[l], s, t)
    cut = limiter
    if limiter == 2:
        other, other_x, other_y, other_xy, cut = adini_eno(m, x, y, size, cell, dx, dy)
        if cut == 2:
            # At a jump the cross moments are not reliable: take Adini's profile, which has none.
            value = other
            fx = other_x
            fy = other_y
            fxx = 0.0
            fxy = other_xy
            fyy = 0.0
    if cut > 0:
        value = within(value, u)
    move_bicubic(value, fx, fy, fxx, fxy, fyy, foot, update.advect, out, size, o)


@kernel
def node_adini(
    m: Array, out: Out, foot: Foot, x: Line, y: Line, update: Update,
    o: Index, i: Index, j: Index, limits: Limits,
) -> None:  # fmt: skip
    """Adini's profile; its limiter is the constant 0, so the compiler removes that code."""
    adini(m, out, foot, x, y, update, o, i, j, 0)


@kernel
def node_adini_limited(
    m: Array, out: Out, foot: Foot, x: Line, y: Line, update: Update,
    o: Index, i: Index, j: Index, limits: Limits,
) -> None:  # fmt: skip
    """Adini's profile with a limiter."""
    adini(m, out, foot, x, y, update, o, i, j, limits.limiter)


@kernel
def node_bicubic(
    m: Array, out: Out, foot: Foot, x: Line, y: Line, update: Update,
    o: Index, i: Index, j: Index, limits: Limits,
) -> None:  # fmt: skip
    """The bicubic profile; its limiter is the constant 0, so the compiler removes that code."""
    bicubic(m, out, foot, x, y, update, o, i, j, 0)


@kernel
def node_bicubic_limited(
    m: Array, out: Out, foot: Foot, x: Line, y: Line, update: Update,
    o: Index, i: Index, j: Index, limits: Limits,
) -> None:  # fmt: skip
    """The bicubic profile with a limiter."""
    bicubic(m, out, foot, x, y, update, o, i, j, limits.limiter)
