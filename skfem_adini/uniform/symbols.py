"""Symbols of Adini's element on a uniform grid, in double and in any precision."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal, localcontext
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skfem_adini.solvers.exact_matrices import ExactMatrix, exact_matrix

Array = NDArray[np.float64]

_GUARD_DIGITS = 15  # decimal digits carried beyond those requested


@lru_cache
def exact_symbol(dim: int, direction: int | None = None) -> ExactMatrix:
    r"""Return the symbol of the mass matrix, or of the stiffness :math:`\int u_i v_i`.

    On a uniform grid a vertex is coupled to its 3^dim neighbours by blocks :math:`A(o)` for u
    and :math:`h_i u_i`. By reflection :math:`\sum_o A_{pq}(o) e^{i \theta \cdot o} = i^m \sum_{e
    \in \{0,1\}^d} C_{pq}(e) \prod_i w_i(e_i)` with w = (1, -4 sin^2(theta/2)) in even directions
    and (0, 2 sin(theta)) in the m odd ones. The numerators C, shape (dim + 1, dim + 1, 2, ...,
    2), are whole numbers, so that terms that vanish for theta = 0 are exactly zero."""
    matrix = exact_matrix(dim, direction, direction)
    size = dim + 1
    cell = matrix.numerators.reshape(2**dim, size, 2**dim, size)
    vertices = list(product((0, 1), repeat=dim))
    stencil = np.zeros((size, size) + (3,) * dim, dtype=np.int64)
    for a, from_vertex in enumerate(vertices):
        for b, to_vertex in enumerate(vertices):
            offset = 1 + np.array(to_vertex) - np.array(from_vertex)
            stencil[(slice(None), slice(None), *offset)] += cell[a, :, b]

    even = np.array([[1, 1, 1], [0, 0, 1]])
    odd = np.array([[0, 0, 0], [0, 0, 1]])
    result = np.zeros((size, size) + (2,) * dim, dtype=np.int64)
    for p, q in product(range(size), repeat=2):
        entry = stencil[p, q]
        for i in range(dim):
            entry = np.tensordot(entry, odd if is_odd(p, q, i) else even, axes=(0, 1))
        result[p, q] = entry
    return ExactMatrix(result, matrix.denominator)


def is_odd(p: int, q: int, direction: int) -> bool:
    """Return whether reflection in a direction changes the sign of the coupling of two dofs."""
    return (p == direction + 1) != (q == direction + 1)


def phase(p: int, q: int, dirichlet: bool) -> int:
    """Return the sign, 1 or -1, of an entry of the trigonometric form for real sines and cosines.
    For u a product of sines, :math:`h_i u_i` has a cosine in the direction i. For u a product of
    cosines it has a sine, and the coupling of u and its slopes the other sign."""
    if p == q:
        return 1
    if q == 0:
        return 1 if dirichlet else -1
    if p == 0:
        return -1 if dirichlet else 1
    return -1


def extended_eigenvalue(
    lengths: Sequence[float],
    cells: Sequence[int],
    modes: Sequence[int],
    weights: Sequence[float],
    dirichlet: bool,
    digits: int,
) -> Decimal:
    """Return the smallest eigenvalue of one block of the discrete operator -sum k_i u_ii. It is
    the root of det(K - lambda M) next to 0, by Newton's method from the left, which is monotone
    because all roots are real. The modes are half waves, the lengths exact binary values."""
    dim = len(cells)
    with localcontext() as context:
        context.prec = digits + _GUARD_DIGITS
        pi = _pi(context.prec)
        scales = [
            Decimal(float(k)) * (n / Decimal(float(l))) ** 2
            for k, n, l in zip(weights, cells, lengths, strict=True)
        ]
        angles = [k * pi / n for k, n in zip(modes, cells, strict=True)]
        even = [(Decimal(1), -4 * _sine(theta / 2) ** 2) for theta in angles]
        odd = [(Decimal(0), 2 * _sine(theta)) for theta in angles]
        active = [p for p in range(dim + 1) if _is_active(p, modes, cells, dirichlet)]

        def block(direction: int | None, p: int, q: int) -> Decimal:
            numerators, denominator = exact_symbol(dim, direction)
            total = Decimal(0)
            for e in product((0, 1), repeat=dim):
                term = Decimal(int(numerators[(p, q, *e)]))
                for i in range(dim):
                    term *= (odd if is_odd(p, q, i) else even)[i][e[i]]
                total += term
            return phase(p, q, dirichlet) * total / denominator

        pencil = [
            [
                [sum(scales[i] * block(i, p, q) for i in range(dim)), -block(None, p, q)]
                for q in active
            ]
            for p in active
        ]
        return _smallest_root(_determinant(pencil), context.prec)


def continuous_eigenvalue(
    lengths: Sequence[float], modes: Sequence[int], weights: Sequence[float], digits: int
) -> Decimal:
    r"""Return :math:`\pi^2 \sum_i k_i (m_i / l_i)^2` for a box with the sides l and modes m."""
    with localcontext() as context:
        context.prec = digits + _GUARD_DIGITS
        terms = [
            Decimal(float(k)) * (m / Decimal(float(l))) ** 2
            for m, l, k in zip(modes, lengths, weights, strict=True)
        ]
        return _pi(context.prec) ** 2 * sum(terms)


def _is_active(p: int, modes: Sequence[int], cells: Sequence[int], dirichlet: bool) -> bool:
    """Return whether a dof occurs in a mode: none of its sines vanishes on the grid."""
    has_sine = [(i + 1 == p) != dirichlet for i in range(len(modes))]
    return all(0 < k < n for k, n, sine in zip(modes, cells, has_sine, strict=True) if sine)


def _determinant(rows: list[Any]) -> list[Decimal]:
    """Return the determinant of a matrix of polynomials, expanded along the first row.
    Polynomials are lists of coefficients, that of the lowest power first."""
    if not rows:
        return [Decimal(1)]
    result = [Decimal(0)] * (len(rows) + 1)
    for j, entry in enumerate(rows[0]):
        minor = _determinant([row[:j] + row[j + 1 :] for row in rows[1:]])
        for i, a in enumerate(entry):
            for k, b in enumerate(minor):
                result[i + k] += (-1) ** j * a * b
    return result


def _smallest_root(coefficients: list[Decimal], precision: int) -> Decimal:
    """Return the smallest root of a polynomial with non-negative real roots."""
    # Relative step at which to stop, ten digits beyond those requested.
    root, bound = Decimal(0), Decimal(10) ** (_GUARD_DIGITS // 3 - precision)
    for _ in range(200):  # never reached: each step near the root doubles the digits
        value = slope = Decimal(0)
        for c in reversed(coefficients):
            slope = slope * root + value
            value = value * root + c
        step = -value / slope if slope else Decimal(0)
        root += step
        if abs(step) <= bound * abs(root):
            break
    return root


def _pi(precision: int) -> Decimal:
    """Return pi by Machin's formula, 16 arctan(1/5) - 4 arctan(1/239)."""
    scale = 10 ** (precision + _GUARD_DIGITS)

    def inverse_tangent(n: int) -> int:
        power = total = scale // n
        k = 1
        while power:
            power //= -n * n
            k += 2
            total += power // k
        return total

    return Decimal(16 * inverse_tangent(5) - 4 * inverse_tangent(239)) / scale


def _sine(x: Decimal) -> Decimal:
    """Return the sine by its power series."""
    term = total = x
    k = 1
    while total + term != total or k == 1:
        term *= -x * x / ((k + 1) * (k + 2))
        total += term
        k += 2
    return total
