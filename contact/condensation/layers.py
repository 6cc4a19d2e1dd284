"""Condensation of layers of equal cells onto their bottom."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.blas_threads import one_blas_thread
from contact.arrays.dense_arrays import HostArrays
from contact.body.free_motions import RIGID, unseen_motion
from contact.body.layers.layered_block import LayeredBlock
from contact.body.layers.layers import PER_NODE
from contact.body.rigid_modes import describe_motion, reduced_echelon, rigid_modes
from contact.condensation.condensed_body import BodyRows, CondensedBody
from contact.condensation.slab_doubling import SlabDoubling

Array = NDArray[np.float64]


class CondensedLayers(CondensedBody):
    """A `LayeredBlock`, condensed onto its bottom by slab doubling, perhaps on a GPU."""

    serial = False  # recovery has large products

    def __init__(self, body: LayeredBlock, rows: BodyRows, arrays: HostArrays) -> None:
        self.arrays = arrays
        size, held = body.row_size, body.prescribed[0]
        free = np.ones((2, size), dtype=bool)  # of all node rows but the top, and of the top
        free[0, held[held < size]] = False
        top = body.ndofs - size
        free[1, held[held >= top] - top] = False
        own = np.flatnonzero(free[0])
        per_length = 1.0 / np.tile([1.0, 1.0, *[body.cell_size] * 4], body.columns + 1)[own]
        self._P = sparse.csr_array((per_length, (own, np.arange(own.size))), shape=(size, own.size))
        self._prescribe(body)
        B = self._touch(rows)
        if body.path is not None:  # unknowns of one kind are kept at all nodes
            kinds = np.unique(own[self._boundary] % PER_NODE)
            self._boundary = np.flatnonzero(np.isin(own % PER_NODE, kinds))
        self.path = "slabs" if body.path is None else body.path
        self.B = sparse.csr_array(B[:, self._boundary])
        self._per_length, self._kinds = per_length[self._boundary], own[self._boundary] % PER_NODE
        self._factor: Any = FACTORS[self.path](body, free, own[self._boundary], arrays)
        bottom, plain = self._free_motions()
        of_unit = self._motion_sizes()[:, None]
        unseen = unseen_motion(of_unit * plain, bottom[self._boundary])
        self._refuse(None if unseen is None else unseen / of_unit[:, 0])
        with one_blas_thread(max(self.B.shape)):
            self._hold(bottom[self._boundary], plain)

    def _prescribe(self, body: Any) -> None:
        self.body = body
        dofs, values = body.prescribed
        self._u0 = self._lifted = None
        if values.any():
            u0 = self.arrays.xp.zeros(body.ndofs)
            u0[self.placed(dofs)] = self.placed(values)
            self._u0, self._lifted = u0, body.stiffness @ u0

    def _free_motions(self) -> tuple[Array, Array]:
        """Free rigid motions on the free unknowns of the bottom row, and their coefficients.
        The coefficients, (3, k), are those of both translations and the rotation about the
        middle."""
        body = self.body
        held = body.prescribed[0]
        node, kind = np.divmod(held, PER_NODE)
        j, i = np.divmod(node, body.columns + 1)
        of_bottom = _motions(np.repeat(body.x, PER_NODE), 0.0, body)
        of_held = _motions(body.x[i], body.y[j], body, kind)
        length = np.where(kind < 2, 1.0, body.cell_size)[:, None]
        # Scales that give each motion unit displacement: the rotation has it at the corners.
        size = np.array([1.0, 1.0, 0.5 * np.hypot(body.width, body.height)])
        scaled = np.vstack((length * of_held / size, np.zeros((3, 3))))
        _, singular, V = np.linalg.svd(scaled, full_matrices=False)
        plain = reduced_echelon(V[singular < RIGID * np.sqrt(max(held.size, 1))] / size).T
        free: Array = self._P.T @ (of_bottom @ plain) / (self._P**2).sum(axis=0)[:, None]
        return free, plain

    def _motion_sizes(self) -> Array:
        """Norms of the translations and the rotation on all dofs, shape (3,)."""
        x, y = self._about_middle()
        turn = x.size * np.sum(y**2) + y.size * np.sum(x**2) + 2.0 * x.size * y.size
        return np.sqrt([x.size * y.size, x.size * y.size, turn])

    def _about_middle(self) -> tuple[Array, Array]:
        """Coordinates of the columns and rows of nodes, from the middle of the body."""
        return self.body.x - 0.5 * self.body.width, self.body.y - 0.5 * self.body.height

    def _invert(self) -> None:
        """By waves, whose inverses are the compliance; by a factor where they are not definite."""
        moves = np.abs(self.N).max(axis=1, initial=0.0)
        free = np.unique(self._kinds[moves > RIGID * moves.max(initial=0.0)])
        self._by_waves = (
            self.body.path is not None and free.size == self.N.shape[1] and self._factor.hold(free)
        )
        self.thin = False
        if not self._by_waves:
            super()._invert()

    def compliance(self) -> Any:
        """``B S_b^-1 B^T`` on the device, shape (n, n)."""
        if not self._by_waves:
            return super().compliance()
        per_length = sparse.diags_array(1.0 / self._per_length)
        return self.arrays.congruent(sparse.csr_array(self.B @ per_length), self._factor.compliance)

    def flexed(self, r: Array) -> Array:
        """Displacement of the boundary's unknowns under forces r on them."""
        if not self._by_waves:
            return super().flexed(r)
        flexed: Array = self._factor.flexed(r / self._per_length) / self._per_length
        return flexed

    def _in_unknowns(self, rows: BodyRows) -> sparse.csr_array:
        size = self.body.row_size
        lowest = BodyRows(rows.normal[:, :size], rows.tangential[:, :size])
        return super()._in_unknowns(lowest)

    def restrict(self, rows: Any) -> Array:
        """Rows on all dofs, expressed in the contact boundary's unknowns, shape (nrows, nb)."""
        own: Array = (rows[:, : self.body.row_size] @ self._P)[:, self._boundary].toarray()
        return own

    def placed(self, v: Any) -> Any:
        """A vector in the memory of the device, where the body computes from now on."""
        self.body.compute_with(self.arrays)
        return self.body.placed(v)

    def prescribed(self) -> Array:
        """The prescribed displacements on all dofs, zero elsewhere, on the host."""
        dofs, values = self.body.prescribed
        u0 = np.zeros(self.body.ndofs)
        if values.any():
            u0[dofs] = values
        return u0

    def reduce(self, load: Any) -> Array:
        """Load on all dofs, condensed onto the contact boundary's unknowns, shape (nb,)."""
        return super().reduce(self.placed(load))

    def expand(self, load: Any, z_b: Array) -> Any:
        """Displacement of all dofs from the contact boundary's unknowns, where the load lies."""
        u = super().expand(self.placed(load), z_b)
        return self.arrays.get(u) if isinstance(load, np.ndarray) else u

    def carried(self, forces: Any) -> Array:
        """Condensed forces on all dofs, supports at rest, in the boundary's unknowns, (nb,)."""
        carried: Array = self._per_length * self._factor.reduce(forces)
        return carried

    def moved(self, forces: Any, z_b: Array) -> Any:
        """Displacement of all dofs under forces on them and supports at rest."""
        return self._factor.expand(forces, self._per_length * z_b)

    def unbalanced(self, rest: Any, u: Any) -> Any:
        """Residual forces on free dofs, for one step of iterative refinement.
        The stiffness of n rows for smooth motions is 1/n^2 of its largest entries, whose rounding
        leaves n^2 eps; the product cell by cell has no such error."""
        left = rest - self.body.stiffness @ u
        held = self.body.prescribed[0]
        left[held if isinstance(left, np.ndarray) else self.placed(held)] = 0.0
        return left

    def motion_of(self, motion: Array) -> tuple[str, Array]:
        """Name and all dofs of two translations and a rotation about the middle, shape (3,)."""
        body, (x, y) = self.body, self._about_middle()
        name = describe_motion(body.trace, rigid_modes(body.trace) @ _about(motion, body))
        u = np.zeros((y.size, x.size, PER_NODE))
        u[..., 0] = motion[0] - motion[2] * y[:, None]
        u[..., 1] = motion[1] + motion[2] * x
        u[..., 3], u[..., 4] = motion[2], -motion[2]
        return name, u.ravel()

    def resultants(self, load: Array) -> Array:
        """Work of a load on the rigid motions, from the load itself, not from its elimination."""
        if not self.modes.shape[1]:
            return np.zeros(0)
        xp, (x, y) = self.arrays.xp, map(self.arrays.xp.asarray, self._about_middle())
        f = self.placed(load).copy()
        f[xp.asarray(self.body.prescribed[0])] = 0.0
        f = f.reshape(y.size, x.size, PER_NODE)
        turn = x @ f[..., 1].sum(axis=0) - y @ f[..., 0].sum(axis=1)
        turn += f[..., 3].sum() - f[..., 4].sum()
        work = xp.stack((f[..., 0].sum(), f[..., 1].sum(), turn))
        return np.asarray(self.modes.T @ self.arrays.get(work))

    def scaled_schur(self) -> Any:
        """S_b on the device, a copy."""
        per_length = self.arrays.put(self._per_length)
        return per_length[:, None] * self._factor.schur * per_length


def _doubled(
    body: LayeredBlock, free: NDArray[np.bool_], boundary: NDArray[np.int64], arrays: HostArrays
) -> Any:
    return SlabDoubling(body.columns, body.cell_rows, free[0], free[1], boundary, arrays)


# By the path of a block; free unknowns of all node rows but the top, and of the top. Others
# register themselves.
FACTORS: dict[str, Callable[..., Any]] = {"slabs": _doubled}


def _motions(
    x: Array, y: Array | float, body: LayeredBlock, kind: NDArray[np.int64] | None = None
) -> Array:
    """Both translations and the rotation about the middle, at dofs in given places, (n, 3)."""
    if kind is None:
        kind = np.arange(x.size) % PER_NODE
    x, y = x - 0.5 * body.width, y - 0.5 * body.height
    turn = np.select([kind == 0, kind == 1, kind == 3, kind == 4], [-y + 0 * x, x, 1.0, -1.0], 0.0)
    return np.column_stack((kind == 0, kind == 1, turn)).astype(np.float64)


def _about(motion: Array, body: LayeredBlock) -> Array:
    """The same motion with its rotation about the middle of the lowest row of cells."""
    drop = 0.5 * (body.height - body.y[1])
    return motion + np.array([drop * motion[2], 0.0, 0.0])
