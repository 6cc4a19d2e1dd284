"""The Adini brick, extended to eight-node hexahedra."""

from __future__ import annotations

import numpy as np
from skfem.refdom import RefHex

from skfem_adini.elements.closed_form_element import ClosedFormElement
from skfem_adini.elements.hermite_factors import adini_functions
from skfem_adini.elements.straight_cells import HexCells


class ElementHexAdini(ClosedFormElement):
    r"""Adini's element in three dimensions, with u, u_x, u_y and u_z at the eight vertices.

    On the reference cube the 32 shape functions span the monomials in which at most one exponent
    exceeds 1 and none exceeds 3: the cubics, :math:`X_i^3 X_j` for :math:`i \ne j`,
    :math:`X_i^2 X_j X_k` and :math:`X_i^3 X_j X_k`. Those of the vertex (0, 0, 0) are

    .. math::
        N = L_1 L_2 L_3 + B_1 L_2 L_3 + L_1 B_2 L_3 + L_1 L_2 B_3, \quad
        H_1 = S_1 L_2 L_3, \quad H_2 = L_1 S_2 L_3, \quad H_3 = L_1 L_2 S_3,

    .. math::
        L_i = 1 - X_i, \quad B_i = X_i (1 - X_i) (1 - 2 X_i), \quad S_i = X_i (1 - X_i)^2,

    and those of the other vertices follow by reflection, with the sign of S changed.
    In a cell :math:`F` the function of the dof :math:`\partial u/\partial x_i` at the vertex
    :math:`k` is :math:`\sum_j DF_{ij}(k) H_j`, so the dofs are the physical derivatives. Vertices
    and reference cube are those of `skfem.MeshHex`; cells may be of either orientation.

    On a face u is the function of :class:`ElementQuadAdini` with the values and the derivatives
    along the face at its four vertices; so u and its derivatives along the face are continuous.
    The normal derivative is continuous at vertices only. The element is conforming for
    second-order problems, with orders 4 in L2 and 3 in H1 on parallelepipeds.

    On other hexahedra the space lacks the products :math:`X_i^2 X_j^2`: with the largest twist t
    of a cell (the parts of the map bilinear and trilinear in X) over its longest side, the error
    gains terms of size :math:`t^2 h^2` and :math:`t h^3`. Orders fall to 2 and 1 when t is
    constant under refinement and stay 4 and 3 when t falls like h (uniform refinement of a coarse
    mesh).

    Parameters
    ----------
    derivatives
        How many orders of derivatives the functions have, 0 to 6: 1 the gradient, 2 also the
        Hessian (`hess`), 3 also `grad3`, and so on. Orders above 1 are computed when a form first
        uses them. `ElementVector` copies all of them as soon as its basis is made:
        ``derivatives=1`` there halves time and memory where no form uses the Hessian.
        Orders above 2 need parallelepiped cells.

    Raises
    ------
    InputError
        `derivatives` is not a whole number from 0 to 6; the Jacobian of a cell vanishes or
        changes sign, or the mesh has curved cells; third derivatives on cells
        that are not parallelepipeds.

    Notes
    -----
    For u = 0 (or u = g) on the boundary of a second-order problem fix u and its derivatives *along*
    the boundary, ``condense(K, f, D=essential_dofs(basis))``. The idiom of Lagrange elements,
    ``D=basis.get_dofs()``, also holds the normal derivative, which the problem leaves free, and
    costs three orders: it is right for clamped plates alone. See :func:`essential_dofs`; for
    slanted edges :func:`essential_constraints`.

    Meshes of second order (`MeshHex2`) are accepted if their cells are straight, with the other
    nodes in the middle of edges, faces and cells.

    `maxdeg` is 4, so `skfem.Basis` integrates with degree 8: on parallelepipeds all matrices of
    constant coefficients are exact (``intorder=6`` is enough there and takes 64 points a cell
    instead of 125). On cells with vertices moved by 4 and 20 % of their sides the mass matrix is
    exact and the stiffness matrix has errors of 2e-10 and 1e-7; with degree 6 these are 1e-6 and
    2e-5, and the mass matrix has an error of 6e-6. The total degree of the functions is 5, but
    degree 10 with its 216 points has no effect within the accuracy of the space.
    That a mesh is twisted is logged as a warning (`logging`), once for each mesh.

    References
    ----------
    J. Hu, X. Yang and S. Zhang, Capacity of the Adini element for biharmonic equations, Journal
    of Scientific Computing 69 (2016), 1366-1383. (Adini's space in any dimension.)

    Examples
    --------
    >>> from skfem import Basis, MeshHex
    >>> basis = Basis(MeshHex().refined(1), ElementHexAdini())
    >>> x = basis.project(lambda x: x[0] ** 3 * x[1] * x[2])
    >>> [round(float(u), 9) for u in x[basis.nodal_dofs[:, 7]]]
    [1.0, 3.0, 1.0, 1.0]
    """

    nodal_dofs = 4
    maxdeg = 4
    dofnames = ["u", "u_x", "u_y", "u_z"]  # noqa: RUF012
    doflocs = np.repeat(RefHex.p.T, 4, axis=0)
    refdom = RefHex
    reference = adini_functions(3)
    cells = HexCells
