"""Arnoldi steps on the device: one cooperative launch a step, or a sweep for a dense matrix.

A step is a product, two projections, two updates and a norm. As separate library calls these cost
some twenty launches; for matrices of a few thousand rows the launches take longer than the work.
Here all blocks of one launch, one a multiprocessor, own a range of rows each and meet twice or
three times a step. Sums are taken in a fixed order, so that a run repeats bit by bit on one device.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from gpu.arnoldi_source import SOURCE
from gpu.errors import InputError

THREADS = 1024
ROWS = 16  # a block owns at least; more blocks than that wait for each other longer
SHARED = 48 * 1024  # bytes a block may have on every device without asking


class FusedSteps:
    """Arnoldi steps in place on the rows of V, for real arrays of CuPy.

    Parameters
    ----------
    V : cupy.ndarray of float64, shape (size + 1, n)
        The basis.
    coefficients : cupy.ndarray of float64, shape (size, size + 2)
        Row j gets the coefficients of step j, and its beta in the last entry.

    Raises
    ------
    InputError
        The coefficients of a step do not fit into shared memory.
    """

    def __init__(self, V: Any, coefficients: Any) -> None:
        import cupy

        self._V, self._rows = V, coefficients
        self.size, self.n = len(coefficients), V.shape[1]
        processors, most_shared = _limits(cupy.cuda.Device().id)
        self._blocks = min(processors, -(-self.n // ROWS))
        self._shared = 8 * (2048 + 2 * (self.size + 1))
        if self._shared > most_shared:
            raise InputError(f"ncv={self.size} is too large for the shared memory of this device")
        self._u = cupy.empty((2, (self.n + 1) // 2 * 2))
        self._parts = cupy.empty((3, self.size + 1, self._blocks))
        self._gate = cupy.zeros(1, dtype=cupy.uint32)
        self._arrived = 0

    def __call__(self, w: Any, j: int) -> None:
        """Orthogonalise w, which is ``A V[j]``, into row j + 1."""
        import cupy

        self._launch(
            "arnoldi_step",
            1,
            lambda goal: (
                self._V,
                self._rows,
                cupy.ascontiguousarray(w, dtype=float),
                self._u,
                self._parts,
                self._gate,
                goal,
                np.int64(self.n),
                np.int32(self.size),
                np.int32(j),
            ),
        )

    def random_start(self, place: int, seed: int) -> None:
        """Row `place`: a random unit vector orthogonal to those before it.

        The coefficients of row `place` - 1 are overwritten.
        """
        import cupy

        w = cupy.empty(self.n)
        _kernel("normal", False)(
            (min(-(-self.n // 256), 4096),), (256,), (w, np.int64(self.n), np.uint64(seed))
        )
        self(w, place - 1)

    @staticmethod
    def multiplies(A: Any) -> bool:
        """Whether `sweep` can read this matrix: real, dense, rows together, entries in pairs."""
        dense = hasattr(A, "flags") and A.dtype == np.float64 and A.flags.c_contiguous
        return bool(dense and A.data.ptr % 16 == 0)

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
            last - first,
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
            ),
        )

    def _launch(self, name: str, steps: int, arguments: Any) -> None:
        kernel = _kernel(name)
        if self._shared > SHARED:
            kernel.max_dynamic_shared_size_bytes = self._shared
        goal = np.uint32(self._arrived % 2**32)
        kernel((self._blocks,), (THREADS,), arguments(goal), shared_mem=self._shared)
        self._arrived += 3 * steps * self._blocks


@functools.cache
def _limits(device: int) -> tuple[int, int]:
    """Multiprocessors, and bytes of shared memory that a block may ask for."""
    import cupy

    attributes = cupy.cuda.Device(device).attributes
    return int(attributes["MultiProcessorCount"]), int(attributes["MaxSharedMemoryPerBlockOptin"])


@functools.cache
def _kernel(name: str, meeting: bool = True) -> Any:
    """The compiled kernel; CuPy compiles it anew for each device.

    A cooperative launch is refused unless all blocks run at once, without which they could not
    meet.
    """
    import cupy

    return cupy.RawKernel(SOURCE, name, options=("--std=c++17",), enable_cooperative_groups=meeting)
