"""Dofs as a user may give them: numbers, a mask, or the result of ``get_dofs``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skfem_adini.errors import InputError

Indices = NDArray[np.intp]


def dof_numbers(name: str, value: Any, size: int) -> Indices:
    """Return the numbers of dofs, from numbers, a mask (size,), or what ``basis.get_dofs``
    gives."""
    dofs = np.asarray(value.flatten() if hasattr(value, "flatten") else value)
    if dofs.dtype == bool:
        if dofs.shape != (size,):
            raise InputError(f"{name}: a mask of dofs has the shape ({size},), got {dofs.shape}")
        return np.flatnonzero(dofs)
    if dofs.size == 0:
        return np.empty(0, dtype=np.intp)
    if dofs.dtype.kind not in "iu":
        raise InputError(f"{name}: expected numbers of dofs, got {value!r}")
    if not 0 <= dofs.min() <= dofs.max() < size:
        bad = dofs[(dofs < 0) | (dofs >= size)].ravel()[0]
        raise InputError(f"{name}: expected dofs from 0 to {size - 1}, got {bad}")
    return np.asarray(dofs.ravel(), dtype=np.intp)
