"""Francis' double-shift QR iteration on a small real Hessenberg matrix.

Plain Python for `real_schur`, which compiles it. All of it works on one array W of shape
(n + 1, 2 n + 1): the matrix H, a row and a column of zeros that let rotations of two rows be turns
of three, and beside H, in the same rows, the transposed orthogonal matrix. So what happens to rows
is one loop over contiguous numbers.
"""

from __future__ import annotations

import math
from typing import Any

EPS = 2.0**-52
TINY = 2.0**-1022
UNUSUAL = 10  # sweeps on a block before shifts from elsewhere
SWEEPS = 30  # for every row, all in all
OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}, "nogil": True}


def turn_rows(W: Any, k: int, w1: float, w2: float, t: float) -> None:
    """Multiply rows k, k + 1, k + 2 from the left by I - t w w^T, w = (1, w1, w2).

    What is left of column k is the caller's.
    """
    t1, t2 = t * w1, t * w2
    upper, middle, lower = W[k, k:], W[k + 1, k:], W[k + 2, k:]
    for j in range(upper.size):
        x, y, z = upper[j], middle[j], lower[j]
        s = x + w1 * y + w2 * z
        upper[j], middle[j], lower[j] = x - s * t, y - s * t1, z - s * t2


def turn_columns(W: Any, k: int, rows: int, w1: float, w2: float, t: float) -> None:
    """Multiply columns k, k + 1, k + 2 of the first rows from the right by the same."""
    t1, t2 = t * w1, t * w2
    columns = W[:rows, k : k + 3]
    for i in range(rows):
        x, y, z = columns[i, 0], columns[i, 1], columns[i, 2]
        s = x + w1 * y + w2 * z
        columns[i, 0], columns[i, 1], columns[i, 2] = x - s * t, y - s * t1, z - s * t2


def reflector(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """w1, w2, t such that I - t w w^T takes (x, y, z) to (beta, 0, 0); and beta."""
    size = abs(x) + abs(y) + abs(z)
    if y == 0.0 and z == 0.0:
        return 0.0, 0.0, 0.0, x
    x, y, z = x / size, y / size, z / size
    beta = -math.copysign(math.sqrt(x * x + y * y + z * z), x)
    return y / (x - beta), z / (x - beta), (beta - x) / beta, beta * size


def product_over(b: float, c: float, size: float) -> float:
    """b c / size, where b c may be too small a number."""
    return (b / size) * c if abs(b) > abs(c) else (c / size) * b


def first_of_block(W: Any, last: int) -> int:
    """The row where the block that ends with `last` begins: what is left of it is round-off.

    By the criterion of M. Ahues and F. Tisseur, A new deflation criterion for the QR algorithm,
    LAPACK Working Note 122 (1997).
    """
    n = W.shape[0] - 1
    small = TINY * n / EPS
    for k in range(last, 0, -1):
        below = abs(W[k, k - 1])
        if below <= small:
            return k
        corner, here = W[k - 1, k - 1], W[k, k]
        around = abs(corner) + abs(here)
        if around == 0.0:
            if k >= 2:
                around += abs(W[k - 1, k - 2])
            around += abs(W[k + 1, k])
        if below <= EPS * around:
            above, apart = abs(W[k - 1, k]), abs(corner - here)
            large, far = max(below, above), max(abs(here), apart)
            least, near = min(below, above), min(abs(here), apart)
            size = large + far
            if least * (large / size) <= max(small, EPS * (near * (far / size))):
                return k
    return 0


def shifts(W: Any, first: int, last: int, tried: int) -> tuple[float, float]:
    """Mean of two conjugate shifts and their distance from it; zero: one real shift, twice."""
    if tried % UNUSUAL == 0:
        at = first if tried % (2 * UNUSUAL) else last
        k = max(at, first + 2)
        size = abs(W[k, k - 1]) + abs(W[k - 1, k - 2])
        return W[at, at] + 0.75 * size, 0.66 * size  # as LAPACK's dlahqr, about
    a, b, c, d = W[last - 1, last - 1], W[last - 1, last], W[last, last - 1], W[last, last]
    size = abs(a - d) + abs(b) + abs(c)
    p = 0.5 * (a - d)
    square = p * (p / size) + product_over(b, c, size)
    root = math.sqrt(abs(square)) * math.sqrt(size)
    if square < 0.0:
        return d + p, root
    return d + p - math.copysign(root, p), 0.0  # the nearer to the last entry


def sweep(W: Any, first: int, last: int, mean: float, apart: float) -> None:
    """Chase a bulge from where it may begin down the block."""
    k = last - 2
    while True:
        here, right, below = W[k, k], W[k, k + 1], W[k + 1, k]
        away = here - mean
        size = abs(away) + abs(apart) + abs(below)
        # The first column of (H - mean)^2 + apart^2.
        x = away * (away / size) + apart * (apart / size) + right * (below / size)
        y = (below / size) * (away + (W[k + 1, k + 1] - mean))
        z = (below / size) * W[k + 2, k + 1]
        size = abs(x) + abs(y) + abs(z)
        if size > 0.0:
            x, y, z = x / size, y / size, z / size
        if k == first:
            break
        around = abs(W[k - 1, k - 1]) + abs(here) + abs(W[k + 1, k + 1])
        if abs(W[k, k - 1]) * (abs(y) + abs(z)) <= EPS * abs(x) * around:
            break
        k -= 1
    w1, w2, t, _ = reflector(x, y, z)
    if k > first:
        W[k, k - 1] *= 1.0 - t
    while True:
        turn_rows(W, k, w1, w2, t)
        turn_columns(W, k, min(k + 3, last) + 1, w1, w2, t)
        k += 1
        if k == last:
            return
        three = k < last - 1
        w1, w2, t, beta = reflector(W[k, k - 1], W[k + 1, k - 1], W[k + 2, k - 1] if three else 0.0)
        W[k, k - 1], W[k + 1, k - 1] = beta, 0.0
        if three:
            W[k + 2, k - 1] = 0.0


def standardise(W: Any, k: int) -> None:
    """Make the block of rows k and k + 1 triangular or, if its values are complex, its diagonal
    entries equal.

    With p, q, r half the difference of the diagonal entries, half the sum and half the difference
    of the others, a rotation turns (p, q) by twice its angle and leaves r; the eigenvalues are
    real where p^2 + q^2 >= r^2.
    """
    a, b, c, d = W[k, k], W[k, k + 1], W[k + 1, k], W[k + 1, k + 1]
    p, size = 0.5 * (a - d), abs(a - d) + abs(b) + abs(c)
    square = p * (p / size) + product_over(b, c, size)
    root = math.sqrt(abs(square)) * math.sqrt(size)
    if square >= 0.0:
        z = p + math.copysign(root, p)
        x, y = z, c  # an eigenvector
        a, d, b, c = d + z, d - (c * (b / z) if z != 0.0 else 0.0), c - b, 0.0
    else:
        q, r = 0.5 * (b + c), 0.5 * (b - c)
        h, sign = math.hypot(p, q), math.copysign(1.0, q)
        x, y = h + abs(q), -p * sign
        if sign != math.copysign(1.0, r):
            x, y = -y, x  # a quarter turn more, that the larger of b and c comes above
        large = r + math.copysign(h, r)
        a = d = d + p
        b, c = -large, root * (root / large)
    size = math.copysign(max(abs(x), abs(y)), x)
    if size == 0.0:
        W[k, k] = d
        return
    x, y = x / size, y / size
    size = math.hypot(x, y)
    t = 1.0 + x / size
    w = (y / size) / t
    turn_rows(W, k, w, 0.0, t)
    turn_columns(W, k, k + 2, w, 0.0, t)
    W[k, k], W[k, k + 1], W[k + 1, k], W[k + 1, k + 1] = a, b, c, d


def iterate(W: Any) -> bool:
    """Bring H to Schur form; whether that was possible.

    References
    ----------
    J. G. F. Francis, The QR transformation, part 2, Comput. J. 4 (1962). G. H. Golub and C. F. Van
    Loan, Matrix Computations, 4th ed., 2013, section 7.5.
    """
    last = W.shape[0] - 2
    tried, left = 0, SWEEPS * max(10, last + 1)
    while last >= 0:
        first = first_of_block(W, last)
        if first > 0:
            W[first, first - 1] = 0.0
        if first < last - 1:
            if left == 0:
                return False
            left -= 1
            tried += 1
            mean, apart = shifts(W, first, last, tried)
            sweep(W, first, last, mean, apart)
            continue
        if first < last:
            standardise(W, first)
        last, tried = first - 1, 0
    return True


KERNELS = (
    turn_rows, turn_columns, reflector, product_over, first_of_block, shifts, sweep, standardise,
    iterate,
)  # fmt: skip
