"""The upper triangle of a sparse matrix, taken where the device's arrays lie."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from skfem_adini.errors import AdiniError, InputError
from skfem_adini.solvers.upper_triangle import upper_triangle


class DeviceTriangle:
    """Which entries of a matrix form its upper triangle, columns ascending, all of the diagonal.

    Parameters
    ----------
    xp
        NumPy or CuPy.
    A
        Sparse matrix, shape (n, n).

    Raises
    ------
    AdiniError
        More entries than 32 bits count.
    """

    def __init__(self, xp: Any, A: Any) -> None:
        self._xp = xp
        A = sparse.csr_array(A)
        self._indptr, self._indices = A.indptr, A.indices  # of the host, to know them again
        n = A.shape[0]
        self._taken: Any = None
        if A.has_canonical_format:
            starts, columns = xp.asarray(A.indptr), xp.asarray(A.indices)
            rows = xp.searchsorted(starts[1:], xp.arange(A.nnz, dtype=starts.dtype), side="right")
            taken = columns >= rows
            before = xp.zeros(A.nnz + 1, dtype=np.int64)
            xp.cumsum(taken, dtype=np.int64, out=before[1:])
            first = before[starts]
            if int((columns == rows).sum()) == n:
                _countable(int(first[-1]))
                self._taken = taken
                self._starts, self._columns = first.astype(np.int32), columns[taken]

    def arrays(self, A: Any) -> tuple[Any, Any, Any]:
        """Return row starts and columns (int32) and values of the matrix, on the device."""
        if self._taken is not None:
            columns = self._columns.astype(np.int32, copy=False)
            return self._starts, columns, self.values(A)
        upper, put = upper_triangle(A), self._xp.asarray
        _countable(upper.nnz)
        return (
            put(upper.indptr.astype(np.int32)),
            put(upper.indices.astype(np.int32)),
            put(upper.data.astype(np.float64)),
        )

    def values(self, A: Any) -> Any:
        """Return the values of a matrix with the same pattern.

        Raises
        ------
        InputError
            The pattern is another one.
        """
        A = sparse.csr_array(A)
        same = A.indices is self._indices or np.array_equal(A.indices, self._indices)
        if A.shape[0] != len(self._indptr) - 1 or not (
            same and np.array_equal(A.indptr, self._indptr)
        ):
            raise InputError(
                f"A: its {A.nnz} entries are not in the places of the {len(self._indices)} entries "
                "that were analysed; call factorize for another pattern"
            )
        if self._taken is None:
            return self._xp.asarray(upper_triangle(A).data.astype(np.float64))
        return self._xp.asarray(A.data)[self._taken].astype(np.float64, copy=False)


def _countable(entries: int) -> None:
    if entries >= 2**31:
        raise AdiniError(f"cuDSS: {entries} entries are too many for 32-bit indices")
