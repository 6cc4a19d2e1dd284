"""Vectors of all dofs of a body, and its matrices, on the host or a device."""

from __future__ import annotations

import logging
import operator
import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.arrays.dense_arrays import HostArrays
from contact.arrays.sparse_rows import AllRows, SparseRows
from contact.body.supports import transposed

Array = NDArray[np.float64]
_log = logging.getLogger(__name__)


class Space:
    """Operations on vectors of all dofs of a body with a Basis, on the device of `arrays`.
    `Solid` computes with the `own` part of a vector: here all of it. A space does not depend on
    loads or prescribed values, so one space serves a whole load history."""

    P: Any  # operators P, P^T, E of ``z = E^T (u - u0)``, E^T, and P^T for sums of moduli
    transposed: Any
    picked: Any
    picks: Any
    of_moduli: Any

    def __init__(self, body: Any, arrays: HostArrays, stiffness: SparseRows | None = None) -> None:
        P = body.constraint[0]
        self.arrays, self._of = arrays, (body.materials, P)
        put = arrays.xp.asarray
        self._S = stiffness or arrays.rows(body.stiffness)
        self.P, self.transposed = (arrays.rows(A) for A in (P, transposed(P, body.chosen)))
        if np.array_equal(body.chosen, np.arange(P.shape[0])):  # no supports
            self.P = self.transposed = AllRows(None)
        self.picked, self.picks, self.of_moduli = self.P, self.transposed, self.transposed
        if body.picked is not P:
            self.picked, self.picks = (arrays.rows(A) for A in (body.picked, body.picked.T))
        self.lengths, self.free_lengths = map(put, body.lengths)
        self.values = put(body.are_values)
        of_nodes = self.values.reshape(-1, body.dim).T.astype(float)
        self._of_nodes = arrays.xp.ascontiguousarray(of_nodes)  # rows, which sum fast
        self.diagonal = stiffness.diagonal() if stiffness else put(body.diagonal)
        self._moved = put(body.translations)
        self._count = self._of_nodes.sum(axis=1)
        self._last: tuple[Any, Any, bool] | None = None
        self._modes: tuple[Any, Array] | None = None

    def are_of(self, body: Any) -> bool:
        """Whether the body still has the matrices from which this space was made."""
        materials, P = self._of
        return P is body.constraint[0] and all(map(operator.is_, materials, body.materials))

    @staticmethod
    def bytes(body: Any, stiffness: SparseRows | None = None) -> int:
        """Estimated bytes of the vectors, and of a stiffness not yet there, on a device."""
        matrix = 0 if stiffness else SparseRows.bytes(body.stiffness)
        return matrix + 8 * 40 * int(body.f.size)  # some forty vectors, with temporary ones

    def placed(self, v: Any) -> Any:
        """Move a vector of all dofs to the host or device of this space."""
        return self.arrays.xp.asarray(v)

    own = placed

    def returned(self, v: Any, like: Any) -> Any:
        """A computed vector, copied to the host if `like` is there."""
        return self.arrays.get(v) if isinstance(like, np.ndarray) else v

    def forces(self, u: Any) -> Any:
        """S u without the mean translations, which would only add rounding; see `remembered`."""
        return self.remembered(u, lambda: self._S @ (u - self.mean_translation(u)))

    def remembered(self, u: Any, compute: Any, strained: bool = False) -> Any:
        """Read-only forces of a displacement, computed anew only if it differs from the last one.
        `strained`: whether forces come from strains, which may differ between copies of a body."""
        known = self._last
        same = known is not None and known[2] is strained
        if known is None or not (same and bool(self.arrays.xp.array_equal(known[0], u))):
            known = self._last = u.copy(), compute(), strained
            if isinstance(known[1], np.ndarray):
                known[1].setflags(write=False)
        return known[1]

    def know(self, u: Any, forces: Any, strained: bool) -> None:
        """Take the forces of a displacement for `remembered`, both read-only."""
        self._last = u, forces, strained

    def mean_translation(self, u: Any) -> Any:
        """The mean of a displacement along the rigid translations, on all dofs, shape (ndofs,)."""
        mean = self._moved * self._sums(u) / self._count
        return self.values * self.arrays.xp.tile(mean, self._of_nodes.shape[1])

    def _sums(self, v: Any) -> Any:
        """Sum of each component over the nodes, (dim,)."""
        return (self._of_nodes * v.reshape(self._of_nodes.T.shape).T).sum(axis=1)

    def moduli(self, u: Any) -> Any:
        """``|S| |u|``."""
        return self._S.moduli(u)

    def largest(self, x: Any) -> float:
        """Largest modulus."""
        return float(abs(x).max()) if x.size else 0.0

    def strained(self, left: Any, rigid: Array) -> Any:
        """A vector in units of `lengths` without its part in the rigid motions (host arrays)."""
        xp, get = self.arrays.xp, self.arrays.get
        if self._modes is None:
            modes = self.placed(rigid) * self.lengths[:, None]
            modes /= xp.linalg.norm(modes, axis=0)
            # Smaller singular values of the Gram matrix, relative to the largest, are rounding.
            gram = np.linalg.pinv(get(modes.T @ modes), rcond=1e-12, hermitian=True)
            self._modes = modes, gram
        modes, inverse = self._modes
        for _ in range(2):  # the second pass removes the rounding error of the first
            left = left - modes @ self.placed(inverse @ get(modes.T @ left))
        return left

    def resultant(self, forces: Any) -> Array:
        """Sum of each component, shape (dim,), on the host; in a ring only the axial one."""
        sums = np.asarray(self.arrays.get(self._sums(forces)))
        finite = bool(self.arrays.xp.isfinite(forces).all())
        return np.asarray(self.arrays.get(self._moved)) * sums if finite else sums * np.nan


class KeptSpaces:
    """The `Space` of a body and of its copies under other loads.
    A condensation owns the spaces on a device, which are freed with it."""

    def __init__(self) -> None:
        self._host: Space | None = None
        self._there: weakref.ref[Space] | None = None

    def of(self, body: Any) -> Space:
        """The space on the device while it exists, else the one on the host."""
        there = None if self._there is None else self._there()
        if there is not None and there.are_of(body):
            return there
        if self._host is None or not self._host.are_of(body):
            self._host = Space(body, HostArrays())
        return self._host

    def on(
        self, arrays: HostArrays, body: Any, beside: int, stiffness: SparseRows | None = None
    ) -> Space:
        """The space on the device of the arrays; `of` returns it while a reference exists.
        Falls back to the host, with a log entry, unless `beside` more bytes are free there."""
        room, needed = arrays.room(), Space.bytes(body, stiffness) + beside
        if room is not None and needed > room:
            _log.info(
                "the certificate is computed on the host: on the device it and the compliance take "
                "%.3g GB, and %.3g GB are free",
                needed / 1e9,
                room / 1e9,
            )
            return self.of(body)
        there = Space(body, arrays, stiffness)
        self._there = weakref.ref(there)
        return there
