"""Displacements of a body at places on its facets, and the integration points of an interface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.errors import InputError
from contact.facet_basis import places_on_facets
from contact.rows.outline import Outline

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Csr = sparse.csr_array


class _Facets(NamedTuple):  # tolerances for facets of an interface
    facing: float = 0.25  # least cosine between a normal and the one opposite it
    sliver: float = 1e-13  # relative size of a segment or polygon that is rounding
    straight: float = 1e-12  # relative deviation below which a facet in the plane is straight
    affine: float = 1e-11  # relative deviation below which a facet in space is affine
    steep: float = 0.1  # least cosine between an averaged normal and the facet plane's normal
    curved: int = 4  # degrees added to the Gauss rules where normals vary along facets


FACETS = _Facets()


def none_opposite(same_way: bool = False, within: str = "") -> InputError:
    """The error if no facet faces another one; `same_way`: some have parallel normals."""
    if same_way:
        return InputError(
            "others: the normals of the two boundaries point the same way; a contact boundary must "
            "face the surface of the other body"
        )
    return InputError(
        f"others: no facet lies opposite the contact boundary, along its normals{within}; check "
        "the places of the bodies and the names of the boundaries"
    )


@dataclass(frozen=True)
class InterfaceQuadrature:
    r"""Integration points on the covered part of a non-mortar boundary, and their projections.
    The integral of a product is :math:`\sum_q w_q f(x_q) g(y_q)`, g given on the mortar side.
    M. A. Puso, A 3D mortar method for solid mechanics, Int. J. Numer. Meth. Engng 59 (2004)."""

    x: Array  # points on the non-mortar facets, shape (dim, n)
    y: Array  # where their normals meet the mortar facets, shape (dim, n)
    n: Array  # unit normals interpolated between averaged ones, shape (dim, n)
    w: Array  # lengths or areas on the non-mortar facets, shape (n,)
    facet: Index  # position of the non-mortar facet on its side, shape (n,)
    other: Index  # position of the mortar facet on its side, shape (n,)
    X: Array  # x on the reference facet, shape (dim - 1, n)
    Y: Array  # y on the reference facet, shape (dim - 1, n)

    @property
    def gap(self) -> Array:
        """Measured gap (y - x) . n at each point, negative where the bodies overlap, shape (n,)."""
        return np.asarray(np.sum((self.y - self.x) * self.n, axis=0))


def facet_trace(outline: Outline, facet: Index, X: Array) -> Csr:
    """Trace of all scalar functions at X (dim - 1, n) on reference facets, (n, scalar dofs).
    `facet` counts positions in ``outline.facets``. Functions not connected to the facet, which
    vanish there, are omitted to avoid rounding."""
    body, mesh = outline.body, outline.body.mesh
    corners = np.hstack((np.zeros((len(X), 1)), np.eye(len(X))))
    first, *ends = np.moveaxis(places_on_facets(mesh, outline.facets, corners), 2, 0)
    places = first[:, facet] + sum(
        (end - first)[:, facet] * s for end, s in zip(ends, X, strict=True)
    )
    cells = mesh.f2t[0, outline.facets[facet]]
    rows, columns, values = [], [], []
    for i, of_cells in enumerate(body.scalar_dofs.element_dofs):
        dof = of_cells[cells]
        on = np.flatnonzero((outline.scalar_dofs[facet] == dof[:, None]).any(axis=1))
        if on.size:
            at = places[:, on, None]
            field = body.element.gbasis(body.basis.mapping, at, i, tind=cells[on])[0]
            rows.append(on)
            columns.append(dof[on])
            values.append(np.broadcast_to(np.asarray(field), (on.size, 1))[:, 0])
    place = np.concatenate(rows), np.concatenate(columns)
    shape = facet.size, int(body.scalar_dofs.N)
    return Csr(sparse.coo_array((np.concatenate(values), place), shape=shape))


def values(trace: Csr, u: Array, dim: int) -> Array:
    """Displacement at the rows of a scalar trace, shape (dim, n)."""
    return np.array([trace @ u[c::dim] for c in range(dim)])
