"""The upper triangle of a sparse matrix, taken where the device's arrays lie."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from skfem_adini.errors import AdiniError, InputError
from skfem_adini.solvers.upper_triangle import upper_triangle


@dataclass(frozen=True)
class Restricted:
    """The matrix ``D A[free][:, free] D``, formed on the device alone.

    Attributes
    ----------
    matrix
        Sparse matrix A by rows.
    free
        Ascending numbers of the rows and columns that remain, shape (n,).
    scale
        Diagonal of D, shape (n,).
    placed
        Row starts, columns and values of A, where they lie on the device already.
    """

    matrix: Any
    free: NDArray[np.integer]
    scale: NDArray[np.float64]
    placed: tuple[Any, Any, Any] | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns that remain."""
        return self.free.size, self.free.size

    def on_host(self) -> Any:
        """The same matrix of SciPy."""
        D = sparse.diags_array(self.scale)
        return sparse.csr_array(D @ self.matrix[self.free][:, self.free] @ D)


class DeviceTriangle:
    """Which entries of a matrix form its upper triangle, columns ascending, all of the diagonal.

    Parameters
    ----------
    xp
        NumPy or CuPy.
    A
        Sparse matrix, or `Restricted`, shape (n, n).

    Raises
    ------
    AdiniError
        More entries than 32 bits count.
    """

    def __init__(self, xp: Any, A: Any) -> None:
        self._xp, (whole, self._free, _) = xp, _parts(A)
        self._indptr, self._indices = whole.indptr, whole.indices  # to know the pattern again
        self._taken: Any = None
        if not whole.has_canonical_format:
            return
        n = A.shape[0]
        starts, columns = (_placed(xp, A, part) for part in ("indptr", "indices"))
        rows = xp.searchsorted(starts[1:], xp.arange(whole.nnz, dtype=starts.dtype), side="right")
        if self._free is not None:
            number = xp.full(whole.shape[0], -1, dtype=np.int32)
            number[xp.asarray(self._free)] = xp.arange(n, dtype=np.int32)
            rows, columns = number[rows], number[columns]
        taken = (columns >= rows) & (rows >= 0)
        before = xp.zeros(whole.nnz + 1, dtype=np.int64)
        xp.cumsum(taken, dtype=np.int64, out=before[1:])
        firsts = starts[:-1] if self._free is None else starts[xp.asarray(self._free)]
        if int(((columns == rows) & taken).sum()) == n:
            _countable(int(before[-1]))
            self._taken, self._columns = taken, columns[taken].astype(np.int32, copy=False)
            self._starts = xp.concatenate([before[firsts], before[-1:]]).astype(np.int32)

    def arrays(self, A: Any) -> tuple[Any, Any, Any]:
        """Return row starts and columns (int32) and values of the matrix, on the device."""
        if self._taken is not None:
            return self._starts, self._columns, self.values(A)
        upper, put = upper_triangle(_on_host(A)), self._xp.asarray
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
        whole, free, scale = _parts(A)
        before, now = (self._indptr, self._indices), (whole.indptr, whole.indices)
        same = all(a is b or np.array_equal(a, b) for a, b in zip(before, now, strict=True))
        if not (same and np.array_equal(free, self._free)):
            raise InputError(
                f"A: its {whole.nnz} entries are not in the places of the {self._indices.size} "
                "entries that were analysed; call factorize for another pattern"
            )
        xp = self._xp
        if self._taken is None:
            return xp.asarray(upper_triangle(_on_host(A)).data.astype(np.float64))
        values = _placed(xp, A, "data")[self._taken].astype(np.float64, copy=False)
        if scale is not None:
            places = xp.arange(values.size, dtype=np.int32)
            rows = xp.searchsorted(self._starts[1:], places, side="right")
            scale = xp.asarray(scale)
            values *= scale[rows]
            values *= scale[self._columns]
        return values


def _parts(A: Any) -> tuple[Any, Any, Any]:
    """Return the whole matrix by rows, what remains of it, and the scale; None for all and 1."""
    whole = A.matrix if isinstance(A, Restricted) else A
    if not isinstance(whole, sparse.csr_array):  # a copy would not know that it is canonical
        whole = sparse.csr_array(whole)
    return (whole, A.free, A.scale) if isinstance(A, Restricted) else (whole, None, None)


def _placed(xp: Any, A: Any, part: str) -> Any:
    """Return row starts, columns or values of the whole matrix on the device."""
    if isinstance(A, Restricted) and A.placed is not None:
        return A.placed[("indptr", "indices", "data").index(part)]
    return xp.asarray(getattr(_parts(A)[0], part))


def on_host_alone(A: Any) -> Any:
    """Return the matrix without its arrays on the device."""
    return replace(A, placed=None) if isinstance(A, Restricted) else A


def _on_host(A: Any) -> Any:
    return A.on_host() if isinstance(A, Restricted) else A


def _countable(entries: int) -> None:
    if entries >= 2**31:
        raise AdiniError(f"cuDSS: {entries} entries are too many for 32-bit indices")
