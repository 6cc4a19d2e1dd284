"""Eigenvalues of the Laplace operator in extended precision, from an eigenvector in double."""

from __future__ import annotations

from dataclasses import dataclass, field
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import CellBasis, ElementVector

from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import dof_numbers, real_part
from skfem_adini.solvers.exact_matrices import exact_matrix

Array = NDArray[np.float64]
LongArray = NDArray[np.longdouble]


@dataclass(frozen=True, eq=False)
class RefinedEigenpair:
    r"""An eigenpair and its residual.

    Attributes
    ----------
    value
        Rayleigh quotient, in extended precision; ``float(value)`` rounds it.
    vector
        The eigenvector as given, shape (dofs,).
    residual
        :math:`\|K x - \lambda M x\|_{D^{-1}} / (\lambda \|x\|_M)` with D the diagonal of M. The
        relative distance of `value` to the nearest eigenvalue is at most a small multiple of the
        residual; if that eigenvalue is well separated, the distance is of the order of its square.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> from skfem.models.poisson import laplace, mass
    >>> from skfem_adini import ElementQuadAdini, lowest_eigenpairs
    >>> basis = Basis(MeshQuad().refined(3), ElementQuadAdini())
    >>> values, vectors = lowest_eigenpairs(laplace.assemble(basis), mass.assemble(basis), 2)
    >>> pair = refine_eigenpair(basis, vectors[:, 1])
    >>> bool(abs(float(pair.value) - values[1]) < 1e-9), bool(pair.residual < 1e-9)
    (True, True)
    """

    value: np.longdouble
    vector: Array = field(repr=False)
    residual: float


def refine_eigenpair(
    basis: Any, x: ArrayLike, fixed: ArrayLike | None = None, tol: float = 1e-6
) -> RefinedEigenpair:
    r"""Return the eigenvalue of :math:`-\Delta u = \lambda u` that belongs to an eigenvector.

    An assembled matrix holds its entries to :math:`\epsilon` only, which moves an eigenvalue by
    about :math:`\epsilon h^{-2}`, whatever is done to the eigenvector later. The Rayleigh quotient

    .. math:: \lambda = \frac{\sum_T \int_T |\nabla u|^2}{\sum_T \int_T u^2}

    has an error quadratic in that of the eigenvector. Here it is summed cell by cell in
    `numpy.longdouble` from exact element matrices, and in each cell the mean of u at the vertices
    is subtracted before the gradient is formed. The remaining error is that of the discretisation.

    Parameters
    ----------
    basis
        Basis with Adini's element in 2-D or 3-D, on axis-parallel rectangles or boxes; with
        ``elements=`` the integrals are those over these cells. The coordinates of its mesh are
        taken as their exact binary values.
    x
        Eigenvector, for instance from `lowest_eigenpairs`, shape (basis.N,).
    fixed
        Dofs of the essential conditions; their equations do not enter the residual.
    tol
        Largest residual at which x is accepted as an eigenvector.

    Returns
    -------
    RefinedEigenpair
        Where `numpy.longdouble` is no wider than double (Windows, Apple silicon) the value has the
        rounding error of one sum in double, a few 1e-16.

    Raises
    ------
    InputError
        Another element, a basis of facets, cells that are no boxes, an x of wrong shape, complex
        or no eigenvector, fixed dofs that do not exist.

    References
    ----------
    B. N. Parlett, The Symmetric Eigenvalue Problem, SIAM 1998: the Rayleigh quotient and its error.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> from skfem.models.poisson import laplace, mass
    >>> from skfem_adini import ElementQuadAdini, lowest_eigenpairs
    >>> basis = Basis(MeshQuad().refined(4), ElementQuadAdini())
    >>> values, vectors = lowest_eigenpairs(laplace.assemble(basis), mass.assemble(basis), 4)
    >>> pair = refine_eigenpair(basis, vectors[:, 1])
    >>> print(f"{float(pair.value / np.pi**2 - 1):.3e}")
    1.641e-09
    """
    if not isinstance(basis, CellBasis) or isinstance(basis.elem, ElementVector):
        raise InputError(f"basis: expected a skfem.Basis of cells, got {type(basis).__name__}")
    if not (isinstance(tol, Real) and float(tol) > 0):
        raise InputError(f"tol: expected a positive number, got {tol!r}")
    x = real_part("x", x)
    if x.shape != (basis.N,) or not np.isfinite(x).all() or not x.any():
        raise InputError(f"x: expected a finite vector of shape ({basis.N},) that is not zero")
    dim = basis.mesh.dim()
    dofs, sides = _box_cells(basis)
    scale = np.ones((dim + 1, sides.shape[1]), dtype=np.longdouble)
    scale[1:] = sides
    scale = np.tile(scale, (2**dim, 1))
    volume = np.prod(sides, axis=0)

    local = x[dofs].astype(np.longdouble) * scale
    if not local.any():
        raise InputError("x: it is zero in all cells of the basis")
    free_of_mean = local.copy()
    free_of_mean[:: dim + 1] -= local[:: dim + 1].mean(axis=0)
    numerators, denominator = exact_matrix(dim)
    mass_x = numerators.astype(np.longdouble) @ local * (volume / denominator)
    mass = np.sum(local * mass_x)
    stiffness_x = np.zeros_like(local)
    for i in range(dim):
        part, divisor = exact_matrix(dim, i, i)
        weight = volume / (divisor * sides[i] ** 2)
        stiffness_x += part.astype(np.longdouble) @ free_of_mean * weight
    value = np.sum(free_of_mean * stiffness_x) / mass

    force = np.zeros(basis.N, dtype=np.longdouble)
    np.add.at(force, dofs, (stiffness_x - value * mass_x) * scale)
    diagonal = np.zeros(basis.N, dtype=np.longdouble)
    np.add.at(diagonal, dofs, np.diag(numerators)[:, None] * scale**2 * (volume / denominator))
    if fixed is not None:
        force[dof_numbers("fixed", fixed, basis.N)] = 0.0
    met = diagonal > 0  # the others belong to no cell of the basis
    size = np.sqrt(mass) * max(abs(value), 1 / volume.sum() ** (2 / dim))
    residual = float(np.sqrt(np.sum(force[met] ** 2 / diagonal[met])) / size)
    if not residual <= tol:
        raise InputError(
            f"x: its residual is {residual:.1e}, more than tol={tol:.0e}, so it is no eigenvector "
            "of -div(grad u); pass fixed= for essential conditions or compute it more accurately"
        )
    return RefinedEigenpair(value, x, residual)


def _box_cells(basis: Any) -> tuple[NDArray[np.integer], LongArray]:
    """Return the dofs of cells in the order of `exact_matrix`, (2^dim (dim + 1), cells), and sides.
    The sides have the shape (dim, cells)."""
    dim = basis.mesh.dim()
    names = ["u", "u_x", "u_y", "u_z"][: dim + 1]
    if list(basis.elem.dofnames) != names or basis.element_dofs.shape[0] != 2**dim * (dim + 1):
        raise InputError(
            f"basis: expected a cell basis of Adini's element with the dofs {names}, got "
            f"{type(basis.elem).__name__}"
        )
    cells = slice(None) if basis.tind is None else basis.tind
    corners = basis.mesh.p[:, basis.mesh.t[:, cells]]
    if not corners.size:
        raise InputError("basis: it has no cells")
    low, high = corners.min(axis=1, keepdims=True), corners.max(axis=1, keepdims=True)
    at_high = corners > 0.5 * (low + high)
    distance = np.abs(corners - np.where(at_high, high, low)).max()
    powers = 2 ** np.arange(dim)[::-1]
    rank = np.tensordot(powers, at_high, axes=1)
    order = np.argsort(rank, axis=0)
    complete = (np.sort(rank, axis=0) == np.arange(2**dim)[:, None]).all()
    if not complete or not distance <= 1e-10 * np.min(high - low):
        raise InputError("basis: a cell of its mesh is no axis-parallel rectangle or box")
    dofs = basis.element_dofs.reshape(2**dim, dim + 1, -1)
    dofs = np.take_along_axis(dofs, order[:, None, :], axis=0)
    sides = high[:, 0].astype(np.longdouble) - low[:, 0]
    return dofs.reshape(2**dim * (dim + 1), -1), sides
