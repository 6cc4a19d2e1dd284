"""Numbers of twice the working precision: each is the sum of two float64.

The sum and the product of two float64 are each a float64 and a float64 error (Dekker 1971, Knuth
1997), of which sums and products of pairs are made (Hida, Li and Bailey 2001). Errors are about
:math:`2^{-102}` relative to the sum of moduli, for products above 1e-290 and numbers up to 1e299.

T. J. Dekker, Numer. Math. 18 (1971), 224-242. D. E. Knuth, The Art of Computer Programming, volume
2, 3rd edition, 1997, section 4.2.2. Y. Hida, X. S. Li and D. H. Bailey, ARITH-15 (2001), 155-162.
T. Ogita, S. M. Rump and S. Oishi, SIAM J. Sci. Comput. 26 (2005), 1955-1988."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def two_sum(a: Any, b: Any) -> tuple[Any, Any]:
    """s = a + b as rounded, and e with ``s + e = a + b`` exactly (Knuth)."""
    s = a + b
    of_b = s - a
    return s, (a - (s - of_b)) + (b - of_b)


def two_product(a: Any, b: Any) -> tuple[Any, Any]:
    """p = a b as rounded, and e with ``p + e = a b`` exactly (Dekker)."""
    p = a * b
    (a1, a2), (b1, b2) = _halves(a), _halves(b)
    e = a1 * b1
    e -= p
    e += a1 * b2
    e += a2 * b1
    e += a2 * b2
    return p, e


def _halves(a: Any) -> tuple[Any, Any]:
    """Two numbers of 26 bits each whose sum is a (Veltkamp)."""
    c = (2.0**27 + 1.0) * a
    upper = c - (c - a)
    return upper, a - upper


@dataclass(frozen=True, eq=False)
class Pairs:
    """An array of pairs, with arithmetic among pairs and with arrays of float64."""

    high: Array  # the sum as rounded
    low: Array  # the rest, of the same shape
    __array_ufunc__ = None  # arrays on the left defer to this class

    @staticmethod
    def of(x: Any) -> Pairs:
        """Numbers as pairs, exactly; pairs as they are."""
        if isinstance(x, Pairs):
            return x
        high = np.asarray(x, dtype=np.float64)
        return Pairs(high, np.zeros_like(high))

    @staticmethod
    def where(chosen: Any, a: Any, b: Any) -> Pairs:
        """`numpy.where` of pairs."""
        a, b = Pairs.of(a), Pairs.of(b)
        return Pairs(np.where(chosen, a.high, b.high), np.where(chosen, a.low, b.low))

    @staticmethod
    def zeros(shape: Any) -> Pairs:
        """Zeros, which may be overwritten."""
        return Pairs(np.zeros(shape), np.zeros(shape))

    def __setitem__(self, at: Any, value: Pairs) -> None:
        self.high[at], self.low[at] = value.high, value.low

    def __getitem__(self, at: Any) -> Pairs:
        return Pairs(self.high[at], self.low[at])

    def reshape(self, *shape: int) -> Pairs:
        """The same numbers in another shape."""
        return Pairs(self.high.reshape(*shape), self.low.reshape(*shape))

    def __neg__(self) -> Pairs:
        return Pairs(-self.high, -self.low)

    def __abs__(self) -> Pairs:
        return Pairs.where(self.high < 0, -self, self)

    def __add__(self, other: Any) -> Pairs:
        other = Pairs.of(other)
        s, e = two_sum(self.high, other.high)
        t, f = two_sum(self.low, other.low)
        s, e = _in_order(s, e + t)
        return Pairs(*_in_order(s, e + f))

    __radd__ = __add__

    def __sub__(self, other: Any) -> Pairs:
        return self + -Pairs.of(other)

    def __rsub__(self, other: Any) -> Pairs:
        return -self + other

    def __mul__(self, other: Any) -> Pairs:
        other = Pairs.of(other)
        p, e = two_product(self.high, other.high)
        return Pairs(*_in_order(p, e + (self.high * other.low + self.low * other.high)))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Pairs:
        other = Pairs.of(other)
        first = self.high / other.high
        rest = self - other * first
        return Pairs(*_in_order(first, rest.high / other.high))

    def sqrt(self) -> Pairs:
        """Square root of numbers that are not negative, by a step of Newton's method."""
        root = np.sqrt(self.high)
        rest = (self - Pairs.of(root) * root).high
        return Pairs(*_in_order(root, rest / (2.0 * np.where(root > 0, root, 1.0))))

    def sum(self, axis: int = 0) -> Pairs:
        """Sum along an axis."""
        high, low = np.moveaxis(self.high, axis, 0), np.moveaxis(self.low, axis, 0)
        return _summed(high.copy(), low.sum(axis=0))

    @property
    def rounded(self) -> Array:
        """The float64 nearest to each number, as an array."""
        return np.asarray(self.high)


def dot(a: Array, x: Pairs) -> Pairs:
    """Sums of products along the first axis, ``sum_i a_i x_i`` (Ogita, Rump and Oishi).
    Shapes (n, ...) that broadcast against each other."""
    p, e = two_product(a, x.high)
    if np.any(x.low):
        e += a * x.low
    return _summed(p, e.sum(axis=0))


def _summed(p: Array, low: Array) -> Pairs:
    """The sum of p along its first axis, and of low; p is overwritten."""
    n = len(p)
    while n > 1:
        half = n // 2
        s, e = two_sum(p[:half], p[half : 2 * half])
        low = low + e.sum(axis=0)
        p[:half] = s
        if n % 2:
            p[half] = p[n - 1]
        n -= half
    return Pairs(*two_sum(p[0] if len(p) else np.zeros_like(low), low))


def _in_order(a: Any, b: Any) -> tuple[Any, Any]:
    """``a + b`` as rounded, and its error, for a number b that is not larger than a (Dekker)."""
    s = a + b
    return s, b - (s - a)
