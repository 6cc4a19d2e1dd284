"""Orthonormal Krylov basis that grows by Arnoldi steps, on either array module."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg.blas import dtrsm

from gpu.arrays.namespace import to_host

ONE_LAUNCH = 10_000  # up to this order a sweep in one launch is faster than library products
TINY = np.finfo(float).tiny  # avoids division by zero where a norm is zero
# Mixed into seeds, so that random vectors differ from a caller's with the same seed.
SALT = 0x6A09E667F3BCC908


class Arnoldi:
    """An Arnoldi basis of orthonormal rows v_0, v_1, ...: ``A V_j = V_j S_j + v_j b_j^*``.
    Classical Gram-Schmidt, twice (CGS2; Giraud et al. 2005). The host waits for the device only at
    the end of a sweep, when the coefficients are copied to it."""

    def __init__(
        self,
        apply: Callable[[Any], Any],
        n: int,
        size: int,
        dtype: Any,
        xp: Any,
        seed: int = 0,
        matrix: Any = None,
    ) -> None:
        self.xp, self.matvecs = xp, 0
        self._apply, self._entries = apply, matrix
        self._seed, self._drawn = seed, 0
        self._allocate(size, n, dtype)

    def _allocate(self, size: int, n: int, dtype: Any) -> None:
        xp, matrix = self.xp, self._entries
        self.size = size
        self.V = xp.empty((size + 1, n), dtype=dtype)
        self._steps = self._matrix = None
        fused = xp is not np and np.dtype(dtype) == np.float64
        # See `ArnoldiSteps.of`.
        self._coefficients = xp.zeros((size, 2 if fused else 1, size + 2), dtype=dtype)
        if fused:
            from gpu.eigenvalues.krylov.device_steps import FusedSteps

            self._steps = FusedSteps(self.V, self._coefficients)
            if matrix is not None and n <= ONE_LAUNCH and self._steps.multiplies(matrix):
                self._matrix = matrix

    def enlarge(self, size: int, rows: int) -> None:
        """Allocate memory for `size` vectors; the first `rows` rows are kept."""
        V = self.V
        self._allocate(size, V.shape[1], V.dtype)
        self.V[:rows] = V[:rows]

    def start(self, place: int, vector: Any = None) -> None:
        """Make row `place` a unit vector orthogonal to those before it; random by default."""
        xp, V = self.xp, self.V
        if vector is None and self._steps is not None and V.shape[1] >= 4 * len(V):
            # The basis is small, so a random vector is far from its span and needs no check.
            self._steps.random_start(place, (self._seed << 32) + self._drawn)
            self._drawn += 1
            return
        for _ in range(3):
            if vector is None:
                rng = self._rng
                drawn = rng.standard_normal(V.shape[1])
                if V.dtype.kind == "c":
                    drawn = drawn + 1j * rng.standard_normal(V.shape[1])
                w = xp.asarray(drawn)
            else:
                w = xp.array(vector, dtype=V.dtype)
            w /= xp.abs(w).max()
            before = float(xp.linalg.norm(w))
            for _ in range(3):
                w -= self._products(w, place) @ V[:place]
            size = float(xp.linalg.norm(w))
            if size > 1e-8 * before:  # otherwise too few digits are left; try a random vector
                V[place] = w / size
                return
            vector = None
        raise np.linalg.LinAlgError("the basis spans the whole space")

    @functools.cached_property
    def _rng(self) -> np.random.Generator:
        return np.random.default_rng((SALT, self._seed))

    def _products(self, w: Any, count: int) -> Any:
        """V^* w for the first `count` vectors; w is conjugated to avoid a conjugated copy of V."""
        V = self.V[:count]
        return V @ w if V.dtype.kind == "f" else (V @ w.conj()).conj()

    def sweep(
        self, first: int, last: int, meanwhile: Callable[[], Any] | None = None
    ) -> ArnoldiSteps:
        """Arnoldi steps from row `first` up to row `last`. `meanwhile` is called while the device
        computes, before the host waits for the coefficients.
        """
        xp, V = self.xp, self.V
        if self._matrix is not None and self._steps is not None:
            self._steps.sweep(self._matrix, first, last)
        else:
            for j in range(first, last):
                w = self._apply(V[j])
                if self._steps is not None:
                    self._steps(w, j)
                else:
                    self._step(xp.array(w, dtype=V.dtype), j)
        self.matvecs += last - first
        if meanwhile is not None:
            meanwhile()
        rows = to_host(self._coefficients[first:last])
        # Only sweeps in one launch multiply vectors v + V r instead of v.
        return ArnoldiSteps.of(rows if self._matrix is not None else rows[:, :1])

    def _step(self, w: Any, j: int) -> None:
        """Orthogonalise w, which is ``A V[j]``, into row j + 1."""
        xp, V, row = self.xp, self.V, self._coefficients[j, 0]
        h = self._products(w, j + 1)
        w -= h @ V[: j + 1]
        # Always twice: the components that one pass leaves grow from step to step, even if each
        # pass subtracts little.
        again = self._products(w, j + 1)
        w -= again @ V[: j + 1]
        beta = xp.sqrt(xp.vdot(w, w).real)
        row[: j + 1] = h + again
        row[-1] = beta
        V[j + 1] = w / xp.maximum(beta, TINY)

    def rotate(self, Q: np.ndarray, residual: int, first: int = 0) -> None:
        """Replace the rows from `first` on by their combinations with the columns of Q. The row
        after them becomes the former row ``first + residual``, the residual vector.
        """
        xp, (count, kept), V = self.xp, Q.shape, self.V[first:]
        if self._steps is not None:
            from gpu.eigenvalues.krylov.ritz_pairs import rotate, turns

            if turns(count):
                rotate(V, Q, residual)
                return
        rotated = xp.asarray(np.ascontiguousarray(Q.T)) @ V[:count]
        last = V[residual].copy()
        V[:kept] = rotated
        V[kept] = last

    def combine(self, Y: np.ndarray) -> Any:
        """``V^T Y``, combinations of the basis vectors, shape (n, k), for Y of shape (count, k)."""
        return (self.xp.asarray(np.ascontiguousarray(Y.T)) @ self.V[: len(Y)]).T


# If all entries of R are below this, I - R is the inverse of I + R up to rounding; a library call
# for a triangular solve would start threads.
SLIGHT = 1e-9
BREAKDOWN = 20 * np.finfo(float).eps  # a beta below this times |A v| is rounding: invariant space


@dataclass(frozen=True)
class ArnoldiSteps:
    """Coefficients of a sweep that began at vector j, for its steps i = 0, 1, ...: ``A (v_{j+i} + V
    r_i) = V h_i + beta_i v_{j+i+1}``.
    """

    coefficients: np.ndarray  # (m, size + 1): rows h_i, undefined from entry j + i + 1 on
    betas: np.ndarray  # (m,); all that follows a beta of rounding size is meaningless, see `ended`
    beside: np.ndarray | None = None  # (m, size + 1): rows r_i, j + i entries; None: all zero

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
        """Write columns `first` to `last` of the projected matrix S, shape (m, m), in place. Its
        earlier columns, and the entry left of the diagonal in row `first`, are known; the first
        `locked` basis vectors are left out of S."""
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
