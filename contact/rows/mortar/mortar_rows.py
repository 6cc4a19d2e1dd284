r"""Contact rows of two bodies whose meshes do not match, in the plane and in space.

With the multiplier functions at the integration points, :math:`\Psi`, their weights :math:`w_q` and
the values of the scalar elements on either side, :math:`\Phi_s` and :math:`\Phi_m`,

.. math::
    P = \mathrm{diag}(1 / w_k) \, \Psi^T \mathrm{diag}(w_q), \qquad
    G = P \, [n \cdot \Phi_s, \; -n \cdot \Phi_m], \qquad g = P \, ((y - x) \cdot n),

and T likewise with the tangents. A multiplier is a force on both bodies along the line from x to y,
so that forces and, without friction, moments balance to rounding for any gap (M. A. Puso and T. A.
Laursen, Comput. Methods Appl. Mech. Engrg. 193, 2004).

For displaced bodies, segments are those of the displaced facets. With the reference positions X and
Y of facing points, the condition is linear in the displacement:

.. math:: n \cdot \big(Y + u_m(Y) - X - u_s(X)\big) \ge 0, \quad G u \le P (n \cdot (Y - X)) .

P. Wriggers, Computational Contact Mechanics, 2nd ed., Springer 2006, chapter 4."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from contact.body.elastic_body import ElasticBody
from contact.body.supports import norms
from contact.errors import InputError
from contact.rows.contact_rows import ContactRows
from contact.rows.frames import (
    along_supports,
    by_point,
    directed,
    interleaved,
    tangent_frame,
    turned_tangents,
    within_supports,
)
from contact.rows.functionals import facet_functional
from contact.rows.mortar.face_maps import FaceMaps, moving_nodes
from contact.rows.mortar.facet_curves import NODES, FacetCurves
from contact.rows.mortar.facet_trace import Csr, InterfaceQuadrature, facet_trace, values
from contact.rows.mortar.multipliers import FaceBasis, Multipliers, PositiveBasis
from contact.rows.outline import Outline
from skfem_adini.ground.arguments import evaluated

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Clearance = float | ArrayLike | Callable[[Array], ArrayLike]


@dataclass(frozen=True)
class MortarRows:
    """Contact rows of the interface of two bodies with displacements u and v.
    ``rows.G @ u + other_G @ v`` is the normal displacement of the first relative to the second,
    along the outward normal of the first."""

    rows: ContactRows  # G and T with the columns of the first body; gap, weights, frames
    other_G: Csr  # noqa: N815
    other_T: Csr  # noqa: N815
    P: Csr  # averages values at the integration points, shape (m, n)
    quadrature: InterfaceQuadrature
    N: Csr  # positive functions of the contact points at the integration points, (n, m)


def mortar_rows(
    first: ElasticBody,
    facets: Index,
    second: ElasticBody,
    others: Index,
    functional: str | None = None,
    clearance: Clearance | None = None,
    tied: bool = False,
) -> MortarRows:
    """Discretise the interface of two bodies; the first is the non-mortar side.
    The second may be the first body with other facets. `clearance`, a function of x (2, n) or
    values at the contact points, replaces the measured gap; `tied` lowers the degree at fixed ends
    (`PositiveBasis`)."""
    interface = Interface.of(first, facets, second, others, functional, tied)
    found = interface.rows()
    return found if clearance is None else with_clearance(found, clearance)


def with_clearance(found: MortarRows, clearance: Clearance) -> MortarRows:
    """The same rows with another gap; see `mortar_rows`."""
    at, size = found.quadrature.x, found.rows.weights.size
    if callable(clearance):
        value = evaluated("clearance", clearance, at)
        shape = at.shape[1:]
    else:
        value, shape = evaluated("clearance", clearance, at), (size,)
    if value.shape not in ((), shape):
        raise InputError(
            f"clearance: expected a number, a function of the place, or {size} values, one for "
            f"each contact point; got shape {value.shape}"
        )
    if not np.all(np.isfinite(value)):
        raise InputError("clearance: holds values that are not finite")
    value = np.broadcast_to(value, shape)
    gap = found.P @ value if callable(clearance) else value.copy()
    return replace(found, rows=replace(found.rows, gap=gap))


@dataclass(frozen=True)
class Interface:
    """Two boundaries and the multipliers between them."""

    first: Outline  # non-mortar side
    second: Outline  # mortar side
    functional: str  # "dual", "standard" or "hat"
    basis: PositiveBasis | FaceBasis
    degree: int  # of the polynomials that the Gauss rules integrate

    @property
    def outlines(self) -> tuple[Outline, Outline]:
        """Of both sides."""
        return self.first, self.second

    @classmethod
    def of(
        cls,
        first: ElasticBody,
        facets: Index,
        second: ElasticBody,
        others: Index,
        functional: str | None = None,
        tied: bool = False,
    ) -> Interface:
        """Number the contact points; arguments as of `mortar_rows`."""
        name = _checked_functional(first, facets, second, others, functional)
        sides = Outline(first, facets), Outline(second, others)
        forms = [facet_functional(body.element, None) for body in (first, second)]
        # Degrees of traces on facets, as polynomials of two variables; in the plane of the values.
        known = {
            "ElementTetP1": 1,
            "ElementTetP2": 2,
            "ElementHex1": 2,
            "ElementHex2": 4,
            "ElementHexAdini": 4,
        }
        degrees = [
            known.get(type(body.element).__name__, len(form.C) - 1)
            for body, form in zip((first, second), forms, strict=True)
        ]
        basis = (
            PositiveBasis.of(sides[0], forms[0], name == "hat", tied)
            if first.dim == 2
            else FaceBasis.of(sides[0], forms[0], name == "hat")
        )
        return cls(*sides, name, basis, degrees[0] + max(degrees) + 1)

    @cached_property
    def rest(self) -> tuple[Any, Any]:
        """The undeformed facets of both sides."""
        return chart(self.first), chart(self.second)

    def rows(self, moved: tuple[Array, Array] | None = None) -> MortarRows:
        """Rows with the measured gap, of undeformed facets or those displaced by u and v."""
        first, (one, two) = self.first.body, self.rest
        if moved is not None:
            one, two = chart(self.first, moved[0]), chart(self.second, moved[1])
        q = one.cut(two, self.degree + one.added(two, self.rest))
        if moved is not None:  # forces and pressures refer to the undeformed area
            q = replace(q, w=one.relaxed(self.rest[0], q.facet, q.X, q.w))
        measures = q.w
        if first.is_ring:  # with the undeformed radii
            q = replace(q, w=measures * first.depth(self.rest[0].at(q.facet, q.X)))
        functions = Multipliers.of(self.basis, q, self.functional != "standard", measures)
        facet, X = self.basis.nominal
        facet, X = facet[functions.point], X[:, functions.point]
        x_nominal = one.at(facet, X)
        # The facet with the largest part of each function.
        N = functions.N.tocoo()
        order = np.lexsort((N.data, N.col))
        most = q.other[N.row[order[np.append(np.diff(N.col[order]) > 0, True)]]]
        facing = facet_trace(self.second, most, two.met(most, x_nominal, one.direction(facet, X)))
        found = self._assembled(
            q, functions, x_nominal, (facet_trace(self.first, facet, X), facing)
        )
        if self.functional != "standard":
            return found
        # At these points a linear pressure equals its coefficients of standard functions.
        return replace(found, rows=replace(found.rows, x=x_nominal))

    def displaced(self, u: Array, v: Array) -> MortarRows:
        """Rows at the positions x + u and y + v, with the gap between reference positions.
        The gap of the displaced bodies is ``rows.gap - (rows.G @ u + other_G @ v)``.
        Raises InputError where no facet faces another one any longer."""
        found = self.rows((u, v))
        q = found.quadrature
        X, Y = self.rest[0].at(q.facet, q.X), self.rest[1].at(q.other, q.Y)
        gap = found.P @ np.sum((Y - X) * q.n, axis=0)
        return replace(found, rows=replace(found.rows, gap=gap))

    def _assembled(
        self, q: InterfaceQuadrature, functions: Multipliers, x_nominal: Array, at: tuple[Csr, Csr]
    ) -> MortarRows:
        """The rows with the measured gap. `at`, (m, scalar dofs), are the traces of both bodies at
        the contact points, which decide whether supports fix both bodies."""
        psi, w = functions.psi, functions.weights
        P = Csr(sparse.diags_array(1.0 / w) @ psi.T @ sparse.diags_array(q.w))
        here, there = facet_trace(self.first, q.facet, q.X), facet_trace(self.second, q.other, q.Y)
        # On a plane of symmetry the mean over the modelled half may cross the plane: the point
        # itself decides, see `contact.rows.discretise.TraceRows.supported`.
        hub = self.basis.at_place[functions.point]
        place, mean = (sparse.diags_array(part.astype(float)) for part in (hub, ~hub))
        own, free = Csr(place @ at[0] + mean @ (P @ here)), self.first.body.constraint[0]
        normals = within_supports(own, _mean_normals(functions, q), free)
        tangents = tangent_frame(normals)
        if len(normals) == 3:
            tangents = along_supports(own, tangents, free)
        entry, point = P.indices, np.repeat(np.arange(P.shape[0]), np.diff(P.indptr))
        n = q.n[:, entry]
        t = turned_tangents(tangents[:, :, point], normals[:, point], n)
        directions = [(normals, n), *((tangents[:, j], t[:, j]) for j in range(t.shape[1]))]
        G, *T = (self._held(P, (own, at[1]), *both, (here, there)) for both in directions)
        along, other = (by_point([rows[k] for rows in T]) for k in (0, 1))
        x = (functions.N.T @ (q.w * q.x).T).T / w
        rows = ContactRows(
            G[0], along, P @ q.gap, w, x, x_nominal, normals, tangents, self.functional
        )
        return MortarRows(rows, G[1], other, P, q, functions.N)

    def _held(
        self,
        P: Csr,
        at: tuple[Csr, Csr],
        straight: Array,
        vectors: Array,
        traces: tuple[Csr, Csr],
    ) -> tuple[Csr, Csr]:
        """Rows of both bodies in one direction, `straight` (dim, m), `vectors` (dim, nnz of P).
        Where supports fix both bodies in this direction, as on a plane of symmetry, the row is that
        of the point: the mean over the modelled half would not vanish."""
        alone = [directed(at[0], straight), -directed(at[1], straight)]
        bodies = self.first.body, self.second.body
        held = np.ones(P.shape[0], dtype=bool)
        for rows, body in zip(alone, bodies, strict=True):
            held &= norms(rows @ body.constraint[0]) <= 1e-9 * norms(rows)  # rounding of fixed rows
        pick, leave = (sparse.diags_array(part.astype(float)) for part in (held, ~held))
        both = []
        rounding = 1e-14  # of entries, relative to the length of the dof
        for rows, body, trace, sign in zip(alone, bodies, traces, (1.0, -1.0), strict=True):
            result = Csr(pick @ rows + leave @ _along(P, sign * vectors, trace))
            # Drop rounding from functions that are biorthogonal to this one.
            small = np.abs(result.data) < rounding * body.lengths[0][result.indices]
            result.data[small] = 0.0
            result.eliminate_zeros()
            both.append(result)
        if bodies[0] is bodies[1]:
            # At the tip of a slit both faces have the same dofs: their sum is zero.
            total = Csr(both[0] + both[1])
            small = np.abs(total.data) < rounding * bodies[0].lengths[0][total.indices]
            total.data[~small] = 0.0
            both[1] = Csr(both[1] - total)
        return both[0], both[1]


def chart(outline: Outline, u: Array | None = None) -> Any:
    """`FacetCurves` or `FaceMaps` of a boundary, undeformed or displaced by u."""
    kind: Any = FacetCurves if outline.body.dim == 2 else FaceMaps
    if u is None:
        return kind.of(outline)
    moved = values(trace_of_nodes(outline), u, outline.body.dim)
    return kind.of(outline, moved.reshape(len(moved), outline.facets.size, -1))


def trace_of_nodes(outline: Outline) -> Csr:
    """Trace at the nodes of displaced facets, facet by facet, shape (nfacets * k, scalar dofs)."""
    nodes = NODES if outline.body.dim == 2 else moving_nodes(outline)
    facets = np.arange(outline.facets.size)
    return facet_trace(outline, np.repeat(facets, nodes.shape[1]), np.tile(nodes, facets.size))


def _mean_normals(functions: Multipliers, q: InterfaceQuadrature) -> Array:
    """Unit normals of the contact points, (dim, m).
    Raises InputError where facets with opposite normals share a contact point."""
    mean = (functions.N.T @ (q.w * q.n).T).T
    length = np.linalg.norm(mean, axis=0)
    if np.any(length < 1e-9 * functions.weights):  # opposite unit vectors
        raise InputError("boundary: facets with opposite normals meet at a contact point")
    return np.asarray(mean / length)


def _along(P: Csr, vectors: Array, trace: Csr) -> Csr:
    """Mean displacements along vectors given for every entry of P, as rows (m, ndofs)."""
    weighted = [Csr((P.data * v, P.indices, P.indptr), shape=P.shape) for v in vectors]
    return interleaved([part @ trace for part in weighted])


def _checked_functional(
    first: ElasticBody, facets: Index, second: ElasticBody, others: Index, functional: str | None
) -> str:
    """The name of the functional; raises InputError for bad arguments of `mortar_rows`."""
    name = "dual" if functional is None else functional
    offered = ("dual", "standard", "hat")
    if name not in offered:
        raise InputError(
            f"functional={functional!r}: two bodies offer {sorted(offered)}; leave it out "
            "for the dual one"
        )
    if first.dim != second.dim:
        raise InputError(
            f"others: bodies in {first.dim} and {second.dim} dimensions do not make an interface"
        )
    if not facets.size or not others.size:
        raise InputError("facets: empty" if not facets.size else "others: empty")
    shared = np.intersect1d(facets, others) if first is second else np.zeros(0)
    if shared.size:
        raise InputError(
            f"others: facet {int(shared[0])} belongs to both sides of the interface; a body "
            "touches itself on disjoint facets"
        )
    return name
