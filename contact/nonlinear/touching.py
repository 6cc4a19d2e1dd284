r"""Contact rows at the current positions, with their derivatives.

Opposite a rigid obstacle with the signed distance g the contact points are the nodes,

.. math:: g_k = g(x_k + u_k), \qquad n = -\nabla g, \qquad w_k = \int N_k ,

with weights over the undeformed area: the forces are derivatives of :math:`\sum \mu_k g_k`, and
those of a uniform pressure are exact. Elements with a node of no weight (P2 on faces, and on the
axis of a ring) or with derivatives as dofs take the means of g, weighted by the hat functions of
the vertices, at sharp edges by those of each side. Between bodies they are
`Interfaces.displaced`.

P. Wriggers, Computational Contact Mechanics, 2nd ed., Springer 2006, chapters 4 and 9."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.errors import InputError
from contact.facet_basis import facet_basis
from contact.nonlinear.cell_forces import cofactor
from contact.nonlinear.stress_forces import deformed, functions_of
from contact.obstacles.rigid import Rigid
from contact.obstacles.rigid_motion import motion_between, said_motion, unknown_motion
from contact.rows.contact_boundaries import friction_values
from contact.rows.contact_boundaries import joined as rows_joined
from contact.rows.contact_rows import ContactRows
from contact.rows.frames import by_point, scaled, tangent_frame
from contact.rows.interfaces import Interfaces
from contact.rows.outline import Outline, hats

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Csr = sparse.csr_array


@dataclass(frozen=True, kw_only=True, repr=False)
class Touch(ContactRows):
    """Rows of m contact points at a displacement, on the dofs of all bodies.
    Gap, places and normals are current ones; weights are current areas, between bodies undeformed
    ones; tangents are those of the rows."""

    slip: Array  # relative to the obstacle since the last step, (m, dim - 1)
    tilted: Csr  # derivative of the normal displacement by the change of G, as G
    turned: Csr  # derivative of `slip` by the change of T, as T
    force: Csr  # derivative of G^T mu + T^T t at fixed mu and t, (ndofs, ndofs)
    friction: Array  # coefficients, (m,)

    @property
    def area(self) -> Array:
        """Area of each point, shape (m,)."""
        return self.weights


class RigidSide:
    """A boundary of body `number` of several opposite a rigid obstacle, boundary `part`."""

    def __init__(
        self, bodies: Any, number: int, boundary: Any, friction: Any, part: int = 0
    ) -> None:
        body, self._own = bodies.bodies[number], bodies.slices[number]
        facets, mesh = body.whole_facets(boundary), body.mesh
        self.body, self._total = body, bodies.slices[-1].stop
        self._number, self._part = number, part
        order = 2 * body.element.maxdeg + 2
        scalar = facet_basis(mesh, body.element, facets, intorder=order, dofs=body.scalar_dofs)
        element, dofs = body.basis.elem, body.basis.dofs
        whole = facet_basis(mesh, element, facets, intorder=order, dofs=dofs)
        x = np.asarray(scalar.global_coordinates())
        values, self._slope = functions_of(whole)
        self._hoop = values / x[0] if body.is_ring else None
        self._facet_dofs, self._facet_normals = whole.element_dofs, np.asarray(whole.normals)
        dA = (scalar.dx * body.depth(x)).ravel()
        trace = _trace(scalar)
        touched = np.unique(trace.indices)
        self._share = Csr((trace.T @ sparse.diags_array(dA))[touched])  # N_k dA
        self.weights = np.asarray(self._share.sum(axis=1)).ravel()
        if body.are_values.all() and self.weights.min() > 1e-6 * self.weights.max():
            self._X = body.basis.doflocs[:, body.dim * touched]
            rows, self._functional = sparse.eye_array(touched.size, format="csr"), "nodal"
            self.mean, trace = (
                Csr(rows),
                Csr(sparse.eye_array(trace.shape[1], format="csr")[touched]),
            )
        else:
            self._X, self._functional = x.reshape(body.dim, -1), "hat"
            self._share = _hats(Outline(body, facets).parted.T, scalar, dA)
            self.weights = np.asarray(self._share.sum(axis=1)).ravel()
            self.mean = scaled(1.0 / self.weights, self._share)
        self._trace = trace
        self._of_rows = _Pattern(self.mean, trace)  # mean of directions times functions
        self._of_pairs = _Pattern(Csr(trace.T), trace)
        self.friction = friction_values(friction, self.mean_of(self._X))
        self.size = float(np.ptp(mesh.p, axis=1).max())

    def mean_of(self, values: Array) -> Array:
        """Weighted means at the contact points, (n, m), of values (n, npoints)."""
        return np.asarray((self.mean @ values.T).T)

    def _moved(self, u: Array) -> Array:
        return np.asarray((self._trace @ u[self._own].reshape(-1, self.body.dim)).T)

    def at(
        self, u: Array, last: Array, forces: tuple[Array, Array], obstacle: Any, said: Any
    ) -> Touch:
        """Rows at u; `obstacle` is the one of the last step and the present one."""
        mu, t = forces
        before, now = obstacle
        y, dim = self._X + self._moved(u), self.body.dim
        gap, frames = _frames(now, y)
        turn = _turning(now, y, 1e-6 * self.size)
        slip = self._moved(u - last) - self._travel(before, now, said, y)
        G, *T = (self._rows(frames[k]) for k in range(dim))
        # d tau / d y_i . slip
        turned = [self._rows(np.einsum("icq,cq->iq", turn[:, k], slip)) for k in range(1, dim)]
        at_points = self.mean.T @ np.column_stack((mu, t))
        stiff = np.einsum("ikcq,qk->ciq", turn, at_points)
        slips = np.stack([self.mean @ (frames[k] * slip).sum(axis=0) for k in range(1, dim)], 1)
        means = np.array([self.mean_of(frame) for frame in frames])
        stretched = self._stretched(u)
        outward = stretched @ self._share.T
        m, x = len(mu), self.mean_of(y)
        return Touch(
            G=G,
            T=T[0] if dim == 2 else by_point(T),
            gap=np.asarray(self.mean @ gap),
            weights=np.linalg.norm(stretched, axis=0) @ self._share.T,
            x=x,
            x_nominal=x,
            normals=outward / np.linalg.norm(outward, axis=0),
            tangents=(means[1:] / np.linalg.norm(means[1:], axis=1)[:, None]).transpose(1, 0, 2),
            functional=self._functional,
            part=np.full(m, self._part),
            bonded=np.zeros(m, dtype=bool),
            owner=np.full(m, self._number),
            axes=means.transpose(2, 0, 1),
            slip=slips,
            tilted=Csr(G.shape),
            turned=turned[0] if dim == 2 else by_point(turned),
            force=self._force(stiff),
            friction=self.friction,
        )

    def _rows(self, directions: Array) -> Csr:
        """Mean displacement along directions (dim, npoints), shape (m, ndofs)."""
        pattern, dim, m = self._of_rows, self.body.dim, self.weights.size
        if not directions.any():
            return Csr((m, self._total))
        column = self._own.start + dim * pattern.column[:, None] + np.arange(dim)
        data = pattern.weights @ directions.T
        found = Csr((data.ravel(), column.ravel(), dim * pattern.ends), shape=(m, self._total))
        found.eliminate_zeros()
        return found

    def _force(self, stiff: Array) -> Csr:
        """Sum of phi_c^T stiff_ci phi_i, for stiff of shape (dim, dim, npoints)."""
        if not stiff.any():
            return Csr((self._total, self._total))
        pattern, dim = self._of_pairs, self.body.dim
        row = np.repeat(np.arange(pattern.ends.size - 1), np.diff(pattern.ends))
        data = pattern.weights @ stiff.reshape(dim * dim, -1).T
        c, i = np.divmod(np.arange(dim * dim), dim)
        place = (self._own.start + dim * n[:, None] + k for n, k in ((row, c), (pattern.column, i)))
        coo = (data.ravel(), tuple(part.ravel() for part in place))
        found = Csr(sparse.coo_array(coo, shape=(self._total, self._total)))
        found.eliminate_zeros()
        return found

    def _stretched(self, u: Array) -> Array:
        """Outward normals of the current facets, as long as current over undeformed area."""
        C, N = (
            cofactor(deformed(u[self._own][self._facet_dofs], self._slope, self._hoop)),
            self._facet_normals,
        )
        along = np.einsum("ijeq,jeq->ieq", C[: len(N), : len(N)], N)
        return np.asarray(along.reshape(len(N), -1))

    def _travel(self, before: Any, now: Any, said: Any, y: Array) -> Array:
        """Displacement of the obstacle's surface since the last step at places y."""
        dim = self.body.dim
        given = said_motion(said, dim)
        if given is not None:
            return np.broadcast_to(given[:, None], y.shape)
        motion = None if now is before else motion_between(before, now)
        if motion is None and now is not before and np.any(self.friction > 0):
            raise unknown_motion(before, now)
        if motion is None or motion.still:
            return np.zeros_like(y)
        off = y - motion.about[:, None]
        turn = motion.rotation
        spin = np.array([-off[1], off[0]]) * turn if dim == 2 else np.cross(turn, off.T).T
        return np.asarray(motion.translation[:, None] + spin)


class _Pattern:
    """A matrix L diag(d) R as a function of d (n,): its entries are `weights` @ d."""

    def __init__(self, L: Csr, R: Csr) -> None:
        count = np.diff(R.indptr)[L.indices]  # entries of R behind each one of L
        entry = np.repeat(R.indptr[L.indices] - np.cumsum(count) + count, count)
        entry += np.arange(entry.size)
        row, point = (
            np.repeat(part, count)
            for part in (np.repeat(np.arange(L.shape[0]), np.diff(L.indptr)), L.indices)
        )
        keys, place = np.unique(row * R.shape[1] + R.indices[entry], return_inverse=True)
        values = np.repeat(L.data, count) * R.data[entry]
        at: Any = place, point
        self.weights = Csr(sparse.coo_array((values, at), shape=(keys.size, L.shape[1])))
        self.column = keys % R.shape[1]
        self.ends = np.searchsorted(keys, R.shape[1] * np.arange(L.shape[0] + 1))


def _trace(scalar: Any) -> Csr:
    """Values of the scalar functions at the points of a facet basis, (npoints, scalar dofs)."""
    values = np.stack([np.broadcast_to(np.asarray(f[0]), scalar.dx.shape) for f in scalar.basis])
    point = np.broadcast_to(np.arange(scalar.dx.size).reshape(scalar.dx.shape), values.shape)
    column = np.broadcast_to(np.asarray(scalar.element_dofs)[:, :, None], values.shape)
    keep = np.abs(values) > 1e-13  # functions that vanish on the facet, up to rounding
    size = scalar.dx.size, scalar.dofs.N
    return Csr(sparse.coo_array((values[keep], (point[keep], column[keep])), shape=size))


def _hats(corners: Index, scalar: Any, dA: Array) -> Csr:
    """Hat functions of the vertices of facets, times area, at the points, (vertices, npoints)."""
    vertices, number = np.unique(corners, return_inverse=True)
    values = hats(np.asarray(scalar.quadrature[0]), len(corners))
    shape = (len(corners), *scalar.dx.shape)
    row = np.broadcast_to(number.reshape(corners.shape)[:, :, None], shape)
    column = np.broadcast_to(np.arange(dA.size).reshape(scalar.dx.shape), shape)
    weighted = (values[:, None] * dA.reshape(scalar.dx.shape)).ravel()
    place = row.ravel(), column.ravel()
    return Csr(sparse.coo_array((weighted, place), shape=(vertices.size, dA.size)))


def _frames(obstacle: Any, y: Array) -> tuple[Array, Array]:
    """Gap (npoints,), and normal and tangents (dim, dim, npoints) at places y."""
    gap, gradient = obstacle.distance(y)
    n = -np.asarray(gradient)
    n = n / np.linalg.norm(n, axis=0)
    return np.asarray(gap), np.concatenate((n[None], tangent_frame(n).transpose(1, 0, 2)))


def _turning(obstacle: Any, y: Array, h: float) -> Array:
    """Derivatives of the frames in y by central differences, (dim, dim, dim, npoints).
    Axes: direction of the change, vector of the frame, component. Zero at edges of obstacles."""
    found = []
    for i in range(len(y)):
        step = np.zeros((len(y), 1))
        step[i] = h
        found.append((_frames(obstacle, y + step)[1] - _frames(obstacle, y - step)[1]) / (2 * h))
    turn = np.array(found)
    size = np.abs(turn).max(axis=(0, 1, 2)) * h
    # A turn by 1e-3 within h is an edge; one by 1e-13 is rounding.
    turn[..., (size > 1e-3) | (size < 1e-13)] = 0.0
    return turn


def checked_obstacle(obstacle: Any) -> Any:
    """The obstacle, or InputError if it has no distance, as numbers and functions of x."""
    if isinstance(obstacle, Rigid):
        raise InputError(
            "obstacle: a Rigid moves by small displacements; in large strain let the obstacle be "
            "a function of time, stepper.obstacle(lambda t: Moved(tool, (0.0, -t)))"
        )
    if not hasattr(obstacle, "distance"):
        raise InputError(
            f"obstacle: expected a shape with a place, such as Plane, Cylinder or SignedDistance; "
            f"a {type(obstacle).__name__} says the gap at undeformed points only"
        )
    return obstacle


class ElasticSides:
    """The pairs of deformable bodies of a problem, projected anew at each displacement."""

    def __init__(self, interfaces: Interfaces, parts: list[int]) -> None:
        self._interfaces, self._parts = interfaces, np.array(parts)

    def at(self, u: Array, last: Array, forces: tuple[Array, Array]) -> Touch:
        """Rows at u; derivatives are zero if `forces` are those of fewer points."""
        here = self._interfaces.displaced(u)
        rows, m, dim = here.rows, here.rows.gap.size, len(here.rows.normals)
        mu, t = forces[0][:m], forces[1][:m]
        N, ties = u.size, rows.ties
        tilted, turned, force = Csr(rows.G.shape), Csr(rows.T.shape), Csr((N, N))
        if m == mu.size and not ties.any():
            change = here.in_motion(u, last, mu, t, [None] * len(here.sides))
            if change is not None:
                tilted, turned, force = change.normal, change.tangential, change.force
        since = np.where(np.repeat(ties, dim - 1), rows.T @ u, rows.T @ (u - last))
        own = {f.name: getattr(rows, f.name) for f in fields(ContactRows)}
        own |= {"gap": rows.gap - rows.G @ u, "part": self._parts[rows.part], "bonded": ties}
        return Touch(
            **own,
            slip=since.reshape(m, dim - 1),
            tilted=tilted,
            turned=turned,
            force=force,
            friction=here.friction(None),
        )


def joined(parts: list[Touch]) -> Touch:
    """The rows of several sides, one after the other."""
    if len(parts) == 1:
        return parts[0]
    stacked: dict[str, Any] = {
        name: Csr(sparse.vstack([getattr(p, name) for p in parts], format="csr"))
        for name in ("tilted", "turned")
    } | {name: np.concatenate([getattr(p, name) for p in parts]) for name in ("slip", "friction")}
    force = sum((p.force for p in parts[1:]), start=parts[0].force)
    part = np.concatenate([p.part for p in parts])
    return replace(rows_joined(parts), **stacked, force=Csr(force), part=part)
