"""The coefficients of a sweep of Arnoldi steps, and the projected matrix made from them."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy.linalg.blas import dtrsm

# If all entries of R are below this, their squares are rounding, so I - R is the inverse of I + R,
# and no library call for a triangular solve, which would start threads, is needed.
SLIGHT = 1e-9
BREAKDOWN = 20 * np.finfo(float).eps  # a beta below this times |A v| is rounding: invariant space


@dataclass(frozen=True)
class ArnoldiSteps:
    """Coefficients of the products of A with the basis vectors v, or with vectors v + V r.

    With v_j the vectors of the basis and i = 0, 1, ... the steps of this sweep, the first of which
    began at vector j,

    .. math::
        A (v_{j+i} + V r_i) = V h_i + beta_i v_{j+i+1}.

    Attributes
    ----------
    coefficients : ndarray, shape (m, size + 1)
        Row i: h_i; entries from j + i + 1 on are undefined.
    betas : ndarray, shape (m,)
        After one that is rounding, all coefficients are meaningless: see `ended`.
    beside : ndarray, shape (m, size + 1), optional
        Row i: r_i in its first j + i entries. None if all are zero.
    """

    coefficients: np.ndarray
    betas: np.ndarray
    beside: np.ndarray | None = None

    @classmethod
    def of(cls, rows: np.ndarray) -> ArnoldiSteps:
        """From an array of shape (m, 1 or 2, size + 2): rows h and r, beta the last entry of h."""
        beside = rows[:, 1, :-1] if rows.shape[1] == 2 else None
        return cls(rows[:, 0, :-1], rows[:, 0, -1].real, beside)

    @functools.cached_property
    def norms(self) -> np.ndarray:
        """Norms of the coefficients of every step, shape (m,)."""
        return np.sqrt(np.vecdot(self.coefficients, self.coefficients).real)

    @property
    def finite(self) -> bool:
        """Whether all coefficients and their squares are finite."""
        return bool(np.isfinite(self.norms + self.betas).all())

    @property
    def ended(self) -> int | None:
        """Number of the first step after which the space is invariant, or None."""
        small = (self.betas <= BREAKDOWN * self.norms).nonzero()[0]
        return int(small[0]) if small.size else None

    def project(self, S: np.ndarray, first: int, last: int, locked: int = 0) -> None:
        """Write columns `first` to `last` of the projected matrix, from the first of these steps.

        Parameters
        ----------
        S : ndarray, shape (m, m)
            Changed in place. Its columns before `first`, and the entry left of the diagonal in row
            `first`, are known.
        first, last : int
        locked : int
            Number of leading basis vectors that S leaves out.
        """
        count = last - first
        rows = slice(locked, locked + last)
        block = self.coefficients[:count, rows].copy().T
        before = np.arange(count - 1)
        block[first + 1 + before, before] = self.betas[: count - 1]
        if self.beside is not None:
            R = self.beside[:count, rows].T
            if first:
                block -= S[:last, :first] @ R[:first]
            R = R[first:]
            if np.abs(R).max() < SLIGHT:
                block -= block @ R
            else:
                block = dtrsm(1.0, R, block, side=1, diag=1, overwrite_b=1)
        S[:last, first:last] = block
        S[last:, first:last] = 0.0
