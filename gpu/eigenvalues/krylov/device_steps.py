"""Arnoldi steps on the device: one cooperative launch a step, or a sweep for a dense matrix.

A step is a product, two projections, two updates and a norm. As separate library calls these cost
some twenty launches; for matrices of a few thousand rows the launches take longer than the work.
Here all blocks of one launch, one for each multiprocessor, own a range of rows each and synchronise
two or three times a step. Sums are taken in a fixed order, so repeated runs on one device agree bit
by bit.
"""

from __future__ import annotations

import functools
import threading
from typing import Any

import numpy as np

from gpu.cuda.arnoldi import SOURCE
from gpu.errors import InputError

THREADS = 1024
ROWS = 8  # least number of rows of a block: with fewer, blocks wait longer than they compute
CACHE_LINE = 16  # numbers in a cache line of 128 bytes
SHARED = 48 * 1024  # bytes of shared memory that a block may use without a special request
SUMS = 2048  # numbers that `gpu.cuda.gram_schmidt` keeps in shared memory for its sums
OWN = SUMS // 2 - THREADS // 32  # most rows of a block whose sums fit there
CACHE_SHARE = 0.5  # fraction of the second-level cache for columns of A; the rest is for vectors
SCARCE = 0.1  # if less than this fraction of the columns fits, none is kept in shared memory
_launching = threading.Lock()
_granted: dict[tuple[int, str], int] = {}  # bytes of shared memory, by device and kernel


class FusedSteps:
    """Arnoldi steps in place on the rows of V, shape (size + 1, n), for real arrays of CuPy. Row
    (j, 0) of `coefficients`, shape (size, 2, size + 2), gets those of step j, beta last; in a sweep
    they are those of ``A (v + V r)`` with r in row (j, 1). They must fit into shared memory."""

    def __init__(self, V: Any, coefficients: Any) -> None:
        import cupy

        self._V, self._rows = V, coefficients
        self.size, self.n = len(coefficients), V.shape[1]
        self._device = cupy.cuda.Device().id
        processors, most_shared, cache = _limits(self._device)
        self._blocks = min(processors, -(-self.n // ROWS))
        numbers = SUMS + 2 * self.size + 4
        self._shared = 8 * numbers
        if self._shared > most_shared:
            raise InputError(f"ncv={self.size} is too large for the shared memory of this device")
        # A sweep also needs memory for the block's rows of the basis, the vector and columns of A.
        own = -(-self.n // self._blocks)
        numbers += (self.size + 1) * (own | 1) + own + self.n
        room = most_shared // 8 - numbers
        self._sweeps = room >= 0 and own <= OWN
        self.near = max(0, min(self.n, room // own // CACHE_LINE * CACHE_LINE))
        cached = int(CACHE_SHARE * cache) // (8 * self.n) // CACHE_LINE * CACHE_LINE
        if self.near < SCARCE * self.n:
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
            kernel, place = _kernel(name), (self._device, name)
            if shared > _granted.get(place, SHARED):
                kernel.max_dynamic_shared_size_bytes = _granted[place] = shared
            kernel((self._blocks,), (THREADS,), arguments(goal), shared_mem=shared)
        self._arrived += meetings * self._blocks


@functools.cache
def _limits(device: int) -> tuple[int, int, int]:
    """Multiprocessors, most bytes of shared memory for a block, bytes of the second-level cache."""
    import cupy

    attributes = cupy.cuda.Device(device).attributes
    names = "MultiProcessorCount", "MaxSharedMemoryPerBlockOptin", "L2CacheSize"
    processors, shared, cache = (int(attributes[name]) for name in names)
    return processors, shared, cache


@functools.cache
def _kernel(name: str) -> Any:
    """The compiled kernel; CuPy compiles it anew for each device. A cooperative launch is refused
    unless all blocks can run at once, as they must to synchronise.
    """
    import cupy

    return cupy.RawKernel(SOURCE, name, options=("--std=c++17",), enable_cooperative_groups=True)
