r"""The analysis of a linear Gaussian problem from the combinations of data that matter most.

With prior w ~ N(0, 1) and data b = A w + e, e ~ N(0, 1), the data are projected on orthonormal
combinations U, those of Golub and Kahan's bidiagonalisation from b (Paige and Saunders, ACM Trans.
Math. Softw. 8, 1982, 43-71; in the space of data as in Gratton and Tshimanga, Q. J. R. Meteorol.
Soc. 135, 2009, 1573-1585). With :math:`A^T U = V C^T`, V orthonormal, mean and covariance given the
data :math:`U^T b` are

.. math::
    w = V C^T (1 + C C^T)^{-1} U^T b , \qquad 1 - V C^T (1 + C C^T)^{-1} C V^T .

More data never increase a covariance: it is an upper bound of that of all data, which it equals
once U spans the range of A. The mean converges like that of conjugate gradients.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lstsq, svd
from scipy.sparse.linalg import LinearOperator

Array = NDArray[np.float64]
# A vector that loses this factor to those before it lies in their span, up to rounding.
_DEPENDENT = 1e-13
# Up to this step the residual is looked at after each, then after each tenth.
_EACH = 50


@dataclass(frozen=True)
class Combined:
    """The mean, and the directions that the data have determined."""

    solution: Array  # shape (r,)
    directions: Array  # (k, r): orthonormal rows, by decreasing singular values
    singular_values: Array  # (k,): change of the data, in deviations, per unit
    residual: float  # estimate of |A^T (b - A w) - w| / |A^T b|
    complete: bool  # the directions span all that the data can determine

    def variances(self, prior: Array, moved: Array) -> Array:
        """Prior variances, shape (n,), less what the data determine along the directions. `moved`,
        shape (k, n), holds each direction times a square root of the prior covariance.
        """
        left = 1.0 / (1.0 + self.singular_values**2)
        if len(self.directions) == self.directions.shape[1]:  # a sum of what is left: no difference
            return np.asarray(left @ moved**2)
        share = self.singular_values**2 * left
        return np.asarray(np.maximum(prior - share @ moved**2, 0.0))


class _Basis:
    """Orthonormal vectors; a new one is made orthogonal to all by two passes of Gram-Schmidt."""

    def __init__(self, size: int) -> None:
        self._rows, self.count = np.empty((8, size)), 0

    @property
    def rows(self) -> Array:
        return self._rows[: self.count]

    def orthogonal(self, vector: Array) -> tuple[Array | None, float]:
        """The normalised part orthogonal to the basis and its norm; None where nothing is left."""
        before = float(np.linalg.norm(vector))
        for _ in range(2):
            vector = vector - self.rows.T @ (self.rows @ vector)
        norm = float(np.linalg.norm(vector))
        if norm <= _DEPENDENT * before:
            return None, 0.0
        return vector / norm, norm

    def append(self, vector: Array) -> None:
        """Add a vector that `orthogonal` has returned."""
        if self.count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        self._rows[self.count] = vector
        self.count += 1


class _Search:
    """The two bases, and C: the coefficients of A^T u in V, a row for each u."""

    def __init__(self, A: LinearOperator, b: Array) -> None:
        self.A, self.b = A, b
        self.U, self.V = _Basis(A.shape[0]), _Basis(A.shape[1])
        self._rows: list[Array] = []
        self._random = np.random.default_rng(0)
        self._next, _ = self.U.orthogonal(b)
        self._left = 0.0  # norm of the part of A v outside U, for the last v
        self._largest = 0.0
        self._rest_is_blind = False
        self.running = self._next is not None

    @property
    def exhausted(self) -> bool:
        """Whether the data can determine nothing more: U spans the range of A. A V lies in the span
        of U and the next combination, so V of full rank is not enough while there is a next one.
        """
        full = self.V.count == self.A.shape[1] and self._next is None
        return self.U.count == self.A.shape[0] or full or self._rest_is_blind

    def step(self) -> None:
        """Another combination of the data; a random one when those from b are exhausted."""
        u, drawn = self._next, self._next is None
        if u is None:
            u, _ = self.U.orthogonal(self._random.standard_normal(self.A.shape[0]))
            assert u is not None  # not exhausted, so random data have a part outside U
        self.U.append(u)
        back = np.asarray(self.A.rmatvec(u), dtype=float)
        self._largest = max(self._largest, float(np.linalg.norm(back)))
        row = self.V.rows @ back
        v, alpha = self.V.orthogonal(back)
        self._next, self._left = None, 0.0
        if v is not None and alpha > _DEPENDENT * self._largest:
            row = np.append(row, alpha)
            self.V.append(v)
            self._next, self._left = self.U.orthogonal(np.asarray(self.A.matvec(v), dtype=float))
        elif drawn:  # A^T is 0 at random data outside U, so at all of them
            self._rest_is_blind = True
        self._rows.append(row)
        self.running = self.running and self._next is not None

    def coefficients(self) -> Array:
        """C, shape (u, v)."""
        C = np.zeros((self.U.count, self.V.count))
        for target, row in zip(C, self._rows, strict=True):
            target[: row.size] = row
        return C

    def solution(self) -> tuple[Array, float]:
        """Coefficients of w in V, and the residual: all of it comes from the last v."""
        C, right = self.coefficients(), self.U.rows @ self.b
        # C^T (1 + C C^T)^-1 U^T b as a least-squares problem, whose condition is not squared.
        rows = np.concatenate([C, np.eye(C.shape[1])])
        data = np.append(right, np.zeros(C.shape[1]))
        y = lstsq(rows, data, lapack_driver="gelsy", check_finite=False)[0]
        scale = float(np.linalg.norm(self.b)) * float(np.linalg.norm(C[0]))
        if not self.running or scale == 0.0:
            return y, 0.0
        return y, abs(float(y[-1])) * self._left * self._largest / scale


def combined_analysis(
    A: LinearOperator,
    b: Array,
    tol: float,
    most: int,
    vectors: int,
    progress: Callable[[int, float], Any],
) -> Combined:
    """Mean and directions of the posterior: at most `most` steps for the mean, until its
    `Combined.residual` is below `tol`, and at least `vectors` directions, if the data determine as
    many. Calls ``progress(step, residual)``."""
    search = _Search(A, np.asarray(b, dtype=float))
    y, residual = np.zeros(0), np.inf if search.running else 0.0
    while residual > tol and search.U.count < most and not search.exhausted:
        search.step()
        k = search.U.count
        if k <= _EACH or k % 10 == 0 or search.exhausted or k == most:
            y, residual = search.solution()
            progress(k, residual)
    if search.exhausted:
        residual = 0.0
    while search.U.count < vectors and not search.exhausted:
        search.step()
    if search.U.count == 0:
        return Combined(np.zeros(A.shape[1]), np.zeros((0, A.shape[1])), np.zeros(0), 0.0, False)
    y, _ = search.solution()
    _, singular, right = svd(search.coefficients(), full_matrices=False)
    V = search.V.rows
    return Combined(y @ V, right @ V, singular, residual, search.exhausted)
