"""A scikit-fem basis whose points lie on a curve in the cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import CellBasis
from skfem.element import DiscreteField

from skfem_adini.errors import InputError

Indices = NDArray[np.integer]


class BoundaryBasis(CellBasis):
    """A `CellBasis` whose points lie on a curve in the cells.

    Forms receive the unit normals as ``w.n`` and, as ``w.h``, the size of the cell across the
    curve, :math:`1 / |DF^{-1} n|`, the side length of square cells.

    `CutDomain.boundary` makes it.

    Parameters
    ----------
    args, options
        Those of `skfem.CellBasis`: mesh, element, and the points as ``quadrature=(X, W)``.
    normals
        Outward unit normals at the points, shape (2, cells, points).
    domain
        The `CutDomain` whose boundary it is, if any.

    Attributes
    ----------
    normals
        Outward unit normals, shape (2, cells, points).
    domain
        As given.

    Examples
    --------
    The length of a circle of radius .9, from its parts in the cells:

    >>> from skfem import Functional, MeshQuad
    >>> from skfem_adini import CutDomain, ElementQuadAdini
    >>> mesh = MeshQuad.init_tensor(*[np.linspace(-1, 1, 9)] * 2)
    >>> domain = CutDomain(mesh, lambda x: x[0] ** 2 + x[1] ** 2 - 0.81)
    >>> circle = domain.boundary(ElementQuadAdini())
    >>> length = Functional(lambda w: w.n[0] ** 2 + w.n[1] ** 2).assemble(circle)
    >>> bool(abs(length - 1.8 * np.pi) < 1e-10)
    True
    """

    def __init__(
        self, *args: Any, normals: DiscreteField | None = None, domain: Any = None, **options: Any
    ) -> None:
        super().__init__(*args, **options)
        self.normals, self.domain = normals, domain

    def default_parameters(self) -> dict[str, Any]:
        """Return x, h and n."""
        return {**super().default_parameters(), "n": self.normals}

    def mesh_parameters(self) -> DiscreteField:
        """Return the size of the cells across the curve."""
        corners = self.mesh.p[:, self.mesh.t[:, self.tind]]
        size = np.ptp(corners, axis=1)[:, :, None]
        return DiscreteField(1 / np.sqrt(np.sum((np.asarray(self.normals) / size) ** 2, axis=0)))

    def with_element(self, elem: Any) -> BoundaryBasis:
        """Return a similar basis with a different element."""
        return BoundaryBasis(
            self.mesh,
            elem,
            mapping=self.mapping,
            quadrature=self.quadrature,
            elements=self.tind,
            normals=self.normals,
            domain=self.domain,
        )

    def of_cells(self, chosen: Indices) -> BoundaryBasis:
        """Return the basis on the part of the curve in some cells."""
        keep = np.isin(self.tind, chosen)
        if not keep.any():
            raise InputError("chosen: the curve does not meet these cells")
        X, W = self.quadrature
        return BoundaryBasis(
            self.mesh,
            self.elem,
            mapping=self.mapping,
            quadrature=(X[:, keep], W[keep]),
            elements=self.tind[keep],
            normals=DiscreteField(np.asarray(self.normals)[:, keep]),
            domain=self.domain,
        )
