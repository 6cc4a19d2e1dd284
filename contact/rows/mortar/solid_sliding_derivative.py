r"""Derivatives of contact rows in space with respect to the displacements.

An integration point keeps its place X on the non-mortar side. When the bodies move, its normal n
turns by :math:`\delta n`, and the place Y that it faces slides over the mortar side, so that y - x
remains along n. With tangents :math:`p_b` across n, :math:`\tau_a = \partial y / \partial Y_a`, the
gap g and changes :math:`\delta` at fixed Y,

.. math::
    \sum_a (p_b \cdot \tau_a) \, \delta Y_a = p_b \cdot (\delta x - \delta y + g \, \delta n),
    \qquad \delta g = n \cdot (\delta y - \delta x) + \sum_a (n \cdot \tau_a) \, \delta Y_a .

Polygons are not differentiated: the motion of their corners enters with the gap, which is zero in
contact. Tangents turn with their normals, and about them, as `contact.rows.frames.tangent_frame`
does. Whole linearisation: M. A. Puso and T. A. Laursen, Comput. Methods Appl. Mech. Engrg. 193
(2004); A. Popp, M. Gitterle, M. W. Gee and W. A. Wall, Int. J. Numer. Meth. Engng 83 (2010)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.rows.frames import tangent_frame, turned_tangents
from contact.rows.mortar.displaced import displaced_maps, trace_of_nodes
from contact.rows.mortar.face_maps import FaceMaps, shapes
from contact.rows.mortar.interface_rows import MortarRows
from contact.rows.mortar.sliding_derivative import SlidingDerivative
from contact.rows.mortar.solid_interface import SolidInterface
from contact.rows.mortar.trace_fields import along, scaled, values
from contact.rows.outline import Outline, hats, reference_corners

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Csr = sparse.csr_array

_TILT = 1e-5  # step of normals in central differences


def solid_sliding_derivative(
    interface: SolidInterface,
    found: MortarRows,
    displacements: tuple[Array, Array],
    increments: tuple[Array, Array],
    forces: tuple[Array, Array],
) -> SlidingDerivative:
    """Differentiate rows in space; arguments as of `SlidingDerivative.of`, t of shape (m, 2)."""
    places = _Places.of(interface, found, displacements)
    (du, dv), (mu, t) = increments, forces
    n, p, here, there = found.quadrature.n, places.p, places.here, places.there
    inverse = np.linalg.inv(np.einsum("dbn,dan->nba", p, places.tau))
    # dY_a = reach_a . (dx - dy + g dn).
    reach = np.einsum("nab,dbn->dan", inverse, p)
    run = [places.run(reach[:, a]) for a in (0, 1)]
    steep = np.einsum("dn,dan->an", n, places.tau)
    normal = found.P @ sum((scaled(-steep[a], run[a]) for a in (0, 1)), start=0.0 * run[0])
    slip = values(here, du, 3) - values(there, dv, 3)
    against, carried = np.sum(n * slip, axis=0), [values(ahead, dv, 3) for ahead in places.ahead]
    across = []
    for b in (0, 1):
        change = scaled(-against, places.turn[b])
        for a in (0, 1):
            change = change - scaled(np.sum(p[:, b] * carried[a], axis=0), run[a])
        across.append(change)
    frames = _frames(found, p)
    T = Csr(sparse.hstack((found.rows.T, found.other_T), format="csr"))
    spin = _spin(found, places)
    since = (T @ np.concatenate(increments)).reshape(-1, 2)
    tangential = [
        frames[j][0] @ across[0] + frames[j][1] @ across[1] + scaled(sign * since[:, 1 - j], spin)
        for j, sign in ((0, 1.0), (1, -1.0))
    ]
    together = np.arange(2 * mu.size).reshape(2, mu.size).T.ravel()
    normal_force = found.P.T @ mu
    shear = np.array([sum(frames[j][b].T @ t[:, j] for j in (0, 1)) for b in (0, 1)])
    whole = n * normal_force + np.einsum("bn,dbn->dn", shear, p)
    of_first = Csr((3 * here.shape[1], run[0].shape[1]))
    of_second = Csr((3 * there.shape[1], run[0].shape[1]))
    for k in (0, 1):
        turned = normal_force * p[:, k] - shear[k] * n
        of_first = of_first + along(here, turned).T @ places.turn[k]
        of_second = of_second - along(there, turned).T @ places.turn[k]
        of_second = of_second - along(places.ahead[k], whole).T @ run[k]
    spun = T[1::2].T @ scaled(t[:, 0], spin) - T[::2].T @ scaled(t[:, 1], spin)
    return SlidingDerivative(
        Csr(normal),
        Csr(Csr(sparse.vstack(tangential, format="csr"))[together]),
        Csr(sparse.vstack((of_first, of_second)) + spun),
    )


@dataclass(frozen=True)
class _Places:
    """The integration points with their derivatives in the dofs."""

    p: Array  # tangents across the normals, shape (3, 2, n)
    here: Csr  # trace of the first body, shape (n, scalar dofs)
    there: Csr  # trace of the second body
    ahead: list[Csr]  # derivatives of `there` with respect to either coordinate
    tau: Array  # derivatives of the places y, shape (3, 2, n)
    gap: Array  # shape (n,)
    turn: list[Csr]  # change of the normals along either tangent p, shape (n, ndofs)

    @classmethod
    def of(
        cls, interface: SolidInterface, found: MortarRows, displacements: tuple[Array, Array]
    ) -> _Places:
        q, (one, two), (u, v) = found.quadrature, (interface.first, interface.second), displacements
        nodes = trace_of_nodes(one), trace_of_nodes(two)
        here, _ = _between(nodes[0], one.facets.size, q.facet, q.X)
        there, ahead = _between(nodes[1], two.facets.size, q.other, q.Y)
        slope = FaceMaps.of(two).tangents(q.other, q.Y)
        tau = slope + np.stack([values(each, v, 3) for each in ahead], axis=1)
        p = tangent_frame(q.n)
        parts = turning_normals(one, displaced_maps(one, u), nodes[0], q.facet, q.X)
        none = Csr((q.facet.size, 3 * there.shape[1]))
        turn = [
            Csr(
                sparse.hstack(
                    (sum((scaled(p[c, b], parts[c]) for c in range(3)), 0.0 * parts[0]), none),
                    format="csr",
                )
            )
            for b in (0, 1)
        ]
        return cls(p, here, there, ahead, tau, q.gap, turn)

    def run(self, v: Array) -> Csr:
        """The change of x - y + g n along vectors v across the normals, shape (n, ndofs)."""
        rows = Csr(sparse.hstack((along(self.here, v), -along(self.there, v)), format="csr"))
        for b in (0, 1):
            rows = rows + scaled(self.gap * np.sum(v * self.p[:, b], axis=0), self.turn[b])
        return Csr(rows)


def _between(of_nodes: Csr, count: int, facet: Index, X: Array) -> tuple[Csr, list[Csr]]:
    """Trace at places of facets, by interpolation between their nodes, and its derivatives."""
    size = of_nodes.shape[0] // count
    column = (facet[:, None] * size + np.arange(size)).ravel()
    place, shape = (np.repeat(np.arange(facet.size), size), column), (facet.size, count * size)
    value, slope = shapes(X, size)
    found = [
        Csr(sparse.coo_array((part.T.ravel(), place), shape=shape) @ of_nodes)
        for part in (value, slope[:, 0], slope[:, 1])
    ]
    return found[0], found[1:]


def _spin(found: MortarRows, places: _Places) -> Csr:
    """Angles by which the tangents of contact points turn about their normals, shape (m, ndofs).
    The frame is a function of the normal, differentiated by central differences."""
    n, (one, two) = found.rows.normals, found.rows.tangents.transpose(1, 0, 2)
    total = 0.0 * (found.P @ places.turn[0])
    for t in (one, two):
        ahead, behind = (tangent_frame(n + h * t)[:, 0] for h in (_TILT, -_TILT))
        here = tangent_frame(n)[:, 1]
        rate = np.sum(here * (ahead - behind), axis=0) / (2.0 * _TILT)
        at, point = found.P.indices, np.repeat(np.arange(n.shape[1]), np.diff(found.P.indptr))
        for b in (0, 1):
            share = found.P.data * np.sum(t[:, point] * places.p[:, b, at], axis=0)
            mean = Csr((share, at, found.P.indptr), shape=found.P.shape)
            total = total + scaled(rate, Csr(mean @ places.turn[b]))
    return Csr(total)


def _frames(found: MortarRows, p: Array) -> list[list[Csr]]:
    """Means of values along p as displacements along the tangents j of contact points, [j][b].
    Each of shape (m, n): the entries of P times the products of both tangents."""
    P, rows = found.P, found.rows
    at, point = P.indices, np.repeat(np.arange(P.shape[0]), np.diff(P.indptr))
    n = found.quadrature.n[:, at]
    t = turned_tangents(rows.tangents[:, :, point], rows.normals[:, point], n)
    share = P.data * np.einsum("djn,dbn->jbn", t, p[:, :, at])
    return [[Csr((one, P.indices, P.indptr), shape=P.shape) for one in own] for own in share]


# [i, j, k] e_k v_j is the component i of v x e.
_CROSS = np.zeros((3, 3, 3))
_CROSS[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
_CROSS[[1, 2, 0], [0, 1, 2], [2, 0, 1]] = -1.0


def turning_normals(
    outline: Outline, maps: FaceMaps, of_nodes: Csr, facet: Index, X: Array
) -> list[Csr]:
    r"""Derivatives of the averaged normals at X (2, n) on displaced facets, three of (n, ndofs).
    The normal of a facet at a corner is that of :math:`c = t_1 \times t_2`, with

    .. math:: \delta c = \sum_k \delta x_k \times (\partial_1 N_k \, t_2 - \partial_2 N_k \, t_1),
        \qquad \delta n = (1 - n n^T) \, \delta c / |c| ,

    by the trace `of_nodes` (M. A. Puso and T. A. Laursen 2004, appendix); weights of the means are
    kept."""
    at_corners, corners, count = _at_corners(outline, maps, of_nodes), maps.corners, facet.size
    hat = hats(X, corners)
    mean = np.einsum("dnk,kn->dn", maps.normals[:, facet], hat)
    size = np.linalg.norm(mean, axis=0)
    column = facet[:, None] * corners + np.arange(corners)
    row = np.repeat(np.arange(count), corners)
    between = Csr(
        sparse.coo_array(
            ((hat / size).T.ravel(), (row, column.ravel())),
            shape=(count, outline.facets.size * corners),
        )
    )
    return _across([Csr(between @ part) for part in at_corners], mean / size)


def _at_corners(outline: Outline, maps: FaceMaps, trace: Csr) -> list[Csr]:
    """Derivatives of the averaged normals at the corners of all facets, (nfacets * ncorners, .)."""
    count, corners, nodes = outline.facets.size, maps.corners, maps.nodes.shape[2]
    every = np.arange(count)
    own, change = np.empty((3, count, corners)), np.empty((3, 3, count, corners, nodes))
    for k, at in enumerate(reference_corners(3, corners).T):
        place = np.repeat(at[:, None], count, axis=1)
        one, two = maps.tangents(every, place).transpose(1, 0, 2)
        c = np.cross(one, two, axis=0)
        size = np.linalg.norm(c, axis=0)
        own[:, :, k] = c / size
        slope = shapes(place, nodes)[1]
        arm = np.einsum("nf,df->dfn", slope[:, 0], two) - np.einsum("nf,df->dfn", slope[:, 1], one)
        of_c = np.einsum("ijk,kfn->ijfn", _CROSS, arm) / size[:, None]
        along = np.einsum("jf,jifn->ifn", own[:, :, k], of_c)
        change[:, :, :, k] = of_c - own[:, :, k][:, None, :, None] * along[None]
    outward = np.sign(np.sum(own * maps.normals, axis=0))
    change, own = change * outward[..., None], own * outward
    row = np.repeat(np.arange(count * corners), nodes)
    column = np.tile((every[:, None] * nodes + np.arange(nodes))[:, None], (1, corners, 1)).ravel()
    shape = count * corners, count * nodes
    mean, free = outline.averaging(own, maps.nodes[:, :, :corners])
    parts = []
    for i in range(3):
        of_components = [
            _embedded(sparse.coo_array((change[i, j].ravel(), (row, column)), shape) @ trace, j)
            for j in range(3)
        ]
        total = of_components[0] + of_components[1] + of_components[2]
        parts.append(Csr(sparse.diags_array(free[i].ravel().astype(float)) @ (mean @ total)))
    return _across(parts, maps.normals.reshape(3, -1))


def _across(parts: list[Csr], n: Array) -> list[Csr]:
    """Components of the derivatives of vectors without those along unit vectors n (3, nrows)."""
    along = sum((sparse.diags_array(n[i]) @ parts[i] for i in range(3)), start=0.0 * parts[0])
    return [Csr(parts[i] - sparse.diags_array(n[i]) @ along) for i in range(3)]


def _embedded(of_scalar: sparse.csr_array, j: int) -> Csr:
    """Rows of a scalar trace in the dofs of component j."""
    coo = of_scalar.tocoo()
    shape = coo.shape[0], 3 * coo.shape[1]
    return Csr(sparse.coo_array((coo.data, (coo.row, 3 * coo.col + j)), shape=shape))
