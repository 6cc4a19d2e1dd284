"""A nested dissection that is handed over to cuDSS, so that it need not find its own."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Index = NDArray[np.integer[Any]]


class DissectionTree(NamedTuple):
    """An order of elimination in the blocks of a complete binary tree, its leaves first.

    Attributes
    ----------
    order : ndarray, shape (n,)
        ``order[k]`` is the unknown of step k; blocks follow one another level by level, the leaves
        first and the separator of the whole, the root, last.
    sizes : ndarray, shape (2**levels - 1,)
        Unknowns in each block, in the same order; none is empty.
    """

    order: Index
    sizes: Index

    @property
    def levels(self) -> int:
        """Levels of the tree."""
        return int(self.sizes.size + 1).bit_length() - 1

    def separates(self, xp: Any, starts: Any, columns: Any) -> bool:
        """Whether each entry joins unknowns of one block, or of a block and one above it.

        cuDSS trusts a tree, and writes where it must not if this does not hold.

        Parameters
        ----------
        xp
            NumPy or CuPy.
        starts, columns
            Upper triangle by rows, arrays of xp, shapes (n + 1,) and (nnz,).
        """
        # Blocks from the last to the first are numbered 1, 2, ...: block h is below block h // 2.
        number = np.empty(self.order.size, dtype=np.int32)
        number[self.order] = np.repeat(np.arange(self.sizes.size, 0, -1), self.sizes)
        level = np.frexp(np.arange(self.sizes.size + 1))[1].astype(np.int32)
        of, depth = xp.asarray(number), xp.asarray(level)
        entries = xp.arange(columns.size, dtype=starts.dtype)
        row, column = of[xp.searchsorted(starts[1:], entries, side="right")], of[columns]
        upper, lower = xp.minimum(row, column), xp.maximum(row, column)
        return bool((lower >> (depth[lower] - depth[upper]) == upper).all())
