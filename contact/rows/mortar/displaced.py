r"""Contact rows of an interface at the displaced places of the bodies.

The segments are those of the displaced facets. With the reference places X and Y that face each
other there, the condition of no penetration is linear in the displacement of the elements:

.. math:: n \cdot \big(Y + u_m(Y) - X - u_s(X)\big) \ge 0, \quad G u \le P (n \cdot (Y - X)) .

P. Wriggers, Computational Contact Mechanics, 2nd ed., Springer 2006, chapter 4."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.rows.mortar.face_maps import FaceMaps, moving_nodes
from contact.rows.mortar.facet_curves import FacetCurves, facet_nodes
from contact.rows.mortar.facet_trace import facet_trace
from contact.rows.mortar.interface_rows import MortarRows
from contact.rows.mortar.mortar_rows import Interface
from contact.rows.mortar.solid_interface import SolidInterface
from contact.rows.mortar.trace_fields import values
from contact.rows.outline import Outline

Array = NDArray[np.float64]


def displaced_rows(interface: Interface | SolidInterface, u: Array, v: Array) -> MortarRows:
    """Rows at the places x + u and y + v of the two bodies, with the gap between reference places.
    The gap of the displaced bodies is ``rows.gap - (rows.G @ u + other_G @ v)``.
    Raises InputError where no facet faces another one any longer."""
    outlines = interface.first, interface.second
    if isinstance(interface, SolidInterface):
        one, two = outlines
        found = interface.rows((displaced_maps(one, u), displaced_maps(two, v)))
        at = found.quadrature
        X, Y = FaceMaps.of(one).at(at.facet, at.X), FaceMaps.of(two).at(at.other, at.Y)
        return _with_gap(found, X, Y)
    moved = tuple(
        FacetCurves.of(outline, facet_nodes(outline) + _at_nodes(outline, of_body))
        for outline, of_body in zip(outlines, (u, v), strict=True)
    )
    found = interface.rows((moved[0], moved[1]))
    at = found.quadrature
    X = FacetCurves.of(outlines[0]).at(at.facet, at.X[0])
    Y = FacetCurves.of(outlines[1]).at(at.other, at.Y[0])
    return _with_gap(found, X, Y)


def displaced_maps(outline: Outline, u: Array) -> FaceMaps:
    """The facets of a boundary in space where a body has moved to."""
    moved = values(trace_of_nodes(outline), u, 3)
    return FaceMaps.of(outline, moved.reshape(3, outline.facets.size, -1))


def trace_of_nodes(outline: Outline) -> sparse.csr_array:
    """Trace at the nodes of displaced facets, facet by facet, shape (nfacets * k, scalar dofs)."""
    nodes, facets = moving_nodes(outline), np.arange(outline.facets.size)
    return facet_trace(outline, np.repeat(facets, nodes.shape[1]), np.tile(nodes, facets.size))


def _with_gap(found: MortarRows, X: Array, Y: Array) -> MortarRows:
    """The same rows with the gap between reference places (dim, n) of the integration points."""
    gap = found.P @ np.sum((Y - X) * found.quadrature.n, axis=0)
    return replace(found, rows=replace(found.rows, gap=gap))


def _at_nodes(outline: Outline, u: Array) -> Array:
    """Displacement at the ends and the middle of each facet, shape (2, nfacets, 3)."""
    count = outline.facets.size
    s = np.tile([0.0, 0.5, 1.0], count)[None]
    trace = facet_trace(outline, np.repeat(np.arange(count), 3), s)
    return values(trace, u, 2).reshape(2, count, 3)
