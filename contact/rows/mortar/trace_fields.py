"""Displacements of a body at places on its facets, from the trace of its scalar element."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]
Csr = sparse.csr_array


def values(trace: Csr, u: Array, dim: int) -> Array:
    """Displacement at the rows of a scalar trace, shape (dim, n)."""
    return np.array([trace @ u[c::dim] for c in range(dim)])


def along(trace: Csr, v: Array) -> Csr:
    """Displacement along vectors v (dim, n) at the rows of a scalar trace, shape (n, ndofs)."""
    dim = len(v)
    parts = [scaled(v[c], trace).tocoo() for c in range(dim)]
    data = np.concatenate([part.data for part in parts])
    row = np.concatenate([part.row for part in parts])
    column = np.concatenate([dim * part.col + c for c, part in enumerate(parts)])
    shape = trace.shape[0], dim * trace.shape[1]
    return Csr(sparse.coo_array((data, (row, column)), shape=shape))


def scaled(v: Array, rows: Csr) -> Csr:
    """Rows times the numbers v."""
    return Csr(sparse.diags_array(v) @ rows)
