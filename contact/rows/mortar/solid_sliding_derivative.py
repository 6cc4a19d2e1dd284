r"""How contact rows in space change with the displacement at which they were projected.

An integration point keeps its place X on the non-mortar side. When the bodies move, its normal n
turns by :math:`\delta n`, and the place Y that it faces runs over the mortar side, so that y - x
remains along n. With tangents :math:`p_b` across n, :math:`\tau_a = \partial y / \partial Y_a`, the
gap g and changes :math:`\delta` at fixed Y,

.. math::
    \sum_a (p_b \cdot \tau_a) \, \delta Y_a = p_b \cdot (\delta x - \delta y + g \, \delta n),
    \qquad \delta g = n \cdot (\delta y - \delta x) + \sum_a (n \cdot \tau_a) \, \delta Y_a .

The corners of the common polygons move too; this changes integrals by products with the gap, which
is zero in contact, so that no polygon is differentiated. Tangents turn with their normals, and
about them, as `contact.rows.frames.tangent_frame` has it.

References
----------
M. A. Puso and T. A. Laursen, Comput. Methods Appl. Mech. Engrg. 193 (2004), and A. Popp, M.
Gitterle, M. W. Gee and W. A. Wall, Int. J. Numer. Meth. Engng 83 (2010), for the whole
linearisation.
"""

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
from contact.rows.mortar.turning_normals import turning_normals

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Csr = sparse.csr_array

_TILT = 1e-5  # of normals, in differences that are exact to its square


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
    """The integration points and how they move.

    Attributes
    ----------
    p : ndarray, shape (3, 2, n)
        Tangents across the normals.
    here, there : csr_array, shape (n, scalar dofs)
        Traces of either body.
    ahead : list of csr_array
        Derivatives of `there` with respect to either coordinate.
    tau : ndarray, shape (3, 2, n)
        Derivatives of the places y.
    gap : ndarray, shape (n,)
    turn : list of csr_array, shape (n, ndofs)
        Components of the change of the normals along p.
    """

    p: Array
    here: Csr
    there: Csr
    ahead: list[Csr]
    tau: Array
    gap: Array
    turn: list[Csr]

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

    The frame is a function of the normal, which is differentiated by central differences.
    """
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
    """Means of values along p as displacements along the tangents j of the contact points, [j][b].

    Each of shape (m, n), with the entries of P times the products of both tangents.
    """
    P, rows = found.P, found.rows
    at, point = P.indices, np.repeat(np.arange(P.shape[0]), np.diff(P.indptr))
    n = found.quadrature.n[:, at]
    t = turned_tangents(rows.tangents[:, :, point], rows.normals[:, point], n)
    share = P.data * np.einsum("djn,dbn->jbn", t, p[:, :, at])
    return [[Csr((one, P.indices, P.indptr), shape=P.shape) for one in own] for own in share]
