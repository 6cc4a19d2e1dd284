"""What functions of a body with a Basis see of it."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from skfem import Basis

from contact.body.constitutive import StressLaw

Array = NDArray[np.float64]


class Discretised(Protocol):
    """A body by its Basis of a vector element."""

    @property
    def basis(self) -> Basis:
        """The Basis."""
        ...

    @property
    def is_ring(self) -> bool:
        """Whether the mesh is the section of an axisymmetric body."""
        ...


class Elastic(Discretised, Protocol):
    """A body by its Basis and its material."""

    @property
    def lam(self) -> Array:
        """Lame's first parameter, a number or one a cell."""
        ...

    @property
    def law(self) -> StressLaw:
        """Stress from strain in each cell."""
        ...

    @property
    def measure(self) -> Array:
        """Quadrature weights of integrals over the body, shape (ncells, npoints)."""
        ...

    @property
    def dilatation(self) -> str:
        """ "pointwise" or "mean"."""
        ...
