r"""Constraint functionals: the values of the trace on which contact conditions are imposed.

On each contact facet a functional combines values of the trace, ``value_k = sum_j C[k, j] v(s_j)``;
facets that meet at a vertex share its value. The gap is combined in the same way, so that a gap in
the trace space is reproduced exactly.

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
mean of its two neighbours and is dropped; the rows then have full rank 2N + 2.

Quadratic elements cannot use vertex and midpoint values, because vertices of a quadratic triangle
have weight zero; all Bernstein coefficients of a face have the same weight.

On curves ``bernstein`` has one value a vertex, see `contact.rows.shares`, and replaces ``gauss``,
with which pressure and shear oscillate by a fifth; ``thesis`` is refused. For facets that differ in
length see `contact.rows.discretise`; there ``nodal`` of Adini has an error of 1.5 %.

Pressures of linear triangles and tetrahedra are of first order: with parallel diagonals the rms
error on a roller with 24 facets a quarter is .026 of the largest pressure, with crossed triangles
(``MeshQuad.to_meshtri(style="x")``) .002, with quadratic ones .006.

A face of the Adini brick has three dofs a vertex; four control or Gauss points per face would give
dependent rows. ``centroid`` takes one value per vertex v, the contribution of its functions phi_j
to the mean of u,

.. math::
    b_v(u) = \frac1{w_v} \sum_{j \in v} u_j \int \phi_j, \qquad w_v = \int \phi_{v},

which is u at the centroid of phi_v to first order. The forces w_v p are the load of a uniform
pressure p."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
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
    C: Array  # maps values at the points to functionals, shape (nvalues, npoints)
    nominal: Array  # nominal places of the values, shape (dim - 1, nvalues)
    vertex: tuple[int | tuple[int, int], ...]  # vertex, ends of an edge, or -1 for the facet
    smooth: bool = False  # C1 trace: no vertex values between facets on a straight line
    mean: bool = False  # vertex values are shares of the mean (centroid)
    reduced: bool = False  # on curves use vertex hats: facet middles miss the curve
    straight: bool = False  # for straight boundaries only
    trace: FacetFunctional | None = None  # with one value per dof, see `placed_on`

    @property
    def shared(self) -> NDArray[np.bool_]:
        """Indices of values that belong to a vertex or edge, not to one facet, shape (nvalues,)."""
        return np.array([carrier != -1 for carrier in self.vertex])

    @property
    def corners(self) -> NDArray[np.int64]:
        """Indices of the values at vertices, in ring order."""
        return np.flatnonzero([isinstance(c, int) and c >= 0 for c in self.vertex])

    @property
    def between(self) -> Array:
        """Interpolation from the points to positions midway between them, (npoints, nplaces)."""
        pairs = np.triu_indices(self.points.shape[1], 1)
        middle = 0.5 * (self.points[:, pairs[0]] + self.points[:, pairs[1]])
        return np.asarray(self.C.T @ self.basis(middle))

    def basis(self, points: Array) -> Array:
        """The polynomials N_k of ``v = sum_k value_k N_k`` at points (dim - 1, n), (nvalues, n).
        They sum to one and are not negative for Bernstein coefficients."""
        powers = _powers(*self.points.shape)
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


@cache
def _powers(dim: int, count: int) -> NDArray[np.integer]:
    """Exponents of the monomials that `count` points determine."""
    if dim == 1:
        return np.arange(count)[:, None]
    if count in (4, 9):
        order = range(2 if count == 4 else 3)
        return np.array([[i, j] for i in order for j in order])
    return np.array([[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]][:count])


@cache
def _of_elements() -> dict[str, tuple[FacetFunctional, ...]]:
    """The functionals of each element; the first is the default."""
    roots = [0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0)]
    nodal, gauss = _line("nodal", [0.0, 1.0], None, (0, 1)), _line("gauss", roots, None, (-1, -1))
    quadratic = _line("bernstein", [0.0, 0.5, 1.0], _quadratic(), (0, -1, 1), reduced=True)
    # Bernstein coefficients of the interpolating cubic.
    C = np.array([[6.0, 0, 0, 0], [-5, 18, -9, 2], [2, -9, 18, -5], [0, 0, 0, 6.0]]) / 6.0
    thirds, carriers = [0.0, 1 / 3, 2 / 3, 1.0], (0, -1, -1, 1)
    cubic = _line("bernstein", thirds, C, carriers, smooth=True, reduced=True)
    straight = replace(gauss, trace=cubic, straight=True)
    cubics = (cubic, straight, nodal, replace(nodal, name="centroid", mean=True))
    corners = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    triangle = FacetFunctional("nodal", corners, np.eye(3), corners, (0, 1, 2))
    corners = np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]])
    square = FacetFunctional("nodal", corners, np.eye(4), corners, (0, 1, 2, 3))
    points = np.array([[x, y] for x in roots for y in roots]).T
    in_square = FacetFunctional("gauss", points, np.eye(4), points, (-1,) * 4, straight=True)
    return {
        "ElementTriP1": (nodal,),
        "ElementQuad1": (nodal,),
        "ElementTriP2": (quadratic, replace(gauss, straight=True)),
        "ElementQuad2": (quadratic, replace(gauss, straight=True)),
        "ElementTetP1": (triangle,),
        "ElementHex1": (square,),
        "ElementTetP2": (_quadratic_triangle(),),
        "ElementHex2": (_quadratic_square(), in_square),
        "ElementHexAdini": (replace(square, name="centroid", mean=True), square),
        "ElementQuadBFS": cubics,
        "ElementQuadAdini": (*cubics, _line("thesis", thirds, None, carriers, straight=True)),
    }


def _quadratic() -> Array:
    """Bernstein coefficients of the interpolating quadratic."""
    return np.array([[1.0, 0.0, 0.0], [-0.5, 2.0, -0.5], [0.0, 0.0, 1.0]])


def _quadratic_triangle() -> FacetFunctional:
    points = np.array([[0.0, 1.0, 0.0, 0.5, 0.5, 0.0], [0.0, 0.0, 1.0, 0.0, 0.5, 0.5]])
    C, edges = np.eye(6), ((0, 1), (1, 2), (0, 2))
    for k, (a, b) in enumerate(edges):
        C[3 + k, [3 + k, a, b]] = 2.0, -0.5, -0.5
    return FacetFunctional("bernstein", points, C, points, (0, 1, 2, *edges), reduced=True)


def _quadratic_square() -> FacetFunctional:
    # Positions in half sides: vertices, middles of edges, the middle.
    place = np.array([(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1)])
    of_line, edges = _quadratic(), ((0, 1), (1, 2), (2, 3), (3, 0))
    C = np.array([[of_line[k, i] * of_line[m, j] for i, j in place] for k, m in place])
    return FacetFunctional(
        "bernstein", place.T / 2, C, place.T / 2, (0, 1, 2, 3, *edges, -1), reduced=True
    )


def facet_functional(element: Any, name: str | None) -> FacetFunctional:
    """The functional of a scalar element by name; None is the element's default.
    Raises InputError for an unsupported family or a name that it does not offer."""
    family, known = type(element).__name__, _of_elements()
    if family not in known:
        raise InputError(
            f"element: {family} has no contact functional yet; use one of {sorted(known)}"
        )
    offered = {functional.name: functional for functional in known[family]}
    if name is None:
        return known[family][0]
    if not isinstance(name, str) or name not in offered:
        raise InputError(f"functional={name!r}: {family} offers {sorted(offered)}")
    return offered[name]
