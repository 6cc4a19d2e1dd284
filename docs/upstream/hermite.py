"""Hermite's line element and the Bogner-Fox-Schmit rectangle from closed forms, for scikit-fem.

They stand in the place of `skfem/element/element_line/element_line_hermite.py` and
`skfem/element/element_quad/element_quad_bfs.py`.
"""

from typing import ClassVar

import numpy as np
from skfem.element import DiscreteField, Element
from skfem.refdom import RefLine, RefQuad

# Coefficients, by growing powers, of what has the value or the slope 1 at an end of (0, 1).
VALUE = ((1, 0, -3, 2), (0, 0, 3, -2))
SLOPE = ((0, 1, -2, 1), (0, 0, -1, 1))


def factor(coefficients, X, order):
    """Return the derivative of a cubic at reference points."""
    return np.polynomial.Polynomial(coefficients).deriv(order)(X)


class ElementLineHermite(Element):
    """:math:`H^2`-conforming element with 4 DOFs."""

    nodal_dofs = 2
    maxdeg = 3
    dofnames: ClassVar = ["u", "u_x"]
    doflocs = np.repeat([[0.0], [1.0]], 2, axis=0)
    refdom = RefLine

    def gbasis(self, mapping, X, i, tind=None):
        """Evaluate a function and its derivatives on cells."""
        if not 0 <= i < 4:
            self._index_error()
        J = mapping.DF(X, tind)[0, 0]
        cubic = (VALUE, SLOPE)[i % 2][i // 2]
        u, du, d2u = (factor(cubic, X[0], k) * J ** (i % 2) / J**k for k in range(3))
        return (DiscreteField(value=u, grad=du[None], hess=d2u[None, None]),)


class ElementQuadBFS(Element):
    """The Bogner-Fox-Schmit element, on rectangles along the axes."""

    nodal_dofs = 4
    maxdeg = 6
    dofnames: ClassVar = ["u", "u_x", "u_y", "u_xy"]
    doflocs = np.repeat([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], 4, axis=0)
    refdom = RefQuad

    def gbasis(self, mapping, X, i, tind=None):
        """Evaluate a function and its derivatives on cells."""
        if not 0 <= i < 16:
            self._index_error()
        J, inverse = mapping.DF(X, tind), mapping.invDF(X, tind)
        size = np.abs(J)
        along = np.maximum(size[0, 0], size[1, 1])
        across = np.maximum(size[0, 1], size[1, 0])
        if np.any(np.minimum(along, across) > 1e-10 * np.maximum(along, across)):
            raise ValueError("ElementQuadBFS: the cells must be rectangles along the axes.")
        vertex, dof = divmod(i, 4)
        at = self.doflocs[4 * vertex].astype(int)

        def product(kind, m, n):
            """Differentiate a product of factors m times by X and n times by Y."""
            x, y = ((VALUE, SLOPE)[kind[k]][at[k]] for k in (0, 1))
            return factor(x, X[0], m) * factor(y, X[1], n)

        # u_X = J00 u_x + J10 u_y, u_Y = J01 u_x + J11 u_y, u_XY = (J00 J11 + J10 J01) u_xy.
        parts = {
            0: [((0, 0), np.ones_like(J[0, 0]))],
            1: [((1, 0), J[0, 0]), ((0, 1), J[0, 1])],
            2: [((1, 0), J[1, 0]), ((0, 1), J[1, 1])],
            3: [((1, 1), J[0, 0] * J[1, 1] + J[1, 0] * J[0, 1])],
        }[dof]

        def field(m, n):
            return sum(weight * product(kind, m, n) for kind, weight in parts)

        gradient = np.array([field(1, 0), field(0, 1)])
        mixed = field(1, 1)
        second = np.array([[field(2, 0), mixed], [mixed, field(0, 2)]])
        return (
            DiscreteField(
                value=field(0, 0),
                grad=np.einsum("ki...,k...->i...", inverse, gradient),
                hess=np.einsum("ki...,kl...,lj...->ij...", inverse, second, inverse),
            ),
        )
