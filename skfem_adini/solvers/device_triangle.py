"""The upper triangle of a sparse matrix, extracted where its arrays are stored."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from skfem_adini.errors import AdiniError, InputError
from skfem_adini.ground.arrays import host, namespace, on_device
from skfem_adini.ground.pardiso import upper_triangle


@dataclass(frozen=True)
class Restricted:
    """The matrix ``D A[free][:, free] D``, formed on the device alone."""

    matrix: Any  # A by rows; or, if `placed`, a function that returns it
    free: NDArray[np.integer]  # ascending numbers of the rows and columns that remain, shape (n,)
    scale: NDArray[np.float64]  # diagonal of D, shape (n,)
    placed: tuple[Any, Any, Any] | None = None  # starts, columns and values on the device

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns that remain."""
        return self.free.size, self.free.size

    @property
    def whole(self) -> Any:
        """A on the host."""
        return self.matrix() if callable(self.matrix) else self.matrix

    def on_host(self) -> Any:
        """The same matrix of SciPy."""
        D = sparse.diags_array(self.scale)
        return sparse.csr_array(D @ self.whole[self.free][:, self.free] @ D)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the data of a copy, on the host only."""
        return type(self), (self.whole, self.free, self.scale)


class Rows(NamedTuple):
    """A square matrix by rows, columns ascending: its pattern on the host, values on a device."""

    indptr: Any
    indices: Any
    data: Any

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.indptr.size - 1, self.indptr.size - 1

    @property
    def nnz(self) -> int:
        """Number of entries."""
        return int(self.indices.size)

    def on_host(self) -> sparse.csr_array:
        """The same matrix of SciPy."""
        return sparse.csr_array((host(self.data), self.indices, self.indptr), shape=self.shape)

    def __matmul__(self, x: Any) -> Any:
        """Return ``A x`` on the host, computed where the values are."""
        if not on_device(self.data):
            return self.on_host() @ x
        from cupyx.scipy.sparse import csr_matrix  # type: ignore[import-not-found, unused-ignore]

        put = namespace(self.data).asarray
        A = csr_matrix((self.data, put(self.indices), put(self.indptr)), shape=self.shape)
        return host(A @ put(x))


class DeviceTriangle:
    """Entries of a matrix that form its upper triangle, columns ascending, with the whole diagonal.
    Their number must fit into 32 bits."""

    def __init__(self, xp: Any, A: Any) -> None:
        self._xp, (whole, self._free, _) = xp, _parts(A)
        # To recognise the pattern. Arrays on the device belong to the caller.
        host = None if isinstance(whole, _Placed) else (whole.indptr, whole.indices)
        self._pattern = partial(_pattern, host or on_host_alone(A))
        self._taken: Any = None
        if not whole.has_canonical_format:
            return
        n, size = A.shape[0], whole.indptr.size - 1
        starts, columns = xp.asarray(whole.indptr), xp.asarray(whole.indices)
        entries = xp.arange(columns.size, dtype=starts.dtype)
        rows = xp.searchsorted(starts[1:], entries, side="right")
        if self._free is not None:
            number = xp.full(size, -1, dtype=np.int32)
            number[xp.asarray(self._free)] = xp.arange(n, dtype=np.int32)
            rows, columns = number[rows], number[columns]
        taken = (columns >= rows) & (rows >= 0)
        before = xp.zeros(columns.size + 1, dtype=np.int64)
        xp.cumsum(taken, dtype=np.int64, out=before[1:])
        firsts = starts[:-1] if self._free is None else starts[xp.asarray(self._free)]
        if int(((columns == rows) & taken).sum()) == n:
            _countable(int(before[-1]))
            self._taken, self._columns = taken, columns[taken].astype(np.int32, copy=False)
            self._starts = xp.concatenate([before[firsts], before[-1:]]).astype(np.int32)

    def arrays(self, A: Any) -> tuple[Any, Any, Any]:
        """Return row starts and columns (int32) and values of the matrix, on the device."""
        if self._taken is not None:
            return self._starts, self._columns, self._values(A)
        upper, put = upper_triangle(_on_host(A)), self._xp.asarray
        _countable(upper.nnz)
        return (
            put(upper.indptr.astype(np.int32)),
            put(upper.indices.astype(np.int32)),
            put(upper.data.astype(np.float64)),
        )

    def values(self, A: Any) -> Any:
        """Return the upper triangle's values of a matrix with the same pattern."""
        before, now = self._pattern(), _pattern(on_host_alone(A))
        same = all(a is b or np.array_equal(a, b) for a, b in zip(before, now, strict=True))
        if not (same and np.array_equal(_parts(A)[1], self._free)):
            raise InputError(
                f"A: its {now[1].size} entries are not in the places of the {before[1].size} "
                "entries that were analysed; call factorize for another pattern"
            )
        return self._values(A)

    def _values(self, A: Any) -> Any:
        xp, (whole, _, scale) = self._xp, _parts(A)
        if self._taken is None:
            return xp.asarray(upper_triangle(_on_host(A)).data.astype(np.float64))
        values = xp.asarray(whole.data)[self._taken].astype(np.float64, copy=False)
        if scale is not None:
            places = xp.arange(values.size, dtype=np.int32)
            rows = xp.searchsorted(self._starts[1:], places, side="right")
            scale = xp.asarray(scale)
            values *= scale[rows]
            values *= scale[self._columns]
        return values


class DeviceRows:
    """All entries of a matrix by rows, `Rows`, for cuDSS."""

    def __init__(self, xp: Any, A: Rows) -> None:
        self._xp, self._pattern = xp, (A.indptr, A.indices)
        _countable(A.indices.size)

    def arrays(self, A: Rows) -> tuple[Any, Any, Any]:
        """Return row starts and columns (int32) and values of the matrix, on the device."""
        starts, columns = (self._xp.asarray(part.astype(np.int32)) for part in self._pattern)
        return starts, columns, self._xp.array(A.data)

    def values(self, A: Rows) -> Any:
        """Return the values of a matrix with the same pattern."""
        pairs = zip(self._pattern, (A.indptr, A.indices), strict=True)
        if not all(a is b or np.array_equal(a, b) for a, b in pairs):
            raise InputError("A: its entries are not in the places that were analysed")
        return self._xp.array(A.data)


def _pattern(known: Any) -> tuple[Any, Any]:
    """Row starts and columns on the host, of a matrix or as they are."""
    if isinstance(known, tuple):
        return known
    whole = _parts(known)[0]
    return whole.indptr, whole.indices


class _Placed(NamedTuple):
    """A matrix by rows on the device, in canonical form."""

    indptr: Any
    indices: Any
    data: Any
    has_canonical_format: bool = True


def _parts(A: Any) -> tuple[Any, Any, Any]:
    """Return the whole matrix by rows, its free indices, and the scale; None for all and 1."""
    if isinstance(A, Restricted) and A.placed is not None:
        return _Placed(*A.placed), A.free, A.scale
    whole = A.whole if isinstance(A, Restricted) else A
    if not isinstance(whole, sparse.csr_array):  # a copy would not know that it is canonical
        whole = sparse.csr_array(whole)
    return (whole, A.free, A.scale) if isinstance(A, Restricted) else (whole, None, None)


def on_host_alone(A: Any) -> Any:
    """Return the matrix without its arrays on the device."""
    return replace(A, placed=None) if isinstance(A, Restricted) else A


def _on_host(A: Any) -> Any:
    return A.on_host() if isinstance(A, Restricted) else A


def _countable(entries: int) -> None:
    if entries >= 2**31:
        raise AdiniError(f"cuDSS: {entries} entries are too many for 32-bit indices")
