"""Hooke's law in an axisymmetric body: that of three dimensions in the axes r, z, theta."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import Basis

from contact.body.anisotropic import Anisotropic
from contact.body.axisymmetry import stiffness
from contact.body.constitutive import IsotropicLaw, TensorLaw
from contact.errors import InputError

Array = NDArray[np.float64]


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
        """The hoop stress, which is among the stresses."""
        return np.asarray(sigma[2, 2])

    def in_plane(self, strain: Array) -> Array:
        """The strain itself."""
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
        """Refuse: the hoop strain is no gradient; see `contact.body.axisymmetry.strain_roots`."""
        raise InputError("strain_rows: those of an axisymmetric body need values and radii too")
