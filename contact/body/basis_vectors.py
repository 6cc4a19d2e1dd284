"""Vectors of all dofs of a body with a Basis, on the host or a device: forces, sums, measures."""

from __future__ import annotations

import logging
import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.arrays.dense_arrays import HostArrays
from contact.arrays.sparse_rows import SparseRows
from contact.body.supports import transposed

Array = NDArray[np.float64]
_log = logging.getLogger(__name__)
_AT_ONCE = 40  # vectors of all dofs in memory at the same time, temporary ones included
_DEPENDENT = 1e-12  # relative singular values of rigid motions' Gram matrix below this are rounding


class BasisVectors:
    """What `BasisSolid` computes with vectors of all its dofs, which lie where `arrays` do.
    Nothing here depends on loads or on the values that supports prescribe: one object serves a
    whole load history."""

    def __init__(self, body: Any, arrays: HostArrays, stiffness: SparseRows | None = None) -> None:
        P = body.constraint[0]
        self.arrays, self._of = arrays, (body.materials, P)
        put = arrays.xp.asarray
        self._S = stiffness or arrays.rows(body.stiffness)
        self._P, self._transposed = (arrays.rows(A) for A in (P, transposed(P, body.chosen)))
        self._picked, self._picks = self._P, self._transposed
        if body.picked is not P:
            self._picked, self._picks = (arrays.rows(A) for A in (body.picked, body.picked.T))
        self._lengths, self._free_lengths = map(put, body.lengths)
        self._values = put(body.are_values.reshape(-1, body.dim))
        self._diagonal = stiffness.diagonal() if stiffness else put(body.diagonal)
        # Those components along which a translation is rigid.
        self._moved = put(np.arange(body.dim) == 1 if body.is_ring else np.ones(body.dim, bool))
        self._count = self._values.sum(axis=0)
        self._last: tuple[Any, Any, bool] | None = None
        self._modes: tuple[Any, Array] | None = None

    def are_of(self, body: Any) -> bool:
        """Whether the body still has the matrices that this was made of."""
        materials, P = self._of
        same = all(a is b for a, b in zip(materials, body.materials, strict=True))
        return same and P is body.constraint[0]

    @staticmethod
    def bytes(body: Any, stiffness: SparseRows | None = None) -> int:
        """Memory that vectors, and a stiffness that is not there, take on a device, about."""
        matrix = 0 if stiffness else SparseRows.bytes(body.stiffness)
        return matrix + 8 * _AT_ONCE * int(body.f.size)

    def placed(self, v: Any) -> Any:
        """A vector of all dofs, on the host or device where this computes."""
        return self.arrays.xp.asarray(v)

    def returned(self, v: Any, like: Any) -> Any:
        """A computed vector, copied to the host if `like` lies there."""
        return self.arrays.get(v) if isinstance(like, np.ndarray) else v

    def forces(self, u: Any) -> Any:
        """S u without the mean translations, which would only add rounding; see `remembered`."""
        return self.remembered(u, lambda: self._S @ (u - self.mean_translation(u)))

    def remembered(self, u: Any, compute: Any, strained: bool = False) -> Any:
        """The forces of a displacement, computed unless it is the last one; nobody may change them.
        `strained` tells whether they come from strains, in which copies of a body may differ."""
        known = self._last
        same = known is not None and known[2] is strained
        if known is None or not (same and bool(self.arrays.xp.array_equal(known[0], u))):
            known = self._last = u.copy(), compute(), strained
            if isinstance(known[1], np.ndarray):
                known[1].setflags(write=False)
        return known[1]

    def mean_translation(self, u: Any) -> Any:
        """The mean of a displacement along the rigid translations, on all dofs, shape (ndofs,)."""
        xp = self.arrays.xp
        at_nodes = xp.where(self._values, u.reshape(self._values.shape), 0.0)
        mean = xp.where(self._moved, at_nodes.sum(axis=0) / self._count, 0.0)
        return xp.where(self._values, mean, 0.0).ravel()

    def equilibrium(self, forces: Any, u: Any, load: Any) -> tuple[float, float]:
        """Largest force at a free dof, and the largest sum of the moduli of its terms there."""
        terms = self._S.moduli(u) + abs(load)
        return (
            _largest(self._transposed @ forces / self._free_lengths),
            _largest(self._transposed @ terms / self._free_lengths),
        )

    def give(self, forces: Any) -> float:
        """Largest displacement that one of the forces would cause if all other dofs were fixed."""
        return _largest(forces * self._lengths / self._diagonal)

    def reach(self, u: Any) -> float:
        """Largest displacement at a node; if all are zero, largest derivative times its length."""
        at_nodes = self.arrays.xp.where(self._values.ravel(), u, 0.0)
        return _largest(at_nodes) or _largest(self._lengths * u)

    def deformation(self, u: Any, rigid: Array) -> float:
        """Largest part of a displacement that no rigid motion explains; these lie on the host."""
        xp, get = self.arrays.xp, self.arrays.get
        if self._modes is None:
            modes = self.placed(rigid) * self._lengths[:, None]
            modes /= xp.linalg.norm(modes, axis=0)
            gram = np.linalg.pinv(get(modes.T @ modes), rcond=_DEPENDENT, hermitian=True)
            self._modes = modes, gram
        modes, inverse = self._modes
        left = self._lengths * u
        for _ in range(2):  # the second removes what rounding leaves of the first
            left = left - modes @ self.placed(inverse @ get(modes.T @ left))
        return _largest(left)

    def support_error(self, u: Any, u0: Any) -> float:
        """Largest deviation from u0 where the supports prescribe it."""
        off = u - u0
        return _largest(self._lengths * (off - self._P @ (self._picks @ off)))

    def at_supports(self, forces: Any) -> Any:
        """The part of forces that acts where a displacement is prescribed."""
        return forces - self._picked @ (self._transposed @ forces)

    def total(self, forces: Any) -> Array:
        """Resultant of forces, shape (dim,), on the host; of a ring along its axis only."""
        xp = self.arrays.xp
        sums = xp.where(self._values, forces.reshape(self._values.shape), 0.0).sum(axis=0)
        sums = np.asarray(self.arrays.get(xp.where(self._moved, sums, 0.0)))
        return sums if bool(xp.isfinite(forces).all()) else np.full(sums.size, np.nan)


class KeptVectors:
    """The `BasisVectors` of a body and of its copies under other loads.
    Those on a device are kept by the condensation that made them, and go with it."""

    def __init__(self) -> None:
        self._host: BasisVectors | None = None
        self._there: weakref.ref[BasisVectors] | None = None

    def of(self, body: Any) -> BasisVectors:
        """Those on the device, as long as they are there, or those on the host."""
        there = None if self._there is None else self._there()
        if there is not None and there.are_of(body):
            return there
        if self._host is None or not self._host.are_of(body):
            self._host = BasisVectors(body, HostArrays())
        return self._host

    def on(
        self, arrays: HostArrays, body: Any, beside: int, stiffness: SparseRows | None = None
    ) -> BasisVectors:
        """Those where the arrays lie; `of` returns them as long as somebody keeps them.
        Unless `beside` more bytes are free on the device they lie on the host, which is logged."""
        room, needed = arrays.room(), BasisVectors.bytes(body, stiffness) + beside
        if room is not None and needed > room:
            _log.info(
                "the certificate is computed on the host: on the device it and the compliance take "
                "%.3g GB, and %.3g GB are free",
                needed / 1e9,
                room / 1e9,
            )
            return self.of(body)
        there = BasisVectors(body, arrays, stiffness)
        self._there = weakref.ref(there)
        return there


def _largest(x: Any) -> float:
    return float(abs(x).max()) if x.size else 0.0
