r"""Contact rows of an interface, in two and in three dimensions, from its integration points.

With the multiplier functions at the points, :math:`\Psi`, their weights :math:`w_q` and the values
of the scalar elements on either side, :math:`\Phi_s` and :math:`\Phi_m`,

.. math::
    P = \mathrm{diag}(1 / w_k) \, \Psi^T \mathrm{diag}(w_q), \qquad
    G = P \, [n \cdot \Phi_s, \; -n \cdot \Phi_m], \qquad g = P \, ((y - x) \cdot n),

and T likewise with the tangents. A multiplier is a force on both bodies along the line from x to y,
so that forces and, without friction, moments balance to rounding whatever the gap (M. A. Puso and
T. A. Laursen, Comput. Methods Appl. Mech. Engrg. 193, 2004)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.supports import norms
from contact.errors import InputError
from contact.rows.contact_rows import ContactRows
from contact.rows.frames import (
    along_supports,
    directed,
    tangent_frame,
    turned_tangents,
    within_supports,
)
from contact.rows.mortar.facet_trace import facet_trace
from contact.rows.mortar.interface_quadrature import InterfaceQuadrature
from contact.rows.mortar.multipliers import Multipliers
from contact.rows.outline import Outline

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Relative: entries of a row that are rounding, over the length of the dof; norm of a held row.
ROUNDING, HELD = 1e-14, 1e-9


@dataclass(frozen=True)
class MortarRows:
    """Contact rows of the interface of two bodies with displacements u and v.
    ``rows.G @ u + other_G @ v`` is the normal displacement of the first relative to the second,
    along the outward normal of the first."""

    rows: ContactRows  # G and T with the columns of the first body; gap, weights, frames
    other_G: sparse.csr_array  # noqa: N815
    other_T: sparse.csr_array  # noqa: N815
    P: sparse.csr_array  # means of values at the integration points, shape (m, n)
    quadrature: InterfaceQuadrature


@dataclass(frozen=True)
class InterfaceRows:
    """Integration points, multipliers and traces that the rows of an interface are built from."""

    first: Outline  # non-mortar side
    second: Outline  # mortar side
    quadrature: InterfaceQuadrature
    functions: Multipliers
    own: sparse.csr_array  # trace of the first body at the contact points, (m, scalar dofs)
    at_place: NDArray[np.bool_]  # held as their place is, not as their mean, shape (m,)

    def means(self) -> sparse.csr_array:
        """The matrix P, shape (m, n)."""
        psi, w = self.functions.psi, sparse.diags_array(self.quadrature.w)
        return sparse.csr_array(sparse.diags_array(1.0 / self.functions.weights) @ psi.T @ w)

    def normals(self) -> Array:
        """Unit normals of the contact points, (dim, m).
        Raises InputError where facets with opposite normals share a contact point."""
        mean = (self.functions.N.T @ (self.quadrature.w * self.quadrature.n).T).T
        length = np.linalg.norm(mean, axis=0)
        if np.any(length < 1e-9 * self.functions.weights):  # unit vectors that cancel
            raise InputError("boundary: facets with opposite normals meet at a contact point")
        return np.asarray(mean / length)

    def assemble(self, x_nominal: Array, partner: sparse.csr_array, name: str) -> MortarRows:
        """Build the rows with the measured gap; `name` is that of the functional.
        `partner`, (m, scalar dofs of the second body), is its trace opposite the contact points,
        which tells with the own trace where supports hold both bodies."""
        quadrature, P = self.quadrature, self.means()
        here = facet_trace(self.first, quadrature.facet, quadrature.X)
        there = facet_trace(self.second, quadrature.other, quadrature.Y)
        own, free = self._recognised(P, here), self.first.body.constraint[0]
        normals = within_supports(own, self.normals(), free)
        tangents = tangent_frame(normals)
        if len(normals) == 3:
            tangents = along_supports(own, tangents, free)
        at, point = P.indices, np.repeat(np.arange(P.shape[0]), np.diff(P.indptr))
        n = quadrature.n[:, at]
        t = turned_tangents(tangents[:, :, point], normals[:, point], n)
        directions = [(normals, n), *((tangents[:, j], t[:, j]) for j in range(t.shape[1]))]
        G, *T = (
            self._held(P, own, partner, straight, vectors, (here, there))
            for straight, vectors in directions
        )
        count = len(normals) - 1
        together = np.arange(P.shape[0] * count).reshape(count, P.shape[0]).T.ravel()
        along, other = (
            sparse.csr_array(sparse.csr_array(sparse.vstack([rows[k] for rows in T]))[together])
            for k in (0, 1)
        )
        w = self.functions.weights
        x = (self.functions.N.T @ (quadrature.w * quadrature.x).T).T / w
        rows = ContactRows(
            G[0], along, P @ quadrature.gap, w, x, x_nominal, normals, tangents, name
        )
        return MortarRows(rows, G[1], other, P, quadrature)

    def _recognised(self, P: sparse.csr_array, here: sparse.csr_array) -> sparse.csr_array:
        """Rows of the first body's trace by which supports are recognised, shape (m, scalar dofs).
        On a plane of symmetry the mean over the modelled half may move across it: the place
        decides, see `contact.rows.trace_rows.TraceRows.supported`."""
        place, mean = (
            sparse.diags_array(part.astype(float)) for part in (self.at_place, ~self.at_place)
        )
        return sparse.csr_array(place @ self.own + mean @ (P @ here))

    def _held(
        self,
        P: sparse.csr_array,
        own: sparse.csr_array,
        partner: sparse.csr_array,
        straight: Array,
        vectors: Array,
        traces: tuple[sparse.csr_array, sparse.csr_array],
    ) -> tuple[sparse.csr_array, sparse.csr_array]:
        """Rows of both bodies in one direction, `straight` (dim, m), `vectors` (dim, nnz of P).
        Where supports hold both bodies in this direction, as on a plane of symmetry, the row is
        that of the place alone: the mean over the modelled half would not vanish."""
        alone = [directed(own, straight), -directed(partner, straight)]
        bodies = self.first.body, self.second.body
        held = np.ones(P.shape[0], dtype=bool)
        for rows, body in zip(alone, bodies, strict=True):
            held &= norms(rows @ body.constraint[0]) <= HELD * norms(rows)
        pick, leave = (sparse.diags_array(part.astype(float)) for part in (held, ~held))
        both = []
        for rows, body, trace, sign in zip(alone, bodies, traces, (1.0, -1.0), strict=True):
            result = sparse.csr_array(pick @ rows + leave @ _along(P, sign * vectors, trace))
            # Rounding: functions that are biorthogonal to this one.
            small = np.abs(result.data) < ROUNDING * body.lengths[0][result.indices]
            result.data[small] = 0.0
            result.eliminate_zeros()
            both.append(result)
        if bodies[0] is bodies[1]:
            # At the tip of a slit both lips have the same dofs: there the sum is zero.
            total = sparse.csr_array(both[0] + both[1])
            small = np.abs(total.data) < ROUNDING * bodies[0].lengths[0][total.indices]
            total.data[~small] = 0.0
            both[1] = sparse.csr_array(both[1] - total)
        return both[0], both[1]


def _along(P: sparse.csr_array, vectors: Array, trace: sparse.csr_array) -> sparse.csr_array:
    """Means of the displacement along vectors given for every entry of P, shape (m, ndofs)."""
    dim, shape = len(vectors), (P.shape[0], len(vectors) * trace.shape[1])
    parts = []
    for c, vector in enumerate(vectors):
        weighted = sparse.csr_array((P.data * vector, P.indices, P.indptr), shape=P.shape)
        part = (weighted @ trace).tocoo()
        parts.append((part.data, part.row, dim * part.col + c))
    data, row, column = (np.concatenate(v) for v in zip(*parts, strict=True))
    return sparse.csr_array(sparse.coo_array((data, (row, column)), shape=shape))
