r"""Derivatives of contact rows with respect to the displacements.

An integration point keeps its reference point X on the non-mortar side. When the bodies move, its
normal n turns by :math:`\delta n`, and its projection Y slides over the mortar side, so that y - x
remains along n. With tangents :math:`p_b` across n, :math:`\tau_a = \partial y / \partial Y_a`, the
gap g and changes :math:`\delta` at fixed Y,

.. math::
    \sum_a (p_b \cdot \tau_a) \, \delta Y_a = p_b \cdot (\delta x - \delta y + g \, \delta n),
    \qquad \delta g = n \cdot (\delta y - \delta x) + \sum_a (n \cdot \tau_a) \, \delta Y_a .

In the plane :math:`\delta n = \theta p`, and an averaged normal turns by the mean of the angles of
its facets, linear between the ends. In space tangents turn with and about their normals, as in
`contact.rows.frames.tangent_frame`. The motion of segment ends and polygon corners is neglected: it
is multiplied by the gap, which is zero in contact. Full linearisation:
M. A. Puso and T. A. Laursen, Comput. Methods Appl. Mech. Engrg. 193 (2004); A. Popp, M. W. Gee and
W. A. Wall, Int. J. Numer. Meth. Engng 79 (2009); A. Popp, M. Gitterle, M. W. Gee and W. A. Wall,
ibid. 83 (2010)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.rows.frames import (
    by_point,
    directed,
    interleaved,
    scaled,
    tangent_frame,
    turned_tangents,
)
from contact.rows.mortar.face_maps import FaceMaps, shapes
from contact.rows.mortar.facet_curves import FacetCurves, facet_nodes
from contact.rows.mortar.facet_trace import Csr, facet_trace, values
from contact.rows.mortar.mortar_rows import Interface, MortarRows, chart, trace_of_nodes
from contact.rows.outline import Outline, hats, reference_corners

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Pair = tuple[Array, Array]


@dataclass(frozen=True)
class SlidingDerivative:
    """Derivatives with respect to the dofs of the first body, then of the second."""

    normal: Csr  # to be added to G, shape (m, ndofs)
    tangential: Csr  # to be added to T, shape (m * (dim - 1), ndofs)
    force: Csr  # derivative of G^T mu + T^T t at fixed mu, t, shape (ndofs, ndofs)

    @classmethod
    def of(
        cls,
        interface: Interface,
        found: MortarRows,
        displacements: Pair,
        increments: Pair,
        forces: Pair,
    ) -> SlidingDerivative:
        """Differentiate rows of `Interface.displaced` at the displacements of the two bodies.
        `increments`: their parts since the last step; `forces`: mu (m,) and t (m, dim - 1)."""
        (du, dv), n, dim = increments, found.quadrature.n, len(found.quadrature.n)
        at = (_in_plane if dim == 2 else _in_space)(interface, found, *displacements)
        mu, t, each = forces[0], forces[1].reshape(-1, dim - 1), range(dim - 1)
        change = sum((scaled(-at.steep[a], at.run[a]) for a in each), start=0.0 * at.run[0])
        normal = found.P @ change
        slip = values(at.here, du, dim) - values(at.there, dv, dim)
        against, carried = np.sum(n * slip, axis=0), [values(ahead, dv, dim) for ahead in at.ahead]
        across = []
        for b in each:
            change = scaled(-against, at.turn[b])
            for a in each:
                change = change - scaled(np.sum(at.p[:, b] * carried[a], axis=0), at.run[a])
            across.append(change)
        tangential = [
            sum((frame[b] @ across[b] for b in each[1:]), start=frame[0] @ across[0])
            for frame in at.frames
        ]
        normal_force = found.P.T @ mu
        shear = np.array([sum(at.frames[j][b].T @ t[:, j] for j in each) for b in each])
        whole = n * normal_force + np.einsum("bn,dbn->dn", shear, at.p)
        ndofs = at.run[0].shape[1]
        of_first, of_second = (Csr((dim * part.shape[1], ndofs)) for part in (at.here, at.there))
        for k in each:
            turned = normal_force * at.p[:, k] - shear[k] * n
            of_first = of_first + directed(at.here, turned).T @ at.turn[k]
            of_second = of_second - directed(at.there, turned).T @ at.turn[k]
            of_second = of_second - directed(at.ahead[k], whole).T @ at.run[k]
        force = sparse.vstack((of_first, of_second), format="csr")
        if dim == 3:
            spin = _spin(found, at)
            T = Csr(sparse.hstack((found.rows.T, found.other_T), format="csr"))
            since = (T @ np.concatenate(increments)).reshape(-1, 2)
            for j, sign in ((0, 1.0), (1, -1.0)):
                tangential[j] = tangential[j] + scaled(sign * since[:, 1 - j], spin)
            force = force + (T[1::2].T @ scaled(t[:, 0], spin) - T[::2].T @ scaled(t[:, 1], spin))
        return cls(Csr(normal), by_point(tangential), Csr(force))


@dataclass(frozen=True)
class _Places:
    """Integration points and their derivatives with respect to the dofs; a, b number tangents."""

    p: Array  # tangents orthogonal to the normals, shape (dim, dim - 1, n)
    here: Csr  # trace of the first body, shape (n, scalar dofs)
    there: Csr  # trace of the second body
    ahead: list[Csr]  # derivatives of `there` with respect to Y_a
    steep: Array  # n . tau_a, shape (dim - 1, n)
    turn: list[Csr]  # changes of the normals along p_b, shape (n, ndofs)
    run: list[Csr]  # changes of Y_a, shape (n, ndofs)
    frames: list[list[Csr]]  # averages of components p_b along tangents j of points, [j][b], (m, n)


def _in_plane(interface: Interface, found: MortarRows, u: Array, v: Array) -> _Places:
    """Integration points in the plane, where changes along p are scalar."""
    q, (one, two), (X, Y) = found.quadrature, (interface.first, interface.second), interface.rest
    n, p = q.n, np.array([-q.n[1], q.n[0]])
    here, there = facet_trace(one, q.facet, q.X), facet_trace(two, q.other, q.Y)
    # Central differences of fourth order, exact for traces of third order.
    steps, weights = (-0.5, -0.25, 0.25, 0.5), (1.0, -8.0, 8.0, -1.0)
    ahead = sum(
        (facet_trace(two, q.other, q.Y + h) * w for h, w in zip(steps, weights, strict=True)),
        start=0.0 * there,
    ) * (1.0 / 3.0)
    gap = np.sum((Y.at(q.other, q.Y) + values(there, v, 2)) * n, axis=0)
    gap -= np.sum((X.at(q.facet, q.X) + values(here, u, 2)) * n, axis=0)
    tau = Y.slope(q.other, q.Y) + values(ahead, v, 2)
    none = Csr((q.facet.size, 2 * there.shape[1]))
    turn = sparse.hstack((_turns(one, u, q.facet, q.X[0]), none), format="csr")
    run = sparse.hstack((directed(here, p), -directed(there, p)), format="csr")
    run = scaled(1.0 / np.sum(tau * p, axis=0), Csr(run + scaled(gap, turn)))
    # The tangents of contact points are their normals turned by +-90 degrees.
    normals, tangents = found.rows.normals, found.rows.tangents[:, 0]
    way = np.sign(tangents[1] * normals[0] - tangents[0] * normals[1])
    steep, frames = np.sum(n * tau, axis=0)[None], [[scaled(way, found.P)]]
    return _Places(p[:, None], here, there, [ahead], steep, [turn], [run], frames)


def _in_space(interface: Interface, found: MortarRows, u: Array, v: Array) -> _Places:
    """Integration points in space."""
    q, (one, two) = found.quadrature, (interface.first, interface.second)
    nodes = trace_of_nodes(one), trace_of_nodes(two)
    here, _ = _between(nodes[0], one.facets.size, q.facet, q.X)
    there, ahead = _between(nodes[1], two.facets.size, q.other, q.Y)
    slope = interface.rest[1].tangents(q.other, q.Y)
    tau = slope + np.stack([values(part, v, 3) for part in ahead], axis=1)
    p = tangent_frame(q.n)
    parts = turning_normals(one, chart(one, u), nodes[0], q.facet, q.X)
    none = Csr((q.facet.size, 3 * there.shape[1]))
    turn = []
    for b in (0, 1):
        along = sum((scaled(p[c, b], parts[c]) for c in range(3)), 0.0 * parts[0])
        turn.append(Csr(sparse.hstack((along, none), format="csr")))
    inverse = np.linalg.inv(np.einsum("dbn,dan->nba", p, tau))
    # dY_a = reach_a . (dx - dy + g dn).
    reach, run = np.einsum("nab,dbn->dan", inverse, p), []
    for way in reach.transpose(1, 0, 2):
        rows = Csr(sparse.hstack((directed(here, way), -directed(there, way)), format="csr"))
        for b in (0, 1):
            rows = rows + scaled(q.gap * np.sum(way * p[:, b], axis=0), turn[b])
        run.append(Csr(rows))
    steep = np.einsum("dn,dan->an", q.n, tau)
    return _Places(p, here, there, ahead, steep, turn, run, _frames(found, p))


def _turns(outline: Outline, u: Array, facet: NDArray[np.int64], s: Array) -> Csr:
    """Rotation angle of the averaged normal at points of facets, shape (n, ndofs)."""
    count = outline.facets.size
    every = np.arange(count)
    trace = trace_of_nodes(outline)
    moved = values(trace, u, 2).reshape(2, count, 3)
    nodes, curves = facet_nodes(outline) + moved, FacetCurves.of(outline, moved)
    # Derivatives at the ends s = 0 and 1, by the ends and the middle.
    slopes = np.array([[-3.0, 4.0, -1.0], [1.0, -4.0, 3.0]])
    angles = []
    for end in (0, 1):
        slope = np.einsum("dfk,k->df", nodes, slopes[end])
        size = np.linalg.norm(slope, axis=0)
        n = curves.sign * np.array([slope[1], -slope[0]]) / size
        # The outward normal is the tangent turned by -90 degrees times the sign.
        pick = sparse.kron(sparse.eye_array(count), slopes[end][None], format="csr")
        angles.append(directed(Csr(pick @ trace), -n * curves.sign / size))
    own = sparse.vstack(angles, format="csr")  # all starts, then all ends
    continued, (beyond, corner) = outline.continued, outline.beyond
    weight, rows, columns, shares = 1.0 / curves.length, [], [], []
    for end in (0, 1):
        on, other = continued[:, end], np.maximum(beyond[:, end], 0)
        share = np.where(on, weight / (weight + weight[other]), 1.0)
        at = every + count * end
        rows += [at, at[on]]
        columns += [at, (other + count * np.maximum(corner[:, end], 0))[on]]
        shares += [share, 1.0 - share[on]]
    mean = sparse.coo_array(
        (np.concatenate(shares), (np.concatenate(rows), np.concatenate(columns))),
        shape=(2 * count, 2 * count),
    )
    k, index = facet.size, np.arange(facet.size)
    between = sparse.coo_array(
        (np.r_[1.0 - s, s], (np.r_[index, index], np.r_[facet, facet + count])),
        shape=(k, 2 * count),
    )
    return Csr(between.tocsr() @ mean.tocsr() @ own)


def _between(of_nodes: Csr, count: int, facet: Index, X: Array) -> tuple[Csr, list[Csr]]:
    """Trace at points of facets, interpolated from nodal values, and its derivatives."""
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
    tilt = 1e-5  # step of normals in central differences
    for t in (one, two):
        ahead, behind = (tangent_frame(n + h * t)[:, 0] for h in (tilt, -tilt))
        here = tangent_frame(n)[:, 1]
        rate = np.sum(here * (ahead - behind), axis=0) / (2.0 * tilt)
        at, point = found.P.indices, np.repeat(np.arange(n.shape[1]), np.diff(found.P.indptr))
        for b in (0, 1):
            share = found.P.data * np.sum(t[:, point] * places.p[:, b, at], axis=0)
            mean = Csr((share, at, found.P.indptr), shape=found.P.shape)
            total = total + scaled(rate, Csr(mean @ places.turn[b]))
    return Csr(total)


def _frames(found: MortarRows, p: Array) -> list[list[Csr]]:
    """Averages of components along p_b on the tangents j of contact points, [j][b].
    Each has shape (m, n): the entries of P times the dot products of both tangents."""
    P, rows = found.P, found.rows
    at, point = P.indices, np.repeat(np.arange(P.shape[0]), np.diff(P.indptr))
    n = found.quadrature.n[:, at]
    t = turned_tangents(rows.tangents[:, :, point], rows.normals[:, point], n)
    share = P.data * np.einsum("djn,dbn->jbn", t, p[:, :, at])
    return [[Csr((one, P.indices, P.indptr), shape=P.shape) for one in own] for own in share]


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
    cross = np.zeros((3, 3, 3))  # [i, j, k] e_k v_j is the component i of v x e
    cross[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
    cross[[1, 2, 0], [0, 1, 2], [2, 0, 1]] = -1.0
    for k, at in enumerate(reference_corners(3, corners).T):
        place = np.repeat(at[:, None], count, axis=1)
        one, two = maps.tangents(every, place).transpose(1, 0, 2)
        c = np.cross(one, two, axis=0)
        size = np.linalg.norm(c, axis=0)
        own[:, :, k] = c / size
        slope = shapes(place, nodes)[1]
        arm = np.einsum("nf,df->dfn", slope[:, 0], two) - np.einsum("nf,df->dfn", slope[:, 1], one)
        of_c = np.einsum("ijk,kfn->ijfn", cross, arm) / size[:, None]
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
        each = [sparse.coo_array((v.ravel(), (row, column)), shape) @ trace for v in change[i]]
        total = interleaved(each)
        parts.append(Csr(sparse.diags_array(free[i].ravel().astype(float)) @ (mean @ total)))
    return _across(parts, maps.normals.reshape(3, -1))


def _across(parts: list[Csr], n: Array) -> list[Csr]:
    """Remove from derivatives of vectors the components along unit vectors n (3, nrows)."""
    along = sum((sparse.diags_array(n[i]) @ parts[i] for i in range(3)), start=0.0 * parts[0])
    return [Csr(parts[i] - sparse.diags_array(n[i]) @ along) for i in range(3)]
