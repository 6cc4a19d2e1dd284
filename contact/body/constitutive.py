"""Hooke's law in a body, isotropic or by a tensor: stress, energy and stiffness of its cells.

A `StressLaw` belongs to all cells; `StressLaw.at` returns the law of some cells or points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import Basis

from contact.body.anisotropic import VOIGT, tensor_of
from contact.body.elasticity import (
    Classes,
    isotropic_classes,
    stiffness_matrix,
    stress,
    tensor_classes,
    tensor_stiffness,
)
from contact.errors import InputError

Array = NDArray[np.float64]


class StressLaw(Protocol):
    """Stress from strain in every cell; material constants are scalar or one per cell."""

    def at(self, cells: NDArray[np.int64]) -> Self:
        """The law of the given cells, or of points in them, shape (n,)."""
        ...

    def stress(self, gradient: Array, dilatation: Array | None = None) -> Array:
        """Stress of displacement gradients (dim, dim, ncells, ...), of the same shape.
        `dilatation` replaces div u in the volumetric part of an isotropic law."""
        ...

    def out_of_plane(self, sigma: Array, thermal_strain: Array | None = None) -> Array:
        """sigma_zz of a body in two dimensions from the stresses in its plane, (2, 2, ncells, ...).
        The thermal strain has the shape (3, 3, ncells, ...)."""
        ...

    def in_plane(self, strain: Array) -> Array:
        """Strain of shape (dim, dim, ...) whose stress is that of a strain (3, 3, ...).
        In plane strain it includes the effect of the prevented strain along z."""
        ...

    def stiffness(self, basis: Basis, mean_dilatation: bool = False) -> sparse.csr_array:
        """Stiffness matrix of a basis whose cells are those of the law."""
        ...

    def classes(self, basis: Basis, mean_dilatation: bool = False) -> Classes | None:
        """Classes of congruent cells with the local stiffness of each; None if there are many."""
        ...


@dataclass(frozen=True, eq=False)
class IsotropicLaw:
    """``sigma = lambda tr(eps) I + 2 mu eps``, with lambda reduced in plane stress."""

    lam: Array  # shape () or (ncells,), as mu and nu
    mu: Array
    nu: Array
    plane: str | None

    def at(self, cells: NDArray[np.int64]) -> Self:
        """The law of the given cells."""
        lam, mu, nu = (v[cells] if v.ndim else v for v in (self.lam, self.mu, self.nu))
        return type(self)(lam, mu, nu, self.plane)

    def stress(self, gradient: Array, dilatation: Array | None = None) -> Array:
        """Stress of displacement gradients."""
        axes = gradient.ndim - 2
        return stress(gradient, _over(self.lam, axes), _over(self.mu, axes), dilatation)

    def out_of_plane(self, sigma: Array, thermal_strain: Array | None = None) -> Array:
        """``nu (sigma_xx + sigma_yy) - E eps_T,zz`` in plane strain, zero in plane stress."""
        trace = np.trace(sigma)
        if self.plane == "stress":
            return np.zeros_like(trace)
        result = np.asarray(_over(self.nu, trace.ndim) * trace)
        if thermal_strain is None:
            return result
        return result - _over(2 * self.mu * (1 + self.nu), trace.ndim) * thermal_strain[2, 2]

    def in_plane(self, strain: Array) -> Array:
        """``eps_ab + nu eps_zz delta_ab`` in plane strain."""
        if self.plane is None:
            return strain
        part = strain[:2, :2].copy()
        if self.plane == "strain":
            along = _over(self.nu, part.ndim - 2) * strain[2, 2]
            for a in range(2):
                part[a, a] += along
        return part

    def stiffness(self, basis: Basis, mean_dilatation: bool = False) -> sparse.csr_array:
        """See `contact.body.elasticity.stiffness_matrix`."""
        return stiffness_matrix(basis, self.lam, self.mu, mean_dilatation)

    def classes(self, basis: Basis, mean_dilatation: bool = False) -> Classes | None:
        """See `contact.body.elasticity.isotropic_classes`."""
        return isotropic_classes(basis, self.lam, self.mu, mean_dilatation)

    def strain_rows(self, gradients: Array, volumetric: bool = True) -> list[Array]:
        """Strains (ncells, npoints, n, dim) whose squares sum to twice the energy density.
        They are rows of the root of ``lambda 1 1^T + 2 mu I``, and shears times ``2 sqrt(mu)``,
        from the gradients of the scalar functions, (dim, ncells, npoints, n)."""
        g, (dim, cells, points, n) = gradients, gradients.shape
        lam, mu = np.broadcast_to(self.lam, cells), np.broadcast_to(self.mu, cells)
        elastic = np.zeros((cells, dim, dim)) + (1.0 if volumetric else 0.0) * lam[:, None, None]
        elastic += 2.0 * mu[:, None, None] * np.eye(dim)
        L = np.linalg.cholesky(elastic)
        rows = []
        for a in range(dim):
            row = np.zeros((cells, points, n, dim))
            for b in range(a, dim):
                row[..., b] = L[:, b, a, None, None] * g[b]
            rows.append(row)
        for a in range(dim):
            for b in range(a):
                row = np.zeros((cells, points, n, dim))
                row[..., a] = np.sqrt(mu)[:, None, None] * g[b]
                row[..., b] = np.sqrt(mu)[:, None, None] * g[a]
                rows.append(row)
        return rows


@dataclass(frozen=True, eq=False)
class TensorLaw:
    """``sigma_ij = C_ijkl eps_kl``; in two dimensions C is reduced to the plane."""

    tensor: Array  # C, shape (dim,) * 4, then (ncells,) if it varies
    zz: Array  # sigma_zz = zz_ab sigma_ab without thermal strain, shape (2, 2), then (ncells,)
    axial: Array  # 1 / S_zz, Young's modulus along z, zero in plane stress, shape () or (ncells,)

    @classmethod
    def of(cls, C: Array, dim: int, plane: str | None) -> Self:
        """Law of a Voigt stiffness C; in 2-D the plane must be a plane of symmetry.
        Plane strain takes the rows and columns xx, yy, xy of C; plane stress their Schur complement
        :math:`C_{pp} - C_{pz} C_{zz}^{-1} C_{zp}` (Ting 1996, section 3.2)."""
        if dim == 3:
            return cls(tensor_of(C), np.zeros((2, 2)), np.zeros(()))
        inside, across = [0, 1, 5], [3, 4]
        for place in (*inside, 2):
            if np.abs(C[..., place, across]).max() > 1e-12 * np.abs(C).max():  # above rounding
                raise InputError(
                    "material: in two dimensions the plane must be one of symmetry, that is "
                    "C_14, C_15, C_24, C_25, C_34, C_35, C_46 and C_56 zero in the axes of the "
                    "mesh; turn the axes about z only, or make the body in three dimensions"
                )
        C_pp, C_pz = C[..., inside, :][..., inside], C[..., inside, 2]
        if plane == "stress":
            outer = C_pz[..., :, None] * C_pz[..., None, :]
            C_pp, C_pz = C_pp - outer / C[..., 2, 2, None, None], np.zeros_like(C_pz)
        row = np.linalg.solve(C_pp, C_pz[..., None])[..., 0]
        axial = C[..., 2, 2] - np.sum(C_pz * row, axis=-1) if plane == "strain" else np.zeros(())
        row[..., 2] *= 0.5  # sigma_xy occurs twice in the double sum
        index = np.where(VOIGT[:2, :2] == 5, 2, VOIGT[:2, :2])
        tensor = C_pp[..., index[:, :, None, None], index[None, None]]
        zz = row[..., index]
        if C.ndim == 3:
            tensor, zz = np.moveaxis(tensor, 0, -1), np.moveaxis(zz, 0, -1)
        return cls(np.ascontiguousarray(tensor), np.ascontiguousarray(zz), axial)

    def at(self, cells: NDArray[np.int64]) -> Self:
        """The law of the given cells."""
        if self.tensor.ndim == 4:
            return self
        zz = self.zz[..., cells] if self.zz.ndim == 3 else self.zz
        axial = self.axial[cells] if self.axial.ndim else self.axial
        return type(self)(self.tensor[..., cells], zz, axial)

    def stress(self, gradient: Array, dilatation: Array | None = None) -> Array:
        """Stress of displacement gradients; `dilatation` is ignored."""
        C = self.tensor
        C = C.reshape(C.shape + (1,) * (gradient.ndim - 3)) if C.ndim == 5 else C
        return np.asarray(np.einsum("abcd...,cd...->ab...", C, gradient))

    def out_of_plane(self, sigma: Array, thermal_strain: Array | None = None) -> Array:
        """sigma_zz for eps_zz = 0 in plane strain, zero in plane stress."""
        zz = self.zz
        zz = zz.reshape(zz.shape + (1,) * (sigma.ndim - 3)) if zz.ndim == 3 else zz
        result = np.asarray(np.einsum("ab...,ab...->...", zz, sigma))
        if thermal_strain is None:
            return result
        return result - _over(np.asarray(self.axial), result.ndim) * thermal_strain[2, 2]

    def in_plane(self, strain: Array) -> Array:
        """``eps_ab + zz_ab eps_zz`` in two dimensions."""
        if self.tensor.shape[0] == 3:
            return strain
        zz = self.zz
        zz = zz.reshape(zz.shape + (1,) * (strain.ndim - 2 - (zz.ndim == 3)))
        return np.asarray(strain[:2, :2] + zz * strain[2, 2])

    def stiffness(self, basis: Basis, mean_dilatation: bool = False) -> sparse.csr_array:
        """See `contact.body.elasticity.tensor_stiffness`."""
        return tensor_stiffness(basis, self.tensor)

    def classes(self, basis: Basis, mean_dilatation: bool = False) -> Classes | None:
        """See `contact.body.elasticity.tensor_classes`."""
        return tensor_classes(basis, self.tensor)

    def strain_rows(self, gradients: Array, volumetric: bool = True) -> list[Array]:
        """Rows of the root of the tensor as a matrix of the independent strains."""
        g, (dim, cells, points, n) = gradients, gradients.shape
        pairs = [(a, b) for a in range(dim) for b in range(a, dim)]
        first, second = np.array(pairs).T
        matrix = self.tensor[first[:, None], second[:, None], first, second]
        matrix = np.broadcast_to(
            matrix.T if matrix.ndim == 3 else matrix, (cells, *matrix.shape[:2])
        )
        L = np.linalg.cholesky(matrix)
        strains = []
        for a, b in pairs:
            strain = np.zeros((cells, points, n, dim))
            strain[..., a] = g[b]
            strain[..., b] = g[a]
            strains.append(strain)
        every = range(len(pairs))
        return [
            sum(
                (L[:, j, i, None, None, None] * strains[j] for j in every if j >= i),
                start=0.0 * strains[0],
            )
            for i in every
        ]


def thermal_stress(law: StressLaw, strain: Array) -> Array:
    """Stress ``C eps_T`` of a thermal strain (3, 3, ncells, ...), shape (dim, dim, ncells, ...)."""
    return law.stress(law.in_plane(strain))


def total_stress(
    law: StressLaw, gradient: Array, dilatation: Array | None, thermal_strain: Array | None
) -> Array:
    """Stress of displacement gradients, without that of a thermal strain (3, 3, ncells, ...)."""
    sigma = law.stress(gradient, dilatation)
    return sigma if thermal_strain is None else sigma - thermal_stress(law, thermal_strain)


def _over(value: Any, axes: int) -> Any:
    """Constants of the cells with `axes - 1` trailing axes, to multiply arrays (ncells, ...)."""
    return value.reshape(value.shape + (1,) * (axes - 1)) if value.ndim else value
