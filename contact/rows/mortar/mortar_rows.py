"""Contact rows of two bodies whose meshes do not match."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from contact.body.elastic_body import ElasticBody
from contact.errors import InputError, evaluated
from contact.rows.functionals import facet_functional
from contact.rows.mortar.facet_curves import FacetCurves
from contact.rows.mortar.facet_trace import facet_trace
from contact.rows.mortar.interface_quadrature import InterfaceQuadrature
from contact.rows.mortar.interface_rows import InterfaceRows, MortarRows
from contact.rows.mortar.multipliers import Multipliers
from contact.rows.mortar.positive_basis import PositiveBasis
from contact.rows.mortar.segments import interface_quadrature, opposite
from contact.rows.mortar.solid_interface import SolidInterface
from contact.rows.outline import Outline

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Clearance = float | ArrayLike | Callable[[Array], ArrayLike]

FUNCTIONALS = ("dual", "standard", "hat")
# Degrees added to those of the Gauss rules where normals vary along facets.
CURVED = 4


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
    The second may be the first body with other facets. `clearance`, on x (2, n) or at the contact
    points, replaces the measured gap; `tied` lowers the degree at held ends (`positive_basis`)."""
    interface = interface_of(first, facets, second, others, functional, tied)
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
    """Two boundaries in the plane and the multipliers between them, at any displacement."""

    first: Outline  # non-mortar side
    second: Outline  # mortar side
    functional: str  # a name of FUNCTIONALS
    basis: PositiveBasis
    degree: int  # sum of the degrees of multipliers, displacement and gap

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
        """Check the arguments of `mortar_rows` and number the contact points."""
        name = checked_functional(first, facets, second, others, functional)
        outlines = Outline(first, facets), Outline(second, others)
        own, theirs = (facet_functional(body.element, None) for body in (first, second))
        basis = PositiveBasis.of(outlines[0], own, name == "hat", tied)
        p = len(own.C) - 1
        return cls(*outlines, name, basis, p + max(p, len(theirs.C) - 1) + 1)

    def rows(self, curves: tuple[FacetCurves, FacetCurves] | None = None) -> MortarRows:
        """Rows with the measured gap, of the displaced facets `curves` or those of the meshes."""
        one, two = curves or (FacetCurves.of(self.first), FacetCurves.of(self.second))
        more = CURVED if one.curved or two.curved else 0
        quadrature = interface_quadrature(one, two, self.degree + more)
        if curves is not None:  # forces and pressures are those of small strains
            at = quadrature.facet, quadrature.X[0]
            slopes = (side.slope(*at) for side in (FacetCurves.of(self.first), one))
            rest, now = (np.linalg.norm(slope, axis=0) for slope in slopes)
            quadrature = replace(quadrature, w=quadrature.w * rest / now)
        lengths = quadrature.w
        if self.first.body.is_ring:  # at the places before any displacement
            x = FacetCurves.of(self.first).at(quadrature.facet, quadrature.X[0])
            quadrature = replace(quadrature, w=lengths * self.first.body.depth(x))
        functions = Multipliers.of(self.basis, quadrature, self.functional != "standard", lengths)
        vertex = self.basis.hub[functions.point] >= 0
        facet, s = self.basis.nominal[0][functions.point], self.basis.nominal[1][functions.point]
        x_nominal = one.at(facet, s)
        own = facet_trace(self.first, facet, s[None])
        interface = InterfaceRows(self.first, self.second, quadrature, functions, own, vertex)
        partner = self._partner(two, quadrature, functions, x_nominal, one.direction(facet, s))
        found = interface.assemble(x_nominal, partner, self.functional)
        if self.functional != "standard":
            return found
        # Coefficients of standard functions that represent a linear pressure are its values there.
        return replace(found, rows=replace(found.rows, x=x_nominal))

    def _partner(
        self,
        two: FacetCurves,
        quadrature: InterfaceQuadrature,
        functions: Multipliers,
        x: Array,
        n: Array,
    ) -> sparse.csr_array:
        """Trace of the second body opposite the contact points, shape (m, scalar dofs)."""
        # The facet that the largest part of each function lies on.
        N = functions.N.tocoo()
        order = np.lexsort((N.data, N.col))
        most = N.row[order[np.append(np.diff(N.col[order]) > 0, True)]]
        other = quadrature.other[most]
        return facet_trace(self.second, other, opposite(two, other, x, n)[None])


def checked_functional(
    first: ElasticBody, facets: Index, second: ElasticBody, others: Index, functional: str | None
) -> str:
    """The name of the functional; raises InputError for bad arguments of `mortar_rows`."""
    name = "dual" if functional is None else functional
    if name not in FUNCTIONALS:
        raise InputError(
            f"functional={functional!r}: two bodies offer {sorted(FUNCTIONALS)}; leave it out "
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


def interface_of(
    first: ElasticBody,
    facets: Index,
    second: ElasticBody,
    others: Index,
    functional: str | None = None,
    tied: bool = False,
) -> Interface | SolidInterface:
    """The interface of two bodies, in the plane or in space; arguments as of `mortar_rows`."""
    if first.dim == 2:
        return Interface.of(first, facets, second, others, functional, tied)
    name = checked_functional(first, facets, second, others, functional)
    return SolidInterface.of(first, facets, second, others, name)
