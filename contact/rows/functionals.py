r"""Constraint functionals: the values of the displacement's trace that contact conditions act on.

On each contact facet a functional combines the values of the trace at a few points into a few
numbers, ``value_k = sum_j C[k, j] v(s_j)``. A number that belongs to a vertex is shared by the
facets that meet there. The same combination is applied to the gap, so that a gap in the trace space
is satisfied exactly.

==============  ===================================  ========  =====================================
name            numbers                              passes    remark
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

For Adini and BFS the trace is a C1 cubic spline. At a vertex between two facets on a straight line
the number is a mean of its two neighbours and is dropped; the remaining ones have full rank
2N + 2.

Quadratic elements cannot use vertex and midpoint values: in the mean over a quadratic triangle its
vertices have weight zero, so a force there has no pressure. All Bernstein coefficients of a face
have the same weight, 1/6 on triangles and 1/9 on quadrilaterals.

On the facets of a curve ``bernstein`` is one number a vertex, see `contact.rows.shares`. Two Gauss
points per facet are unsuitable there: pressure and shear oscillate by a fifth on any mesh.
``gauss`` on a boundary with a curve is ``bernstein``, and ``thesis`` is refused. Where facets
differ in length see `contact.rows.unequal_facets`; ``nodal`` of Adini stays 1.5 % off there.

Pressures of linear triangles and tetrahedra, which are their consistent reactions, are of first
order. Their rms error on a roller with 24 facets a quarter is .026 of the largest pressure if all
diagonals are parallel, .04 with facets of lengths 1:2, and .06 for tetrahedra on a bore as fine. It
is .002 with crossed triangles (``MeshQuad.to_meshtri(style="x")``) and .006 with quadratic ones,
and both converge faster. Bilinear cells have .004, and .009, of first order, where long and short
cells alternate.

A face of the Adini brick has three numbers a vertex, u and its slopes along the face. Control
points along the edges, or Gauss points, would be four a face, and their rows would be linearly
dependent. ``centroid`` takes one a vertex v, the part of the mean of u that belongs to its
functions phi_j,

.. math::
    b_v(u) = \frac1{w_v} \sum_{j \in v} u_j \int \phi_j, \qquad w_v = \int \phi_{v},

that is u plus the slope times the vector to the centroid of phi_v: the vertex value itself on a
uniform mesh. On any mesh the forces w_v p are then the load of a uniform pressure p.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FacetFunctional:
    """The part of a constraint functional that belongs to one facet.

    Attributes
    ----------
    name : str
    points : ndarray, shape (dim - 1, npoints)
        Where the trace is evaluated, on the reference facet.
    C : ndarray, shape (nvalues, npoints)
        Coefficients that combine the values at the points.
    nominal : ndarray, shape (dim - 1, nvalues)
        Nominal place of each number on the reference facet.
    vertex : tuple of int or pairs of int
        Local vertex that carries the number, the two ends of the edge that does, or -1 for the
        facet.
    smooth : bool
        The trace is C1: vertex numbers are dropped between two facets on a straight line.
    mean : bool
        Replace the vertex values by the vertices' shares of the mean (``centroid``).
    reduced : bool
        On straight facets that approximate a curve only the hats of the vertices are used, because
        conditions at vertices contradict those in the middle of a facet, which is off the curve by
        the sagitta.
    straight : bool
        For straight boundaries only.
    trace : FacetFunctional, optional
        A functional with as many numbers as the trace has dofs. Given if this one has fewer: it
        determines where pressures are reported, see `contact.rows.shares.placed_on`.
    """

    name: str
    points: Array
    C: Array
    nominal: Array
    vertex: tuple[int | tuple[int, int], ...]
    smooth: bool = False
    mean: bool = False
    reduced: bool = False
    straight: bool = False
    trace: FacetFunctional | None = None

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
        """The polynomials N_k that the numbers multiply, ``v = sum_k value_k N_k``.

        Parameters
        ----------
        points : ndarray, shape (dim - 1, n)

        Returns
        -------
        ndarray, shape (nvalues, n)
            They are not negative for Bernstein coefficients, and sum to one.
        """
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
    """Look up the functional of an element family.

    Parameters
    ----------
    element : Element
        Scalar element.
    name : str or None
        None takes the family's default.

    Raises
    ------
    InputError
        The family is not supported or does not offer the name.

    Examples
    --------
    >>> from skfem import ElementTriP2
    >>> facet_functional(ElementTriP2(), None).name
    'bernstein'
    """
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
