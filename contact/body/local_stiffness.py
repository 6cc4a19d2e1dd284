"""Local stiffness matrices of the cells of a basis, and of each class of congruent cells."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from skfem import ElementVector

from skfem_adini import CongruentCells

if TYPE_CHECKING:
    from skfem import Basis

Classes = tuple[CongruentCells, NDArray[np.float64]]  # with the local matrix of each
Local = Iterator[tuple[slice, NDArray[np.float64]]]  # cells with their local matrices

_CHUNK = 16384  # cells whose element matrices are held in memory at a time


def isotropic_classes(
    basis: Basis,
    lame_lambda: NDArray[np.float64],
    lame_mu: NDArray[np.float64],
    mean_dilatation: bool = False,
) -> Classes | None:
    """Classes of congruent cells with the stiffness of each, if these are few; else None.
    The stiffnesses have the shape (classes, dofs of a cell, dofs of a cell)."""

    def of_each(part: Basis, cells: Any) -> Local:
        lam, mu = (v[cells] if v.ndim else v for v in (lame_lambda, lame_mu))
        return local_matrices(part, lam, mu, mean_dilatation)

    return _few(basis, of_each, lame_lambda, lame_mu)


def tensor_classes(basis: Basis, tensor: NDArray[np.float64]) -> Classes | None:
    """As `isotropic_classes`, for `contact.body.elasticity.tensor_stiffness`."""

    def of_each(part: Basis, cells: Any) -> Local:
        return tensor_matrices(part, tensor[..., cells] if tensor.ndim == 5 else tensor)

    fields = tensor.reshape(-1, basis.nelems) if tensor.ndim == 5 else ()
    return _few(basis, of_each, *fields)


def _few(basis: Basis, of_each: Callable[..., Local], *fields: Any) -> Classes | None:
    classes = CongruentCells.of(basis, *fields)
    if classes is None or 2 * len(classes.cells) > basis.nelems:
        return None
    part = classes.basis_of(basis.elem.elem)
    whole = np.concatenate([local for _, local in of_each(part, classes.cells)])
    # Exactly symmetric: other solvers converge on it where rounding had broken the symmetry.
    return classes, 0.5 * (whole + whole.transpose(0, 2, 1))


def local_matrices(
    basis: Basis,
    lame_lambda: NDArray[np.float64],
    lame_mu: NDArray[np.float64],
    mean_dilatation: bool,
) -> Local:
    """Cells, and their stiffness matrices (cells, dofs of a cell, dofs of a cell)."""
    dim, n_cells = basis.mesh.dim(), len(basis.dx)
    lame_lambda = np.broadcast_to(lame_lambda, (n_cells,))[:, None, None]
    lame_mu = np.broadcast_to(lame_mu, (n_cells,))[:, None, None]
    for cells, weighted, K in _products(basis):
        laplacian = sum(K[a, a] for a in range(dim))
        if mean_dilatation:
            total_of = weighted.sum(axis=-1)  # int d_c phi_i, (dim, ncells, n_local)
            size = basis.dx[cells].sum(axis=1)[:, None, None]
        local = _empty_blocks(K, dim)
        for c in range(dim):
            for d in range(dim):
                volume = K[c, d]
                if mean_dilatation:
                    volume = total_of[c][:, :, None] * total_of[d][:, None, :] / size
                block = lame_lambda[cells] * volume + lame_mu[cells] * K[d, c]
                local[:, :, c, :, d] = block + lame_mu[cells] * laplacian if c == d else block
        yield cells, _flat(local)


def tensor_matrices(basis: Basis, tensor: NDArray[np.float64]) -> Local:
    """Cells, and their stiffness matrices (cells, dofs of a cell, dofs of a cell)."""
    dim, n_cells = basis.mesh.dim(), len(basis.dx)
    constant = tensor if tensor.ndim == 5 else tensor[..., None]
    C = np.broadcast_to(constant, (*tensor.shape[:4], n_cells))[..., None, None]
    for cells, _, K in _products(basis):
        local = _empty_blocks(K, dim)
        for c in range(dim):
            for d in range(dim):
                local[:, :, c, :, d] = sum(C[c, a, d, b, cells] * K[a, b] for a, b in K)
        yield cells, _flat(local)


def _products(basis: Basis) -> Iterator[tuple[slice, Any, dict[tuple[int, int], Any]]]:
    """Weighted gradients of a chunk of cells, and K_ab = int d_a phi_i d_b phi_j.
    The basis is that of a component, or of a vector, of which each component has its own
    functions."""
    dim = basis.mesh.dim()
    if isinstance(basis.elem, ElementVector):
        scalar = [basis.basis[i][0].grad[0] for i in range(0, basis.Nbfun, dim)]
    else:
        scalar = [field.grad for (field,) in basis.basis]
    n_cells, n_points = basis.dx.shape
    for start in range(0, n_cells, _CHUNK):
        cells = slice(start, min(start + _CHUNK, n_cells))
        gradient = np.empty((dim, cells.stop - start, n_points, len(scalar)))
        for i, of_function in enumerate(scalar):
            gradient[..., i] = of_function[:, cells]
        weighted = (gradient * basis.dx[cells][..., None]).swapaxes(-1, -2)
        K = {(a, b): weighted[a] @ gradient[b] for a in range(dim) for b in range(a, dim)}
        K |= {(b, a): block.swapaxes(-1, -2) for (a, b), block in K.items() if a < b}
        yield cells, weighted, K


def _empty_blocks(K: dict[tuple[int, int], Any], dim: int) -> NDArray[np.float64]:
    n_cells, n_local, _ = K[0, 0].shape
    return np.empty((n_cells, n_local, dim, n_local, dim))


def _flat(local: NDArray[np.float64]) -> NDArray[np.float64]:
    n_cells, n_local, dim = local.shape[:3]
    return local.reshape(n_cells, n_local * dim, n_local * dim)
