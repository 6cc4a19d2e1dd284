"""The Bogner-Fox-Schmit rectangle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from skfem.refdom import RefQuad

from skfem_adini.elements.closed_form_element import Array, ClosedFormElement
from skfem_adini.elements.hermite_factors import HERMITE, SLOPE, Function
from skfem_adini.elements.straight_cells import GEOMETRY, QuadCells
from skfem_adini.errors import InputError


class ElementQuadBFS(ClosedFormElement):
    r"""Bogner, Fox and Schmit's bicubic element with u, u_x, u_y and u_xy at the four vertices.

    The shape functions are the products of the cubic Hermite functions

    .. math::
        H(X) = (1 - X)^2 (1 + 2 X), \quad S(X) = X (1 - X)^2,

    those of the vertex (0, 0) being :math:`H H, S H, H S` and :math:`S S`. The functions are once
    continuously differentiable across edges, so the element is conforming for plates. Orders of
    convergence are 4 in L2, 3 in H1 and 2 in H2. It does what `skfem.ElementQuadBFS` does, from a
    closed form instead of the inverse of a matrix of monomials, whose condition grows like the
    sixth power of the number of cells along a side.

    Cells are rectangles with sides parallel to the axes, of either orientation. In a
    parallelogram with sides a and b

    .. math::
        u_{XY} = a_x b_x u_{xx} + (a_x b_y + a_y b_x) u_{xy} + a_y b_y u_{yy} :

    unless the sides are parallel to the axes, u_xy does not determine the mixed derivative along
    them. Shape functions dual to u, u_x, u_y, u_xy exist wherever :math:`a_x b_y + a_y b_x \ne 0`
    (so not on a square turned by 45 degrees), but their normal derivatives jump across edges. For
    tensor grids in another direction turn the coordinates, or use :class:`ElementQuadAdini`.

    Parameters
    ----------
    derivatives
        How many orders of derivatives the functions have, 0 to 6: 1 the gradient, 2 also the
        Hessian (`hess`), 3 also `grad3`, and so on. Orders above 1 are computed when a form first
        uses them. `ElementVector` copies all of them as soon as its basis is made:
        ``derivatives=1`` there halves time and memory where no form uses the Hessian.

    Raises
    ------
    InputError
        `derivatives` is not a whole number from 0 to 6; a cell is degenerate or no rectangle with
        sides parallel to the axes.

    Notes
    -----
    `maxdeg` is 6, the degree of the functions and what scikit-fem gives its own, so `skfem.Basis`
    takes 49 points a cell. The cells are rectangles: all matrices of constant coefficients are
    exact with `intorder=6`, 16 points.

    For u = 0 on the boundary of a second-order problem fix u and its derivatives *along* the
    boundary, ``condense(K, f, D=essential_dofs(basis))``. ``D=basis.get_dofs()`` also holds the
    normal derivative and u_xy, which the problem leaves free, and costs three orders: it is right
    for clamped plates alone.

    scikit-fem has a class of the same name. Functions of this package that need dofs at vertices
    take both.

    References
    ----------
    F. K. Bogner, R. L. Fox and L. A. Schmit, The generation of interelement-compatible stiffness
    and mass matrices by the use of interpolation formulas, Proceedings of the Conference on
    Matrix Methods in Structural Mechanics, Wright-Patterson Air Force Base, 1965, 397-444.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> basis = Basis(MeshQuad().refined(2), ElementQuadBFS(), intorder=6)
    >>> x = basis.project(lambda x: x[0] ** 3 * x[1] ** 2)
    >>> [round(float(u), 9) for u in x[basis.nodal_dofs[:, 2]]]
    [1.0, 3.0, 2.0, 6.0]
    """

    nodal_dofs = 4
    maxdeg = 6
    dofnames = ["u", "u_x", "u_y", "u_xy"]  # noqa: RUF012
    doflocs = np.repeat([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], 4, axis=0)
    refdom = RefQuad
    reference = (
        ((HERMITE, HERMITE),),
        ((SLOPE, HERMITE),),
        ((HERMITE, SLOPE),),
        ((SLOPE, SLOPE),),
    )
    cells = QuadCells

    def _check(self, cells: QuadCells, mapping: Any, X: Array) -> None:
        sizes = np.abs([cells.a, cells.b])
        slanted = sizes.min(axis=1) > GEOMETRY.slant * sizes.max(axis=1)
        bad = slanted.any(axis=0) | cells.c.any(axis=0)
        if bad.any():
            raise InputError(
                f"mesh: {bad.sum()} of {len(bad)} cells are no rectangles with sides parallel to "
                f"the axes (first: position {np.flatnonzero(bad)[0]}), and u_xy means nothing "
                f"along other sides; turn the coordinates or use ElementQuadAdini"
            )
        cells.check()

    def _pull_back(
        self, cells: QuadCells, vertex: Array, dof: int
    ) -> tuple[Sequence[Function], list[Array]]:
        if dof < 3:
            return super()._pull_back(cells, vertex, dof)
        a, b = cells.a, cells.b
        return self.reference[3:], [(a[0] * b[1] + a[1] * b[0])[:, None]]
