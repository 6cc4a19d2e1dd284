r"""One sweep along an axis for the conservative profiles: kernels for CPU and device.

M = int p is transported, so the new mean of a cell is the integral of the old profile between the
feet of its ends, divided by its width: what leaves one cell enters the next, up to rounding. With
J = X_a and K = X_aa along the sweep, the new value at a node is J q(X) and the new slope
J^2 q'(X) + K q(X).

In several dimensions a moment is a value or a mean in each direction: moment number ``bits`` is the
mean in the directions whose bit is set. A sweep takes each pair (value, mean) along its axis with
the velocity at the point that is a node or the middle of a cell in the other directions. Feet: X,
X_a (CSL4 on lines: X_aa too) for each of these points.

CSL4 carries slopes on lines. In several dimensions it takes the slope of a node from the values and
means of two neighbouring cells, exact for quartics: carrying slopes would require all mixed
derivatives and means, in space 27 moments per node instead of 8.
"""

from __future__ import annotations

from math import floor

from cip.profiles.catalogue import Foot, Limits, Line, Means, Update
from cip.profiles.conservative_profiles import csl2, csl4
from cip.profiles.line_profiles import cubic
from skfem_adini.ground.jit import Array, Index, Out, Real, kernel


@kernel
def cell_of(i: Index, d: Real, n: Index, periodic: Index) -> tuple[Index, Real]:
    """Cell of the foot d cells from node i, not reduced modulo the period, and local coordinate."""
    f = floor(d)
    s = d - f
    k = i + f
    if periodic == 0:
        if k < 0:
            k = 0
            s = 0.0
        if k > n - 2:
            k = n - 2
            s = 1.0
    return k, s


@kernel
def slope_of(m: Array, line: Line, value: Index, mean: Index, i: Index) -> Real:
    """Slope at node i of the quartic through values and means of the adjacent cells (at an end of a
    line the two nearest): with the integral M from the node, :math:`g(x) = (M(x) - M'(0) x) / x^2`
    is a cubic known at the other two nodes with its derivatives, and the slope is
    :math:`M''(0) = 2 g(0)`."""
    h = line.h
    n = line.n
    stride = line.stride
    first = i - 1
    if line.periodic == 0:
        first = min(max(first, 0), n - 3)
    k0 = first
    if k0 < 0:
        k0 = k0 + n
    k1 = k0 + 1
    if k1 == n:
        k1 = 0
    k2 = k1 + 1
    if k2 == n:
        k2 = 0
    h0 = h[k0]
    h1 = h[k1]
    mass0 = h0 * m[mean + k0 * stride]
    mass1 = h1 * m[mean + k1 * stride]
    p = m[value + i * stride]
    if i == first + 1:
        x1 = -h0
        x2 = h1
        f1 = m[value + k0 * stride]
        f2 = m[value + k2 * stride]
        mass0 = -mass0
    elif i == first:
        x1 = h0
        x2 = h0 + h1
        f1 = m[value + k1 * stride]
        f2 = m[value + k2 * stride]
        mass1 = mass0 + mass1
    else:
        x1 = -h0 - h1
        x2 = -h1
        f1 = m[value + k0 * stride]
        f2 = m[value + k1 * stride]
        mass0 = -mass0 - mass1
        mass1 = -mass1
    g1 = (mass0 / x1 - p) / x1
    g2 = (mass1 / x2 - p) / x2
    d1 = ((f1 - p) / x1 - 2.0 * g1) / x1
    d2 = ((f2 - p) / x2 - 2.0 * g2) / x2
    width = x2 - x1
    g, _derivative = cubic(g1, g2, width * d1, width * d2, -x1 / width)
    return 2.0 * g


@kernel
def slope_at(m: Array, feet: Array, line: Line, means: Means, i: Index) -> Real:
    """Slope at node i: by `slope_of`, beside a coast that of the parabola of one cell."""
    side = 0.0
    if means.sides >= 0:
        side = feet[means.sides + i * line.stride]
    if side == 0.0:
        return slope_of(m, line, means.value, means.mean, i)
    if side == 3.0:
        return 0.0
    k = i
    if side == 2.0:
        k = i - 1
        if k < 0:
            k = k + line.n
    r = k + 1
    if r == line.n:
        r = 0
    a = m[means.value + k * line.stride]
    b = m[means.value + r * line.stride]
    six = 6.0 * m[means.mean + k * line.stride]
    if side == 1.0:
        return (six - 4.0 * a - 2.0 * b) / line.h[k]
    return (2.0 * a + 4.0 * b - six) / line.h[k]


@kernel
def profile(
    m: Array, feet: Array, line: Line, means: Means, cell: Index, s: Real, order: Index,
    limits: Limits,
) -> tuple[Real, Real, Real]:  # fmt: skip
    """Value, slope (per length) and integral from the left end of a cell, all at s."""
    n = line.n
    stride = line.stride
    value = means.value
    mean = means.mean
    k = cell
    if k < 0 or k >= n:
        k = k % n
    r = k + 1
    if r == n:
        r = 0
    a = m[value + k * stride]
    b = m[value + r * stride]
    width = line.h[k]
    if order == 2:
        f0, f1, mass = csl2(a, b, m[mean + k * stride], s, limits)
    else:
        if means.carried == 1:
            va = width * m[means.slope + k * stride]
            vb = width * m[means.slope + r * stride]
        else:
            va = width * slope_at(m, feet, line, means, k)
            vb = width * slope_at(m, feet, line, means, r)
        f0, f1, mass = csl4(a, b, va, vb, m[mean + k * stride], s, limits)
    return f0, f1 / width, mass * width


@kernel
def mass_of(m: Array, line: Line, mean: Index, cell: Index) -> Real:
    """Integral over a whole cell."""
    k = cell
    if k < 0 or k >= line.n:
        k = k % line.n
    return m[mean + k * line.stride] * line.h[k]


@kernel
def node_csl(
    m: Array, out: Out, foot: Foot, line: Line, update: Update, o: Index, i: Index,
    limits: Limits, order: Index,
) -> None:  # fmt: skip
    """Compute values at node i and means of the cell after it, for each pair (value, mean)."""
    feet = foot.feet
    n = line.n
    base = line.first
    periodic = line.periodic
    size = update.size
    nxt = i + 1
    if nxt == n:
        nxt = 0
    bit = 1
    for _ in range(update.axis):
        bit = bit * 2
    count = 1
    for _ in range(update.dim):
        count = count * 2
    carried = 0
    if order == 4 and update.dim == 1:
        carried = 1
    at = 0
    for pair in range(count):
        if (pair // bit) % 2 == 0:
            value = pair * size + base
            mean = (pair + bit) * size + base
            slope = value
            if carried == 1:
                slope = size + base
                mean = 2 * size + base
            sides = -1
            if update.coasts == 1:
                sides = (count // 2 * (2 + carried) + at // ((2 + carried) * size)) * size + base
            means = Means(value, slope, mean, carried, sides)
            k1, s1 = cell_of(i, feet[at + o], n, periodic)
            f0, f1, left = profile(m, feet, line, means, k1, s1, order, limits)
            # On a coast before land, in whose cell a limiter would bend the profile.
            if sides >= 0 and feet[at + o] == 0.0 and feet[sides + i * line.stride] == 2.0:
                f0 = m[value + i * line.stride]
                f1 = m[slope + i * line.stride]
            J = feet[at + size + o]
            out[pair * size + o] = J * f0
            if carried == 1:
                out[size + o] = J * J * f1 + feet[at + 2 * size + o] * f0
            if periodic == 1 or i < n - 1:
                k2, s2 = cell_of(i + 1, feet[at + base + nxt * line.stride], n, periodic)
                _value, _slope, right = profile(m, feet, line, means, k2, s2, order, limits)
                if k1 == k2:
                    mass = right - left
                else:
                    mass = mass_of(m, line, mean, k1) - left + right
                    for k in range(k1 + 1, k2):
                        mass = mass + mass_of(m, line, mean, k)
                out[mean - base + o] = mass / line.h[i]
            else:
                out[mean - base + o] = 0.0
            at = at + (2 + carried) * size


@kernel
def node_csl2(
    m: Array, out: Out, foot: Foot, line: Line, update: Update, o: Index, i: Index, limits: Limits
) -> None:
    """Compute new values and means of CSL2."""
    node_csl(m, out, foot, line, update, o, i, limits, 2)


@kernel
def node_csl4(
    m: Array, out: Out, foot: Foot, line: Line, update: Update, o: Index, i: Index, limits: Limits
) -> None:
    """Compute new moments of CSL4: values, slopes and means on a line, else values and means."""
    node_csl(m, out, foot, line, update, o, i, limits, 4)


@kernel
def node_leaving(
    m: Array, out: Out, foot: Foot, line: Line, update: Update, o: Index, i: Index,
    limits: Limits, order: Index,
) -> None:  # fmt: skip
    """Compute what leaves by node i if it is an end of its line: the integral of the old means from
    there to its foot, per area; 0 for others."""
    feet = foot.feet
    n = line.n
    size = update.size
    bit = 1
    for _ in range(update.axis):
        bit = bit * 2
    count = 1
    for _ in range(update.dim):
        count = count * 2
    carried = 0
    if order == 4 and update.dim == 1:
        carried = 1
    last = count // 2 - 1
    at = last * (2 + carried) * size
    left = 0.0
    if feet[at + o] != 0.0 and line.periodic == 0 and (i == 0 or i == n - 1):
        value = (count - 1 - bit) * size + line.first
        mean = (count - 1) * size + line.first
        slope = value
        if carried == 1:
            slope = size + line.first
            mean = 2 * size + line.first
        sides = -1
        if update.coasts == 1:
            sides = (count // 2 * (2 + carried) + last) * size + line.first
        means = Means(value, slope, mean, carried, sides)
        k1, s1 = cell_of(i, feet[at + o], n, 0)
        _value, _slope, left = profile(m, feet, line, means, k1, s1, order, limits)
        if i == 0:
            for k in range(0, k1):
                left = left + mass_of(m, line, mean, k)
        else:
            left = mass_of(m, line, mean, k1) - left
            for k in range(k1 + 1, n - 1):
                left = left + mass_of(m, line, mean, k)
    out[o] = left


@kernel
def node_leaving_csl2(
    m: Array, out: Out, foot: Foot, line: Line, update: Update, o: Index, i: Index, limits: Limits
) -> None:
    """Compute what leaves by an end of a line, with the profiles of CSL2."""
    node_leaving(m, out, foot, line, update, o, i, limits, 2)


@kernel
def node_leaving_csl4(
    m: Array, out: Out, foot: Foot, line: Line, update: Update, o: Index, i: Index, limits: Limits
) -> None:
    """Compute what leaves by an end of a line, with the profiles of CSL4."""
    node_leaving(m, out, foot, line, update, o, i, limits, 4)
