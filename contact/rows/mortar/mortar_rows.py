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
# Degrees that Gauss rules integrate besides those of the trace where normals vary.
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
    """Discretise the interface of two bodies.

    Parameters
    ----------
    first : ElasticBody
        The body that carries the multipliers: the non-mortar side.
    facets : ndarray of int
        Facets of its contact boundary.
    second : ElasticBody
        The body opposite; it may be the first one, whose facets it then must not share.
    others : ndarray of int
        Facets of its surface.
    functional : {None, "dual", "standard", "hat"}
        See `contact.rows.mortar.multipliers`; None is "dual".
    clearance : number, callable x -> gap, or ndarray of shape (m,), optional
        Gap at places x of shape (2, n) on the first body, or at the contact points, in the place of
        the one between the two meshes.
    tied : bool
        Lower the degree of the multipliers at held ends, see
        `contact.rows.mortar.positive_basis`.

    Raises
    ------
    InputError
        Facets that no facet of the second body faces, or of which it shares one; normals that point
        the same way; an unknown functional; a clearance that is not finite or has a wrong shape.

    Examples
    --------
    >>> from skfem import ElementQuad1, MeshQuad
    >>> upper, lower = (
    ...     ElasticBody.from_mesh(
    ...         MeshQuad.init_tensor(np.linspace(0, 1, n + 1), [y, y + 1.0]).with_defaults(),
    ...         ElementQuad1(),
    ...         E=1.0,
    ...         nu=0.3,
    ...     )
    ...     for n, y in ((3, 0.5), (5, -1.0))
    ... )
    >>> interface = mortar_rows(upper, upper.facets("bottom"), lower, lower.facets("top"))
    >>> interface.rows.gap.round(12).tolist(), interface.rows.weights.round(3).tolist()
    ([0.5, 0.5, 0.5, 0.5], [0.167, 0.333, 0.333, 0.167])
    """
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
    """Two boundaries and the multipliers between them, whatever the present places.

    Attributes
    ----------
    first, second : Outline
        Non-mortar and mortar side.
    functional : {"dual", "standard", "hat"}
    basis : PositiveBasis
    degree : int
        Sum of the degrees of multipliers, displacement and gap.
    """

    first: Outline
    second: Outline
    functional: str
    basis: PositiveBasis
    degree: int

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
        """Rows at the present places of both boundaries; the gap is the measured one.

        Parameters
        ----------
        curves : pair of FacetCurves, optional
            The facets where the bodies have moved to. Those of the meshes if not given.
        """
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
    """The name of the functional, after a look at the other arguments of `mortar_rows`."""
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
