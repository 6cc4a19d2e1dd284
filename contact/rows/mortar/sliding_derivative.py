r"""Derivatives of contact rows in the plane with respect to the displacements.

An integration point keeps its place X on the non-mortar side. When the bodies move, its normal n
turns by an angle :math:`\theta`, and the place Y that it faces slides along the mortar side, so
that :math:`(y - x) \times n = 0` remains true. With p the normal turned by 90 degrees,
:math:`\tau = \partial y / \partial Y`, the gap g and changes :math:`\delta` at fixed Y,

.. math::
    \delta Y = \frac{(\delta x - \delta y) \cdot p + g\, \theta}{\tau \cdot p}, \qquad
    \delta g = n \cdot (\delta y - \delta x) + (n \cdot \tau)\, \delta Y .

An averaged normal turns by the mean of the angles of its facets, linear between the ends. The
motion of the ends of segments is left out: it enters with the gap, which is zero in contact. Whole
linearisation: M. A. Puso and T. A. Laursen, Comput. Methods Appl. Mech. Engrg. 193 (2004); A. Popp,
M. W. Gee and W. A. Wall, Int. J. Numer. Meth. Engng 79 (2009)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.rows.mortar.facet_curves import FacetCurves, facet_nodes
from contact.rows.mortar.facet_trace import facet_trace
from contact.rows.mortar.interface_rows import MortarRows
from contact.rows.mortar.mortar_rows import Interface
from contact.rows.mortar.trace_fields import along, scaled, values
from contact.rows.outline import Outline

Array = NDArray[np.float64]
Csr = sparse.csr_array

# Derivative of a facet's end with respect to its ends and middle: row 0 at s = 0, row 1 at s = 1.
_SLOPE = np.array([[-3.0, 4.0, -1.0], [1.0, -4.0, 3.0]])
_NODES = np.array([0.0, 0.5, 1.0])
# Central differences of fourth order, exact for traces of third order.
_STEPS, _WEIGHTS = (-0.5, -0.25, 0.25, 0.5), (1.0, -8.0, 8.0, -1.0)


@dataclass(frozen=True)
class SlidingDerivative:
    """Derivatives with respect to the dofs of the first body, then of the second."""

    normal: Csr  # to be added to G, shape (m, ndofs)
    tangential: Csr  # to be added to T, shape (m, ndofs)
    force: Csr  # of G^T mu + T^T t at fixed mu and t, shape (ndofs, ndofs)

    @classmethod
    def of(
        cls,
        interface: Interface,
        found: MortarRows,
        displacements: tuple[Array, Array],
        increments: tuple[Array, Array],
        forces: tuple[Array, Array],
    ) -> SlidingDerivative:
        """Differentiate rows of `displaced_rows` at the displacements of the two bodies.
        `increments` are their parts since the last step, `forces` are mu and t, shapes (m,)."""
        q, (one, two) = found.quadrature, (interface.first, interface.second)
        n, p = q.n, np.array([-q.n[1], q.n[0]])
        (u, v), (du, dv) = displacements, increments
        here, there = facet_trace(one, q.facet, q.X), facet_trace(two, q.other, q.Y)
        ahead = sum(
            (facet_trace(two, q.other, q.Y + h) * w for h, w in zip(_STEPS, _WEIGHTS, strict=True)),
            start=0.0 * there,
        ) * (1.0 / 3.0)
        X, Y = FacetCurves.of(one), FacetCurves.of(two)
        gap = np.sum((Y.at(q.other, q.Y[0]) + values(there, v, 2)) * n, axis=0)
        gap -= np.sum((X.at(q.facet, q.X[0]) + values(here, u, 2)) * n, axis=0)
        tau = Y.slope(q.other, q.Y[0]) + values(ahead, v, 2)
        count = 2 * here.shape[1], 2 * there.shape[1]
        turn = sparse.hstack(
            (_turns(one, u, q.facet, q.X[0]), Csr((q.facet.size, count[1]))), format="csr"
        )
        run = sparse.hstack((along(here, p), -along(there, p)), format="csr")
        run = scaled(1.0 / np.sum(tau * p, axis=0), run + scaled(gap, turn))
        # The tangents of contact points are their normals turned, one way or the other.
        way = np.sign(found.rows.tangents[1, 0] * found.rows.normals[0]
                      - found.rows.tangents[0, 0] * found.rows.normals[1])  # fmt: skip
        normal = found.P @ scaled(-np.sum(n * tau, axis=0), run)
        slip = values(here, du, 2) - values(there, dv, 2)
        tangential = scaled(-np.sum(p * values(ahead, dv, 2), axis=0), run)
        tangential = found.P @ (tangential - scaled(np.sum(n * slip, axis=0), turn))
        a, b = found.P.T @ forces[0], found.P.T @ (way * forces[1])
        turned, whole = p * a - n * b, n * a + p * b
        of_first = along(here, turned).T @ turn
        of_second = -(along(there, turned).T @ turn) - along(ahead, whole).T @ run
        return cls(
            Csr(normal),
            Csr(scaled(way, tangential)),
            Csr(sparse.vstack((of_first, of_second), format="csr")),
        )


def _turns(outline: Outline, u: Array, facet: NDArray[np.int64], s: Array) -> Csr:
    """Angle by which the averaged normal at places of facets turns, shape (n, ndofs)."""
    count = outline.facets.size
    every = np.arange(count)
    trace = facet_trace(outline, np.repeat(every, 3), np.tile(_NODES, count)[None])
    nodes = facet_nodes(outline) + values(trace, u, 2).reshape(2, count, 3)
    curves = FacetCurves.of(outline, nodes)
    angles = []
    for end in (0, 1):
        slope = np.einsum("dfk,k->df", nodes, _SLOPE[end])
        size = np.linalg.norm(slope, axis=0)
        n = curves.sign * np.array([slope[1], -slope[0]]) / size
        # The outward normal is the tangent turned by -90 degrees times the sign.
        pick = sparse.kron(sparse.eye_array(count), _SLOPE[end][None], format="csr")
        angles.append(along(Csr(pick @ trace), -n * curves.sign / size))
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
