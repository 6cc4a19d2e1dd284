"""The matrix by which a profile gives the field between the nodes from its moments."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array, diags_array

from cip.errors import NotSupported
from cip.grid import Grid
from cip.output.sample import points_of, profile_value
from cip.profiles.catalogue import moments

Array = NDArray[np.float64]


class _Rows:
    """Linear functionals of the moments, one for each point, in place of their values:
    `profile_value` computes with these rows of a sparse matrix as with numbers.
    """

    # Arrays then leave products and sums with rows to the methods below.
    __array_ufunc__ = None

    def __init__(self, matrix: csr_array) -> None:
        self.matrix = matrix

    def __add__(self, other: Any) -> _Rows:
        if isinstance(other, _Rows):
            return _Rows(self.matrix + other.matrix)
        assert np.all(other == 0.0)  # a constant is no linear functional; sums begin with 0
        return self

    __radd__ = __add__

    def __sub__(self, other: _Rows) -> _Rows:
        return _Rows(self.matrix - other.matrix)

    def __mul__(self, factor: Any) -> _Rows:
        factors = np.broadcast_to(np.asarray(factor, dtype=float), (self.matrix.shape[0],))
        return _Rows(csr_array(diags_array(factors) @ self.matrix))

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> _Rows:
        return self * (1.0 / divisor)


class _Moment:
    """One moment at all nodes: indexed by nodes it gives the rows that read it there."""

    def __init__(self, offset: int, grid: Grid, columns: int) -> None:
        self._offset, self._grid, self._columns = offset, grid, columns

    def __getitem__(self, index: Any) -> _Rows:
        nodes = np.ravel_multi_index(
            index if isinstance(index, tuple) else (index,), self._grid.nodes
        )
        ones = (np.ones(nodes.size), (np.arange(nodes.size), self._offset + nodes))
        return _Rows(csr_array(ones, shape=(nodes.size, self._columns)))


def sample_rows(grid: Grid, profile: str, points: ArrayLike) -> csr_array:
    """The matrix of `cip.output.sample.sample`, by the same formulas: shape (n, N), applied to
    ``state.data.ravel()``. Raises `NotSupported` for a profile that is not linear in its moments,
    or csl4 in more than one dimension."""
    wanted = moments(profile, grid.dim)
    if profile in ("piecewise_linear", "smoothed"):
        raise NotSupported(f"profile: {profile!r} is not linear in its moments; take 'cubic'")
    if profile == "csl4" and grid.dim > 1:
        raise NotSupported("profile: rows of 'csl4' are implemented on lines; take 'csl2'")
    size = grid.size
    data = {one.name: _Moment(q * size, grid, len(wanted) * size) for q, one in enumerate(wanted)}
    place = points_of(points, grid.dim).reshape(grid.dim, -1)
    found: csr_array = profile_value(profile, data, grid, place).matrix
    found.sum_duplicates()
    return found
