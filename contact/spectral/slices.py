"""Fields on planes through layers, recovered from the forces of a contact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.errors import InputError
from contact.spectral.grid_compliance import GridCompliance
from skfem_adini.ground.arguments import finite_number, integer
from skfem_adini.ground.errors import optional

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Slice:
    """Displacement and stress on equidistant points of a plane along coordinate axes.

    Attributes
    ----------
    axes : tuple of ndarray
        Coordinates along each axis; a single number for the axis normal to the plane.
    points : ndarray, shape (dim, n, m), of a line in a plane body (2, n)
    u : ndarray, of the same shape
    stress : ndarray, shape (dim, dim, n, m) or (2, 2, n)
        Cauchy stress; at an interface that of the upper layer.

    Examples
    --------
    Under an even pressure the stress is that of an oedometer:

    >>> from contact import GridContact, PeriodicLayers, Rigid
    >>> block = PeriodicLayers(1.0, [(0.5, 4, 1.0, 0.2)], 4)
    >>> cut = GridContact(block, Rigid(0.0, force=(None, 0.01))).solve().section(levels=3)
    >>> print(cut.points.shape, cut.stress[:, :, 0, 1].diagonal().round(6))
    (2, 4, 3) [-0.0025 -0.01  ]
    """

    axes: tuple[Array, ...]
    points: Array
    u: Array
    stress: Array

    def to_pyvista(self) -> Any:
        """Image data with displacement and stress, the latter by rows of its nine components.

        Returns
        -------
        pyvista.ImageData

        Raises
        ------
        MissingDependency
            pyvista is not installed.
        """
        dim = len(self.axes)
        image = image_data(self.axes)
        u, stress = np.zeros((3, self.u[0].size)), np.zeros((3, 3, self.u[0].size))
        for i in range(dim):
            u[i] = self.u[i].ravel(order="F")
            for j in range(dim):
                stress[i, j] = self.stress[i, j].ravel(order="F")
        image.point_data["u"], image.point_data["stress"] = u.T, stress.reshape(9, -1).T
        return image


class FieldsInside:
    """The fields inside layers, for the result of their contact."""

    compliance: GridCompliance
    forces: Array

    def sample(self, points: ArrayLike) -> Array:
        """Displacement at points inside layers, by the element's own interpolation.

        Parameters
        ----------
        points : array, shape (dim, n)
            The lower side lies at height zero; coordinates are taken modulo a period.

        Returns
        -------
        ndarray, shape (dim, n)
            Relative to the same mean as `u`.

        Raises
        ------
        InputError
            Points outside the layers, or of another shape; a body without layers.
        """
        return np.asarray(self._layers().sample(self._on_the_body(), points))

    def stress(self, points: ArrayLike) -> Array:
        """Cauchy stress at points inside layers; between two of them that of the upper one.

        Parameters
        ----------
        points : array, shape (dim, n)

        Returns
        -------
        ndarray, shape (dim, dim, n)

        Raises
        ------
        InputError
            As for `sample`.
        """
        return np.asarray(self._layers().stress(self._on_the_body(), points))

    def plane(self, z: float) -> Slice:
        """Fields below or above every point of the surface, at one height.

        Only two planes of nodes are recovered, for any number of layers of cells.

        Parameters
        ----------
        z : float
            Height over the lower side.

        Returns
        -------
        Slice

        Raises
        ------
        InputError
            A height outside the layers; a body without layers.

        Examples
        --------
        >>> from contact import GridContact, PeriodicLayers, Rigid
        >>> block = PeriodicLayers((1.0, 1.0), [(1.0, 8, 1.0, 0.3)], (8, 8))
        >>> pressed = GridContact(block, Rigid(0.0, force=(None, None, 0.01))).solve()
        >>> middle = pressed.plane(0.5)
        >>> print(middle.points.shape, middle.stress[2, 2].mean().round(12))
        (3, 8, 8) -0.01
        """
        return self._slice([*self._lateral(), np.array([finite_number("z", z)])])

    def section(self, y: float | None = None, levels: int = 65) -> Slice:
        """Fields on an upright section: across y in space, the whole body in the plane.

        Parameters
        ----------
        y : float, optional
            Place of the section in space.
        levels : int
            Number of heights, from the lower side to the top.

        Returns
        -------
        Slice

        Raises
        ------
        InputError
            No place in space, or one in the plane; a number of heights below two; a body without
            layers.
        """
        layers, lateral = self._layers(), self._lateral()
        if (y is None) != (len(lateral) == 1):
            raise InputError(f"y={y!r}: expected a number in space, and none in the plane")
        count = integer("levels", levels, 2)
        if y is not None:
            lateral[1] = np.array([finite_number("y", y)])
        last = layers.layers[-1]
        return self._slice([*lateral, np.linspace(0.0, last.bottom + last.height, count)])

    def _slice(self, axes: list[Array]) -> Slice:
        grid = np.array(np.meshgrid(*axes, indexing="ij"))
        shape = tuple(x.size for x in axes if x.size > 1)
        flat = grid.reshape(len(axes), -1)
        u, stress = self.sample(flat), self.stress(flat)
        return Slice(
            tuple(axes), flat.reshape(-1, *shape), u.reshape(-1, *shape),
            stress.reshape(*stress.shape[:2], *shape),
        )  # fmt: skip

    def _layers(self) -> Any:
        if not hasattr(self.compliance, "layers"):
            raise InputError(
                f"compliance: a {type(self.compliance).__name__} has no fields inside; take "
                "PeriodicLayers, on a half space (base=...) if need be"
            )
        return self.compliance

    def _lateral(self) -> list[Array]:
        """Coordinates of the points of the surface."""
        sizes = zip(self.compliance.spacing, self.compliance.shape, strict=True)
        return [h * np.arange(float(n)) for h, n in sizes]

    def _on_the_body(self) -> Array:
        """Contact forces along the coordinate axes."""
        return np.concatenate((-self.forces[1:], self.forces[:1]))


def image_data(axes: Sequence[Array]) -> Any:
    """Points of equidistant axes as pyvista image data without fields; two axes make a plane."""
    pyvista = optional("pyvista", "image data need pyvista: pip install 'pyvista>=0.47'")
    all_axes = [*axes, *[np.zeros(1)] * (3 - len(axes))]
    return pyvista.ImageData(
        dimensions=tuple(x.size for x in all_axes),
        spacing=tuple(float(x[1] - x[0]) if x.size > 1 else 1.0 for x in all_axes),
        origin=tuple(float(x[0]) for x in all_axes),
    )
