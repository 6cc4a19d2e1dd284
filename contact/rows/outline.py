"""How the facets of a boundary meet: angles, corners, and smooth normals.

The normals of straight facets along a curve jump at every vertex. Normal displacement and gap use
facet normals: a uniform pressure is then exact on the polygon. Slip uses smooth tangents: with
facet tangents a uniformly shrinking polygon would show alternating slip. With the weights of N. Max
(J. Graphics Tools 4, 1999) vertex normals are exact on circles and spheres."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.deferred_basis import edges_of_facets
from contact.body.elastic_body import ElasticBody
from contact.errors import InputError
from contact.facet_basis import places_on_facets
from skfem_adini.conditions.trace_directions import CORNER, corner_weights

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Sine of the largest angle between a normal and a plane of symmetry: half that to its mirror image.
NEARLY = np.sin(0.5 * CORNER)


@dataclass(frozen=True)
class Outline:
    """Facets of a contact boundary, their normals, and how they meet."""

    body: ElasticBody
    facets: Index  # shape (nfacets,)

    @cached_property
    def corners(self) -> Index:
        """Mesh vertices of each facet, in ring order, shape (nfacets, ncorners)."""
        return np.asarray(self.body.mesh.facets[:, self.facets].T, dtype=np.int64)

    def normals(self, points: Array) -> Array:
        """Outward unit normals at points (dim - 1, n) of the reference facet, (dim, nfacets, n)."""
        mapping, mesh = self.body.basis.mapping, self.body.mesh
        cells, inside = mesh.f2t[0, self.facets], places_on_facets(mesh, self.facets, points)
        return np.asarray(mapping.normals(inside, cells, self.facets, mesh.t2f))

    @cached_property
    def at_corners(self) -> Array:
        """Normals of each facet at its corners, shape (dim, nfacets, ncorners)."""
        return self.normals(reference_corners(self.body.dim, self.corners.shape[1]))

    @cached_property
    def scalar_dofs(self) -> Index:
        """Dofs of a scalar function on each facet, its edges and its vertices, (nfacets, ndofs)."""
        dofs, mesh = self.body.scalar_dofs, self.body.mesh
        held = [(dofs.nodal_dofs, self.corners.T), (dofs.facet_dofs, self.facets)]
        if self.body.dim == 3 and len(dofs.edge_dofs):
            held.append((dofs.edge_dofs, edges_of_facets(mesh, self.facets)))
        tables = [table[:, of] for table, of in held if len(table)]
        return np.vstack([table.reshape(-1, self.facets.size) for table in tables]).T

    @cached_property
    def _vertices(self) -> tuple[Index, Index]:
        vertex, place = np.unique(self.corners, return_inverse=True)
        return vertex, place.reshape(self.corners.shape)

    @cached_property
    def parted(self) -> Index:
        """Numbers of the vertices of each facet, shape as `corners`, from zero; facets that meet at
        a sharp angle have vertices of their own there."""
        normals, slot = self.at_corners.reshape(self.body.dim, -1), np.arange(self.corners.size)
        at = sparse.csr_array((np.ones(slot.size), (self._vertices[1].ravel(), slot)))
        pair = (at.T @ at).tocoo()
        smooth = np.sum(normals[:, pair.row] * normals[:, pair.col], axis=0) > np.cos(CORNER)
        linked = sparse.coo_array(
            (smooth[smooth], (pair.row[smooth], pair.col[smooth])), pair.shape
        )
        labels = sparse.csgraph.connected_components(linked, directed=False)[1]
        return np.asarray(labels, dtype=np.int64).reshape(self.corners.shape)

    @cached_property
    def turned(self) -> Array:
        """Smooth normals at facet corners, at sharp ones the facet's; shape as `at_corners`."""
        return self.averaged(self.at_corners, self.body.mesh.p[:, self.corners])

    def averaged(self, own: Array, corners: Array) -> Array:
        """Smooth normals at facet corners, at sharp ones the facet's; shape as `at_corners`.
        `own` are the facet normals, `corners` the current coordinates, (dim, nfacets, ncorners)."""
        vertex, place = self._vertices
        weight = corner_weights(corners, axis=2)
        mean = _unit_sums(weight * own, place, vertex.size)
        sharp = _sharp(own.reshape(own.shape[0], -1), place.ravel(), vertex.size)
        mean = self._within_supports(mean, vertex)
        return np.where(sharp[place], own, mean[:, place])

    def averaging(self, own: Array, corners: Array) -> tuple[sparse.csr_array, NDArray[np.bool_]]:
        """Derivative of averaged normals with respect to the normals `own`, and free components.
        Its order is nfacets * ncorners; the part along the averaged normal is not yet removed. Free
        components (dim, nfacets, ncorners) are not zero by symmetry. Arguments as of `averaged`."""
        vertex, place = self._vertices
        weight, at = corner_weights(corners, axis=2).ravel(), place.ravel()
        total = [np.bincount(at, weight * c.ravel(), vertex.size) for c in own]
        size = np.linalg.norm(total, axis=0)
        sharp = _sharp(own.reshape(own.shape[0], -1), at, vertex.size)[at]
        index = np.arange(at.size)
        to_vertex = sparse.coo_array((weight, (at, index)), shape=(vertex.size, at.size))
        share = np.where(sharp, 0.0, 1.0 / np.where(size > 0, size, 1.0)[at])
        back = sparse.coo_array((share, (index, at)), shape=(at.size, vertex.size))
        mean = sparse.csr_array(back @ to_vertex) + sparse.diags_array(sharp.astype(float))
        unit = np.array(total) / np.where(size > 0, size, 1.0)
        free = ~self._within_a_plane(unit, vertex)
        return sparse.csr_array(mean), free[:, place] | sharp.reshape(place.shape)

    @cached_property
    def curved(self) -> NDArray[np.bool_]:
        """Whether a facet approximates a piece of a curve or curved surface, shape (nfacets,)."""
        tilt = np.maximum(*self._tilts)
        return np.asarray((tilt > 0.5 * 1e-3).any(axis=1))  # smaller angles (rad) are noise

    @cached_property
    def _tilts(self) -> tuple[Array, Array]:
        """Distances of corner normals from the smooth ones, and from the normal in the middle."""
        middle = self.normals(
            reference_corners(self.body.dim, self.corners.shape[1]).mean(1)[:, None]
        )
        smooth, within = self.turned - self.at_corners, middle - self.at_corners
        return np.linalg.norm(smooth, axis=0), np.linalg.norm(within, axis=0)

    @cached_property
    def continued(self) -> NDArray[np.bool_]:
        """Corners (2-D) with one adjacent facet and no sharp angle, (nfacets, ncorners)."""
        vertex, place = self._vertices
        met = np.bincount(place.ravel(), minlength=vertex.size)
        bend = np.zeros((self.body.dim, vertex.size))
        for c in range(self.body.dim):
            np.add.at(bend[c], place, self.at_corners[c])
        # The length of a sum of unit vectors is twice the cosine of half their angle.
        sharp = np.linalg.norm(bend, axis=0) < 2 * np.cos(0.5 * CORNER)
        return np.asarray((met == 2) & ~sharp)[place]

    @cached_property
    def beyond(self) -> tuple[Index, Index]:
        """The facet beyond each continued corner, and its corner there; -1 elsewhere."""
        _, place = self._vertices
        facet, corner = np.full((2, *place.shape), -1)
        order = np.argsort(place.ravel(), kind="stable")
        here = order[self.continued.ravel()[order]]
        one, two = here[::2], here[1::2]
        for a, b in ((one, two), (two, one)):
            facet.ravel()[a], corner.ravel()[a] = np.divmod(b, place.shape[1])
        return facet, corner

    def smooth(self, normals: Array, points: Array) -> Array:
        """Smooth normals at points (dim - 1, n), from those of the facets (dim, nfacets, n).
        The interpolated difference between smooth and facet normals at the corners is added."""
        change = (self.turned - self.at_corners) @ hats(points, self.corners.shape[1])
        result: Array = normals + change
        return result / np.linalg.norm(result, axis=0)

    def mean_normals(
        self, points: Array, number: Index, size: Array
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Normals of contact points that facets share: smooth unit means, own means, where sharp.
        Own means, (dim, m), are shorter than one where facet normals differ; `number` (nfacets,
        nvalues) is -1 for none, `size` are weights. Raises InputError for opposite normals."""
        used, own = number >= 0, self.normals(points)
        at, count = number[used], int(number.max()) + 1

        def mean(v: Array) -> Array:
            total = [np.bincount(at, (size * c)[used], count) for c in v]
            return np.array(total) / np.bincount(at, size[used], count)

        normals = mean(self.smooth(own, points))
        length = np.linalg.norm(normals, axis=0)
        if np.any(length < 1e-9):  # opposite unit vectors
            raise InputError("boundary: facets with opposite normals meet at a contact point")
        normals /= length
        sharp = _sharp(own[:, used], at, count)
        return normals, np.where(sharp, normals, mean(own)), sharp

    @cached_property
    def bent(self) -> NDArray[np.bool_]:
        """Straight facets whose smooth normals diverge, or converge, at all corners, (nfacets,).
        They approximate a curve; facets next to a flat side, noisy or curved ones do not. A body
        may hold what was found before its vertices moved, a mask of all facets."""
        held: NDArray[np.bool_] | None = vars(self.body).get("_bent")
        if held is not None:
            return held[self.facets]
        corner, change = self.body.mesh.p[:, self.corners], self.turned - self.at_corners
        lean = np.sum(change * (corner - corner.mean(axis=2, keepdims=True)), axis=0)
        # The same sign at all corners, and none below a quarter of the largest.
        bent = np.abs(lean.sum(axis=1)) > 0.999 * np.abs(lean).sum(axis=1)
        bent &= np.abs(lean).min(axis=1) > 0.25 * np.abs(lean).max(axis=1)
        between, within = (tilt.max(axis=1) for tilt in self._tilts)
        return np.asarray(bent & (within < 0.5 * between))

    def raised(self, x: Array, points: Array) -> Array:
        """Points on the smooth surface above points x (dim, nfacets, n) of `bent` facets.
        The height is half the hat-weighted mean of the tangent planes' heights at the corners,
        exact to second order on circles and spheres."""
        corner, change = self.body.mesh.p[:, self.corners], self.turned - self.at_corners
        bent = self.bent
        own = np.einsum("cfk,cfp->fkp", change, x) - np.sum(change * corner, axis=0)[..., None]
        height = -0.5 * np.sum(own * hats(points, corner.shape[2]), axis=1)
        return np.asarray(x + self.normals(points) * np.where(bent[:, None], height, 0.0))

    def _within_supports(self, normals: Array, vertex: Index) -> Array:
        """Turn vertex normals (dim, n) near a plane of symmetry exactly into it.
        See `contact.rows.frames.within_supports`."""
        turned = np.where(self._within_a_plane(normals, vertex), 0.0, normals)
        size = np.linalg.norm(turned, axis=0)
        return turned / np.where(size > 0, size, 1.0)

    def _within_a_plane(self, normals: Array, vertex: Index) -> NDArray[np.bool_]:
        """Components of vertex normals that vanish at planes of symmetry, (dim, n)."""
        body = self.body
        P, value = body.constraint[0], body.scalar_dofs.nodal_dofs[0, vertex]
        dofs = body.dim * value + np.arange(body.dim)[:, None]
        return np.asarray((np.diff(P.indptr)[dofs] == 0) & (np.abs(normals) < NEARLY))


def _unit_sums(v: Array, at: Index, count: int) -> Array:
    """Sums of the vectors of each index, scaled to unit length; zero where they cancel."""
    total = np.array([np.bincount(at.ravel(), c.ravel(), count) for c in v])
    scale = np.bincount(at.ravel(), np.linalg.norm(v, axis=0).ravel(), count)
    size = np.linalg.norm(total, axis=0)
    return total / np.where(size > 1e-9 * scale, size, np.inf)


def _sharp(normals: Array, at: Index, count: int) -> NDArray[np.bool_]:
    """Whether any two of the facets that meet form an angle larger than `CORNER`.
    Angles to the mean normal are unsuitable: it is dominated by small facets."""
    order = np.argsort(at, kind="stable")
    at, normals = at[order], normals[:, order]
    sharp, limit = np.zeros(count, dtype=bool), np.cos(CORNER)
    for ahead in range(1, int(np.bincount(at).max())):
        turn = np.sum(normals[:, ahead:] * normals[:, :-ahead], axis=0)
        sharp[at[ahead:][(at[ahead:] == at[:-ahead]) & (turn < limit)]] = True
    return sharp


def reference_corners(dim: int, count: int) -> Array:
    """Corners of the reference facet in ring order, shape (dim - 1, count)."""
    if dim == 2:
        return np.array([[0.0, 1.0]])
    ring = np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]])
    return ring if count == 4 else ring[:, [0, 1, 3]]


def hats(points: Array, count: int) -> Array:
    """Hat functions of the corners at points of the reference facet, shape (count, n)."""
    if points.shape[0] == 1:
        return np.vstack((1 - points[0], points[0]))
    x, y = points
    if count == 3:
        return np.array([1 - x - y, x, y])
    return np.array([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y])
