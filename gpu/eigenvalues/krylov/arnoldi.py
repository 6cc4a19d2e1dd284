"""Orthonormal Krylov basis that grows by Arnoldi steps, on either array module."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from gpu.arrays.namespace import to_host
from gpu.eigenvalues.krylov.arnoldi_steps import ArnoldiSteps

ONE_LAUNCH = 10_000  # up to this order a sweep in one launch is quicker than library products
TINY = np.finfo(float).tiny  # in place of a norm of zero
# Of random vectors: a start drawn by the caller from a plain seed must not be drawn here again.
SALT = 0x6A09E667F3BCC908


class Arnoldi:
    """Orthonormal rows v_0, v_1, ...; of the first j as columns, ``A V_j = V_j S_j + v_j b_j``.

    Orthogonalisation is classical Gram-Schmidt, twice (CGS2). Nothing waits for the device inside
    a sweep: the coefficients come to the host in one copy at its end.

    Parameters
    ----------
    apply : callable x -> A x
        On arrays of `xp`, shape (n,).
    n, size : int
        Order of A, and most vectors that span the basis until it is enlarged.
    dtype : numpy dtype
        float64 or complex128.
    xp : module
        numpy or cupy.
    seed : int
        Of the vectors that take the place of broken-down ones.
    matrix : array, optional
        The entries of A, where `apply` multiplies by just these.

    References
    ----------
    L. Giraud, J. Langou, M. Rozloznik and J. van den Eshof, Rounding error analysis of the
    classical Gram-Schmidt orthogonalization process, Numer. Math. 101 (2005).
    """

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
        """Make room for `size` vectors; the first `rows` stay."""
        V = self.V
        self._allocate(size, V.shape[1], V.dtype)
        self.V[:rows] = V[:rows]

    def start(self, place: int, vector: Any = None) -> None:
        """Make row `place` a unit vector orthogonal to those before it; random by default."""
        xp, V = self.xp, self.V
        if vector is None and self._steps is not None and V.shape[1] >= 4 * len(V):
            # So much of a random vector is orthogonal to so few that nothing need be looked at.
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
            if size > 1e-8 * before:
                V[place] = w / size
                return
            vector = None
        raise np.linalg.LinAlgError("the basis spans the whole space")

    @functools.cached_property
    def _rng(self) -> np.random.Generator:
        return np.random.default_rng((SALT, self._seed))

    def _products(self, w: Any, count: int) -> Any:
        """V^* w of the first rows; conjugating w spares a conjugated copy of V."""
        V = self.V[:count]
        return V @ w if V.dtype.kind == "f" else (V @ w.conj()).conj()

    def sweep(
        self, first: int, last: int, meanwhile: Callable[[], Any] | None = None
    ) -> ArnoldiSteps:
        """Arnoldi steps from row `first` up to row `last`.

        Parameters
        ----------
        first, last : int
        meanwhile : callable, optional
            Called once the steps are under way, before their coefficients are waited for.
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
        # Only sweeps in one launch multiply what is beside the vectors of the basis.
        return ArnoldiSteps.of(rows if self._matrix is not None else rows[:, :1])

    def _step(self, w: Any, j: int) -> None:
        """Orthogonalise w, which is ``A V[j]``, into row j + 1."""
        xp, V, row = self.xp, self.V, self._coefficients[j, 0]
        h = self._products(w, j + 1)
        w -= h @ V[: j + 1]
        # Always: what one pass leaves grows from step to step even where each takes away little.
        again = self._products(w, j + 1)
        w -= again @ V[: j + 1]
        beta = xp.sqrt(xp.vdot(w, w).real)
        row[: j + 1] = h + again
        row[-1] = beta
        V[j + 1] = w / xp.maximum(beta, TINY)

    def rotate(self, Q: np.ndarray, residual: int, first: int = 0) -> None:
        """Replace the rows from `first` on by the columns of Q, the next by the `residual`-th."""
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
        """Columns ``V^T Y`` of the space, shape (n, k), for Y of shape (count, k)."""
        return (self.xp.asarray(np.ascontiguousarray(Y.T)) @ self.V[: len(Y)]).T
