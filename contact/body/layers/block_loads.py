"""The load of a block without a mesh, which knows the few dofs that it acts on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from contact.arrays.dense_arrays import HostArrays
from contact.body.solid import Solid
from contact.errors import InputError

Array = NDArray[np.float64]


class BlockLoads(Solid):
    """What a `LayeredBlock` keeps of its load.

    Tractions act on the dofs of an edge, few among all. While nothing else is loaded the vector of
    all dofs is read-only, so that snapshots and devices need no copy of it, and its other entries
    are known to be zero. Who takes `f` gets a vector that may be edited, as of any body.

    Attributes
    ----------
    arrays : HostArrays
        Where the body computes.
    """

    arrays = HostArrays()
    _acting: NDArray[np.int64] | None = None  # dofs that may be loaded, ascending; None: any

    def _unload(self, size: int) -> None:
        """No load on so many dofs."""
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
        """Load some dofs besides, in each of the loads every dof once.

        Raises
        ------
        InputError
            The sum is not finite.
        """
        acting = self._acting
        if acting is None:
            f = self._f.copy()
        else:
            f = np.zeros(self.ndofs)  # pages that nobody writes to cost nothing
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
        """The load on every dof, to be read only, shape (ndofs,)."""
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
        """A vector of all dofs in the memory of the device that applies the stiffness.

        Of the block's own load only what acts is copied to a device; the zeros it makes itself.
        """
        xp = self.arrays.xp
        if v is not self._f or self._acting is None or xp is np:
            return xp.asarray(v)
        load, at = xp.zeros(v.size), xp.asarray(self._acting)
        load[at] = xp.asarray(v[self._acting])
        return load
