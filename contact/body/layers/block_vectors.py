"""Vectors of all dofs of a layered block, on the host or a device."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from contact.arrays.dense_arrays import HostArrays, arrays_on
from contact.body.layers.layers import PER_NODE, CellRows
from contact.body.solid import Solid
from contact.errors import InputError

Array = NDArray[np.float64]


class BlockVectors(Solid):
    """Operations of `LayeredBlock` on vectors of all its dofs, on the device of its arrays.
    While only edges are loaded, the load vector is read-only and shared with snapshots and devices;
    access to `f` makes it editable."""

    columns: int  # cells in a row
    node_rows: int  # rows of nodes
    x: Any  # coordinates of the nodes, likewise y
    y: Any
    cell_rows: Any  # list of CellRows
    prescribed: Any  # dofs with a prescribed displacement, and its values
    cell_size: Any
    arrays = HostArrays()
    _acting: NDArray[np.int64] | None = None  # dofs that may be loaded, ascending; None: any

    def _unload(self, size: int) -> None:
        """Set the load to zero on `size` dofs."""
        self._f, self._acting = np.zeros(size), np.zeros(0, dtype=np.int64)
        self._f.flags.writeable = False

    @property
    def f(self) -> Array:
        """Load on every dof, shape (ndofs,)."""
        if self._acting is not None:
            self._f, self._acting = self._f.copy(), None
        return self._f

    @f.setter
    def f(self, value: Array) -> None:
        self._f, self._acting = self._checked_load(value), None

    def _add(self, loads: Sequence[tuple[NDArray[np.int64], Array]]) -> None:
        """Add loads: pairs of distinct dofs and their forces."""
        acting = self._acting
        if acting is None:
            f = self._f.copy()
        else:
            f = np.zeros(self.ndofs)  # untouched pages take no memory
            f[acting] = self._f[acting]
            acting = np.unique(np.concatenate([acting, *[dofs for dofs, _ in loads]]))
        with np.errstate(over="ignore"):
            for dofs, forces in loads:
                f[dofs] += forces
        if not all(np.all(np.isfinite(f[dofs])) for dofs, _ in loads):
            raise InputError("f: the loads add up to values that are not finite")
        f.flags.writeable = acting is None
        self._f, self._acting = f, acting

    @property
    def loads(self) -> Array:
        """The load on every dof, read-only, shape (ndofs,)."""
        return self._f

    def check_unchanged(self) -> None:
        """Raise an `InputError` if the loads were edited in place to values that are not finite."""
        if self._acting is None:
            super().check_unchanged()

    def snapshot(self) -> Self:
        """A copy for a result, which later loads and supports do not change."""
        if self._acting is None:
            return super().snapshot()
        other: Self = self.__copy__()
        return other

    def placed(self, v: Any) -> Any:
        """Move a vector of all dofs to the device that applies the stiffness; only the nonzeros of
        the block's own load are copied."""
        xp = self.arrays.xp
        if v is not self._f or self._acting is None or xp is np:
            return xp.asarray(v)
        load, at = xp.zeros(v.size), xp.asarray(self._acting)
        load[at] = xp.asarray(v[self._acting])
        return load

    def compute_on(self, device: str) -> HostArrays:
        """Apply the stiffness on "cpu" or "cuda" from now on; return the arrays of that device."""
        return self.compute_with(arrays_on(device))

    def compute_with(self, arrays: HostArrays) -> HostArrays:
        """Apply the stiffness with these arrays from now on."""
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
        """``G^T mu + T^T t`` on all dofs, from `ContactRows`, on the device of the body. Only the
        lowest row of cells is copied; all other forces are zero."""
        xp, own = self.arrays.xp, self.trace.ndofs
        lowest = rows.G[:, :own].T @ mu + rows.T[:, :own].T @ t.ravel()
        forces = xp.zeros(self.ndofs)
        forces[:own] = xp.asarray(lowest)
        return forces

    def at_points(self, rows: Any, u: Any) -> Array:
        """Product of contact rows, on dofs of the lowest cells, and a displacement."""
        own = self.trace.ndofs
        values: Array = rows[:, :own] @ self.arrays.get(u[:own])
        return values

    def internal(self, u: Any) -> Any:
        """Internal forces S u on the device of u."""
        return self.stiffness @ u

    def local_displacement(self, forces: Any) -> float:
        """Return zero: the diagonal of the stiffness is not assembled."""
        return 0.0

    def equilibrium(
        self, u: Any, contact: Any, load: Any, moduli: Any = None
    ) -> tuple[float, float]:
        """Largest residual force at a free dof, and the largest sum of the terms' moduli there."""
        u, contact, load = map(self.placed, (u, contact, load))
        terms = abs(load) if moduli is None else self.placed(moduli)
        return self.stiffness.residual(u, contact - load, terms, self.prescribed[0], self.cell_size)

    def largest_displacement(self, u: Any) -> float:
        """Largest displacement at a node."""
        return float(abs(u.reshape(-1, PER_NODE)[:, :2]).max())

    def deformation(self, u: Any) -> float:
        """Largest displacement after removing rigid motions; nodes are complex numbers x + i y."""
        u = self.arrays.get(u)
        v = u.reshape(self.node_rows, -1, PER_NODE)[..., :2] @ np.array([1.0, 1j])
        v, z = v - v.mean(), (self.x - self.x.mean()) + 1j * (self.y - self.y.mean())[:, None]
        return float(np.abs(v - 1j * z * (np.vdot(z, v).imag / np.vdot(z, z).real)).max())

    def support_error(self, u: Any) -> float:
        """Largest deviation from a prescribed displacement; derivatives are scaled by their
        length."""
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
        # A device sums contiguous numbers a hundred times faster.
        parts = (self.arrays.xp.ascontiguousarray(forces[q::PER_NODE]) for q in (0, 1))
        return np.array([float(part.sum()) for part in parts])


class CellStencil:
    """``S @ u`` and |S| |u| for layers of equal cells, bottom up, by their element matrices.
    Products are computed on the device of `arrays` and returned on that of the vectors."""

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
        Derivatives are multiplied by the length `cell`, and their forces divided by it."""
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
        """Element matrix of up to `step` rows of cells at a time, and slices of their corners.
        The slices index the first two axes of a node array, corners in the order of `CellRows`."""
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
        # The dofs of 2^12 cells fit into the cache.
        step = max(1, 2**12 // self.columns) if xp is np else u.shape[0]
        for stiffness, corners in self.strips(step):
            K = xp.asarray(np.abs(stiffness) if absolute else stiffness)
            cells = xp.concatenate([u[c] for c in corners], axis=2)
            if not absolute:
                # Remove the translation, which causes no force: rounding then scales with strains.
                values = cells.reshape(*cells.shape[:2], 4, PER_NODE)[..., :2]
                values -= values[:, :, :1].copy()
            local = (cells.reshape(-1, 4 * PER_NODE) @ K).reshape(cells.shape)
            for k, c in enumerate(corners):
                force[c] += local[:, :, PER_NODE * k : PER_NODE * (k + 1)]
        return force
