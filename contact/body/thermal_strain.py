r"""Thermal strains of a body: the strains of its cells if they could expand freely.

The stresses are :math:`\sigma = C (\epsilon(u) - \epsilon_T)`, with the thermal strain
:math:`\epsilon_T = \alpha (T - T_0)` (Boley and Weiner, Theory of Thermal Stresses, Wiley 1960,
section 1.12). It is kept in each cell as a polynomial of second degree by its values in the nodes
of the quadratic element, so that it can be stored, added and scaled; six components in the order
xx, yy, zz, yz, zx, xy.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import ElementHex2, ElementQuad2, ElementTetP2, ElementTriP2

from contact.body.anisotropic import VOIGT
from contact.body.axisymmetry import forces_of_stress
from contact.body.constitutive import thermal_stress
from contact.errors import InputError
from skfem_adini.ground.arguments import evaluated, numbers

Array = NDArray[np.float64]


def thermal_strain(body: Any, temperature: Any, expansion: ArrayLike) -> Array:
    """Thermal strain (6, ncells, 1 or nodes of a cell) of a change of temperature."""
    coefficients = _tensors(expansion, body.mesh.nelements)
    order = [0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1]  # components as Voigt numbers them
    return coefficients[order][..., None] * _temperatures(body, temperature)


def interpolated(body: Any, strain: Array, X: Array) -> Array:
    """Tensors (3, 3, ncells, npoints) at reference points X, from the output of
    `thermal_strain`."""
    if strain.shape[-1] > 1:
        element = quadratic_element(body)
        shapes = [element.lbasis(X, i)[0] for i in range(strain.shape[-1])]
        strain = sum(
            (strain[..., i, None] * shape for i, shape in enumerate(shapes)), start=np.zeros(())
        )
    else:
        strain = np.broadcast_to(strain, (*strain.shape[:2], X.shape[-1]))
    return np.asarray(strain[VOIGT])


def quadratic_element(body: Any) -> Any:
    """The element in whose nodes the thermal strain of a cell is kept."""
    elements = {
        (3, 2): ElementTriP2,
        (4, 2): ElementQuad2,
        (4, 3): ElementTetP2,
        (8, 3): ElementHex2,
    }
    return elements[body.mesh.refdom.nnodes, body.dim]()


def _temperatures(body: Any, temperature: Any) -> Array:
    """Temperature at the nodes of each cell, or one value per cell."""
    X, cells = quadratic_element(body).doflocs.T, body.mesh.nelements
    x = np.asarray(body.basis.mapping.F(X))
    value = evaluated("temperature", temperature, x)
    if value.shape not in ((), x.shape[1:]) or not np.all(np.isfinite(value)):
        raise InputError(
            "temperature: expected a finite number, or a function of the places x that returns "
            f"finite numbers of shape x.shape[1:], got shape {value.shape}"
        )
    if value.ndim == 0:
        return np.full((cells, 1), float(value))
    if body.dilatation != "mean":
        return value
    at = interpolated(body, np.broadcast_to(value, (6, *value.shape)), body.basis.X)[0, 0]
    return np.average(at, axis=1, weights=body.measure)[:, None]


def thermal_forces(body: Any, strain: Array) -> Array:
    """``int C eps_T : eps(v)`` for every basis function v, shape (ndofs,)."""
    basis = body.basis
    sigma = thermal_stress(body.law, interpolated(body, strain, basis.X))
    if body.is_ring:
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


def checked_thermal(body: Any, strain: Any) -> Array | None:
    """Check a stored thermal strain; raise an `InputError` if it does not fit the cells."""
    if strain is None:
        return None
    found, cells = numbers("thermal", strain), body.mesh.nelements
    nodes = len(quadratic_element(body).doflocs)
    if found.shape not in ((6, cells, 1), (6, cells, nodes)) or not np.all(np.isfinite(found)):
        raise InputError(f"thermal: expected a strain for {cells} cells, got shape {found.shape}")
    return found
