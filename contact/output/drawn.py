"""The interface of a solved contact problem that pictures and VTK output use."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from contact.rows.contact_rows import ContactRows

Array = NDArray[np.float64]


class DrawnSystem(Protocol):
    """The problem whose solution is drawn."""

    @property
    def body(self) -> Any:
        """A `Solid`."""

    @property
    def rows(self) -> ContactRows:
        """Places, frames and weights of the contact points."""

    @property
    def law(self) -> str | None:
        """The friction law: "coulomb", "tresca" or None."""

    def bound(self, mu: Array) -> Array:
        """Friction bound of every point for given normal forces, shape (m,)."""


class DrawnBody(Protocol):
    """A body and its displacement."""

    @property
    def body(self) -> Any:
        """A `Solid`."""

    @property
    def u(self) -> Array:
        """Displacement of all dofs, shape (ndofs,)."""

    def von_mises(self) -> Array:
        """Von Mises stress in the quadrature points, shape (ncells, nquadrature)."""

    def nodal_stress(self) -> Array:
        """Stress at the vertices of the mesh, shape (3, 3, nvertices)."""

    def cell_stress(self) -> Array:
        """Mean stress of each cell, shape (3, 3, ncells)."""


class Drawn(DrawnBody, Protocol):
    """A displacement, and fields at the m contact points of its body."""

    @property
    def system(self) -> DrawnSystem:
        """The problem."""

    @property
    def mu(self) -> Array:
        """Normal contact forces, shape (m,)."""

    @property
    def t(self) -> Array:
        """Tangential multipliers, shape (m, dim - 1)."""

    @property
    def x(self) -> Array:
        """Places of the contact points, shape (dim, m)."""

    @property
    def x_nominal(self) -> Array:
        """Nominal places of the contact points, shape (dim, m)."""

    @property
    def part(self) -> NDArray[np.int64]:
        """Number of the contact boundary of each point, shape (m,)."""

    @property
    def pressure(self) -> Array:
        """Force per area, shape (m,)."""

    @property
    def shear(self) -> Array:
        """Traction on the body along the tangents, shape (m, dim - 1)."""

    @property
    def tie_pressure(self) -> Array:
        """Normal traction of ties, zero elsewhere, shape (m,)."""

    @property
    def tie_shear(self) -> Array:
        """Tangential traction of ties on the body, zero elsewhere, shape (m, dim - 1)."""

    @property
    def slip(self) -> Array:
        """Tangential displacement relative to the obstacle, shape (m, dim - 1)."""

    @property
    def gap(self) -> Array:
        """Gap in the deformed state, shape (m,)."""

    @property
    def status(self) -> NDArray[np.int8]:
        """`Status` of each point, shape (m,)."""
