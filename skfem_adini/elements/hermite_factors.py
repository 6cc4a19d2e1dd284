"""Reference shape functions as sums of products of one-dimensional factors."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations_with_replacement
from math import perm

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# Coefficients in X of a factor of the end X = 0, and of the corresponding one of the end X = 1.
Factor = tuple[tuple[float, ...], tuple[float, ...]]
# A sum of products, one factor for each coordinate.
Function = tuple[tuple[Factor, ...], ...]

HERMITE: Factor = ((1.0, 0.0, -3.0, 2.0), (0.0, 0.0, 3.0, -2.0))
SLOPE: Factor = ((0.0, 1.0, -2.0, 1.0), (0.0, 0.0, -1.0, 1.0))


def adini_functions(dim: int) -> tuple[Function, ...]:
    r"""Return Adini's functions of one vertex: that of u, then those of the derivatives.
    :math:`N = \prod_i L(X_i) + \sum_i B(X_i) \prod_{j \ne i} L(X_j)`, :math:`H_i = S(X_i)
    \prod_{j \ne i} L(X_j)`."""
    linear: Factor = ((1.0, -1.0), (0.0, 1.0))
    bubble: Factor = ((0.0, 1.0, -3.0, 2.0), (0.0, -1.0, 3.0, -2.0))
    plain = (linear,) * dim
    bubbles, slopes = (
        [(*plain[:i], factor, *plain[i + 1 :]) for i in range(dim)] for factor in (bubble, SLOPE)
    )
    return ((plain, *bubbles), *((slope,) for slope in slopes))


@lru_cache(maxsize=64)
def exponents(dim: int, order: int) -> tuple[tuple[int, ...], ...]:
    """Return the partial derivatives of one order, as multi-indices with the first axis first."""
    choices = combinations_with_replacement(range(dim), order)
    return tuple(tuple(choice.count(i) for i in range(dim)) for choice in choices)


def derivatives(functions: Sequence[Function], vertex: Array, X: Array, order: int) -> Array:
    """Return all partial derivatives of one order at reference points X (dim, ...), by `exponents`.
    The functions are those of the origin, moved to the vertex; shape (functions times indices,
    ...)."""
    ends = vertex.astype(int)
    known: dict[tuple[Factor, int, int], Array] = {}

    def factor(f: Factor, axis: int, times: int) -> Array:
        key = (f, axis, times)
        if key not in known:
            known[key] = _derivative(f[ends[axis]], times, X[axis])
        return known[key]

    def product(term: tuple[Factor, ...], alpha: tuple[int, ...]) -> Array:
        first, *rest = (factor(f, axis, alpha[axis]) for axis, f in enumerate(term))
        for other in rest:
            first = first * other
        return first

    rows = [
        sum((product(term, alpha) for term in terms[1:]), start=product(terms[0], alpha))
        for terms in functions
        for alpha in exponents(len(X), order)
    ]
    return np.array(rows)


def _derivative(coefficients: tuple[float, ...], order: int, x: Array) -> Array:
    """Return one derivative of a polynomial at x, by Horner's rule."""
    result = np.zeros_like(x)
    for power in range(len(coefficients) - 1, order - 1, -1):
        result = result * x + coefficients[power] * perm(power, order)
    return result
