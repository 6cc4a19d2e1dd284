"""The Adini rectangle, extended to straight-sided quadrilaterals."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import perm
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem.element import DiscreteField, ElementH1
from skfem.refdom import RefQuad

from .errors import InputError
from .quad_cells import QuadCells

Array = NDArray[np.float64]

# Coefficients in X of the factors seen from the end X = 0 and from the end X = 1.
_LINEAR = ((1.0, -1.0), (0.0, 1.0))
_CUBIC = ((0.5, 0.5, -3.0, 2.0), (0.0, -0.5, 3.0, -2.0))
_SLOPE = ((0.0, 1.0, -2.0, 1.0), (0.0, 0.0, -1.0, 1.0))

# A reference function is a sum of products f(X) g(Y).
_VALUE = ((_CUBIC, _LINEAR), (_LINEAR, _CUBIC))
_DX = ((_SLOPE, _LINEAR),)
_DY = ((_LINEAR, _SLOPE),)

_MOST_DERIVATIVES = 6


class ElementQuadAdini(ElementH1):
    r"""Adini's twelve-parameter element with u, u_x and u_y at the four vertices.

    On the reference square the shape functions span the cubics and :math:`X^3 Y, X Y^3`. Those of
    the vertex (0, 0) are

    .. math::
        N = C(X) L(Y) + L(X) C(Y), \quad H_1 = S(X) L(Y), \quad H_2 = L(X) S(Y),

    .. math::
        L(X) = 1 - X, \quad C(X) = (1 + X - 6 X^2 + 4 X^3) / 2, \quad S(X) = X (1 - X)^2,

    and those of the other vertices follow by reflection, with the sign of S changed.
    In a cell :math:`F` the function of the dof :math:`\partial u/\partial x_i` at the vertex
    :math:`k` is :math:`\sum_j DF_{ij}(k) H_j`, so the dofs are the physical derivatives.

    The function u and its tangential derivative are continuous across edges (along an edge u is
    the cubic Hermite interpolant of its end points); the normal derivative is continuous at
    vertices only. The element is conforming for second-order problems, with orders 4 in L2 and 3
    in H1 on parallelograms, and nonconforming for plates, with order 2 in L2, H1 and H2.

    On cells that are not parallelograms the space lacks :math:`X^2 Y^2`: with the twist
    :math:`t = |p_0 - p_1 + p_2 - p_3|` over the longest side the error gains terms of size
    :math:`t^2 h^2` and :math:`t h^3`. Orders fall to 2 and 1 when t is constant under refinement
    and stay 4 and 3 when t falls like h (uniform refinement of a coarse mesh).

    Parameters
    ----------
    derivatives
        How many orders of derivatives `gbasis` returns, 0 to 6: 1 the gradient, 2 also the
        Hessian (`hess`), 3 also `grad3`, and so on. Orders above 2 need parallelogram cells.

    Raises
    ------
    InputError
        `derivatives` is not a whole number from 0 to 6; a cell is not strictly convex or the mesh
        not made of four-node quadrilaterals; third derivatives on cells that are not
        parallelograms.

    Warns
    -----
    ReducedOrderWarning
        Cells have a twist above 1e-3.

    References
    ----------
    A. Adini and R. W. Clough, Analysis of plate bending by the finite element method, report to
    the National Science Foundation, grant G 7337, 1961.

    R. J. Melosh, Basis for derivation of matrices for the direct stiffness method, AIAA Journal
    1 (1963), 1631-1637.

    J. Hu, X. Yang and S. Zhang, Capacity of the Adini element for biharmonic equations, Journal
    of Scientific Computing 69 (2016), 1366-1383.

    D. N. Arnold, D. Boffi and R. S. Falk, Approximation by quadrilateral finite elements,
    Mathematics of Computation 71 (2002), 909-922.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> basis = Basis(MeshQuad().refined(2), ElementQuadAdini())
    >>> x = basis.project(lambda x: x[0] ** 3 * x[1])
    >>> [round(float(u), 9) for u in x[basis.nodal_dofs[:, 2]]]
    [1.0, 3.0, 1.0]
    """

    nodal_dofs = 3
    maxdeg = 3
    dofnames = ["u", "u_x", "u_y"]  # noqa: RUF012
    doflocs = np.repeat([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], 3, axis=0)
    refdom = RefQuad

    def __init__(self, derivatives: int = 1) -> None:
        if derivatives not in range(_MOST_DERIVATIVES + 1):
            raise InputError(f"derivatives: expected 0 to {_MOST_DERIVATIVES}, got {derivatives!r}")
        self.derivatives = int(derivatives)

    def lbasis(self, X: Array, i: int) -> tuple[Array, Array]:
        """Return reference function i and its gradient at the reference points X, (2, ...)."""
        dof = self._locate(i)
        function = [(_VALUE, _DX, _DY)[dof]]
        value, gradient = (_reference(function, self.doflocs[i], X, order) for order in (0, 1))
        return value[0], gradient

    def gbasis(
        self, mapping: Any, X: Array, i: int, tind: NDArray[np.integer] | None = None
    ) -> tuple[DiscreteField]:
        """Return shape function i and its derivatives in the cells `tind`.

        Parameters
        ----------
        mapping
            A scikit-fem mapping; its mesh gives the cells.
        X
            Reference points, shape (2, points) or (2, cells, points).
        i
            Local number of the function, 0 to 11.
        tind
            Cell numbers, all by default.

        Returns
        -------
        tuple of DiscreteField
            One field: value (cells, points), grad (2, cells, points), hess (2, 2, cells, points)
            and so on, up to `derivatives`.
        """
        dof = self._locate(i)
        vertex = self.doflocs[i]
        cells = QuadCells.from_mapping(mapping, tind)
        if i == 0:
            cells.check()
        if self.derivatives > 2 and not cells.affine:
            raise InputError(
                f"derivatives: {self.derivatives} orders need parallelogram cells; "
                "use ElementQuadAdini(derivatives=2) on this mesh"
            )
        functions: list[Any]
        if dof == 0:
            functions = [_VALUE]
            weights = [np.ones((cells.a.shape[1], 1))]
        else:
            functions = [_DX, _DY]
            weights = [tangent[dof - 1, :, None] for tangent in cells.tangents(*vertex)]

        fields = [_combine(weights, _reference(functions, vertex, X, 0))]
        if self.derivatives > 0:
            G = cells.inverse_jacobian(X)
        for order in range(1, self.derivatives + 1):
            fields.append(_push_forward(weights, _reference(functions, vertex, X, order), G))
        if self.derivatives > 1 and not cells.affine:
            fields[2] -= _twist_hessian(cells.c, fields[1], G)
        names = ("value", "grad", "hess", "grad3", "grad4", "grad5", "grad6")
        return (DiscreteField(**dict(zip(names, fields, strict=False))),)

    def _locate(self, i: int) -> int:
        if not 0 <= i < 12:
            self._index_error()
        return i % 3


def _reference(functions: Sequence[Any], vertex: Array, X: Array, order: int) -> Array:
    """Return the order + 1 partial derivatives of each function, by rising order in Y."""
    end_x, end_y = vertex.astype(int)
    x, y = X
    rows = [
        sum(_derivative(f[end_x], order - k, x) * _derivative(g[end_y], k, y) for f, g in function)
        for function in functions
        for k in range(order + 1)
    ]
    return np.array(rows)


def _derivative(coefficients: tuple[float, ...], order: int, x: Array) -> Array:
    """Return one derivative of a polynomial at x, by Horner's rule."""
    result = np.zeros_like(x)
    for power in range(len(coefficients) - 1, order - 1, -1):
        result = result * x + coefficients[power] * perm(power, order)
    return result


def _combine(coefficients: Sequence[Array], functions: Array) -> Array:
    """Return the sum of coefficient times function, as (cells, points)."""
    if functions.ndim == 2 and coefficients[0].shape[1] == 1:
        return np.einsum("cr,rp->cp", np.hstack(coefficients), functions)
    return sum((c * f for c, f in zip(coefficients, functions, strict=True)), start=np.zeros(()))


def _push_forward(weights: Sequence[Array], functions: Array, G: Array) -> Array:
    r"""Return all derivatives of one order m, by the chain rule of an affine map.

    With :math:`G = DF^{-1}`, the operator :math:`\prod_r \partial_{i_r}` in x is the polynomial
    :math:`\prod_r (G_{1 i_r} \partial_X + G_{2 i_r} \partial_Y)`.
    """
    order = len(functions) // len(weights) - 1
    affine = G.shape[-1] == 1
    if not affine:
        terms = [_combine(weights, functions[k :: order + 1]) for k in range(order + 1)]
        functions = np.array(terms)
    partial = []
    for in_y in range(order + 1):
        powers = [np.ones((1, 1))]
        for i in (0,) * (order - in_y) + (1,) * in_y:
            X_part, Y_part = ([g * power for power in powers] for g in G[:, i])
            inner = [p + q for p, q in zip(X_part[1:], Y_part[:-1], strict=True)]
            powers = [X_part[0], *inner, Y_part[-1]]
        coefficients = [w * power for w in weights for power in powers] if affine else powers
        partial.append(_combine(coefficients, functions))
    indices = list(product((0, 1), repeat=order))
    field = np.array([partial[sum(index)] for index in indices])
    return field.reshape((2,) * order + field.shape[1:])


def _twist_hessian(c: Array, gradient: Array, G: Array) -> Array:
    r"""Return :math:`(\nabla u \cdot c)` times the symmetric product of the rows of DF^-1.

    This is what the second derivative of the map, c in the mixed place and zero elsewhere, adds
    to the Hessian of an affine one.
    """
    along = c[0, :, None] * gradient[0] + c[1, :, None] * gradient[1]
    outer = G[0][:, None] * G[1][None, :]
    return along * (outer + outer.transpose(1, 0, 2, 3))
