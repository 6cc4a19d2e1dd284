"""Element matrices of Adini's element on a box, as exact fractions."""

from __future__ import annotations

from functools import lru_cache, reduce
from itertools import product
from math import perm
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]

_DENOMINATOR = 420  # least common multiple of 1, ..., 7: the factors are cubics


class ExactMatrix(NamedTuple):
    """A matrix of fractions with one denominator."""

    numerators: Integers  # integers, shape (functions, functions)
    denominator: int  # coprime to the numerators


@lru_cache
def exact_matrix(dim: int, row: int | None = None, column: int | None = None) -> ExactMatrix:
    r"""Return the integrals of products of shape functions over the unit box, in 1 to 3 variables.

    With :math:`L = 1 - X`, :math:`B = X (1 - X) (1 - 2 X)`, :math:`S = X (1 - X)^2` those of the
    origin are :math:`N = \prod_j L(X_j) + \sum_i B(X_i) \prod_{j \ne i} L(X_j)` and :math:`H_i =
    S(X_i) \prod_{j \ne i} L(X_j)`, for u and :math:`h_i \partial_i u` on a box of sides h.
    Vertices are in the order of `itertools.product`. `row` and `column` are the variables of
    differentiation, if any."""
    integrals = [_integrals(int(row == i), int(column == i)) for i in range(dim)]
    functions = _functions(dim)
    numerators = functions @ reduce(np.kron, integrals) @ functions.T
    common = np.gcd.reduce(np.append(numerators.ravel(), _DENOMINATOR**dim))
    numerators //= common
    numerators.setflags(write=False)  # every caller gets the same array
    return ExactMatrix(numerators, int(_DENOMINATOR**dim // common))


def _integrals(row: int, column: int) -> Integers:
    """Return the integrals over [0, 1] of products of factors or their derivatives, times 420."""
    # Coefficients of L = 1 - X, B = X (1 - X) (1 - 2 X), S = X (1 - X)^2 and of the corresponding
    # factors of the end X = 1: 1 - X in place of X, and the sign of the slope S changed.
    factors = (
        *((1, -1, 0, 0), (0, 1, -3, 2), (0, 1, -2, 1)),
        *((0, 1, 0, 0), (0, -1, 3, -2), (0, 0, -1, 1)),
    )
    result = np.zeros((6, 6), dtype=np.int64)
    for a, p in enumerate(factors):
        for b, q in enumerate(factors):
            result[a, b] = sum(
                perm(i, row)
                * perm(j, column)
                * p[i]
                * q[j]
                * _DENOMINATOR
                // (i + j + 1 - row - column)
                for i in range(row, 4)
                for j in range(column, 4)
            )
    return result


def _functions(dim: int) -> Integers:
    """Return the shape functions in terms of products of factors, shape (functions, 6^dim)."""
    rows = []
    for vertex in product((0, 1), repeat=dim):
        at_end = np.array(vertex) * 3
        units = at_end + np.eye(dim, dtype=int)
        slopes = at_end + 2 * np.eye(dim, dtype=int)
        for choice in ([at_end, *units], *([slope] for slope in slopes)):
            row = np.zeros((6,) * dim, dtype=np.int64)
            for index in choice:
                row[tuple(index)] = 1
            rows.append(row.ravel())
    return np.array(rows)
