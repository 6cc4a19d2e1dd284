"""Vectors of all dofs of a layered block, on the host or a device: forces, sums and measures."""

from __future__ import annotations

from copy import copy
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from contact.arrays.dense_arrays import HostArrays, arrays_on
from contact.body.layers.block_loads import BlockLoads
from contact.body.layers.cell_stencil import CellStencil
from contact.body.layers.layers import PER_NODE

Array = NDArray[np.float64]


class BlockVectors(BlockLoads):
    """What `LayeredBlock` computes with vectors of all its dofs, where its arrays lie.

    Attributes
    ----------
    columns, node_rows : int
        Cells in a row, and rows of nodes.
    x, y : ndarray
        Places of the nodes.
    cell_rows : list of CellRows
    prescribed : (ndarray of int, ndarray)
        Dofs with a prescribed displacement, and its values.
    cell_size : float
    """

    columns: int
    node_rows: int
    x: Any
    y: Any
    cell_rows: Any
    prescribed: Any
    cell_size: Any

    def compute_on(self, device: str) -> HostArrays:
        """Apply the stiffness on "cpu" or "cuda" from now on; return the arrays of that device."""
        return self.compute_with(arrays_on(device))

    def compute_with(self, arrays: HostArrays) -> HostArrays:
        """Apply the stiffness to these arrays from now on."""
        if arrays is not self.arrays:
            self.arrays = arrays
            self.__dict__.pop("stiffness", None)
        return arrays

    def on_host(self) -> Self:
        """The same block, which computes on the host."""
        other = copy(self)
        other.compute_on("cpu")
        return other

    @cached_property
    def stiffness(self) -> CellStencil:
        """S as ``S @ u``, cell by cell; no matrix is built."""
        return CellStencil(self.columns, self.cell_rows, self.arrays)

    def contact_forces(self, rows: Any, mu: Array, t: Array) -> Any:
        """``G^T mu + T^T t`` on all dofs, where the body computes, from `ContactRows`.

        They act on the lowest row of cells: all others are zeros that the device makes itself.
        """
        xp, own = self.arrays.xp, self.trace.ndofs
        lowest = rows.G[:, :own].T @ mu + rows.T[:, :own].T @ t.ravel()
        forces = xp.zeros(self.ndofs)
        forces[:own] = xp.asarray(lowest)
        return forces

    def at_points(self, rows: Any, u: Any) -> Array:
        """The product of contact rows, which take dofs of the lowest cells, and a displacement."""
        own = self.trace.ndofs
        values: Array = rows[:, :own] @ self.arrays.get(u[:own])
        return values

    def equilibrium(self, u: Any, contact: Any, load: Any) -> tuple[float, float]:
        """Largest residual force at a free dof, and the largest sum of the terms' moduli there."""
        u, contact, load = map(self.placed, (u, contact, load))
        return self.stiffness.residual(
            u, contact - load, abs(load), self.prescribed[0], self.cell_size
        )

    def reach(self, u: Any) -> float:
        """Largest displacement at a node."""
        return float(abs(u.reshape(-1, PER_NODE)[:, :2]).max())

    def deformation(self, u: Any) -> float:
        """Largest part of a displacement that no rigid motion explains, by numbers x + i y."""
        u = self.arrays.get(u)
        v = u.reshape(self.node_rows, -1, PER_NODE)[..., :2] @ np.array([1.0, 1j])
        v, z = v - v.mean(), (self.x - self.x.mean()) + 1j * (self.y - self.y.mean())[:, None]
        return float(np.abs(v - 1j * z * (np.vdot(z, v).imag / np.vdot(z, z).real)).max())

    def support_error(self, u: Any) -> float:
        """Largest deviation from a prescribed displacement; derivatives are times their length."""
        dofs, values = self.prescribed
        length = np.where(dofs % PER_NODE < 2, 1.0, self.cell_size)
        found = self.arrays.get(self.placed(u)[self.placed(dofs)])
        return float(np.abs(length * (found - values)).max(initial=0.0))

    def at_supports(self, forces: Any) -> Any:
        """The part of forces on all dofs that acts where a displacement is prescribed."""
        dofs, forces = self.placed(self.prescribed[0]), self.placed(forces)
        reactions = self.arrays.xp.zeros(forces.size)
        reactions[dofs] = forces[dofs]
        return reactions

    def total(self, forces: Any) -> Array:
        """Resultant of forces on all dofs, shape (2,)."""
        # A device adds numbers that lie side by side in a hundredth of the time.
        parts = (self.arrays.xp.ascontiguousarray(forces[q::PER_NODE]) for q in (0, 1))
        return np.array([float(part.sum()) for part in parts])
