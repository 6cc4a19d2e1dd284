"""Copies of values that belong to other processes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.int64]


class Halo:
    """Which values each process copies from which other one.

    Parameters
    ----------
    comm : Communicator
    numbers : ndarray, shape (n,)
        Number of every local dof in the whole space.
    first : int
        Number of the first owned dof; those of a process are consecutive.
    owned : ndarray
        Local dofs that belong to this process, by number.
    """

    def __init__(self, comm: Any, numbers: Indices, first: int, owned: Indices) -> None:
        self._comm = comm
        firsts = np.array(comm.allgather(first))
        copied = np.ones(numbers.size, dtype=bool)
        copied[owned] = False
        others = np.flatnonzero(copied)
        # Processes without dofs share their first number with the next one, the owner.
        owner = np.searchsorted(firsts, numbers[others], side="right") - 1
        self._received = [others[owner == rank] for rank in range(comm.size)]
        asked = comm.alltoall([numbers[place] for place in self._received])
        self._sent = [owned[number - first] for number in asked]

    def update(self, x: NDArray[Any]) -> NDArray[Any]:
        """A new vector, or matrix of columns, with the values of their owners."""
        fresh = x.copy()
        if self._comm.size == 1:
            return fresh
        parts = self._comm.alltoall([x[place] if place.size else None for place in self._sent])
        for place, values in zip(self._received, parts, strict=True):
            if place.size:
                fresh[place] = values
        return fresh
