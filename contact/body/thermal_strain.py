r"""Thermal strains of a body: what it would expand by, were its cells free.

The stresses are :math:`\sigma = C (\epsilon(u) - \epsilon_T)`, with the thermal strain
:math:`\epsilon_T = \alpha (T - T_0)` (Boley and Weiner, Theory of Thermal Stresses, Wiley 1960,
section 1.12). It is kept in each cell as a polynomial of second degree by its values in the nodes
of the quadratic element, so that it can be stored, added and scaled; six components in the order
xx, yy, zz, yz, zx, xy.
"""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import ElementHex2, ElementQuad2, ElementTetP2, ElementTriP2

from contact.body.anisotropic import VOIGT
from contact.body.axisymmetry import forces_of_stress
from contact.body.cell_finder import places_in
from contact.body.constitutive import thermal_stress
from contact.body.material import MaterialBody
from contact.errors import InputError
from skfem_adini.ground.arguments import evaluated, numbers

Array = NDArray[np.float64]
_QUADRATIC = {  # by the number of vertices and the dimension of a cell
    (3, 2): ElementTriP2,
    (4, 2): ElementQuad2,
    (4, 3): ElementTetP2,
    (8, 3): ElementHex2,
}
_FIRST, _SECOND = [0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1]


class HeatedBody(MaterialBody):
    """A body that may have thermal strains."""

    thermal: Array | None = None  # eps_T, (6, ncells, 1 or nodes of a cell)

    def heat(self, temperature: Any, expansion: ArrayLike) -> Self:
        """Add a change of temperature: thermal strains, and the forces equivalent to them on `f`.

        All stresses that are read out are those without the thermal strain. Repeated calls add.
        Give the material before: it enters the forces.

        Parameters
        ----------
        temperature : float or callable x -> array of shape x.shape[1:]
            Difference from the temperature at which the body is free of stress. In each cell it is
            taken as a quadratic polynomial; with mean dilatation, as its mean.
        expansion : array, shape (), (3,) or (3, 3)
            Coefficient of thermal expansion, one over the unit of `temperature`: isotropic, three
            coefficients along x, y, z, or a symmetric tensor in the axes of the mesh. The third
            direction counts in plane strain too. In each cell another: with a leading axis ncells,
            for one coefficient a cell shape (ncells, 1, 1).

        Returns
        -------
        Self
            Itself, for chaining.

        Raises
        ------
        InputError
            A temperature or an expansion of another shape, or not finite.

        Examples
        --------
        A bar between smooth walls that is heated by 100 K:

        >>> from skfem import MeshHex
        >>> from contact import ContactProblem, ElasticBody
        >>> mesh = MeshHex().with_defaults()
        >>> bar = ElasticBody.from_mesh(mesh, E=2e5, nu=0.25).heat(100.0, 1e-5)
        >>> bar = bar.fix(["left", "right"], "x").fix(["front", "back"], "z").fix("top", "y")
        >>> result = ContactProblem(bar, "bottom", 0.0).solve()
        >>> round(float(result.pressure.mean()), 6)  # E alpha T / (1 - 2 nu)
        400.0
        """
        self.check_unchanged()
        coefficients = _tensors(expansion, self.mesh.nelements)
        degrees = self._temperatures(temperature)
        strain = coefficients[_FIRST, _SECOND][..., None] * degrees
        forces = self._thermal_forces(strain)
        self.thermal = strain if self.thermal is None else self.thermal + strain
        self.f = self.f + forces
        return self

    def thermal_strain_in(self, X: Array) -> Array | None:
        """Thermal strain at reference places, the same ones or others in each cell.

        Parameters
        ----------
        X : ndarray, shape (dim, npoints) or (dim, ncells, npoints)

        Returns
        -------
        ndarray, shape (3, 3, ncells, npoints), or None
        """
        return None if self.thermal is None else self._interpolated(self.thermal, X)

    def thermal_strain_at(self, points: Array) -> Array | None:
        """Thermal strain at points (dim, npoints), shape (3, 3, npoints), or None."""
        if self.thermal is None:
            return None
        cells = self.cells_of(points)
        X = places_in(self.mesh, self.basis.mapping, points, cells)
        return self._interpolated(self.thermal[:, cells], X[:, :, None])[..., 0]

    def _interpolated(self, strain: Array, X: Array) -> Array:
        if strain.shape[-1] > 1:
            element = self._quadratic
            shapes = [element.lbasis(X, i)[0] for i in range(strain.shape[-1])]
            strain = sum(
                (strain[..., i, None] * shape for i, shape in enumerate(shapes)), start=np.zeros(())
            )
        else:
            strain = np.broadcast_to(strain, (*strain.shape[:2], X.shape[-1]))
        return np.asarray(strain[VOIGT])

    @property
    def _quadratic(self) -> Any:
        return _QUADRATIC[self.mesh.refdom.nnodes, self.dim]()

    def _temperatures(self, temperature: Any) -> Array:
        """Temperature in the nodes of each cell, or one a cell."""
        X, cells = self._quadratic.doflocs.T, self.mesh.nelements
        x = np.asarray(self.basis.mapping.F(X))
        value = evaluated("temperature", temperature, x)
        if value.shape not in ((), x.shape[1:]) or not np.all(np.isfinite(value)):
            raise InputError(
                "temperature: expected a finite number, or a function of the places x that returns "
                f"finite numbers of shape x.shape[1:], got shape {value.shape}"
            )
        if value.ndim == 0:
            return np.full((cells, 1), float(value))
        if self.dilatation != "mean":
            return value
        at = self._interpolated(np.broadcast_to(value, (6, *value.shape)), self.basis.X)[0, 0]
        return np.average(at, axis=1, weights=self.measure)[:, None]

    def _thermal_forces(self, strain: Array) -> Array:
        """``int C eps_T : eps(v)`` for every basis function v, shape (ndofs,)."""
        basis = self.basis
        sigma = thermal_stress(self.law, self._interpolated(strain, basis.X))
        if self.is_ring:
            return forces_of_stress(basis, sigma)
        sigma = sigma * basis.dx
        result = np.zeros(basis.N)
        for i in range(basis.Nbfun):
            work = np.einsum("abcq,abcq->c", sigma, np.asarray(basis.basis[i][0].grad))
            np.add.at(result, basis.element_dofs[i], work)
        return result


def _tensors(expansion: ArrayLike, count: int) -> Array:
    """Expansion as tensors, shape (3, 3, 1) or (3, 3, ncells)."""
    given = numbers("expansion", expansion)
    if not np.all(np.isfinite(given)):
        raise InputError("expansion: holds values that are not finite")
    if given.shape in ((), (1, 1), (count, 1, 1)):
        tensor = given[..., None, None] * np.eye(3) if given.ndim == 0 else given * np.eye(3)
    elif given.shape in ((3,), (count, 3)) and given.shape != (3, 3):
        tensor = given[..., None] * np.eye(3)
    elif given.shape in ((3, 3), (count, 3, 3)):
        tensor = given
    else:
        raise InputError(
            "expansion: expected a number, three coefficients, a tensor of shape (3, 3), or one of "
            f"them a cell with shape (ncells, 1, 1), (ncells, 3) or (ncells, 3, 3), ncells = "
            f"{count}; got shape {given.shape}"
        )
    if np.abs(tensor - tensor.swapaxes(-1, -2)).max() > 1e-12 * np.abs(tensor).max():
        raise InputError("expansion: the tensor must be symmetric")
    return np.moveaxis(tensor if tensor.ndim == 3 else tensor[None], 0, -1)


def checked_thermal(body: HeatedBody, strain: Any) -> Array | None:
    """Stored thermal strain of a body, or an `InputError` if it is none of its cells."""
    if strain is None:
        return None
    found, cells = numbers("thermal", strain), body.mesh.nelements
    nodes = len(body._quadratic.doflocs)
    if found.shape not in ((6, cells, 1), (6, cells, nodes)) or not np.all(np.isfinite(found)):
        raise InputError(f"thermal: expected a strain for {cells} cells, got shape {found.shape}")
    return found
