"""The interface of an elastic body for contact on a grid."""

from __future__ import annotations

from typing import Any, Protocol

ArrayLike = Any  # an array of NumPy or of CuPy


class GridCompliance(Protocol):
    """Displacements of a surface grid under forces on its points, by transforms.

    All arrays have the shape (dim, nx) or (dim, nx, ny): component along a coordinate axis, then
    the point. They are on the device of `initial`. Optional methods ``apply_normal(forces)`` and
    ``precondition_normal(displacements)`` for normal components only, of shape (nx,) or (nx, ny),
    make frictionless contact several times faster, and so does an attribute ``normal_filter``, as
    in `contact.spectral.normal_filter`, with the same on coarser grids. The optional attributes
    ``weights``, shape (nx[, ny]), the area of each point in units of a cell, ``fixed``, shape (dim,
    nx[, ny]), components of points that supports fix, and ``mirrored``, a bool for each direction,
    are those of a surface that is not periodic. ``contact_modulus``, E* at the surface, serves
    `GridResult.edge`.

    Attributes
    ----------
    shape : tuple of int
        Points along each direction of the surface.
    spacing : tuple of float
        Distance of the points along each direction.
    normal : array, shape (dim,)
        Outward unit normal of the body, along a coordinate axis, in either sense.
    constant : array of bool, shape (dim,)
        Components whose mean displacement is free; `apply` ignores the mean force there.
    initial : array, shape (dim, nx[, ny])
        Displacements without contact forces.
    """

    shape: tuple[int, ...]
    spacing: tuple[float, ...]
    normal: Any
    constant: Any
    initial: Any

    def apply(self, forces: ArrayLike) -> ArrayLike:
        """Displacements under forces on the points: symmetric positive semidefinite."""

    def precondition(self, displacements: ArrayLike) -> ArrayLike:
        """Approximate forces that cause given displacements: symmetric positive definite."""
