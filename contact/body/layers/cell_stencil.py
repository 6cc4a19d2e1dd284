"""The stiffness of rows of equal cells, applied cell by cell."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.arrays.dense_arrays import HostArrays
from contact.body.layers.layers import PER_NODE, CellRows

Array = NDArray[np.float64]
_CHUNK = 1 << 12  # cells whose dofs are gathered at a time: about what the cache holds


class CellStencil:
    """``S @ u`` and |S| |u| for layers of equal cells; only element matrices are stored.

    Parameters
    ----------
    columns : int
    layers : list of CellRows
        From the bottom up.
    arrays : HostArrays
        Where to compute; products are returned where the vectors lie.
    """

    def __init__(self, columns: int, layers: list[CellRows], arrays: HostArrays) -> None:
        self.columns, self.layers, self.arrays = columns, layers, arrays

    def __matmul__(self, u: Any) -> Any:
        """Forces of all dofs."""
        on_device = self.arrays.xp.asarray(u).reshape(-1, self.columns + 1, PER_NODE)
        force = self._apply(on_device, absolute=False).ravel()
        return self.arrays.get(force) if isinstance(u, np.ndarray) else force

    def residual(
        self, u: Any, external: Any, size: Any, held: NDArray[np.int64], cell: float
    ) -> tuple[float, float]:
        """Largest component of ``S u + external`` and of ``|S| |u| + size`` at the free dofs.

        Parameters
        ----------
        u, external, size : arrays, shape (ndofs,), on the host or the device
        held : ndarray of int
            Dofs that do not count.
        cell : float
            Length that derivatives are multiplied by, and their forces divided by.
        """
        xp = self.arrays.xp
        shape = (-1, self.columns + 1, PER_NODE)
        per_length = xp.asarray([1.0, 1.0] + [1.0 / cell] * 4)
        dofs, place = xp.asarray(u).reshape(shape), xp.asarray(held)
        largest = []
        for values, more, absolute in ((dofs, external, False), (xp.abs(dofs), size, True)):
            force = self._apply(values, absolute) + xp.asarray(more).reshape(shape)
            force *= per_length
            force.ravel()[place] = 0.0
            largest.append(float(xp.abs(force).max()))
        return largest[0], largest[1]

    def strips(self, step: int) -> Iterator[tuple[Array, tuple[Any, ...]]]:
        """Element matrix of so many rows of cells at a time, and where their four corners are.

        The places index the first two axes of an array of the nodes; corners are ordered as in
        `CellRows`.
        """
        n, first = self.columns, 0
        left, right = slice(0, n), slice(1, n + 1)
        for layer in self.layers:
            for low in range(first, first + layer.height, step):
                high = min(low + step, first + layer.height)
                below, above = slice(low, high), slice(low + 1, high + 1)
                corners = (below, left), (below, right), (above, right), (above, left)
                yield layer.stiffness, corners
            first += layer.height

    def _apply(self, u: Any, absolute: bool) -> Any:
        xp = self.arrays.xp
        force = xp.zeros_like(u)
        step = max(1, _CHUNK // self.columns) if xp is np else u.shape[0]
        for stiffness, corners in self.strips(step):
            K = xp.asarray(np.abs(stiffness) if absolute else stiffness)
            cells = xp.concatenate([u[c] for c in corners], axis=2)
            if not absolute:
                # No force comes from a translation: without it, rounding is that of strains.
                values = cells.reshape(*cells.shape[:2], 4, PER_NODE)[..., :2]
                values -= values[:, :, :1].copy()
            local = (cells.reshape(-1, 4 * PER_NODE) @ K).reshape(cells.shape)
            for k, c in enumerate(corners):
                force[c] += local[:, :, PER_NODE * k : PER_NODE * (k + 1)]
        return force
