"""Constraint functionals: how a multiplier meets the trace of the displacement.

A functional takes, on each contact facet, the values of the trace at a few points to a few
numbers, ``value_k = sum_j C[k, j] v(s_j)``. Numbers that belong to a shared vertex are one and the
same for both facets. The same combination is applied to the gap, so a gap in the trace space is
met exactly.

==============  ===================================  ========  =====================================
name            numbers                              passes    remark
                                                     the patch
                                                     test
==============  ===================================  ========  =====================================
``nodal``       vertex values                        P1, Q1    Adini fails the patch test
``bernstein``   Bernstein (control-net) coefficients yes       no penetration between the points:
                                                               the trace lies in their convex hull
``gauss``       values at two Gauss points           yes       may penetrate between the points
``thesis``      3N + 1 points at thirds              --        rank 2N + 2: reproduction only
==============  ===================================  ========  =====================================

For Adini the trace is a C1 cubic spline. Where two facets continue each other the vertex number
is a mean of its two neighbours and is dropped; what remains has full rank 2N + 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FacetFunctional:
    """One facet's share of a constraint functional.

    Attributes
    ----------
    name
    points : ndarray, shape (dim - 1, npoints)
        Where the trace is evaluated, on the reference facet.
    C : ndarray, shape (nvalues, npoints)
    nominal : ndarray, shape (dim - 1, nvalues)
        Where each number is thought to sit.
    vertex : tuple of int
        Local vertex that carries the number, or -1 if the facet does.
    smooth : bool
        The trace is C1: drop vertex numbers where two facets continue each other.
    weights : ndarray, shape (nvalues,), or None
        Weights as fractions of the facet's measure; None derives them from the trace space.
    """

    name: str
    points: Array
    C: Array
    nominal: Array
    vertex: tuple[int, ...]
    smooth: bool = False
    weights: Array | None = None


def _line(
    name: str, points: list[float], C: Array | None, vertex: tuple[int, ...], **more: Any
) -> FacetFunctional:
    s = np.array([points])
    nominal = s if C is None else np.linspace(0.0, 1.0, len(vertex))[None]
    return FacetFunctional(
        name, s, np.eye(len(points)) if C is None else C, nominal, vertex, **more
    )


_THIRDS = [0.0, 1 / 3, 2 / 3, 1.0]
_GAUSS = [0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0)]
# Bernstein coefficients of the interpolating quadratic and cubic.
_QUADRATIC = np.array([[1.0, 0.0, 0.0], [-0.5, 2.0, -0.5], [0.0, 0.0, 1.0]])
_CUBIC = np.array([[6.0, 0, 0, 0], [-5, 18, -9, 2], [2, -9, 18, -5], [0, 0, 0, 6.0]]) / 6.0

_NODAL_LINE = _line("nodal", [0.0, 1.0], None, (0, 1))
_GAUSS_LINE = _line("gauss", _GAUSS, None, (-1, -1))
_NODAL_TRIANGLE = FacetFunctional(
    "nodal",
    np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    np.eye(3),
    np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    (0, 1, 2),
)
_NODAL_QUAD = FacetFunctional(
    "nodal",
    np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]]),
    np.eye(4),
    np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]]),
    (0, 1, 2, 3),
)
_QUADRATIC_LINE = _line("bernstein", [0.0, 0.5, 1.0], _QUADRATIC, (0, -1, 1))

# The first functional of an element is its default.
_OF_ELEMENT: dict[str, tuple[FacetFunctional, ...]] = {
    "ElementTriP1": (_NODAL_LINE,),
    "ElementQuad1": (_NODAL_LINE,),
    "ElementTriP2": (_QUADRATIC_LINE, _GAUSS_LINE),
    "ElementQuad2": (_QUADRATIC_LINE, _GAUSS_LINE),
    "ElementTetP1": (_NODAL_TRIANGLE,),
    "ElementHex1": (_NODAL_QUAD,),
    "ElementQuadAdini": (
        _line("bernstein", _THIRDS, _CUBIC, (0, -1, -1, 1), smooth=True),
        _GAUSS_LINE,
        _NODAL_LINE,
        _line("thesis", _THIRDS, None, (0, -1, -1, 1), weights=np.array([1.0, 3, 3, 1]) / 8),
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
    if name not in offered:
        raise InputError(f"functional={name!r}: {family} offers {sorted(offered)}")
    return offered[name]
