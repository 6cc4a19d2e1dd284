r"""Constraint functionals: the values of the displacement's trace that contact conditions act on.

On each contact facet a functional combines values of the trace, ``value_k = sum_j C[k, j] v(s_j)``;
facets that meet at a vertex share its value. The gap is combined in the same way, so that a gap in
the trace space is satisfied exactly.

==============  ===================================  ========  =====================================
name            values                               passes    remark
                                                     the patch
                                                     test
==============  ===================================  ========  =====================================
``nodal``       vertex values                        P1, Q1    Adini fails the patch test: uniform
                                                               pressure, a third off at the ends
``bernstein``   Bernstein (control-net) coefficients yes       no penetration between the points:
                                                               the trace lies in their convex hull
``gauss``       values at two Gauss points           yes       may penetrate between the points
``centroid``    one a vertex: its share of the mean  yes       may penetrate between the points
``thesis``      3N + 1 points at thirds              --        rank 2N + 2: reproduction only
==============  ===================================  ========  =====================================

The trace of Adini and BFS is a C1 cubic spline: the value at a vertex within a straight line is a
mean of its two neighbours and is dropped, which leaves full rank 2N + 2.

Quadratic elements cannot use vertex and midpoint values, because vertices of a quadratic triangle
have weight zero; all Bernstein coefficients of a face have the same weight.

On curves ``bernstein`` is one value a vertex, see `contact.rows.shares`, and replaces ``gauss``,
with which pressure and shear oscillate by a fifth; ``thesis`` is refused. Where facets differ in
length see `contact.rows.discretise`; ``nodal`` of Adini stays 1.5 % off there.

Pressures of linear triangles and tetrahedra are of first order: with parallel diagonals the rms
error on a roller with 24 facets a quarter is .026 of the largest pressure, with crossed triangles
(``MeshQuad.to_meshtri(style="x")``) .002, with quadratic ones .006.

A face of the Adini brick has three dofs a vertex; four control or Gauss points a face would make
dependent rows. ``centroid`` takes one value a vertex v, the part of the mean of u that belongs to
its functions phi_j,

.. math::
    b_v(u) = \frac1{w_v} \sum_{j \in v} u_j \int \phi_j, \qquad w_v = \int \phi_{v},

u at the centroid of phi_v to first order. The forces w_v p are the load of a uniform pressure p."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FacetFunctional:
    """The part of a constraint functional that belongs to one facet."""

    name: str
    points: Array  # where the trace is evaluated, shape (dim - 1, npoints)
    C: Array  # combines the values at the points, shape (nvalues, npoints)
    nominal: Array  # nominal places of the values, shape (dim - 1, nvalues)
    vertex: tuple[int | tuple[int, int], ...]  # vertex, ends of the edge, or -1: the facet
    smooth: bool = False  # C1 trace: no vertex values between facets on a straight line
    mean: bool = False  # vertex values are shares of the mean (centroid)
    reduced: bool = False  # on curves hats of the vertices: middles are off by the sagitta
    straight: bool = False  # for straight boundaries only
    trace: FacetFunctional | None = None  # with a value per dof, for places, see `placed_on`

    @property
    def shared(self) -> NDArray[np.bool_]:
        """Numbers that belong to a vertex or an edge, not to the facet alone, shape (nvalues,)."""
        return np.array([carrier != -1 for carrier in self.vertex])

    @property
    def corners(self) -> NDArray[np.int64]:
        """The numbers that belong to vertices, in ring order."""
        return np.flatnonzero([isinstance(c, int) and c >= 0 for c in self.vertex])

    @property
    def between(self) -> Array:
        """Values midway between the points, of the polynomial through them, (npoints, nplaces)."""
        pairs = np.triu_indices(self.points.shape[1], 1)
        middle = 0.5 * (self.points[:, pairs[0]] + self.points[:, pairs[1]])
        return np.asarray(self.C.T @ self.basis(middle))

    def basis(self, points: Array) -> Array:
        """The polynomials N_k of ``v = sum_k value_k N_k`` at points (dim - 1, n), (nvalues, n).
        They sum to one and are not negative for Bernstein coefficients."""
        powers = _POWERS[self.points.shape]
        at_nodes, at_points = (
            np.prod(x.T[:, None] ** powers, axis=2) for x in (self.points, points)
        )
        return np.asarray(np.linalg.solve((self.C @ at_nodes).T, at_points.T))


def _line(
    name: str, points: list[float], C: Array | None, vertex: tuple[int, ...], **more: Any
) -> FacetFunctional:
    s = np.array([points])
    nominal = s if C is None else np.linspace(0.0, 1.0, len(vertex))[None]
    return FacetFunctional(
        name, s, np.eye(len(points)) if C is None else C, nominal, vertex, **more
    )


# Exponents of the monomials that span the traces, by the number of points that determine them.
_LINE = {(1, n): np.arange(n)[:, None] for n in (2, 3, 4)}
_POWERS = _LINE | {
    (2, 3): np.array([[0, 0], [1, 0], [0, 1]]),
    (2, 6): np.array([[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]]),
    (2, 4): np.array([[i, j] for i in range(2) for j in range(2)]),
    (2, 9): np.array([[i, j] for i in range(3) for j in range(3)]),
}
_THIRDS = [0.0, 1 / 3, 2 / 3, 1.0]
_GAUSS = [0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0)]
# Bernstein coefficients of the interpolating quadratic and cubic.
_QUADRATIC = np.array([[1.0, 0.0, 0.0], [-0.5, 2.0, -0.5], [0.0, 0.0, 1.0]])
_CUBIC = np.array([[6.0, 0, 0, 0], [-5, 18, -9, 2], [2, -9, 18, -5], [0, 0, 0, 6.0]]) / 6.0

_NODAL_LINE = _line("nodal", [0.0, 1.0], None, (0, 1))
_GAUSS_LINE = _line("gauss", _GAUSS, None, (-1, -1))
_TRIANGLE = np.array([[0.0, 1.0, 0.0, 0.5, 0.5, 0.0], [0.0, 0.0, 1.0, 0.0, 0.5, 0.5]])
_SQUARE = np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]])
_NODAL_TRIANGLE = FacetFunctional("nodal", _TRIANGLE[:, :3], np.eye(3), _TRIANGLE[:, :3], (0, 1, 2))
_NODAL_QUAD = FacetFunctional("nodal", _SQUARE, np.eye(4), _SQUARE, (0, 1, 2, 3))
_TRIANGLE_EDGES, _SQUARE_EDGES = ((0, 1), (1, 2), (0, 2)), ((0, 1), (1, 2), (2, 3), (3, 0))


def _quadratic_triangle() -> FacetFunctional:
    C = np.eye(6)
    for k, (a, b) in enumerate(_TRIANGLE_EDGES):
        C[3 + k, [3 + k, a, b]] = 2.0, -0.5, -0.5
    carriers = (0, 1, 2, *_TRIANGLE_EDGES)
    return FacetFunctional("bernstein", _TRIANGLE, C, _TRIANGLE, carriers, reduced=True)


def _quadratic_square() -> FacetFunctional:
    # Places in halves of a side: vertices, middles of edges, the middle.
    place = np.array([(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1)])
    C = np.array([[_QUADRATIC[k, i] * _QUADRATIC[m, j] for i, j in place] for k, m in place])
    return FacetFunctional(
        "bernstein", place.T / 2, C, place.T / 2, (0, 1, 2, 3, *_SQUARE_EDGES, -1), reduced=True
    )


_GAUSS_SQUARE = FacetFunctional(
    "gauss",
    np.array([[x, y] for x in _GAUSS for y in _GAUSS]).T,
    np.eye(4),
    np.array([[x, y] for x in _GAUSS for y in _GAUSS]).T,
    (-1, -1, -1, -1),
    straight=True,
)
_QUADRATIC_LINE = _line("bernstein", [0.0, 0.5, 1.0], _QUADRATIC, (0, -1, 1), reduced=True)

_CUBIC_LINE = _line("bernstein", _THIRDS, _CUBIC, (0, -1, -1, 1), smooth=True, reduced=True)
_CUBIC_LINES = (
    _CUBIC_LINE,
    replace(_GAUSS_LINE, trace=_CUBIC_LINE, straight=True),
    _NODAL_LINE,
    replace(_NODAL_LINE, name="centroid", mean=True),
)

# The first functional of an element is its default.
_OF_ELEMENT: dict[str, tuple[FacetFunctional, ...]] = {
    "ElementTriP1": (_NODAL_LINE,),
    "ElementQuad1": (_NODAL_LINE,),
    "ElementTriP2": (_QUADRATIC_LINE, replace(_GAUSS_LINE, straight=True)),
    "ElementQuad2": (_QUADRATIC_LINE, replace(_GAUSS_LINE, straight=True)),
    "ElementTetP1": (_NODAL_TRIANGLE,),
    "ElementHex1": (_NODAL_QUAD,),
    "ElementTetP2": (_quadratic_triangle(),),
    "ElementHex2": (_quadratic_square(), _GAUSS_SQUARE),
    "ElementHexAdini": (replace(_NODAL_QUAD, name="centroid", mean=True), _NODAL_QUAD),
    "ElementQuadBFS": (*_CUBIC_LINES,),
    "ElementQuadAdini": (
        *_CUBIC_LINES,
        _line("thesis", _THIRDS, None, (0, -1, -1, 1), straight=True),
    ),
}


def facet_functional(element: Any, name: str | None) -> FacetFunctional:
    """The functional of a scalar element by its name, None for the family's default.
    Raises InputError for an unsupported family or a name that it does not offer."""
    family = type(element).__name__
    if family not in _OF_ELEMENT:
        raise InputError(
            f"element: {family} has no contact functional yet; use one of {sorted(_OF_ELEMENT)}"
        )
    offered = {functional.name: functional for functional in _OF_ELEMENT[family]}
    if name is None:
        return _OF_ELEMENT[family][0]
    if not isinstance(name, str) or name not in offered:
        raise InputError(f"functional={name!r}: {family} offers {sorted(offered)}")
    return offered[name]
