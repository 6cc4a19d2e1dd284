r"""Contact rows of a boundary opposite a rigid tool, where both are at the moment.

With the trace N at the points q of the functional, their weights P, and the tool's signed distance
:math:`\phi` at :math:`y = x + u`, :math:`n = -\nabla\phi`,

.. math:: G = P \, (n \cdot N), \qquad d = P \, (\phi + n \cdot u), \qquad
    u_n - d = -P \, \phi(x + u) .

The derivative of the gap is G itself; that of the normals is the curvature of the tool,
:math:`\delta n = -\nabla^2\phi \, (\delta y - w) + \theta \times n` for a motion
:math:`w, \theta` of the tool. Tangents are those of the boundary at rest, turned by the shortest
rotation from its normal m to n. P. Wriggers, Computational Contact Mechanics, 2nd ed., Springer
2006, sections 4.1 and 5.2."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import block_diag

from contact.obstacles.rigid_motion import closest_rotation, turn_of
from contact.obstacles.tool import Tool, WornTools, cross, rate
from contact.rows.contact_rows import ContactRows
from contact.rows.frames import turned_tangents

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Csr = sparse.csr_array


@dataclass(frozen=True)
class BoundaryPoints:
    """The points where a functional reads the trace of a boundary."""

    P: Csr  # means of values at the points, shape (m, n)
    N: Csr  # scalar functions at the points, shape (n, scalar dofs)
    x: Array  # at rest, shape (dim, n)
    normals: Array  # outward normals of the body, shape (dim, n)
    turns: bool = True  # False: part of a ring or of a symmetric body, which bends but cannot turn


@dataclass(frozen=True)
class RowsInMotion:
    """Derivatives of contact rows by the displacement and by k motions of obstacles."""

    normal: Csr  # to be added to G, shape (m, ndofs)
    tangential: Csr  # to be added to T, shape (m (dim - 1), ndofs)
    force: Csr  # derivative of the negative contact forces, shape (ndofs, ndofs)
    slip: Array  # of the slip, to be added to minus the motions' tangent, (m (dim - 1), k)
    push: Csr  # derivative of the negative contact forces by the motions, (ndofs, k)
    pull: Csr  # derivative of the forces on the motions by the displacement, (k, ndofs)
    lean: Array  # and by the motions, (k, k)
    swing: Array  # of the slip by rotations of whole boundaries, (m (dim - 1), r)
    turning: Csr  # of these by the displacement, (r, ndofs)

    @classmethod
    def still(cls, m: int, rows: ContactRows, ndofs: int, k: int) -> RowsInMotion:
        """The derivatives of m points whose rows stay."""
        slips = m * rows.tangents.shape[1]
        empty = [
            Csr(s) for s in ((m, ndofs), (slips, ndofs), (ndofs, ndofs), (ndofs, k), (k, ndofs))
        ]
        normal, tangential, force, push, pull = empty
        none, lean, turning = np.zeros((slips, k)), np.zeros((k, k)), Csr((0, ndofs))
        return cls(normal, tangential, force, none, push, pull, lean, none[:, :0], turning)

    @classmethod
    def joined(cls, parts: Sequence[RowsInMotion]) -> RowsInMotion:
        """Those of several boundaries, each with its motions."""

        def whole(join: Callable[..., Any], name: str) -> Any:
            return join([getattr(part, name) for part in parts])

        def diagonal(blocks: list[Array]) -> Array:
            return np.asarray(block_diag(*blocks))

        def one(blocks: list[Csr], join: Callable[..., Any] = sparse.vstack) -> Csr:
            return Csr(join(blocks, format="csr"))

        return cls(
            whole(one, "normal"),
            whole(one, "tangential"),
            Csr(sum((part.force for part in parts[1:]), start=parts[0].force)),
            whole(diagonal, "slip"),
            one([part.push for part in parts], sparse.hstack),
            whole(one, "pull"),
            whole(diagonal, "lean"),
            whole(diagonal, "swing"),
            whole(one, "turning"),
        )

    def among(self, ndofs: int, own: Sequence[slice]) -> RowsInMotion:
        """The same on the dofs of all bodies, of which these rows have the slices `own`."""
        place = np.concatenate([np.arange(part.start, part.stop) for part in own])
        E = Csr((np.ones(place.size), (np.arange(place.size), place)), shape=(place.size, ndofs))
        names = ("normal", "tangential", "pull", "turning")
        rows: dict[str, Any] = {name: Csr(getattr(self, name) @ E) for name in names}
        return replace(self, **rows, force=Csr(E.T @ self.force @ E), push=Csr(E.T @ self.push))

    @property
    def alone(self) -> RowsInMotion:
        """Without motions of the obstacle."""
        none = self.slip[:, :0], Csr(self.push[:, :0]), Csr(self.pull[:0]), self.lean[:0, :0]
        return replace(self, slip=none[0], push=none[1], pull=none[2], lean=none[3])


@dataclass(frozen=True)
class ToolRows:
    """The rows of a boundary at the displacement u opposite a tool, on the body's dofs."""

    points: BoundaryPoints
    own: ContactRows  # at rest: its normals m and tangents t0
    tool: Tool
    here: Array  # displacement of the points, (dim, n)
    before: Array  # that of the last step

    @classmethod
    def of(
        cls, points: BoundaryPoints, own: ContactRows, tool: Tool, u: Array, last: Array
    ) -> ToolRows:
        """The rows at u, `last` that of the last step, both (ndofs,); `own` are those at rest.
        Raises NotConverged where no closest point is unique."""
        here, before = ((points.N @ v.reshape(-1, len(points.x))).T for v in (u, last))
        return cls(points, own, tool, here, before)

    @cached_property
    def _entries(self) -> tuple[Index, Index]:
        """Point of the functional, and contact point, of each entry of P."""
        P = self.points.P
        return P.indices.astype(np.int64), np.repeat(np.arange(P.shape[0]), np.diff(P.indptr))

    @cached_property
    def _found(self) -> tuple[Array, Array]:
        return self.tool.distance(self.points.x + self.here)

    @cached_property
    def _n(self) -> Array:
        """Unit vectors towards the tool, (dim, n)."""
        return -self._found[1]

    @cached_property
    def _w(self) -> Array:
        """Velocities of the tool's points for unit changes of its pose, (dim, k, n)."""
        return self.tool.velocities(self.points.x + self.here)

    @cached_property
    def _turn(self) -> tuple[Array, Array]:
        """Rotation of the boundary since the last step, as a matrix and as a vector."""
        none = np.zeros_like(self.tool.spin)
        if not self.points.turns:
            return np.eye(len(self.here)), none
        turn = closest_rotation(self.points.x + self.before, self.points.x + self.here)
        found = turn_of(turn)
        return turn, none if found is None else found

    @cached_property
    def _slips(self) -> tuple[Array, Array, Array, Array]:
        """Slips s of the points, their positions relative to the tool's point, before, turned with
        the body, and on average, all (dim, n), and the tool's rotation relative to the body."""
        was, y = self.points.x + self.before, self.points.x + self.here
        turn, of_body = self._turn
        lag = self.tool.spin - of_body
        one, two = turn @ (was - self.tool.start[:, None]), y - self.tool.end[:, None]
        arm = 0.5 * (one + two)
        s, size = two - one - cross(lag, arm), np.abs(was).max() + np.abs(self.tool.start).max()
        s[np.abs(s) <= 4 * np.finfo(float).eps * size] = 0.0  # rounding of places
        return s, one, arm, lag

    @cached_property
    def _frames(self) -> tuple[Array, Array, Array, Array]:
        """m, n (dim, e) and tangents at rest and turned (dim, dim - 1, e), of entries of P."""
        entry, point = self._entries
        m, t0 = self.own.normals[:, point], self.own.tangents[:, :, point]
        n = self._n[:, entry]
        away = np.sum(m * n, axis=0) < -0.999  # opposite, where the rotation is not unique
        n = np.where(away, m, n)
        return m, n, t0, turned_tangents(t0, m, n)

    def _mean(self, values: Array) -> Array:
        """Means at the contact points of values at the entries of P, (..., e)."""
        P = self.points.P
        return np.asarray(np.add.reduceat(P.data * values, P.indptr[:-1], axis=-1))

    @cached_property
    def slip(self) -> Array:
        """Slip along the tool since the last step, shape (m, dim - 1)."""
        s = self._slips[0][:, self._entries[0]]
        return self._mean(np.einsum("dje,de->je", self._frames[3], s)).T

    @cached_property
    def normal(self) -> Array:
        """w_n of unit changes of the pose, shape (m, k)."""
        return self._mean(np.einsum("dn,dkn->kn", self._n, self._w)[:, self._entries[0]]).T

    @cached_property
    def tangent(self) -> Array:
        """w_t of unit changes of the pose, shape (m (dim - 1), k)."""
        w = self._w[:, :, self._entries[0]]
        t = self._mean(np.einsum("dje,dke->jke", self._frames[3], w))
        return np.asarray(t.transpose(2, 0, 1).reshape(-1, t.shape[1]))

    @cached_property
    def rows(self) -> ContactRows:
        """Rows and gap: ``gap - (G u - w_n)`` is the mean distance."""
        phi, (entry, _), P = self._found[0], self._entries, self.points.P
        known = np.isfinite(phi)
        off = np.where(known, phi, 0.0) + np.sum(self._n * self.here, axis=0)
        gap = self._mean(off[entry]) - self.normal @ self.tool.pose.motion
        gap[np.add.reduceat(~known[entry], P.indptr[:-1]) > 0] = np.inf
        n = self._mean(self._n[:, entry])
        size = np.linalg.norm(n, axis=0)
        n = np.where(size > 1e-3, n / np.maximum(size, 1e-3), self.own.normals)
        m = np.where(np.sum(n * self.own.normals, axis=0) < -0.999, n, self.own.normals)
        tangents = turned_tangents(self.own.tangents, m, n)
        G = self._spread(P.data * self._n[:, entry][None])
        T = self._spread(P.data * self._frames[3].transpose(1, 0, 2))
        return replace(self.own, G=G, T=T, gap=gap, normals=n, tangents=tangents)

    def worn(self, tools: WornTools, number: int, frame: Array) -> Array:
        """Depths that earlier steps took off the tool opposite the contact points, (m,)."""
        depth = tools.depth(number, self.tool.within(self._opposite, frame))
        return self._mean(depth[self._entries[0]])

    def wear(
        self, tools: WornTools, number: int, frame: Array, lost: Array, area: Array
    ) -> WornTools:
        """The tools after this one has lost more opposite the contact points, of areas (m,)."""
        entry, point = self._entries
        near = (self._found[0][entry] <= tools.cell) & (area[point] > 0)
        x = self.tool.within(self._opposite[:, entry[near]], frame)
        area = np.abs(self.points.P.data[near]) * area[point[near]]
        return tools.after(number, x, lost[point[near]], area)

    @property
    def _opposite(self) -> Array:
        """Closest points of the tool, (dim, n); the points themselves where there is none."""
        phi = self._found[0]
        return self.points.x + self.here + self._n * np.where(np.isfinite(phi), phi, 0.0)

    @property
    def distance(self) -> Array:
        """Mean distance of each contact point from the tool, shape (m,)."""
        return self._mean(self._found[0][self._entries[0]])

    @property
    def faces(self) -> NDArray[np.bool_]:
        """Contact points that the tool meets from outside the body, shape (m,)."""
        toward = np.sum(self._n * self.points.normals, axis=0)[self._entries[0]]
        return np.asarray(np.maximum.reduceat(toward, self.points.P.indptr[:-1]) > 0.0)

    @cached_property
    def _trace(self) -> Csr:
        """Displacement of the points by the dofs, component by component, (dim n, ndofs)."""
        return Csr(sparse.kron(self.points.N, np.eye(len(self.here)), format="csr"))

    def _spread(self, vectors: Array) -> Csr:
        """Rows of all dofs from vectors (j, dim, e) of entries of P, contact point by point."""
        (entry, point), (count, dim, _) = self._entries, vectors.shape
        row = count * point + np.arange(count)[:, None, None]
        column = dim * entry + np.arange(dim)[:, None]
        shape = count * self.points.P.shape[0], dim * self.here.shape[1]
        i, k = (np.broadcast_to(v, vectors.shape).ravel() for v in (row, column))
        rows = Csr(sparse.coo_array((vectors.ravel(), (i, k)), shape=shape) @ self._trace)
        rows.eliminate_zeros()
        return rows

    def derivative(self, mu: Array, t: Array) -> RowsInMotion:
        """Derivatives at the contact forces mu (m,) and t (m, dim - 1)."""
        (entry, point), P, (dim, size) = self._entries, self.points.P, self.here.shape
        H, n, w = self.tool.curvature(self.points.x + self.here), self._n, self._w
        turns = np.eye(w.shape[1] - dim)
        of_pose = np.einsum("abn,bkn->akn", H, w)  # derivative of n
        for i, v in enumerate(turns):
            of_pose[:, dim + i] += cross(v, n)
        D, tangents = self._turning, self._frames[3]
        # Forces f at the points, whose derivative is M times that of n.
        press, shear = P.data * mu[point], P.data * t.T[:, point]
        f = _at(press * n[:, entry] + np.einsum("je,dje->de", shear, tangents), entry, size)
        turned = np.einsum("je,jabe->abe", shear, D) + press * np.eye(dim)[:, :, None]
        M = _at(turned.reshape(dim * dim, -1), entry, size).reshape(dim, dim, size)
        of_u, of_a = -np.einsum("abn,bcn->acn", M, H), np.einsum("abn,bkn->akn", M, of_pose)
        tangential, slip = self._slip_derivative(H, of_pose)
        pull, lean = np.einsum("dkn,dbn->kbn", w, of_u), np.einsum("dkn,din->ki", w, of_a)
        for i, v in enumerate(turns):  # arms: f . (v x (dy - dc))
            pull[dim + i] -= cross(v, f)
            lean[dim + i, :dim] += cross(v, f).sum(axis=1)
        block = (of_u.transpose(2, 0, 1), np.arange(size), np.arange(size + 1))
        force = sparse.bsr_array(block, shape=(dim * size, dim * size))
        return RowsInMotion(
            Csr((mu.size, self._trace.shape[1])),
            tangential,
            Csr(self._trace.T @ (Csr(force) @ self._trace)),
            slip,
            Csr(self._trace.T @ of_a.transpose(2, 0, 1).reshape(dim * size, -1)),
            Csr(pull.transpose(0, 2, 1).reshape(-1, dim * size) @ self._trace),
            lean,
            *self._swing(),
        )

    def _swing(self) -> tuple[Array, Csr]:
        """`RowsInMotion.swing` and `turning`: with the boundary's centred places h before, turned,
        and g now, ``sum ((h . g) theta - (g . theta) h) = sum h x dy`` for a small rotation."""
        (_, of_body), (_, one, arm, lag) = self._turn, self._slips
        if not self.points.turns:
            return np.zeros((self.own.T.shape[0], 0)), Csr((0, self._trace.shape[1]))
        unit = np.eye(lag.size)
        way = [cross(_of_spin(of_body, v), arm) - cross(v, one) for v in unit]
        way = [s - 0.5 * cross(lag, cross(v, one)) for s, v in zip(way, unit, strict=True)]
        along = np.stack(way, axis=1)[:, :, self._entries[0]]
        swing = self._mean(np.einsum("dje,dre->jre", self._frames[3], along))
        h, _, weight = self._centred
        # (h x dy) . v = dy . (v x h)
        rows = np.linalg.solve(weight, self._whole([cross(v, h) for v in unit]))
        return swing.transpose(2, 0, 1).reshape(-1, len(unit)), Csr(Csr(rows) @ self._trace)

    @cached_property
    def _centred(self) -> tuple[Array, Array, Array]:
        """The places h and g of `_swing`, and the matrix of theta."""
        was, y, turn = self.points.x + self.before, self.points.x + self.here, self._turn[0]
        h, g = turn @ (was - was.mean(axis=1)[:, None]), y - y.mean(axis=1)[:, None]
        weight = np.sum(h * g) * np.eye(self.tool.spin.size)
        return h, g, weight - h @ g.T if len(h) == 3 else weight

    def _whole(self, vectors: Sequence[Array]) -> Array:
        return np.stack(vectors).transpose(0, 2, 1).reshape(len(vectors), -1)

    def by_last(self) -> tuple[Csr, Array]:
        """Derivatives of `slip` by the last step's displacement and pose, rows point by point."""
        (entry, _), tool, (turn, _) = self._entries, self.tool, self._turn
        (_, _, arm, lag), tangents, (_, g, weight) = self._slips, self._frames[3], self._centred
        before = -(np.eye(len(g)) + 0.5 * cross(lag, np.eye(len(g)))) @ turn
        by_was = self._spread(self.points.P.data * np.einsum("dje,db->jbe", tangents, before))
        if self.points.turns:  # (R dw x g) . v = dw . R^T (g x v)
            rows = self._whole([-turn.T @ cross(v, g) for v in np.eye(lag.size)])
            turning = Csr(Csr(np.linalg.solve(weight, rows)) @ self._trace)
            by_was = Csr(by_was + Csr(self._swing()[0]) @ turning)
        place = tool.centre + tool.last.motion[: len(g)]
        found = []
        for k in range(tool.pose.motion.size):
            ways = -before @ rate(k, (tool.start - place)[:, None])
            v = np.eye(tool.pose.motion.size)[k, len(g) :]
            if v.any():  # the rotation since then is the smaller
                v = v if v.size == 1 else tool.pose.turn @ tool.last.turn.T @ v
                ways = ways - cross(-_of_spin(tool.spin, v), arm)
            ways = np.broadcast_to(ways, arm.shape)[:, entry]
            found.append(self._mean(np.einsum("dje,de->je", tangents, ways)).T.ravel())
        return by_was, np.array(found).T

    def _slip_derivative(self, H: Array, of_pose: Array) -> tuple[Csr, Array]:
        """`RowsInMotion.tangential` and `slip`: of B (dy - w(end)) - dspin x arm along t, and of
        the slip along tangents that turn."""
        entry, P, w, tool = self._entries[0], self.points.P, self._w, self.tool
        (s, _, arm, lag), tangents, dim = self._slips, self._frames[3], len(H)
        half = -0.5 * cross(lag, np.eye(dim))  # B - 1
        along = np.einsum("de,jdbe->jbe", s[:, entry], self._turning)
        by_u = np.einsum("dje,db->jbe", tangents, half)
        by_u -= np.einsum("jbe,bce->jce", along, H[:, :, entry])
        ends = tool.velocities(tool.end[:, None])[:, :, 0]
        moved = w - ((half + np.eye(dim)) @ ends)[:, :, None]
        for i, v in enumerate(np.eye(w.shape[1] - dim)):
            moved[:, dim + i] -= cross(_of_spin(tool.spin, v), arm)
        by_a = np.einsum("dje,dke->jke", tangents, moved[:, :, entry])
        by_a += np.einsum("jbe,bke->jke", along, of_pose[:, :, entry])
        slip = self._mean(by_a).transpose(2, 0, 1).reshape(-1, w.shape[1])
        return self._spread(P.data * by_u), slip

    @cached_property
    def _turning(self) -> Array:
        """Derivatives of the tangents by n, shape (dim - 1, dim, dim, e)."""
        m, n, t0, _ = self._frames
        size, steep = 1.0 + np.sum(m * n, axis=0), np.einsum("de,dje->je", n, t0)
        both = (m + n) / size
        turn = np.einsum("je,ae,be->jabe", steep / size, both, m)
        turn -= np.einsum("ae,bje->jabe", both, t0)
        return turn - np.einsum("je,ab->jabe", steep / size, np.eye(len(m)))


def _at(values: Array, entry: Index, size: int) -> Array:
    """Sums of values (k, e) of entries at the points of the functional, (k, n)."""
    return np.array([np.bincount(entry, v, size) for v in values])


def _of_spin(spin: Array, v: Array) -> Array:
    r"""Change of a rotation vector :math:`\omega` by a small rotation v after it,
    :math:`v - \omega \times v / 2 + (1 - \alpha \cot \alpha) \, \omega \times (\omega \times v)
    / \omega^2` with :math:`\alpha = |\omega| / 2`."""
    if spin.size == 1:
        return v
    half, across = 0.5 * float(np.linalg.norm(spin)), np.cross(spin, v)
    # At whole turns, where the quotient has a pole, its limit at rest.
    curved = half > 1e-4 and abs(np.sin(half)) > 1e-2
    factor = (1.0 - half / np.tan(half)) / (4.0 * half**2) if curved else 1.0 / 12.0
    return np.asarray(v - 0.5 * across + factor * np.cross(spin, across))
