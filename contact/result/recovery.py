"""Stresses at the vertices, and mean stresses of the cells."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from contact.body.constitutive import IsotropicLaw, total_stress
from contact.body.vector_element import GRADIENT_DOFS
from skfem_adini import nodal_stress as stress_of_dofs

if TYPE_CHECKING:
    from contact.body.elastic_body import ElasticBody

Array = NDArray[np.float64]


def nodal_stress(body: ElasticBody, u: Array) -> Array:
    """Stress at the vertices, shape (3, 3, nvertices).

    Adini and BFS have the gradient among their dofs. For other elements the stresses of the cells
    around a vertex are evaluated there and averaged by the cells' sizes.
    """
    from_dofs = isinstance(body.law, IsotropicLaw) and body.thermal is None  # no axisymmetric law
    if isinstance(body.element, GRADIENT_DOFS) and from_dofs:
        plane: Any = body.plane or "strain"
        return stress_of_dofs(body.basis, u, body.E, body.nu, plane)
    mesh, size = body.mesh, body.measure.sum(axis=1)
    X = np.repeat(mesh.elem.refdom.p[:, None], mesh.nelements, axis=1)
    at = _full(body, _stress_at(body, u, X), body.thermal_strain_in(X))
    total, share = np.zeros((mesh.nvertices, 3, 3)), np.zeros(mesh.nvertices)
    for corner, vertices in enumerate(mesh.t):
        np.add.at(total, vertices, (at[..., corner] * size).transpose(2, 0, 1))
        np.add.at(share, vertices, size)
    return (total / share[:, None, None]).transpose(1, 2, 0)


def cell_stress(body: ElasticBody, sigma: Array) -> Array:
    """Mean of each cell of the stress in the quadrature points, shape (3, 3, ncells)."""
    dx, free = body.measure, body.thermal_strain_in(body.basis.X)
    mean = np.sum(sigma * dx, axis=-1) / dx.sum(axis=1)
    if free is not None:
        free = np.sum(free * dx, axis=-1) / dx.sum(axis=1)
    return _full(body, mean, free)


def _stress_at(body: ElasticBody, u: Array, X: Array) -> Array:
    """Stress at reference points (dim, ncells, npoints) of every cell."""
    everywhere, size = np.arange(X.shape[1]), 3 if body.is_ring else body.dim
    gradient = np.zeros((size, size, *X.shape[1:]))
    x = np.asarray(body.basis.mapping.F(X, tind=everywhere))
    for i, dofs in enumerate(body.basis.element_dofs):
        field = body.basis.elem.gbasis(body.basis.mapping, X, i, tind=everywhere)[0]
        gradient += body.in_space(field, x) * u[dofs][:, None]
    mean = body.mean_dilatation(u)
    volume = None if mean is None else mean[:, None]
    return total_stress(body.law, gradient, volume, body.thermal_strain_in(X))


def _full(body: ElasticBody, sigma: Array, thermal_strain: Array | None) -> Array:
    """Tensors with nine components: sigma_zz of plane strain follows from the law."""
    if len(sigma) == 3:
        return sigma
    full = np.zeros((3, 3, *sigma.shape[2:]))
    full[:2, :2] = sigma
    full[2, 2] = body.law.out_of_plane(sigma, thermal_strain)
    return full
