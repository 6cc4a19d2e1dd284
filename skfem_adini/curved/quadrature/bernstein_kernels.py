"""Bernstein polynomials on the unit square: values, roots, subdivision, bounds.

Plain Python for numba (`cut_quadrature.compiled_cut_boxes`). A polynomial in one variable is an
array of coefficients, one in two variables an array c[i, j] with i the degree in x.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def value(c: Array, t: float) -> float:
    """Return a polynomial in one variable at t; in [0, 1] all weights of the sum are >= 0."""
    p = c.size - 1
    total, binomial, power = c[0], 1.0, 1.0
    for i in range(1, p + 1):
        # Horner's scheme in 1 - t: after step i the sum still lacks the factor (1 - t)^(p - i).
        binomial *= (p - i + 1) / i
        power *= t
        total = total * (1 - t) + binomial * power * c[i]
    return total


def slope(c: Array, t: float) -> float:
    """Return the derivative of a polynomial in one variable."""
    p = c.size - 2
    total, binomial, power = c[1] - c[0], 1.0, 1.0
    for i in range(1, p + 1):
        binomial *= (p - i + 1) / i
        power *= t
        total = total * (1 - t) + binomial * power * (c[i + 1] - c[i])
    return (p + 1) * total


def line(c: Array, axis: int, s: float) -> Array:
    """Return the polynomial along an axis, the other coordinate being s."""
    m = c.shape[0]
    out = np.empty(m)
    for i in range(m):
        out[i] = value(c[i, :], s) if axis == 0 else value(c[:, i], s)
    return out


def gradient(c: Array, x: float, y: float) -> tuple[float, float]:
    """Return both partial derivatives at a point."""
    return slope(line(c, 0, y), x), slope(line(c, 1, x), y)


def bracketed_root(c: Array, a: float, b: float) -> float:
    """Return the root between a and b, where the signs differ: Newton's method, safeguarded."""
    rising = value(c, b) > 0
    t = 0.5 * (a + b)
    for _ in range(200):
        f = value(c, t)
        if f == 0:
            return t
        if (f > 0) == rising:
            b = t
        else:
            a = t
        d = slope(c, t)
        new = t - f / d if d != 0 else a
        if not a < new < b:
            new = 0.5 * (a + b)
        if abs(new - t) < 1e-16 or b - a < 1e-16:  # below the rounding of t near 1
            return new
        t = new
    return t


def roots(c: Array, tol: float, found: Array) -> int:
    """Write the zeros in (0, 1) where a polynomial changes sign to `found`; return their number. It
    has no more zeros there than its coefficients have sign changes (variation diminishing). One
    whose coefficients are all at most `tol` in size counts as zero, without any."""
    m = c.size
    count = 0
    largest = 0.0
    for i in range(m):
        largest = max(largest, abs(c[i]))
    if largest <= tol:
        return 0
    stack = np.empty((64, m))
    ends = np.empty((64, 2))
    stack[0], ends[0, 0], ends[0, 1] = c, 0.0, 1.0
    top = 1
    while top > 0:
        top -= 1
        now, a, b = stack[top].copy(), ends[top, 0], ends[top, 1]
        changes, last = 0, 0.0
        for i in range(m):
            if now[i] != 0:
                if last * now[i] < 0:
                    changes += 1
                last = now[i]
        if changes == 0:
            continue
        if changes == 1 and now[0] != 0 and now[m - 1] != 0:
            if count < found.size:
                found[count] = a + (b - a) * bracketed_root(now, 0.0, 1.0)
                count += 1
            continue
        if b - a < 1e-14 or top + 2 > 64:  # closer roots count as a double one
            if count < found.size:
                found[count] = 0.5 * (a + b)
                count += 1
            continue
        left, right = now.copy(), now.copy()
        for r in range(m):
            left[r] = right[0]
            for i in range(m - 1 - r):
                right[i] = 0.5 * (right[i] + right[i + 1])
        middle = 0.5 * (a + b)
        stack[top], ends[top, 0], ends[top, 1] = left, a, middle
        stack[top + 1], ends[top + 1, 0], ends[top + 1, 1] = right, middle, b
        top += 2
    return count


def split(c: Array, axis: int, t: float, left: Array, right: Array) -> None:
    """Write the coefficients on both sides of t, by de Casteljau's scheme."""
    m = c.shape[0]
    for k in range(m):
        work = c[:, k].copy() if axis == 0 else c[k, :].copy()
        for r in range(m):
            if axis == 0:
                left[r, k] = work[0]
                right[m - 1 - r, k] = work[m - 1 - r]
            else:
                left[k, r] = work[0]
                right[k, m - 1 - r] = work[m - 1 - r]
            for i in range(m - 1 - r):
                work[i] += t * (work[i + 1] - work[i])


def slope_range(c: Array, axis: int) -> tuple[float, float]:
    """Return bounds of the derivative along an axis."""
    m = c.shape[0]
    low, high = np.inf, -np.inf
    for i in range(m - 1):
        for j in range(m):
            d = c[i + 1, j] - c[i, j] if axis == 0 else c[j, i + 1] - c[j, i]
            low, high = min(low, d), max(high, d)
    return (m - 1) * low, (m - 1) * high


def append(rows: Array, count: int, row: Array) -> Array:
    """Append a row after the first `count` ones; return the array, doubled if it was full."""
    if count == rows.shape[0]:
        more = np.empty((2 * count, rows.shape[1]))
        for i in range(count):
            for j in range(rows.shape[1]):
                more[i, j] = rows[i, j]
        rows = more
    for i in range(row.size):
        rows[count, i] = row[i]
    return rows


def product_range(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    """Return bounds of the product of two numbers with known bounds."""
    p, q, r, s = a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]
    return min(min(p, q), min(r, s)), max(max(p, q), max(r, s))


def jacobian_range(f: Array, g: Array) -> tuple[float, float]:
    """Return bounds of f_x g_y - f_y g_x."""
    first_low, first_high = product_range(slope_range(f, 0), slope_range(g, 1))
    last_low, last_high = product_range(slope_range(f, 1), slope_range(g, 0))
    return first_low - last_high, first_high - last_low
