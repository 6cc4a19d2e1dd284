"""The half of a symmetric matrix that direct solvers take."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse


def upper_triangle(A: Any) -> Any:
    """Return the upper triangle, columns ascending, with every diagonal entry stored."""
    n = A.shape[0]
    upper = sparse.csr_array(sparse.triu(A, format="csr"))
    if np.count_nonzero(upper.diagonal()) < n:
        # Sums of sparse matrices drop zeros; conversion from triplets keeps them.
        entries, k = upper.tocoo(), np.arange(n)
        row, column = (np.concatenate([part, k]) for part in entries.coords)
        data = np.concatenate([entries.data, np.zeros(n)])
        upper = sparse.csr_array(sparse.coo_array((data, (row, column)), shape=A.shape))
    upper.sort_indices()
    return upper
