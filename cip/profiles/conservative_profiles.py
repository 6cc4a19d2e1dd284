r"""Profiles on one cell with a given mean: kernels for CPU and device.

With s in [0, 1], end values a, b, mean m and slopes times the width va, vb:

* CSL2 (Nakamura, Tanaka, Yabe and Takizawa, J. Comput. Phys. 174, 2001, 171-207):
  q = a + (6m - 4a - 2b) s + 3 (a + b - 2m) s^2;
* its rational form (Xiao, Yabe, Peng and Kobayashi, J. Geophys. Res. 107, 2002, 4609), used if m
  lies between a and b, where it is monotone: q = (a + 2Bs + (w-1) B s^2) / (1 + (w-1) s)^2 with
  B = mw - a, w = (m - a) / (b - m). It is computed without cancellation as
  q = (1-p)^2 a + 2p (1-p) m + p^2 b with p = ws / (1 - s + ws). Other cells keep the quadratic:
  with |w| in place of w, as printed, the value at s = 1 would be 2m - b;
* CSL4: the quartic with the end slopes too.

The limiter of Zhang and Shu (J. Comput. Phys. 229, 2010, 3091-3120) scales q towards its mean,
m + theta (q - m), with the largest theta <= 1 that satisfies the bounds: it keeps mean and order.
"""

from __future__ import annotations

from math import sqrt

from cip.profiles.catalogue import Limits
from skfem_adini.ground.jit import Real, kernel


@kernel
def scaling(m: Real, least: Real, most: Real, limits: Limits) -> Real:
    """The factor theta that scales a profile of mean m and range [least, most] into the bounds."""
    theta = 1.0
    if least < limits.low - limits.slack:
        theta = min(theta, max(0.0, (m - limits.low) / (m - least)))
    if most > limits.high + limits.slack:
        theta = min(theta, max(0.0, (limits.high - m) / (most - m)))
    return theta


@kernel
def quadratic_range(a: Real, c1: Real, c2: Real) -> tuple[Real, Real]:
    """Least and largest value of a + c1 s + c2 s^2 on [0, 1]."""
    end = a + c1 + c2
    least = min(a, end)
    most = max(a, end)
    if c1 * (c1 + 2.0 * c2) < 0.0:
        value = a - 0.25 * c1 * c1 / c2
        least = min(least, value)
        most = max(most, value)
    return least, most


@kernel
def quartic(c0: Real, c1: Real, c2: Real, c3: Real, c4: Real, s: Real) -> Real:
    """Value of a quartic."""
    return c0 + s * (c1 + s * (c2 + s * (c3 + s * c4)))


@kernel
def slope_root(c1: Real, c2: Real, c3: Real, c4: Real, left: Real, right: Real) -> Real:
    """A root of the slope of a quartic between two points; `left` if its sign does not change."""
    low = left
    high = right
    at_low = quartic(c1, 2.0 * c2, 3.0 * c3, 4.0 * c4, 0.0, low)
    at_high = quartic(c1, 2.0 * c2, 3.0 * c3, 4.0 * c4, 0.0, high)
    if at_low * at_high >= 0.0:
        return left
    # 30 bisections give the root to 1e-9; the quartic is stationary there, so its value is exact
    # to the square of that, below rounding.
    for _ in range(30):
        middle = 0.5 * (low + high)
        slope = quartic(c1, 2.0 * c2, 3.0 * c3, 4.0 * c4, 0.0, middle)
        if slope * at_low > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@kernel
def quartic_range(c0: Real, c1: Real, c2: Real, c3: Real, c4: Real) -> tuple[Real, Real]:
    """Least and largest value of a quartic on [0, 1]. Its slope is monotone between the inflections
    p and q, so has at most one root in each part."""
    end = c0 + c1 + c2 + c3 + c4
    least = min(c0, end)
    most = max(c0, end)
    p = 1.0
    q = 1.0
    discriminant = 9.0 * c3 * c3 - 24.0 * c4 * c2
    if discriminant > 0.0:
        root = sqrt(discriminant)
        big = -3.0 * c3 - root
        if c3 < 0.0:
            big = -3.0 * c3 + root
        if c4 != 0.0:
            p = min(max(big / (12.0 * c4), 0.0), 1.0)
        if big != 0.0:
            q = min(max(2.0 * c2 / big, 0.0), 1.0)
    first = min(p, q)
    second = max(p, q)
    s = slope_root(c1, c2, c3, c4, 0.0, first)
    value = quartic(c0, c1, c2, c3, c4, s)
    least = min(least, value)
    most = max(most, value)
    s = slope_root(c1, c2, c3, c4, first, second)
    value = quartic(c0, c1, c2, c3, c4, s)
    least = min(least, value)
    most = max(most, value)
    s = slope_root(c1, c2, c3, c4, second, 1.0)
    value = quartic(c0, c1, c2, c3, c4, s)
    return min(least, value), max(most, value)


@kernel
def csl2(a: Real, b: Real, m: Real, s: Real, limits: Limits) -> tuple[Real, Real, Real]:
    """Value, slope in s, and the integral from 0 to s of CSL2, with limiter 3 its rational form."""
    if limits.limiter == 3:
        A = m - a
        B = b - m
        if A * B > 0.0:
            bottom = B * (1.0 - s) + A * s
            p = A * s / bottom
            value = (1.0 - p) * ((1.0 - p) * a + 2.0 * p * m) + p * p * b
            slope = 2.0 * A * B * (A * (1.0 - p) + B * p) / (bottom * bottom)
            mass = s * ((1.0 - p) * a + p * m)
            return value, slope, mass
    c1 = 6.0 * m - 4.0 * a - 2.0 * b
    c2 = 3.0 * (a + b - 2.0 * m)
    value = a + s * (c1 + s * c2)
    slope = c1 + 2.0 * s * c2
    mass = s * (a + s * (0.5 * c1 + s * c2 / 3.0))
    if limits.limiter == 4:
        least, most = quadratic_range(a, c1, c2)
        theta = scaling(m, least, most, limits)
        if theta < 1.0:
            value = m + theta * (value - m)
            slope = theta * slope
            mass = m * s + theta * (mass - m * s)
    return value, slope, mass


@kernel
def csl4(
    a: Real, b: Real, va: Real, vb: Real, m: Real, s: Real, limits: Limits
) -> tuple[Real, Real, Real]:
    """Value, slope in s, and the integral from 0 to s of CSL4."""
    A = b - a - va
    B = vb - va
    C = m - a - 0.5 * va
    c2 = -12.0 * A + 1.5 * B + 30.0 * C
    c3 = 28.0 * A - 4.0 * B - 60.0 * C
    c4 = -15.0 * A + 2.5 * B + 30.0 * C
    value = quartic(a, va, c2, c3, c4, s)
    slope = va + s * (2.0 * c2 + s * (3.0 * c3 + s * 4.0 * c4))
    mass = s * (a + s * (0.5 * va + s * (c2 / 3.0 + s * (0.25 * c3 + s * 0.2 * c4))))
    if limits.limiter == 4:
        # Bernstein coefficients enclose the quartic cheaply; its exact range is rarely needed.
        b1 = a + 0.25 * va
        b2 = a + 0.5 * va + c2 / 6.0
        b3 = b - 0.25 * vb
        least = min(min(min(a, b), min(b1, b2)), b3)
        most = max(max(max(a, b), max(b1, b2)), b3)
        if least < limits.low - limits.slack or most > limits.high + limits.slack:
            least, most = quartic_range(a, va, c2, c3, c4)
            theta = scaling(m, least, most, limits)
            if theta < 1.0:
                value = m + theta * (value - m)
                slope = theta * slope
                mass = m * s + theta * (mass - m * s)
    return value, slope, mass
