"""The part of a result that pictures and VTK output use, and the two sides of its pairs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.layers.layered_block import LayeredBlock
from contact.body.rigid_modes import rigid_field
from contact.rows.contact_rows import ContactRows

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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

    def on_grid(self, grid: Any) -> Any:
        """The grid of the body, with what a result adds to it."""


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


@dataclass(frozen=True)
class Side:
    """The body on whose boundary contact points lie."""

    body: Any
    mesh: Any  # where it is drawn: of large strain the deformed one
    G: sparse.csr_array  # rows of the normal displacement, columns of this body, shape (n, ndofs)

    @property
    def trace(self) -> Any:
        """The body with a Basis that determines the boundary."""
        return self.body.trace


def side(result: Drawn, points: Index) -> Side:
    """The side of points of one contact boundary, which carries the multipliers."""
    rows, body = result.system.rows, result.system.body
    k = int(rows.owner[points[0]]) if rows.owner.size else 0
    return Side(body.bodies[k], drawn_mesh(result, k), rows.G[points][:, body.slices[k]])


def drawn_mesh(result: Drawn, k: int) -> Any:
    """Mesh of body k on which its contact points lie: of large strain the deformed one."""
    moved = getattr(result, "moved_mesh", None)
    return result.system.body.bodies[k].trace.mesh if moved is None else moved(k)


def pair_name(result: Drawn, k: int) -> str:
    """Name of contact boundary k in texts, pictures and blocks: "contact 0", or "tie 0"."""
    return f"{'tie' if result.system.rows.ties[result.part == k].all() else 'contact'} {k}"


def is_elastic(result: Drawn, points: Index) -> bool:
    """Whether a body, not a rigid obstacle, is opposite to points of one contact boundary.
    A translation of all bodies together then changes no gap."""
    rows, bodies = result.system.rows, result.system.body
    if not rows.owner.size:
        return False
    k = int(rows.owner[points[0]])
    elsewhere = np.ones(rows.G.shape[1], dtype=bool)
    elsewhere[bodies.slices[k]] = False
    if abs(rows.G[points][:, elsewhere]).sum() > 0:
        return True
    own, axes = side(result, points), rows.axes[points]
    trace = own.trace
    moved = own.G[:, : trace.f.size] @ rigid_field(trace, np.zeros(trace.dim))[:, : trace.dim]
    # A common translation changes gaps by rounding only.
    return bool(np.abs(moved).max() <= 1e-12 * np.abs(axes).max())


def drawn_bodies(result: Any) -> list[Any]:
    """The part of a result, or of a part, in each of its bodies."""
    if not hasattr(result, "__getitem__"):
        return [meshed(result)]
    return [meshed(result[k]) for k in range(len(result.system.body.bodies))]


def meshed(one: Any) -> Any:
    """The part of a result in one body; in a `LayeredBlock` with the mesh that this stands for."""
    return one.on_mesh if isinstance(one.body, LayeredBlock) else one
