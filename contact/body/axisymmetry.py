r"""Axisymmetric bodies: rings whose mesh is their section, x the radius r and y the axis z.

The displacement is :math:`(u_r, u_z)`, the same in every plane through the axis, and the strains
are (Timoshenko and Goodier, Theory of Elasticity, 3rd ed., McGraw-Hill 1970, article 117)

.. math::
    \epsilon_{rr} = \partial_r u_r, \qquad \epsilon_{zz} = \partial_z u_z, \qquad
    \epsilon_{\theta\theta} = u_r / r, \qquad
    2 \epsilon_{rz} = \partial_z u_r + \partial_r u_z .

All integrals are those over the whole ring: their measure is :math:`2 \pi r \, dr \, dz`, so that
forces are forces of the ring, and pressures stay forces per area. On the axis :math:`u_r` and its
derivative along the axis are zero; the hoop strain there is the limit :math:`\partial_r u_r`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import Basis, Mesh

from contact.body.anisotropic import Anisotropic
from contact.body.constitutive import IsotropicLaw, TensorLaw
from contact.body.elasticity import Local, summed
from contact.errors import InputError

Array = NDArray[np.float64]
Index = NDArray[np.int64]

AXISYMMETRIC = "axisymmetric"
_NEAR = 1e-10  # points with r below this fraction of the largest extent are on the axis


def circumference(x: Array) -> Array:
    """Length 2 pi r of the circle through each place x, shape (2, ...)."""
    return np.asarray(2.0 * np.pi * x[0])


def axis_facets(mesh: Mesh) -> Index:
    """Facets of a section that lie on the axis r = 0.
    Radii must not be negative, and no vertex may touch the axis alone: the ring would have a
    hole of zero radius."""
    r, near = mesh.p[0], _NEAR * float(np.ptp(mesh.p, axis=1).max())
    if np.any(r < -near):
        raise InputError(
            f"plane='axisymmetric': x is the radius and must not be negative, and the mesh has a "
            f"vertex at x = {r.min():.6g}; take the half of the section with x >= 0"
        )
    boundary = mesh.boundary_facets()
    along = np.asarray(mesh.mapping().G(np.array([[0.0, 0.5, 1.0]]), find=boundary))[0]
    facets = boundary[(along <= near).all(axis=1)]
    on_axis = np.flatnonzero(r[: mesh.nvertices] <= near)
    alone = np.setdiff1d(on_axis, mesh.facets[:, facets])
    if alone.size:
        raise InputError(
            f"plane='axisymmetric': vertex {int(alone[0])} at {mesh.p[:, alone[0]].tolist()} lies "
            "on the axis x = 0, and no facet beside it does; let the section meet the axis in "
            "facets, or leave a hole"
        )
    return np.asarray(facets, dtype=np.int64)


def refuse_axis(mesh: Mesh, facets: Index) -> None:
    """Raise an `InputError` if facets lie on the axis, where they have no area."""
    found = np.intersect1d(facets, axis_facets(mesh))
    if found.size:
        raise InputError(
            f"boundary: facet {int(found[0])} lies on the axis x = 0, where a surface of the ring "
            "has no area and nothing can act on it; leave the axis out"
        )


def with_hoop(gradient: Array, radial: Array, r: Array) -> Array:
    """Displacement gradient (3, 3, ...) in r, z, theta from that of the section, (2, 2, ...).
    The hoop strain is radial / r, on the axis its limit d u_r / dr."""
    full = np.zeros((3, 3, *gradient.shape[2:]))
    full[:2, :2] = gradient
    # Points closer to the axis than the rounding of coordinates count as on it.
    away = r > _NEAR * float(np.abs(r).max(initial=0.0))
    full[2, 2] = np.where(away, radial / np.where(away, r, 1.0), gradient[0, 0])
    return full


def strains(basis: Basis, cells: slice = slice(None)) -> Array:
    """Strains rr, zz, theta theta, 2 rz of the basis functions, shape (ncells, npoints, 4,
    nfunctions)."""
    n, (count, points) = basis.Nbfun, basis.dx[cells].shape
    r = np.asarray(basis.global_coordinates())[0][cells]
    found = np.zeros((count, points, 4, n))
    for i in range(n):
        field = basis.basis[i][0]
        component = i % 2
        slope = np.broadcast_to(np.asarray(field.grad[component]), (2, *basis.dx.shape))[:, cells]
        found[..., component, i] = slope[component]
        found[..., 3, i] = slope[1 - component]
        if component == 0:
            value = np.broadcast_to(np.asarray(field)[0], basis.dx.shape)[cells]
            found[..., 2, i] = value / r
    return found


def stiffness(basis: Basis, elastic: Array, volumetric: Array | None = None) -> sparse.csr_array:
    r"""Stiffness of the whole ring; `elastic` (ncells, 4, 4) maps `strains` to stresses.
    With mean dilatation `elastic` has no lambda: `volumetric` (ncells,) is lambda in the term
    :math:`\lambda |K|^{-1} \int_K \operatorname{div} u \int_K \operatorname{div} v`."""
    return summed(basis, _local_matrices(basis, elastic, volumetric))


def _local_matrices(basis: Basis, elastic: Array, volumetric: Array | None) -> Local:
    for cells in _chunks(basis):
        B, weights = strains(basis, cells), ring_weights(basis)[cells]
        stress = elastic[cells, None] @ B * weights[..., None, None]
        count, points, four, n = B.shape
        flat = B.reshape(count, points * four, n)
        local = flat.swapaxes(-1, -2) @ stress.reshape(count, points * four, n)
        if volumetric is not None:
            mean = np.einsum("cq,cqsn->cn", weights, B[:, :, :3])
            share = volumetric[cells] / weights.sum(axis=1)
            local += share[:, None, None] * mean[:, :, None] * mean[:, None, :]
        yield cells, local


def strain_roots(basis: Basis, elastic: Array, volumetric: Array | None = None) -> Array:
    """Rows A of every cell with ``A^T A`` its stiffness, shape (ncells, nrows, nfunctions).
    The arguments are those of `stiffness`."""
    B, weights = strains(basis), ring_weights(basis)
    count, points, four, n = B.shape
    upper = np.linalg.cholesky(elastic).swapaxes(-1, -2)
    rows = upper[:, None] @ B * np.sqrt(weights)[..., None, None]
    found: Array = rows.reshape(count, points * four, n)
    if volumetric is None:
        return found
    mean = np.einsum("cq,cqsn->cn", weights, B[:, :, :3])
    share = np.sqrt(volumetric / weights.sum(axis=1))
    return np.concatenate((found, (share[:, None] * mean)[:, None]), axis=1)


def ring_weights(basis: Basis) -> Array:
    """Quadrature weights of integrals over the whole ring, shape (ncells, npoints)."""
    return np.asarray(basis.dx * circumference(np.asarray(basis.global_coordinates())))


def _chunks(basis: Basis) -> Iterator[slice]:
    count = len(basis.dx)
    together = 2048  # number of cells whose element matrices are in memory at once
    for start in range(0, count, together):
        yield slice(start, min(start + together, count))


def forces_of_stress(basis: Basis, sigma: Array) -> Array:
    """``int sigma : eps(v)`` over the ring for every basis function, shape (ndofs,).
    The stress has the axes r, z, theta and the shape (3, 3, ncells, npoints)."""
    four = np.stack([sigma[0, 0], sigma[1, 1], sigma[2, 2], sigma[0, 1]], axis=-1)
    four = four * ring_weights(basis)[..., None]
    result = np.zeros(basis.N)
    for cells in _chunks(basis):
        work = np.einsum("cqs,cqsn->cn", four[cells], strains(basis, cells))
        np.add.at(result, basis.element_dofs.T[cells], work)
    return result


def refuse_motions(motion: Array, force: Array) -> None:
    """Raise an `InputError` if a rigid obstacle does not move along the axis.
    Motion and force (3,) are those of `contact.obstacles.rigid.Rigid.components`."""
    for k, name in ((0, "displacement or force along the radius x"), (2, "rotation or moment")):
        if motion[k] != 0.0 or not np.isnan(force[k]):
            raise InputError(
                f"Rigid: a {name} is no motion of a rigid ring; an obstacle of an axisymmetric "
                "body moves along the axis y only: displacement=(None, v) or force=(None, F)"
            )


def check_shift(shift: Any) -> None:
    """Raise an `InputError` if a translation is not along the axis."""
    if abs(float(shift[0])) > _NEAR * float(np.abs(shift).max()):
        raise InputError(
            "other: an axisymmetric body repeats itself along its axis y only, and these two "
            "boundaries have different radii"
        )


@dataclass(frozen=True, eq=False)
class AxisymmetricLaw:
    """A `contact.body.constitutive.StressLaw` of strains in a ring; tensors are (3, 3, ...)."""

    solid: IsotropicLaw | TensorLaw  # the law in three dimensions

    @classmethod
    def of_material(cls, material: Anisotropic) -> Self:
        """Law of an anisotropic material with the axes r, z, theta; the section is a plane of
        symmetry."""
        TensorLaw.of(material.C, 2, "strain")
        return cls(TensorLaw.of(material.C, 3, None))

    def at(self, cells: NDArray[np.int64]) -> Self:
        """The law of the given cells."""
        return type(self)(self.solid.at(cells))

    def stress(self, gradient: Array, dilatation: Array | None = None) -> Array:
        """Stress of displacement gradients (3, 3, ncells, ...) in the axes r, z, theta."""
        return self.solid.stress(gradient, dilatation)

    def out_of_plane(self, sigma: Array, thermal_strain: Array | None = None) -> Array:
        """Return the hoop stress, a component of sigma."""
        return np.asarray(sigma[2, 2])

    def in_plane(self, strain: Array) -> Array:
        """Return the strain unchanged."""
        return strain

    def stiffness(self, basis: Basis, mean_dilatation: bool = False) -> sparse.csr_array:
        """See `contact.body.axisymmetry.stiffness`."""
        return stiffness(basis, *self.elastic(basis.mesh.nelements, mean_dilatation))

    def classes(self, basis: Basis, mean_dilatation: bool = False) -> None:
        """Return None: cells at different radii are not congruent."""

    def elastic(self, cells: int, mean_dilatation: bool = False) -> tuple[Array, Array | None]:
        """Matrices (ncells, 4, 4) of strains rr, zz, theta theta, 2 rz; lambda (ncells,) or None.
        Lambda is left out of the matrices of an isotropic law with mean dilatation."""
        places = ((0, 0), (1, 1), (2, 2), (0, 1))
        unit = np.zeros((3, 3, cells, 4))
        for k, (i, j) in enumerate(places):
            unit[i, j, :, k] += 0.5
            unit[j, i, :, k] += 0.5
        volume = np.zeros((cells, 4)) if mean_dilatation else None
        sigma = self.solid.stress(unit, volume)
        found = np.stack([np.broadcast_to(sigma[i, j], (cells, 4)) for i, j in places], axis=1)
        if not mean_dilatation or not isinstance(self.solid, IsotropicLaw):
            return found, None
        return found, np.broadcast_to(self.solid.lam, (cells,))

    def strain_rows(self, gradients: Array, volumetric: bool = True) -> list[Array]:
        """Raise an error: the hoop strain is not a gradient; see
        `contact.body.axisymmetry.strain_roots`."""
        raise InputError("strain_rows: those of an axisymmetric body need values and radii too")
