"""The Schur complement of chosen unknowns by cuDSS, which leaves them out of its factors."""

from __future__ import annotations

import ctypes
from contextlib import ExitStack
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from skfem_adini.solvers.cudss import CudssMatrix, Order

# cuDSS's numbers (cudss_data_types.h of version 1.0).
_SCHUR_MODE = 23
_MARKS, _SHAPE, _COMPLEMENT = 18, 19, 20
FORWARD, BACKWARD = 0b11_0000, 0b1_1000_0000


class CudssSchur(CudssMatrix):
    """Factors of the unknowns that are not chosen, and the dense Schur complement of the chosen.
    Not deterministic: in that mode cuDSS 1.0 leaves out terms of the complement without an
    error. NVIDIA cuDSS 1.0 documentation, Schur complement mode."""

    def __init__(
        self, A: Any, chosen: ArrayLike, tree: Order = None,
        hybrid_memory: bool | int = False,
    ) -> None:  # fmt: skip
        """Factor A, whose block without the chosen unknowns is positive definite; `chosen` ascends.
        The tree is as the order of `CudssMatrix`, with the chosen unknowns last and ascending."""
        self._marks = np.zeros(A.shape[0], dtype=np.int32)
        self._marks[np.asarray(chosen)] = 1
        self._count = int(self._marks.sum())
        super().__init__(A, True, False, tree, hybrid_memory)
        self._given = self._given[0], chosen, self._given[3], hybrid_memory
        self.complement = self._complement()

    def refactor(self, A: Any) -> None:
        """Factor a matrix with the same pattern, and replace the complement."""
        super().refactor(A)
        self.complement = self._complement()

    def forward(self, load: Any) -> Any:
        """Eliminate a load (n,) on host or device: its last k entries are the chosen unknowns'.
        The result, like that of `backward`, lies on the device, in an order of cuDSS."""
        return self._one(FORWARD, load)

    def backward(self, halfway: Any) -> Any:
        """Solve for all unknowns (n,) after `forward`, values of the chosen ones in the last k."""
        return self._one(BACKWARD, halfway)

    def _one(self, phase: int, load: Any) -> Any:
        """Return what a phase makes of one load (n,)."""
        with self._factors():
            return self._executed(phase, self._cudss.xp.asarray(load)[None], 1)[0]

    def _settings(self) -> dict[int, Any]:
        return {**super()._settings(), _SCHUR_MODE: ctypes.c_int(1)}

    def _prepare(self, order: Any) -> None:
        self._cudss.put(_MARKS, self._marks)
        super()._prepare(order)

    def _more_bytes(self) -> int:
        return 8 * self._count**2

    def _complement(self) -> Any:
        shape = self._cudss.get(_SHAPE, (ctypes.c_int64 * 3)())
        if tuple(shape)[:2] != (self._count, self._count):
            raise AssertionError(
                f"cuDSS: a Schur complement of {tuple(shape)[:2]}, not {self._count}"
            )
        S = self._cudss.xp.zeros((self._count, self._count))
        with ExitStack() as opened:
            self._cudss.get(_COMPLEMENT, self._cudss.dense(opened, S))
        return S
