"""Linear elasticity: Lame parameters, the stiffness matrix, stresses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from contact.errors import InputError, numbers

if TYPE_CHECKING:
    from skfem import Basis

_CHUNK = 16384  # cells whose element matrices are held in memory at a time


def lame(
    E: ArrayLike, nu: ArrayLike, plane: str | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lame parameters (lambda, mu) of an isotropic material.

    Parameters
    ----------
    E : float or ndarray
        Young's modulus, positive.
    nu : float or ndarray
        Poisson ratio in (-1, 1/2).
    plane : {"strain", "stress", None}
        In two dimensions, plane stress replaces lambda by 2 lambda mu / (lambda + 2 mu).

    Raises
    ------
    InputError
        A value outside its range.

    Examples
    --------
    >>> [round(float(value), 4) for value in lame(2.0, 0.3, "strain")]
    [1.1538, 0.7692]
    """
    modulus, ratio = numbers("E", E), numbers("nu", nu)
    if not (np.all(np.isfinite(modulus)) and np.all(modulus > 0)):
        raise InputError(f"E={E!r}: Young's modulus must be positive and finite")
    if not (np.all(ratio > -1) and np.all(ratio < 0.5)):
        raise InputError(f"nu={nu!r}: Poisson's ratio must lie in (-1, 1/2)")
    if plane not in ("strain", "stress", None):
        raise InputError(f"plane={plane!r}: expected 'strain' or 'stress'")
    mu = modulus / (2 * (1 + ratio))
    lam = modulus * ratio / ((1 + ratio) * (1 - 2 * ratio))
    if plane == "stress":
        lam = 2 * lam * mu / (lam + 2 * mu)
    return lam, mu


def stiffness_matrix(
    basis: Basis, lam: NDArray[np.float64], mu: NDArray[np.float64]
) -> sparse.csr_array:
    """Stiffness of sigma(u) : eps(v) for a vector basis made by ElementVector.

    The same matrix as ``skfem.models.elasticity.linear_elasticity`` gives, from one batched
    product K_ab = int d_a phi_i d_b phi_j per pair of directions.

    Parameters
    ----------
    basis : Basis of an ElementVector
    lam, mu : ndarray, shape () or (ncells,)

    Returns
    -------
    csr_array, shape (ndofs, ndofs)
    """
    dim, n_local = basis.mesh.dim(), basis.Nbfun // basis.mesh.dim()
    n_cells, n_points = basis.dx.shape
    lam = np.broadcast_to(lam, (n_cells,))[:, None, None]
    mu = np.broadcast_to(mu, (n_cells,))[:, None, None]
    dofs = basis.element_dofs.T
    total = sparse.csr_array((basis.N, basis.N))
    for start in range(0, n_cells, _CHUNK):
        cells = slice(start, min(start + _CHUNK, n_cells))
        gradient = np.empty((dim, cells.stop - start, n_points, n_local))
        for i in range(n_local):
            gradient[..., i] = basis.basis[dim * i][0].grad[0][:, cells]
        weighted = (gradient * basis.dx[cells][..., None]).swapaxes(-1, -2)
        K = {(a, b): weighted[a] @ gradient[b] for a in range(dim) for b in range(a, dim)}
        K |= {(b, a): block.swapaxes(-1, -2) for (a, b), block in K.items() if a < b}
        laplacian = sum(K[a, a] for a in range(dim))
        local = np.empty((cells.stop - start, n_local, dim, n_local, dim))
        for c in range(dim):
            for d in range(dim):
                block = lam[cells] * K[c, d] + mu[cells] * K[d, c]
                local[:, :, c, :, d] = block + mu[cells] * laplacian if c == d else block
        size = dim * n_local
        chunk = dofs[cells]
        rows = np.repeat(chunk, size, axis=1).ravel()
        columns = np.tile(chunk, (1, size)).ravel()
        total = total + sparse.csr_array(
            sparse.coo_array((local.ravel(), (rows, columns)), shape=total.shape)
        )
    total.sort_indices()
    return total


def stress(
    gradient: NDArray[Any],
    lam: NDArray[np.float64],
    mu: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Cauchy stress from the displacement gradient.

    Parameters
    ----------
    gradient : ndarray, shape (dim, dim, ...)
        ``gradient[i, j]`` is d u_i / d x_j.
    lam, mu : ndarray
        Broadcast against the trailing axes.

    Returns
    -------
    ndarray, shape (dim, dim, ...)
    """
    strain = 0.5 * (gradient + np.swapaxes(gradient, 0, 1))
    result = 2 * mu * strain
    trace = lam * np.trace(strain)
    for i in range(gradient.shape[0]):
        result[i, i] += trace
    return result
