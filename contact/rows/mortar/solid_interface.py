"""The interface of two bodies in space whose meshes do not match."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.elastic_body import ElasticBody
from contact.rows.functionals import facet_functional
from contact.rows.mortar.clipped_polygons import middle_normals, polygon_quadrature
from contact.rows.mortar.face_maps import FaceMaps
from contact.rows.mortar.face_multipliers import FaceBasis, face_multipliers
from contact.rows.mortar.facet_trace import facet_trace
from contact.rows.mortar.interface_rows import InterfaceRows, MortarRows
from contact.rows.mortar.multipliers import Multipliers
from contact.rows.outline import Outline

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Degree of the trace of each element on a facet, as a polynomial of two variables.
_DEGREE = {"ElementTetP1": 1, "ElementTetP2": 2, "ElementHex1": 2, "ElementHex2": 4}
_CUBIC = 4  # degree of the trace of the Adini brick
# Degrees added where normals vary, and where facets are not affine, so that traces are no
# polynomials: uniform pressures are then exact to 1e-13 with corners off by a quarter of a side.
CURVED, BENT = 4, 8


@dataclass(frozen=True)
class SolidInterface:
    """Two boundaries in space and the multipliers between them."""

    first: Outline  # non-mortar side
    second: Outline  # mortar side
    functional: str  # "dual", "standard" or "hat"
    basis: FaceBasis
    degree: int  # of the polynomials that the Gauss rules integrate

    @classmethod
    def of(
        cls, first: ElasticBody, facets: Index, second: ElasticBody, others: Index, functional: str
    ) -> SolidInterface:
        """Number the contact points; arguments as of `contact.rows.mortar.mortar_rows`."""
        one, two = Outline(first, facets), Outline(second, others)
        form = facet_functional(first.element, None)
        facet_functional(second.element, None)  # its trace is known
        degrees = [_DEGREE.get(type(body.element).__name__, _CUBIC) for body in (first, second)]
        basis = FaceBasis.of(one, form, functional == "hat")
        return cls(one, two, functional, basis, degrees[0] + max(degrees) + 1)

    def rows(self, maps: tuple[FaceMaps, FaceMaps] | None = None) -> MortarRows:
        """Rows with the measured gap, of the displaced facets `maps` or those of the meshes."""
        one, two = rest = FaceMaps.of(self.first), FaceMaps.of(self.second)
        more = 0 if one.flat else CURVED
        if not (one.affine and two.affine):
            more = BENT
        if maps is not None:
            one, two = maps
            more = max(more, CURVED)
        outward = (
            middle_normals(one, self.first.at_corners),
            middle_normals(two, self.second.at_corners),
        )
        quadrature = polygon_quadrature(one, two, outward, self.degree + more)
        if maps is not None:  # forces and pressures are those of small strains
            at = quadrature.facet, quadrature.X
            stretch = one.area(*at) / rest[0].area(*at)
            quadrature = replace(quadrature, w=quadrature.w / stretch)
        functions = face_multipliers(self.basis, quadrature, self.functional != "standard")
        facet, X = self.basis.nominal
        facet, X = facet[functions.point], X[:, functions.point]
        x_nominal = one.at(facet, X)
        own, held = facet_trace(self.first, facet, X), np.ones(facet.size, dtype=bool)
        interface = InterfaceRows(self.first, self.second, quadrature, functions, own, held)
        n = one.direction(facet, X)
        partner = self._partner(two, quadrature.other, functions, x_nominal, n)
        found = interface.assemble(x_nominal, partner, self.functional)
        if self.functional != "standard":
            return found
        # Coefficients of standard functions that represent a linear pressure are its values there.
        return replace(found, rows=replace(found.rows, x=x_nominal))

    def _partner(
        self, two: FaceMaps, other: Index, functions: Multipliers, x: Array, n: Array
    ) -> sparse.csr_array:
        """Trace of the second body opposite the contact points, shape (m, scalar dofs)."""
        # The facet that the largest part of each function lies on.
        N = functions.N.tocoo()
        order = np.lexsort((N.data, N.col))
        most = other[N.row[order[np.append(np.diff(N.col[order]) > 0, True)]]]
        return facet_trace(self.second, most, two.met(most, x, n))
