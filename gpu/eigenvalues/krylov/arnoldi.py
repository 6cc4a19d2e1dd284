"""Orthonormal Krylov basis that grows by Arnoldi steps, with NumPy or CuPy."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg.blas import dtrsm

from gpu.cuda.catalogue import kernel, limits
from gpu.errors import InputError
from skfem_adini.ground.arrays import to_host


class _Device(NamedTuple):  # sizes of the launches of `FusedSteps`
    threads: int = 1024
    rows: int = 8  # least rows of a block: with fewer, blocks wait longer than they compute
    line: int = 16  # numbers in a cache line of 128 bytes
    shared: int = 48 * 1024  # bytes of shared memory of a block without a special request
    sums: int = 2048  # numbers that `gpu.cuda.gram_schmidt` keeps in shared memory for its sums
    own: int = sums // 2 - threads // 32  # most rows of a block for which the sums fit there
    cached: float = 0.5  # part of the second-level cache for columns of A; the rest is for vectors
    scarce: float = 0.1  # least part of the columns that is worth keeping in shared memory


DEVICE = _Device()


class _Limits(NamedTuple):  # limits of Arnoldi steps on the host and on a device
    one_launch: int = 10_000  # up to this order a sweep is faster than library products
    tiny: float = float(np.finfo(float).tiny)  # avoids division by zero where a norm is zero
    salt: int = 0x6A09E667F3BCC908  # mixed into seeds: no caller's generator gives the same numbers
    slight: float = 1e-9  # entries of R below which I - R inverts I + R without library threads
    breakdown: float = 20 * float(np.finfo(float).eps)  # over |A v|: a smaller beta is rounding


LIMITS = _Limits()


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
            from gpu.eigenvalues.krylov.arnoldi import FusedSteps

            self._steps = FusedSteps(self.V, self._coefficients)
            if matrix is not None and n <= LIMITS.one_launch and self._steps.multiplies(matrix):
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
        return np.random.default_rng((LIMITS.salt, self._seed))

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
        V[j + 1] = w / xp.maximum(beta, LIMITS.tiny)

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
        small = (self.betas <= LIMITS.breakdown * self.norms).nonzero()[0]
        return int(small[0]) if small.size else None

    def project(self, S: np.ndarray, first: int, last: int, locked: int = 0) -> None:
        """Write columns `first` to `last` of the projected matrix S, shape (m, m), in place. Its
        earlier columns, and the entry left of the diagonal in row `first`, are known; S excludes
        the first `locked` basis vectors."""
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
            if np.abs(R).max() < LIMITS.slight:
                block -= block @ R
            else:
                block = dtrsm(1.0, R, block, side=1, diag=1, overwrite_b=1)
        S[:last, first:last] = block
        S[last:, first:last] = 0.0


_launching = threading.Lock()
_granted: dict[tuple[int, str], int] = {}  # bytes of shared memory, by device and kernel


class FusedSteps:
    """Arnoldi steps in place on the rows of V, shape (size + 1, n), for real arrays of CuPy. Row
    (j, 0) of `coefficients`, shape (size, 2, size + 2), gets those of step j, beta last; in a sweep
    they are those of ``A (v + V r)`` with r in row (j, 1). They must fit into shared memory. One
    launch takes the place of some twenty library calls, see `gpu.cuda.gram_schmidt`."""

    def __init__(self, V: Any, coefficients: Any) -> None:
        import cupy

        self._V, self._rows = V, coefficients
        self.size, self.n = len(coefficients), V.shape[1]
        self._device = cupy.cuda.Device().id
        processors, most_shared, cache = limits(
            self._device, "MultiProcessorCount", "MaxSharedMemoryPerBlockOptin", "L2CacheSize"
        )
        self._blocks = min(processors, -(-self.n // DEVICE.rows))
        numbers = DEVICE.sums + 2 * self.size + 4
        self._shared = 8 * numbers
        if self._shared > most_shared:
            raise InputError(f"ncv={self.size} is too large for the shared memory of this device")
        # A sweep also needs memory for the block's rows of the basis, the vector and columns of A.
        own = -(-self.n // self._blocks)
        numbers += (self.size + 1) * (own | 1) + own + self.n
        room = most_shared // 8 - numbers
        self._sweeps = room >= 0 and own <= DEVICE.own
        self.near = max(0, min(self.n, room // own // DEVICE.line * DEVICE.line))
        cached = int(DEVICE.cached * cache) // (8 * self.n) // DEVICE.line * DEVICE.line
        if self.near < DEVICE.scarce * self.n:
            self.near, self.stay, self.ahead = 0, 0, min(self.n, cached)
        else:
            self.stay, self.ahead = min(self.n - self.near, cached), 0
        self._shared_by_sweep = 8 * (numbers + self.near * own)
        self._u = cupy.empty(self.n)
        self._parts = cupy.empty(3 * self._blocks * (self.size + 2))
        self._gate = cupy.zeros(1, dtype=cupy.uint32)
        self._arrived = 0

    def __call__(self, w: Any, j: int) -> None:
        """Orthogonalise w, which is ``A V[j]``, into row j + 1."""
        import cupy

        self._step(cupy.ascontiguousarray(w, dtype=float), 0, j)

    def random_start(self, place: int, seed: int) -> None:
        """Make row `place` a random unit vector orthogonal to the rows before it. The coefficients
        of row `place` - 1 are overwritten.
        """
        self._step(np.uint64(0), seed, place - 1)

    def _step(self, w: Any, seed: int, j: int) -> None:
        self._launch(
            "arnoldi_step",
            3,
            self._shared,
            lambda goal: (
                self._V,
                self._rows,
                w,
                np.uint64(seed),
                self._u,
                self._parts,
                self._gate,
                goal,
                np.int64(self.n),
                np.int32(self.size),
                np.int32(j),
            ),
        )

    def multiplies(self, A: Any) -> bool:
        """Whether `sweep` can use this matrix: real, dense, row-major, not too large."""
        dense = hasattr(A, "flags") and A.dtype == np.float64 and A.flags.c_contiguous
        return bool(dense and self._sweeps)

    def sweep(self, A: Any, first: int, last: int) -> None:
        """All steps from row `first` to row `last` with a dense A, shape (n, n), in one launch.
        `multiplies` says whether A qualifies.
        """
        if first >= last:
            return
        self._launch(
            "arnoldi_sweep",
            3 * (last - first) + 1,
            self._shared_by_sweep,
            lambda goal: (
                A,
                self._V,
                self._rows,
                self._u,
                self._parts,
                self._gate,
                goal,
                np.int64(self.n),
                np.int32(self.size),
                np.int32(first),
                np.int32(last),
                np.int32(self.near),
                np.int32(self.stay),
                np.int32(self.ahead),
            ),
        )

    def _launch(self, name: str, meetings: int, shared: int, arguments: Any) -> None:
        goal = np.uint32(self._arrived % 2**32)
        # The limit of shared memory is an attribute of the kernel, which all threads share. Without
        # a lock, a launch between another thread's setting and its launch would be refused.
        with _launching:
            # Refused unless all blocks can run at once, as they must to synchronise.
            step = kernel("arnoldi", name, enable_cooperative_groups=True)
            place = self._device, name
            if shared > _granted.get(place, DEVICE.shared):
                step.max_dynamic_shared_size_bytes = _granted[place] = shared
            step((self._blocks,), (DEVICE.threads,), arguments(goal), shared_mem=shared)
        self._arrived += meetings * self._blocks
