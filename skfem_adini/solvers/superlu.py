"""SciPy's SuperLU for symmetric matrices, in a form that can be copied and sent to a process."""

from __future__ import annotations

from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]
Ordering = Literal["NATURAL", "MMD_AT_PLUS_A"]


class SuperLUFactor:
    """Factors of a symmetric matrix A (n, n), without row exchanges where the pivots allow it.
    Threads may share it, and a copy is the object itself; a pickle factors the matrix again.
    With a `threshold` of 0 every pivot on the diagonal that is not zero is kept."""

    def __init__(self, A: Any, ordering: Ordering, threshold: float) -> None:
        A = sparse.csc_matrix(A)
        self._given = A, ordering, threshold
        self.factors = splu(
            A,
            permc_spec=ordering,
            diag_pivot_thresh=threshold,
            options={"SymmetricMode": True},
        )

    def solve(self, b: Array) -> Array:
        """Return the solution for one load (n,) or several (n, loads)."""
        return np.asarray(self.factors.solve(b))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), self._given

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self
