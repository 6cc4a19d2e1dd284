"""Products with a symmetric matrix whose upper triangle lies on a device."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from scipy import sparse

# Of one row, in the order of its entries: equal calls give equal bits.
_ROW = """
double sum = 0.0;
for (int k = first; k < last; ++k) sum += upper[k] * x[columns[k]];
for (int k = begin; k < end; ++k) sum += lower[k] * x[rows[k]];
y = sum;
"""


class DeviceProduct:
    """The symmetric matrix of an upper triangle, as an operator on rows of an array.

    The entries below the diagonal are kept by rows too, so that each entry of a product is summed
    by one thread.

    Parameters
    ----------
    xp
        NumPy or CuPy.
    starts, columns, values
        The upper triangle by rows, arrays of xp, shapes (n + 1,) and (nnz,).
    """

    def __init__(self, xp: Any, starts: Any, columns: Any, values: Any) -> None:
        n = len(starts) - 1
        places = xp.arange(columns.size, dtype=np.int32)
        rows = xp.searchsorted(starts[1:], places, side="right").astype(np.int32)
        below = xp.flatnonzero(columns > rows)
        below = below[xp.argsort(columns[below], kind="stable" if xp is np else None)]
        counts = xp.bincount(columns[below], minlength=n) if below.size else xp.zeros(n, np.int64)
        ends = xp.concatenate([xp.zeros(1, dtype=np.int64), xp.cumsum(counts)]).astype(np.int32)
        self._xp, self._upper = xp, (starts, columns, values)
        self._lower = ends, rows[below], values[below]

    def __matmul__(self, x: Any) -> Any:
        """Return ``A x`` for each row of an array, shape (count, n)."""
        if self._xp is np:
            n = x.shape[1]
            U, L = (
                sparse.csr_array((values, at, starts), shape=(n, n))
                for starts, at, values in (self._upper, self._lower)
            )
            return (U @ x.T + L @ x.T).T
        (starts, columns, upper), (ends, rows, lower) = self._upper, self._lower
        bounds = starts[:-1], starts[1:], ends[:-1], ends[1:]
        product = self._xp.empty_like(x)
        for one, found in zip(x, product, strict=True):
            _kernel()(*bounds, columns, upper, rows, lower, one, found)
        return product


@cache
def _kernel() -> Any:
    import cupy

    return cupy.ElementwiseKernel(
        "int32 first, int32 last, int32 begin, int32 end, raw int32 columns, raw float64 upper, "
        "raw int32 rows, raw float64 lower, raw float64 x",
        "float64 y",
        _ROW,
        "skfem_adini_symmetric_row",
    )
