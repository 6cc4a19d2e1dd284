r"""Internal forces from the strains of each cell, for meshes with slender cells.

In a cell with sides h and r h the entries of the stiffness matrix differ by a factor r^2, and
internal forces are small differences of large products: the rounding error of a product with the
assembled matrix is :math:`r^2` machine precisions. The strains of a cell are differences of
displacements at its own nodes. If they are computed first and the stresses from them, the rounding
error is only r machine precisions.

Bodies of up to 3000 unknowns are factored and refined in this way, and solved up to r = 1e6. A
column that only stands on a floor has a bending stiffness of r^-4 times its axial stiffness: it is
solved up to r = 1e4, and beyond if the solution meets its certificate. If not, the error names the
slender cells.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from skfem import Basis, Mesh

from contact.arrays.ranges import in_ranges
from contact.body.axisymmetry import AxisymmetricLaw, forces_of_stress, strain_roots, with_hoop
from contact.body.constitutive import IsotropicLaw, TensorLaw
from contact.body.jacobians import jacobians, measures
from contact.body.rigid_modes import Elastic, value_dofs

Array = NDArray[np.float64]


def has_slender_cells(mesh: Mesh, ratio: float = 300.0) -> bool:
    """Whether any cell's aspect ratio exceeds `ratio`; at 300 a product with S loses five
    digits."""
    middle = mesh.elem.refdom.p.mean(axis=1)[:, None]

    def slender(cells: slice) -> bool:
        det, norms = (found[:, 0] for found in measures(mesh, cells, middle)[:2])
        # No ratio of singular values exceeds the product of the Frobenius norms of J and J^-1.
        near = cells.start + np.flatnonzero(norms > 0.99 * ratio * np.abs(det))
        size = np.linalg.svd(jacobians(mesh, near, middle)[:, 0], compute_uv=False)
        return bool(np.any(size[:, 0] > ratio * size[:, -1]))

    return any(in_ranges(slender, mesh.nelements))


def strain_rows(body: Elastic) -> Array:
    r"""Rows A of every cell with ``A^T A`` its stiffness, shape (ncells, nrows, ndofs a cell).

    At each quadrature point they are :math:`L^T (\epsilon_{11}, \epsilon_{22}, \dots)`, with
    :math:`L L^T = \lambda 1 1^T + 2 \mu I`, and :math:`2 \sqrt\mu\, \epsilon_{ij}`, times the
    root of the weight; for an anisotropic body :math:`L L^T = C` with all strains. With mean
    dilatation the part with lambda is a separate row, one for each cell."""
    basis, dim = _of_positive_weights(body.basis), body.basis.mesh.dim()
    mean, law = body.dilatation == "mean", body.law
    if isinstance(law, AxisymmetricLaw):
        return strain_roots(basis, *law.elastic(basis.mesh.nelements, mean))
    assert isinstance(law, IsotropicLaw | TensorLaw)
    g, dx = gradients(basis), basis.dx
    _, cells, _, n = g.shape
    rows = law.strain_rows(g, not mean)
    A = (np.stack(rows, axis=1) * np.sqrt(dx)[:, None, :, None, None]).reshape(cells, -1, n * dim)
    if mean:
        total = np.einsum("cq,acqn->cna", dx, g).reshape(cells, 1, n * dim)
        lame_lambda = np.broadcast_to(body.lam, cells)
        A = np.hstack((A, np.sqrt(lame_lambda / dx.sum(axis=1))[:, None, None] * total))
    return A


def internal_forces(body: Elastic, u: Array) -> Array:
    """Forces of a displacement on all dofs, ``S u``, shape (ndofs,)."""
    basis = body.basis
    g, dofs, dim = gradients(basis), basis.element_dofs.T, basis.mesh.dim()
    local = u[dofs].reshape(len(dofs), -1, dim)
    values = value_dofs(body)[dofs].reshape(local.shape)
    # Translations cause no strain; displacements from the cell's first node are exact.
    moved = local - np.where(values, local[:, :1], 0.0)
    gradient = np.einsum("acqn,cnb->bacq", g, moved)
    if isinstance(body.law, AxisymmetricLaw):
        radial, r = np.asarray(basis.interpolate(u))[0], np.asarray(basis.global_coordinates())[0]
        gradient = with_hoop(gradient, radial, r)
    mean = None
    if body.dilatation == "mean":
        mean = np.average(np.trace(gradient), axis=1, weights=body.measure)[:, None]
    stress = body.law.stress(gradient, mean)
    if isinstance(body.law, AxisymmetricLaw):
        return forces_of_stress(basis, stress)
    forces = np.einsum("bacq,acqn->cnb", stress * basis.dx, g)
    result = np.zeros(u.size)
    np.add.at(result, dofs, forces.reshape(dofs.shape))
    return result


def _of_positive_weights(basis: Basis) -> Basis:
    """The basis, or one with positive weights: some rules on simplices have negative weights."""
    order = 2 * basis.elem.maxdeg
    while np.any(basis.W <= 0):
        basis = Basis(basis.mesh, basis.elem, mapping=basis.mapping, intorder=order)
        order += 1
    return basis


def gradients(basis: Basis) -> Array:
    """Gradient of each scalar basis function, shape (dim, ncells, npoints, nfunctions)."""
    dim = basis.mesh.dim()
    shape = (dim, *basis.dx.shape)
    return np.stack(
        [
            np.broadcast_to(np.asarray(basis.basis[i][0].grad[0]), shape)
            for i in range(0, basis.Nbfun, dim)
        ],
        axis=-1,
    )
