"""The Adini rectangle, extended to straight-sided quadrilaterals."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from skfem.refdom import RefQuad

from skfem_adini.elements.closed_form_element import ClosedFormElement
from skfem_adini.elements.hermite_factors import adini_functions
from skfem_adini.elements.straight_cells import QuadCells


class ElementQuadAdini(ClosedFormElement):
    r"""Adini's twelve-parameter element with u, u_x and u_y at the four vertices.

    On the reference square the shape functions span the cubics and :math:`X^3 Y, X Y^3`. Those of
    the vertex (0, 0) are

    .. math::
        N = L(X) L(Y) + B(X) L(Y) + L(X) B(Y), \quad H_1 = S(X) L(Y), \quad H_2 = L(X) S(Y),

    .. math::
        L(X) = 1 - X, \quad B(X) = X (1 - X) (1 - 2 X), \quad S(X) = X (1 - X)^2,

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
        How many orders of derivatives the functions have, 0 to 6: 1 the gradient, 2 also the
        Hessian (`hess`), 3 also `grad3`, and so on. Orders above 1 are computed when a form first
        uses them. `ElementVector` copies all of them as soon as its basis is made:
        ``derivatives=1`` there halves time and memory where no form uses the Hessian.
        Orders above 2 need parallelogram cells.

    Raises
    ------
    InputError
        `derivatives` is not a whole number from 0 to 6; a cell is not strictly convex or the mesh
        has curved cells; third derivatives on cells that are not
        parallelograms.

    Notes
    -----
    For u = 0 (or u = g) on the boundary of a second-order problem fix u and its derivatives *along*
    the boundary, ``condense(K, f, D=essential_dofs(basis))``. The idiom of Lagrange elements,
    ``D=basis.get_dofs()``, also holds the normal derivative, which the problem leaves free, and
    costs three orders: it is right for clamped plates alone. See :func:`essential_dofs`; for
    slanted edges :func:`essential_constraints`.

    Meshes of second order (`MeshQuad2`) are accepted if their cells are straight, with the other
    nodes in the middle of edges and cells.

    `maxdeg` is 4, so `skfem.Basis` integrates with degree 8: on parallelograms all matrices of
    constant coefficients are exact (``intorder=6`` is enough there and takes 16 points a cell
    instead of 25). On cells with vertices moved by 8, 20 and 32 % of their sides the mass matrix is
    exact and the stiffness matrix has errors of 5e-9, 4e-7 and 2e-5; with degree 6 these are 2e-6,
    3e-5 and 2e-4.
    That a mesh is twisted is logged as a warning (`logging`), once for each mesh.

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
    maxdeg = 4
    dofnames = ["u", "u_x", "u_y"]  # noqa: RUF012
    doflocs = np.repeat([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], 3, axis=0)
    refdom = RefQuad
    reference = adini_functions(2)
    cells = QuadCells
    # The function whose values and derivatives the dofs are.
    dofs_of: ClassVar[str] = "u"
