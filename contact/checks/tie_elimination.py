"""Unknowns that satisfy the equations of bonded points exactly, for other packages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Part of the largest pivot below which an equation follows from the others.
_DEPENDENT = 1e-10


@dataclass(frozen=True)
class TieElimination:
    """The solutions ``z = start + free y`` of ``E z = e``, and the forces of these equations.

    Other packages lose digits on equations that nearly depend on each other or on inequalities,
    as at a corner where three bodies meet. By the QR decomposition with column pivoting of the
    equations' transpose, in unknowns scaled by `unit` (Golub, Van Loan, Matrix Computations, 2013,
    5.4.2 and 6.2).

    Attributes
    ----------
    start : ndarray, shape (n,)
    free : ndarray, shape (n, n - rank)
    """

    start: Array
    free: Array
    _unit: Array
    _own: Array
    _triangle: Array
    _order: Index

    @classmethod
    def of(cls, E: Array, closed: Array, unit: Array) -> Self:
        """Eliminate ``E z = closed``; unit: the size of each unknown, shape (n,)."""
        factors: Any = qr((E * unit).T, pivoting=True)
        Q, R, order = factors
        pivots = np.abs(np.diag(R))
        rank = int(np.sum(pivots > _DEPENDENT * pivots.max(initial=0.0)))
        own, triangle, order = Q[:, :rank], R[:rank, :rank], order[:rank]
        start = own @ solve_triangular(triangle, closed[order], trans="T")
        return cls(unit * start, unit[:, None] * Q[:, rank:], unit, own, triangle, order)

    def forces(self, load: Array, count: int) -> Array:
        """Forces r of all equations with ``E^T r = load`` in their span; dependent ones have none.

        Parameters
        ----------
        load : ndarray, shape (n,)
            What the other forces leave unbalanced.
        count : int
            Number of equations.
        """
        found = np.zeros(count)
        found[self._order] = solve_triangular(self._triangle, self._own.T @ (self._unit * load))
        return found
