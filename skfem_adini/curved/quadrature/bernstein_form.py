"""Polynomial interpolation on boxes, in Bernstein form."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import comb

Array = NDArray[np.float64]


def lobatto(degree: int) -> Array:
    """Return the Chebyshev-Lobatto points on [0, 1], ascending, shape (degree + 1,)."""
    return (1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2


def bernstein(degree: int, t: Array) -> Array:
    r"""Return :math:`\binom{p}{j} t^j (1-t)^{p-j}`, shape (points, degree + 1)."""
    j = np.arange(degree + 1)
    return comb(degree, j) * t[:, None] ** j * (1 - t[:, None]) ** (degree - j)


@lru_cache
def _matrices(degree: int) -> tuple[Array, Array, Array, Array]:
    """Return nodes, matrix from values to coefficients, check points, Bernstein values there."""
    nodes = lobatto(degree)
    to_coefficients: Array = np.asarray(np.linalg.inv(bernstein(degree, nodes)), dtype=float)
    # Between the nodes: around the middle, where the interpolant of a kink is worst, and near the
    # ends.
    checks: Array = np.array([0.03, 0.19, 0.43, 0.61, 0.86, 0.98])
    return nodes, to_coefficients, checks, bernstein(degree, checks)


def interpolate(
    function: Callable[[Array], Array], lower: Array, size: Array, degree: int
) -> tuple[Array, Array]:
    r"""Interpolate a function on boxes at the tensor Chebyshev-Lobatto points.

    The result is :math:`\sum_{ij} c_{ij} B_i(X) B_j(Y)` in the unit coordinates of each box; its
    values there lie between the least and the largest coefficient.

    Parameters
    ----------
    function
        Takes points of shape (2, boxes, points) and returns (boxes, points).
    lower, size
        Lower corner and sides of the boxes, shape (2, boxes).
    degree
        Degree in each variable.

    Returns
    -------
    coefficients : ndarray
        Shape (boxes, degree + 1, degree + 1).
    error : ndarray
        Largest difference to the function at 36 points that are not nodes, shape (boxes,).

    References
    ----------
    R. I. Saye, High-order quadrature on multi-component domains implicitly defined by multivariate
    polynomials, Journal of Computational Physics 448 (2022), 110720, section 2.
    """
    nodes, to_coefficients, checks, at_checks = _matrices(degree)
    m, k = degree + 1, len(checks)
    ticks = np.concatenate([nodes, checks])
    X, Y = np.meshgrid(nodes, nodes, indexing="ij")
    Xc, Yc = np.meshgrid(checks, checks, indexing="ij")
    unit = np.array([np.append(X, Xc), np.append(Y, Yc)])
    assert ticks.size == m + k
    values = function(lower[:, :, None] + size[:, :, None] * unit[:, None])
    data, seen = values[:, : m * m].reshape(-1, m, m), values[:, m * m :].reshape(-1, k, k)
    coefficients = to_coefficients @ data @ to_coefficients.T
    # The corners are nodes: keep their values to the last bit, so that neighbours agree.
    for i in (0, -1):
        for j in (0, -1):
            coefficients[:, i, j] = data[:, i, j]
    difference = at_checks @ coefficients @ at_checks.T - seen
    return coefficients, np.abs(difference).max(axis=(1, 2), initial=0.0)
