"""Linear elasticity: Lame parameters, the stiffness matrix, stresses.

How near Poisson's ratio may come to 1/2 depends on the element. The pressure's rms error over p0 in
Hertz' line contact (|x| < .8 a, a / h = 8; `benchmarks/contact_scaling.py`):

=================  ======  ======  ======  ======  ======
element            nu .3   .45     .49     .499    .4999
=================  ======  ======  ======  ======  ======
Adini, bernstein   8.9e-4  8.8e-4  1.1e-3  5.2e-3  1.8e-2
Adini, gauss       9.9e-4  9.6e-4  4.3e-3  2.2e-2  7.3e-2
BFS                9.6e-4  9.6e-4  9.2e-4  9.0e-4  2.0e-3
Q2                 1.2e-3  1.2e-3  1.9e-3  2.2e-2  .18
P2                 1.8e-3  2.9e-3  8.5e-3  2.6e-2  4.3e-2
Q1                 4.4e-4  3.4e-3  1.8e-2  .13     .77
Q1, mean           1.1e-3  1.6e-3  1.7e-3  1.7e-3  1.7e-3
P1                 3.0e-2  7.9e-2  .26     .72     .81
=================  ======  ======  ======  ======  ======

"mean" is ``ElasticBody(..., dilatation="mean")``, for Q1 quadrilaterals and hexahedra. The force
that compresses a bonded unit block by a tenth shows the same: elements of first order lock, their
error grows like 1 / (1 - 2 nu), all others stay within 4 % for any nu.

================  =====  ====  ====  =====  =======
element, cells    nu .3  .45   .49   .499   .49999
================  =====  ====  ====  =====  =======
P1, 12 x 12       .3 %   2 %   8 %   50 %   x 39
Q1, 12 x 12       .2 %   1 %   4 %   26 %   x 20
P1, 6 x 6 x 6     1 %    5 %   19 %  107 %  x 52
Q1, 6 x 6 x 6     .5 %   3 %   14 %  110 %  x 103
================  =====  ====  ====  =====  =======

A body of P1, or of Q1 with pointwise dilatation, warns above nu = .48, one of Q2 above .4995, where
its pressure begins to oscillate; plane stress does not lock.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTriP1,
)

from contact.errors import InputError, warn
from skfem_adini import AffineCells
from skfem_adini.ground.arguments import choice, numbers

if TYPE_CHECKING:
    from skfem import Basis
from collections.abc import Callable, Iterator

from skfem import ElementVector

from skfem_adini import CongruentCells


def lame(
    E: ArrayLike, nu: ArrayLike, plane: str | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lame parameters (lambda, mu) of Young's modulus E > 0 and Poisson's ratio nu in (-1, 1/2).
    Plane stress replaces lambda by 2 lambda mu / (lambda + 2 mu)."""
    modulus, ratio = numbers("E", E), numbers("nu", nu)
    wrong = modulus[~(np.isfinite(modulus) & (modulus > 0))]
    if wrong.size:
        raise InputError(f"E={wrong.flat[0]:.12g}: Young's modulus must be positive and finite")
    wrong = ratio[~((ratio > -1) & (ratio < 0.5))]
    if wrong.size:
        raise InputError(f"nu={wrong.flat[0]:.12g}: Poisson's ratio must lie in (-1, 1/2)")
    if plane is not None:
        choice("plane", plane, ("strain", "stress"))
    lame_mu = modulus / (2 * (1 + ratio))
    lame_lambda = modulus * ratio / ((1 + ratio) * (1 - 2 * ratio))
    if plane == "stress":
        lame_lambda = 2 * lame_lambda * lame_mu / (lame_lambda + 2 * lame_mu)
    return lame_lambda, lame_mu


def checked_dilatation(dilatation: str, element: Any) -> str:
    """Check the name of the volumetric strain, "pointwise" or, for Q1 only, "mean"."""
    choice("dilatation", dilatation, ("pointwise", "mean"))
    if dilatation == "mean" and not isinstance(element, ElementQuad1 | ElementHex1):
        raise InputError(
            f"dilatation='mean' is for ElementQuad1 and ElementHex1, not {type(element).__name__}: "
            "it would cost elements of higher order their order"
        )
    return dilatation


def check_locking(
    nu: NDArray[np.float64], plane: str | None, dilatation: str, element: Any
) -> None:
    """Warn if the element locks because nu is close to 1/2; see the tables of this module."""
    largest, name = float(nu.max()), type(element).__name__
    if plane == "stress" or dilatation == "mean":
        return
    locks, oscillates = 0.48, 0.4995  # Poisson's ratios, from the tables of this module
    if isinstance(element, ElementQuad1 | ElementHex1) and largest > locks:
        remedy = "dilatation='mean'"
    elif isinstance(element, ElementTriP1 | ElementTetP1) and largest > locks:
        remedy = "elements of second order, or quadrilaterals or hexahedra with dilatation='mean'"
    elif isinstance(element, ElementQuad2 | ElementHex2) and largest > oscillates:
        warn(
            f"nu={largest:.6g}: the contact pressure of {name} oscillates so near to 1/2; "
            "take Adini elements, or Q1 with dilatation='mean'"
        )
        return
    else:
        return
    warn(
        f"nu={largest:.6g}: {name} locks so near to 1/2, stiffer by a factor that grows like "
        f"1 / (1 - 2 nu); take {remedy}"
    )


def stiffness_matrix(
    basis: Basis,
    lame_lambda: NDArray[np.float64],
    lame_mu: NDArray[np.float64],
    mean_dilatation: bool = False,
) -> sparse.csr_array:
    r"""Stiffness of sigma(u) : eps(v) for an ElementVector; lambda, mu: shape () or (ncells,).
    Mean dilatation: :math:`\lambda |K|^{-1} \int_K \operatorname{div} u \int_K
    \operatorname{div} v` in a cell K (Hughes, The Finite Element Method, 1987, section 4.4)."""
    few = isotropic_classes(basis, lame_lambda, lame_mu, mean_dilatation)
    if few is not None:
        return _as_array(few[0].matrix(few[1]))
    # Cell means are not products of gradients.
    straight = None if mean_dilatation else AffineCells.of(basis)
    if straight is not None:
        tensor = isotropic_tensor(lame_lambda, lame_mu, basis.mesh.dim())
        return _as_array(straight.matrix(tensor))
    return summed(basis, local_matrices(basis, lame_lambda, lame_mu, mean_dilatation))


def isotropic_tensor(
    lame_lambda: NDArray[np.float64], lame_mu: NDArray[np.float64], dim: int
) -> NDArray[np.float64]:
    """``C_ijkl = lambda d_ij d_kl + mu (d_ik d_jl + d_il d_jk)``, shape (dim,) * 4, then
    (ncells,) if any."""
    pairs = np.multiply.outer(np.eye(dim), np.eye(dim))  # d_ij d_kl
    shear = pairs.transpose(0, 2, 1, 3) + pairs.transpose(0, 2, 3, 1)
    return np.asarray(np.multiply.outer(pairs, lame_lambda) + np.multiply.outer(shear, lame_mu))


def tensor_stiffness(basis: Basis, tensor: NDArray[np.float64]) -> sparse.csr_array:
    """Stiffness of ``C eps(u) : eps(v)`` for a basis of an ElementVector.
    C_ijkl has the shape (dim,) * 4, then (ncells,) if it varies."""
    few = tensor_classes(basis, tensor)
    if few is not None:
        return _as_array(few[0].matrix(few[1]))
    if (straight := AffineCells.of(basis)) is not None:
        return _as_array(straight.matrix(tensor))
    return summed(basis, tensor_matrices(basis, tensor))


def _as_array(matrix: sparse.csr_matrix) -> sparse.csr_array:
    """The matrix as an array; keeps the flag of sorted columns, whose check reads all entries."""
    result = sparse.csr_array(matrix)
    result.has_canonical_format = matrix.has_canonical_format
    return result


def summed(basis: Basis, matrices: Local) -> sparse.csr_array:
    """The stiffness matrix of a basis from those of its cells."""
    total = sparse.csr_array((basis.N, basis.N))
    for cells, local in matrices:
        total = total + _scattered(basis, cells, local)
    total.sort_indices()
    return total


def _scattered(basis: Basis, cells: slice, local: NDArray[np.float64]) -> sparse.csr_array:
    chunk = basis.element_dofs.T[cells]
    rows = np.repeat(chunk, basis.Nbfun, axis=1).ravel()
    columns = np.tile(chunk, (1, basis.Nbfun)).ravel()
    return sparse.csr_array(
        sparse.coo_array((local.ravel(), (rows, columns)), shape=(basis.N, basis.N))
    )


def stress(
    gradient: NDArray[Any],
    lame_lambda: NDArray[np.float64],
    lame_mu: NDArray[np.float64],
    dilatation: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Cauchy stress, shape (dim, dim, ...), of ``gradient[i, j] = d u_i / d x_j``.
    `dilatation` replaces div u in the volumetric part; lambda and mu broadcast to the trailing
    axes."""
    strain = 0.5 * (gradient + np.swapaxes(gradient, 0, 1))
    result = 2 * lame_mu * strain
    trace = lame_lambda * (np.trace(strain) if dilatation is None else dilatation)
    for i in range(gradient.shape[0]):
        result[i, i] += trace
    return result


Classes = tuple[CongruentCells, NDArray[np.float64]]  # cells, and the local matrix of each class
Local = Iterator[tuple[slice, NDArray[np.float64]]]  # cells with their local matrices


def isotropic_classes(
    basis: Basis,
    lame_lambda: NDArray[np.float64],
    lame_mu: NDArray[np.float64],
    mean_dilatation: bool = False,
) -> Classes | None:
    """Classes of congruent cells with the stiffness of each; None if there are many.
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
    # Make it exactly symmetric: some solvers fail to converge on rounding asymmetry.
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
    The basis is scalar, or a vector basis with functions for each component."""
    dim = basis.mesh.dim()
    if isinstance(basis.elem, ElementVector):
        scalar = [basis.basis[i][0].grad[0] for i in range(0, basis.Nbfun, dim)]
    else:
        scalar = [field.grad for (field,) in basis.basis]
    n_cells, n_points = basis.dx.shape
    together = 16384  # cells whose element matrices are in memory at a time
    for start in range(0, n_cells, together):
        cells = slice(start, min(start + together, n_cells))
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
