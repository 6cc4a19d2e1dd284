"""The Schur complement of chosen unknowns by cuDSS, which leaves them out of its factors."""

from __future__ import annotations

import ctypes
from contextlib import ExitStack
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skfem_adini.solvers.cudss import CudssMatrix, pointer

Array = NDArray[np.float64]

# cuDSS's numbers (cudss_data_types.h of version 1.0).
_FLOAT64, _COLUMN_MAJOR = 1, 0
_SCHUR_MODE = 23
_MARKS, _SHAPE, _COMPLEMENT = 18, 19, 20
FORWARD, BACKWARD = 0b11_0000, 0b1_1000_0000


class CudssSchur(CudssMatrix):
    """Factors of the unknowns that are not chosen, and the Schur complement of those that are.

    It is in cuDSS's order of sums, which may vary from call to call: in the deterministic mode of
    version 1.0 the complement lacks terms, without an error.

    Parameters
    ----------
    A
        Symmetric sparse matrix, shape (n, n); its block without the chosen unknowns must be
        positive definite.
    chosen
        Ascending indices of the unknowns to keep, shape (k,), fewer than n.

    Attributes
    ----------
    complement
        Dense Schur complement on the device, shape (k, k).

    Raises
    ------
    MissingDependency, CudssError
        As for `CudssMatrix`.

    References
    ----------
    NVIDIA cuDSS 1.0 documentation, Schur complement mode.
    """

    def __init__(self, A: Any, chosen: ArrayLike) -> None:
        self._marks = np.zeros(A.shape[0], dtype=np.int32)
        self._marks[np.asarray(chosen)] = 1
        super().__init__(A, definite=True, deterministic=False)
        self._given = A, chosen
        self.complement = self._complement()

    def forward(self, load: Array) -> Array:
        """Eliminate a load (n,): in an order of cuDSS, the carried chosen part in the last k."""
        return self._run(FORWARD, load[:, None], 1)[:, 0]

    def backward(self, halfway: Array) -> Array:
        """Solve for all unknowns (n,) after `forward`, values of the chosen ones in the last k."""
        return self._run(BACKWARD, halfway[:, None], 1)[:, 0]

    def _open(self, opened: ExitStack, definite: bool) -> None:
        super()._open(opened, definite)
        self._set(_SCHUR_MODE, 1)
        marks, size = ctypes.c_void_p(self._marks.ctypes.data), ctypes.c_size_t(self._marks.nbytes)
        self._call("cudssDataSet", self._handle, self._data, _MARKS, marks, size)

    def _complement(self) -> Any:
        count = int(self._marks.sum())
        shape, written = (ctypes.c_int64 * 3)(), ctypes.c_size_t()
        room = ctypes.c_size_t(ctypes.sizeof(shape)), ctypes.byref(written)
        self._call("cudssDataGet", self._handle, self._data, _SHAPE, ctypes.byref(shape), *room)
        if tuple(shape)[:2] != (count, count):
            raise AssertionError(f"cuDSS: a Schur complement of {tuple(shape)[:2]}, not {count}")
        S = self._xp.zeros((count, count))
        layout = (*(ctypes.c_int64(count),) * 3, pointer(S), _FLOAT64, _COLUMN_MAJOR)
        with ExitStack() as opened:
            out = self._create(opened, "cudssMatrixCreateDn", "cudssMatrixDestroy", *layout)
            room = ctypes.c_size_t(ctypes.sizeof(out)), ctypes.byref(written)
            self._call(
                "cudssDataGet", self._handle, self._data, _COMPLEMENT, ctypes.byref(out), *room
            )
        return S
