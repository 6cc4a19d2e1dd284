r"""One sweep along an axis for profiles of point values: kernels for CPU and device.

Every node function writes the new moments of node `o`, which is number `i` of its `Line`. For
transport the new field is u(X) and for advection J u(X) with J = X_a; derivatives follow by the
chain rule, with X_a, X_aa, ... along the sweep and X_b, X_ab, ... across it (King 2012, section
3.1.3, in the form without division by c). Derivatives across the sweep are interpolated along it by
cubics through four nodes: with linear interpolation the error of his example 1 is 3.6 times larger.

Arrays are flat; moment q begins at index ``q size``, the feet are stored as `Foot` says:

| profile | moments | feet, transport | feet, advection |
| --- | --- | --- | --- |
| linear | u | X | X, X_a |
| piecewise_linear, cubic | u, u_x, .. | X, X_a, (X_b) | X, X_a, X_aa, (X_b, X_ab) |
| quintic | u, u_x, u_xx, .. | X, X_a, X_aa, (X_b, X_bb) | and X_aaa, (.., X_ab, X_abb) |

The components in parentheses are repeated for each direction across the sweep.
"""

from __future__ import annotations

from cip.profiles.catalogue import Foot, Limits, Line, Update
from cip.profiles.line_profiles import (
    cubic,
    lagrange,
    locate,
    quintic,
    rational,
    rough,
    smoothed,
    tangents,
)
from skfem_adini.ground.jit import Array, Index, Out, Real, kernel


@kernel
def node_linear(
    m: Array, out: Out, foot: Foot, line: Line, update: Update, o: Index, i: Index, limits: Limits
) -> None:
    """Linear interpolation of the values."""
    k, r, s = locate(i, foot.feet[foot.first], line.n, line.periodic)
    a = m[line.first + k * line.stride]
    value = a + s * (m[line.first + r * line.stride] - a)
    if update.advect == 1:
        value = value * foot.feet[foot.stride + foot.first]
    out[o] = value


@kernel
def move_cubic(
    value: Real, slope: Real, foot: Foot, advect: Index, out: Out, slopes: Index, o: Index
) -> None:
    """Write the new value and the new slope along the sweep, from the profile's at the foot."""
    J = foot.feet[foot.stride + foot.first]
    if advect == 1:
        K = foot.feet[2 * foot.stride + foot.first]
        out[o] = J * value
        out[slopes + o] = J * J * slope + K * value
    else:
        out[o] = value
        out[slopes + o] = J * slope


@kernel
def hermite(
    m: Array, out: Out, foot: Foot, line: Line, update: Update, o: Index, i: Index,
    limiter: Index, piecewise: Index,
) -> None:  # fmt: skip
    """Cubic or piecewise linear profile of values and slopes, with the limiters of the cubic.
    `piecewise` is 0 for the cubic, 1 for the piecewise linear profile, 2 for its smoothed form."""
    feet = foot.feet
    size = update.size
    axis = update.axis
    advect = update.advect
    base = line.first
    stride = line.stride
    d = feet[foot.first]
    k, r, s = locate(i, d, line.n, line.periodic)
    width = line.h[k]
    slopes = (1 + axis) * size + base
    a = m[base + k * stride]
    b = m[base + r * stride]
    va = width * m[slopes + k * stride]
    vb = width * m[slopes + r * stride]
    lines = piecewise
    if limiter == 2:
        lines = rough(m, line, k, r, a, b, va, vb, 0.1)
    if lines == 1:
        value, slope = tangents(a, b, va, vb, s, d)
    elif lines == 2:
        value, slope = smoothed(a, b, va, vb, s, width)
    else:
        if limiter == 3:
            value, slope = rational(a, b, va, vb, s)
        else:
            value, slope = cubic(a, b, va, vb, s)
        if limiter == 1:
            low = min(a, b)
            high = max(a, b)
            value = min(max(value, low), high)
    slope = slope / width
    move_cubic(value, slope, foot, advect, out, (1 + axis) * size, o)
    J = feet[foot.stride + foot.first]
    component = 2 + advect
    for b_axis in range(update.dim):
        if b_axis != axis:
            q = (1 + b_axis) * size
            if piecewise > 0:
                f0 = m[q + base + k * stride]
                across = f0 + s * (m[q + base + r * stride] - f0)
            else:
                across, _slope = lagrange(m, line, q, k, s)
            across = across + feet[component * foot.stride + foot.first] * slope
            component = component + 1
            if advect == 1:
                across = J * across + feet[component * foot.stride + foot.first] * value
                component = component + 1
            out[q + o] = across


@kernel
def node_piecewise_linear(
    m: Array, out: Out, foot: Foot, line: Line, update: Update, o: Index, i: Index, limits: Limits
) -> None:
    """The piecewise linear profile."""
    hermite(m, out, foot, line, update, o, i, 0, 1)


@kernel
def node_smoothed(
    m: Array, out: Out, foot: Foot, line: Line, update: Update, o: Index, i: Index, limits: Limits
) -> None:
    """The piecewise linear profile with the smooth weights of King 2012, (2.18)."""
    hermite(m, out, foot, line, update, o, i, 0, 2)


@kernel
def node_cubic(
    m: Array, out: Out, foot: Foot, line: Line, update: Update, o: Index, i: Index, limits: Limits
) -> None:
    """The cubic profile; its limiter is the constant 0, so the compiler removes that code."""
    hermite(m, out, foot, line, update, o, i, 0, 0)


@kernel
def node_cubic_limited(
    m: Array, out: Out, foot: Foot, line: Line, update: Update, o: Index, i: Index, limits: Limits
) -> None:
    """The cubic profile with a limiter."""
    hermite(m, out, foot, line, update, o, i, limits.limiter, 0)


@kernel
def node_quintic(
    m: Array, out: Out, foot: Foot, line: Line, update: Update, o: Index, i: Index, limits: Limits
) -> None:
    """The quintic profile of values, slopes and second derivatives."""
    feet = foot.feet
    fs = foot.stride
    fo = foot.first
    size = update.size
    advect = update.advect
    k, r, s = locate(i, feet[fo], line.n, line.periodic)
    width = line.h[k]
    q1 = (1 + 2 * update.axis) * size
    q2 = (2 + 2 * update.axis) * size
    left = line.first + k * line.stride
    right = line.first + r * line.stride
    half = 0.5 * width * width
    f0, f1, f2, f3 = quintic(
        m[left], m[right], width * m[q1 + left], width * m[q1 + right],
        half * m[q2 + left], half * m[q2 + right], s,
    )  # fmt: skip
    if limits.limiter == 1:
        f0 = min(max(f0, min(m[left], m[right])), max(m[left], m[right]))
    f1 = f1 / width
    f2 = f2 / (width * width)
    f3 = f3 / (width * width * width)
    J = feet[fs + fo]
    K = feet[2 * fs + fo]
    component = 3
    if advect == 1:
        L = feet[3 * fs + fo]
        out[o] = J * f0
        out[q1 + o] = J * J * f1 + K * f0
        out[q2 + o] = J * J * J * f2 + 3.0 * J * K * f1 + L * f0
        component = 4
    else:
        out[o] = f0
        out[q1 + o] = J * f1
        out[q2 + o] = J * J * f2 + K * f1
    for b_axis in range(update.dim):
        if b_axis != update.axis:
            p1 = (1 + 2 * b_axis) * size
            p2 = (2 + 2 * b_axis) * size
            g0, g1 = lagrange(m, line, p1, k, s)
            e0, _slope = lagrange(m, line, p2, k, s)
            Q = feet[component * fs + fo]
            P = feet[(component + 1) * fs + fo]
            once = g0 + Q * f1
            twice = e0 + 2.0 * Q * g1 + Q * Q * f2 + P * f1
            component = component + 2
            if advect == 1:
                E = feet[component * fs + fo]
                F = feet[(component + 1) * fs + fo]
                twice = J * twice + 2.0 * E * once + F * f0
                once = J * once + E * f0
                component = component + 2
            out[p1 + o] = once
            out[p2 + o] = twice
