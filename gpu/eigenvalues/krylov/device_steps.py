"""Arnoldi steps on the device: one cooperative launch a step, or a sweep for a dense matrix.

A step is a product, two projections, two updates and a norm. As separate library calls these cost
some twenty launches; for matrices of a few thousand rows the launches take longer than the work.
Here all blocks of one launch, one a multiprocessor, own a range of rows each and meet two or three
times a step. Sums are taken in a fixed order, so that a run repeats bit by bit on one device.
"""

from __future__ import annotations

import functools
import threading
from typing import Any

import numpy as np

from gpu.cuda.arnoldi import SOURCE
from gpu.errors import InputError

THREADS = 1024
ROWS = 8  # that a block owns at least: with smaller shares blocks wait longer than they work
CACHE_LINE = 16  # numbers that memory moves together: 128 bytes
SHARED = 48 * 1024  # bytes a block may have on every device without asking
SUMS = 2048  # numbers that `gpu.cuda.gram_schmidt` keeps in shared memory for its sums
OWN = SUMS // 2 - THREADS // 32  # rows of a block whose sums fit there
CACHE_SHARE = 0.5  # part of the common cache for columns of A; vectors pass through the rest
SCARCE = 0.1  # where less than this part of the columns fits, none is kept in shared memory
_launching = threading.Lock()
_granted: dict[tuple[int, str], int] = {}  # bytes of shared memory, by device and kernel


class FusedSteps:
    """Arnoldi steps in place on the rows of V, for real arrays of CuPy.

    Parameters
    ----------
    V : cupy.ndarray of float64, shape (size + 1, n)
        The basis.
    coefficients : cupy.ndarray of float64, shape (size, 2, size + 2)
        Row (j, 0) gets the coefficients of step j, and its beta in the last entry; those of a sweep
        are of ``A (v + V r)``, with r in row (j, 1).

    Attributes
    ----------
    near, stay, ahead : int
        Columns of A that a sweep keeps in shared memory, that stay in the cache of the device, and
        that it fetches there ahead of each step.

    Raises
    ------
    InputError
        The coefficients of a step do not fit into shared memory.
    """

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
        # What a sweep has beside: its share of the basis, the vector, and columns of A.
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
        """Row `place`: a random unit vector orthogonal to those before it.

        The coefficients of row `place` - 1 are overwritten.
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
        """Whether `sweep` can read this matrix: real, dense, rows together, not too wide."""
        dense = hasattr(A, "flags") and A.dtype == np.float64 and A.flags.c_contiguous
        return bool(dense and self._sweeps)

    def sweep(self, A: Any, first: int, last: int) -> None:
        """All steps from row `first` up to row `last` with a dense matrix, in one launch.

        Parameters
        ----------
        A : cupy.ndarray of float64, shape (n, n)
            One that `multiplies` accepts.
        first, last : int
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
        # What a kernel may have belongs to it, and so to all threads: a launch between the wish of
        # another thread and its own is refused, as too large or as an invalid argument.
        with _launching:
            kernel, place = _kernel(name), (self._device, name)
            if shared > _granted.get(place, SHARED):
                kernel.max_dynamic_shared_size_bytes = _granted[place] = shared
            kernel((self._blocks,), (THREADS,), arguments(goal), shared_mem=shared)
        self._arrived += meetings * self._blocks


@functools.cache
def _limits(device: int) -> tuple[int, int, int]:
    """Multiprocessors, bytes of shared memory that a block may ask for, bytes of the cache."""
    import cupy

    attributes = cupy.cuda.Device(device).attributes
    names = "MultiProcessorCount", "MaxSharedMemoryPerBlockOptin", "L2CacheSize"
    processors, shared, cache = (int(attributes[name]) for name in names)
    return processors, shared, cache


@functools.cache
def _kernel(name: str) -> Any:
    """The compiled kernel; CuPy compiles it anew for each device.

    A cooperative launch is refused unless all blocks run at once, without which they could not
    meet.
    """
    import cupy

    return cupy.RawKernel(SOURCE, name, options=("--std=c++17",), enable_cooperative_groups=True)
