"""Gradients and stresses at the mesh vertices, read off the dofs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skfem_adini.elements.vertex_dofs import vertex_dofs
from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import array_of, choice, finite_numbers

Array = NDArray[np.float64]


def nodal_gradient(basis: Any, x: ArrayLike) -> Array:
    """Return the gradient at the vertices: it is among the dofs, nothing is recovered or averaged.

    Parameters
    ----------
    basis
        Basis with `ElementQuadAdini`, `ElementHexAdini` or `ElementQuadBFS`, or an
        `ElementVector` of one.
    x
        Dofs, shape (basis.N,).

    Returns
    -------
    ndarray
        Of a scalar field the derivatives, shape (dim, vertices); of a vector field
        ``gradient[i, j]`` = d u_i / d x_j, shape (components, dim, vertices). For the solution of
        a second-order problem its error is of order 3 on parallelograms and boxes, as large as
        that of the gradient inside the cells.

    Raises
    ------
    InputError
        Another element, or dofs of wrong shape, complex or not finite.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> from skfem_adini import ElementQuadAdini
    >>> basis = Basis(MeshQuad(), ElementQuadAdini())
    >>> x = basis.project(lambda x: x[0] ** 2 * x[1])
    >>> print((nodal_gradient(basis, x).round(9) + 0.0).tolist())  # at (0,0), (1,0), (1,1), (0,1)
    [[0.0, 0.0, 2.0, 0.0], [0.0, 1.0, 1.0, 0.0]]
    """
    dofs = vertex_dofs(basis)[1 : 1 + basis.mesh.dim()]
    gradient: Array = finite_numbers("x", x, (basis.N,))[dofs].swapaxes(0, 1)
    return gradient if "^" in basis.elem.dofnames[0] else gradient[0]


def nodal_stress(
    basis: Any,
    x: ArrayLike,
    E: ArrayLike | None = None,
    nu: ArrayLike | None = None,
    plane: Literal["strain", "stress"] = "strain",
    law: Callable[[Array], ArrayLike] | None = None,
) -> Array:
    r"""Return the stress at the vertices from the dofs of a displacement.

    Of an isotropic material :math:`\sigma = \lambda\, \mathrm{tr}(\varepsilon) I + 2 \mu
    \varepsilon` with the strain of `nodal_gradient`.

    Parameters
    ----------
    basis
        Vector basis of `ElementQuadAdini`, `ElementHexAdini` or `ElementQuadBFS` with as many
        components as the mesh has dimensions.
    x
        Dofs, shape (basis.N,).
    E, nu
        Young's modulus (force per area) and Poisson's ratio: numbers, or one for each cell. Where
        they jump, the stress at a vertex is the mean over the cells around it. The gradient of
        these elements cannot jump at a vertex as that of the solution does there: along the
        interface itself, stresses evaluated inside the cells are more accurate.
    plane
        In 2-D, whether the strain or the stress normal to the plane vanishes.
    law
        Instead of E and nu: a function that returns the stress for displacement gradients (dim,
        dim, vertices), as an array whose last axis is that of the vertices.

    Returns
    -------
    ndarray
        Symmetric tensors, shape (3, 3, vertices); in 2-D the last row and column hold only
        sigma_zz. With `law`, the array that it returns.

    Raises
    ------
    InputError
        No vector basis, E not positive, nu not in (-1, 1/2), wrong shapes, or numbers that are not
        finite; neither E and nu nor a law, or both.

    Examples
    --------
    >>> from skfem import Basis, ElementVector, MeshQuad
    >>> from skfem_adini import ElementQuadAdini
    >>> basis = Basis(MeshQuad(), ElementVector(ElementQuadAdini()))
    >>> x = basis.project(lambda x: np.array([x[1], 0 * x[0]]))  # simple shear
    >>> stress = nodal_stress(basis, x, E=2.0, nu=0.25)
    >>> print(stress[0, 1].round(12).tolist(), von_mises(stress)[0].round(6))
    [0.8, 0.8, 0.8, 0.8] 1.385641
    """
    gradient = nodal_gradient(basis, x)
    dim, vertices = basis.mesh.dim(), gradient.shape[-1]
    if gradient.shape[:-1] != (dim, dim):
        raise InputError(
            f"basis: stresses need an ElementVector with {dim} components, got a field of shape "
            f"{gradient.shape[:-2]}"
        )
    if (law is None) == (E is None and nu is None) or (E is None) != (nu is None):
        raise InputError("E, nu, law: give either both E and nu, or a law")
    if law is not None:
        if not callable(law):
            raise InputError(f"law: expected a function, got {type(law).__name__}")
        found = array_of("law", law(gradient))
        if found.ndim == 0 or found.shape[-1] != vertices:
            raise InputError(
                f"law: expected an array with last axis {vertices}, it returned {found.shape}"
            )
        stress: Array = finite_numbers("law", found, found.shape)
        return stress
    choice("plane", plane, ("strain", "stress"))
    if dim == 3 and plane == "stress":
        raise InputError("plane: 'stress' is for fields in 2-D; leave it out in 3-D")

    lam, mu = _lame(E, nu, basis.mesh.nelements)
    if dim == 2 and plane == "stress":
        lam = 2 * lam * mu / (lam + 2 * mu)
    lam, mu = (_mean_at_vertices(basis.mesh, parameter) for parameter in (lam, mu))
    stress = np.zeros((3, 3, vertices))
    stress[:dim, :dim] = mu * (gradient + gradient.swapaxes(0, 1))
    pressure = lam * np.trace(gradient)
    for i in range(3 if plane == "strain" else dim):
        stress[i, i] += pressure
    return stress


def von_mises(stress: ArrayLike) -> Array:
    r"""Return the von Mises stress :math:`\sqrt{3/2\; s : s}`, s the deviator.

    Parameters
    ----------
    stress
        Tensors, shape (3, 3, ...), as `nodal_stress` gives.

    Returns
    -------
    ndarray
        Shape (...).

    Raises
    ------
    InputError
        The first two axes are not of length 3 (in 2-D, too, sigma_zz is needed).

    References
    ----------
    R. von Mises, Mechanik der festen Körper im plastisch-deformablen Zustand, Nachrichten von der
    Gesellschaft der Wissenschaften zu Göttingen (1913), 582-592.

    Examples
    --------
    >>> float(von_mises(np.diag([3.0, 0.0, 0.0])))
    3.0
    """
    try:
        shape = np.shape(stress)
    except ValueError as error:
        raise InputError(f"stress: expected shape (3, 3, ...): {error}") from error
    if shape[:2] != (3, 3):
        raise InputError(
            f"stress: expected shape (3, 3, ...) with sigma_zz, got {shape}; a plane stress has "
            "zeros there"
        )
    stress = finite_numbers("stress", stress, shape)
    mean = np.trace(stress) / 3
    deviator = stress - np.multiply.outer(np.eye(3), mean)
    return np.asarray(np.sqrt(1.5 * np.sum(deviator**2, axis=(0, 1))))


def _lame(E: Any, nu: Any, cells: int) -> tuple[Array, Array]:
    """Return lambda and mu of every cell."""
    modulus, ratio = (
        np.broadcast_to(finite_numbers(name, value, (cells,) if np.ndim(value) else ()), cells)
        for name, value in (("E", E), ("nu", nu))
    )
    if not (modulus > 0).all():
        raise InputError("E: Young's modulus must be positive")
    if not ((ratio > -1) & (ratio < 0.5)).all():
        raise InputError("nu: Poisson's ratio must lie between -1 and 1/2")
    return modulus * ratio / ((1 + ratio) * (1 - 2 * ratio)), modulus / (2 * (1 + ratio))


def _mean_at_vertices(mesh: Any, values: Array) -> Array:
    """Return the means of cell values over the cells around each vertex."""
    corners = len(mesh.t)
    count = np.bincount(mesh.t.ravel(), minlength=mesh.nvertices)
    total = np.bincount(mesh.t.ravel(), np.tile(values, corners), minlength=mesh.nvertices)
    return np.asarray(total / np.maximum(count, 1))
