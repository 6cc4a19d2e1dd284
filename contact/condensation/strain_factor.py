r"""Schur complement of the contact boundary by QR of the strains, without the stiffness matrix.

With the matrix A of all weighted strains, ``S = A^T A``, and the inner unknowns first,

.. math:: A = Q \begin{pmatrix} R_{II} & R_{Ib} \\ & R_{bb} \end{pmatrix}, \qquad
          S_b = R_{bb}^T R_{bb} .

Its error grows with the condition number of A, the root of that of S, for which Cholesky breaks
down on slender cells (A. Bjoerck, Numerical Methods for Least Squares Problems, SIAM 1996, section
2.4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import qr, solve_triangular

from contact.body.basis_solid import BasisSolid
from contact.body.cell_strains import strain_rows
from contact.errors import InputError

Array = NDArray[np.float64]
STRAIN_UNKNOWNS = 3000  # largest size, which takes about ten seconds


class StrainFactor:
    """A `contact.condensation.schur.SchurFactor` of a body of moderate size with slender cells.
    Free unknowns z of ``u = P z``; `boundary`, ascending, are kept. Raises InputError if a motion
    of the inner unknowns alone causes no strain."""

    def __init__(self, body: BasisSolid, P: sparse.csr_array, boundary: NDArray[np.int64]) -> None:
        cells: Array = np.asarray(np.linalg.qr(strain_rows(body), mode="r"))
        count, rows, local = cells.shape
        place = np.repeat(body.basis.element_dofs.T, rows, axis=0)
        start = local * np.arange(count * rows + 1)
        A = sparse.csr_array(
            (cells.ravel(), place.ravel(), start), shape=(count * rows, P.shape[0])
        )
        inner = np.ones(P.shape[1], dtype=bool)
        inner[boundary] = False
        self._inner, self._boundary = np.flatnonzero(inner), boundary
        order = np.concatenate((self._inner, boundary))
        R = np.zeros((order.size, order.size))
        found = qr((A @ P[:, order]).toarray(), mode="r", overwrite_a=True, check_finite=False)[0]
        R[: len(found)] = found[: order.size]
        k = self._inner.size
        self._R_II, self._R_Ib, self._R_bb = R[:k, :k], R[:k, k:], R[k:, k:]
        self.schur: Array = self._R_bb.T @ self._R_bb
        if not np.all(np.diag(self._R_II) != 0):
            raise InputError("stiffness: parts of the mesh hang together by a hinge alone")

    def equilibrate(self, node: NDArray[np.int64]) -> tuple[sparse.csr_array, sparse.csr_array]:
        """Change to unknowns y of unit stiffness, ``z = U y`` on the boundary; returns U and U^-1.
        At each `node` (nb,) stiff and soft directions become separate unknowns: bending is softer
        than stretching by the fourth power of slenderness and would be lost in rounding."""
        nb = self._boundary.size
        U, inverse = sparse.lil_array((nb, nb)), sparse.lil_array((nb, nb))
        R_bb = np.empty_like(self._R_bb)
        for number in np.unique(node):
            own = np.flatnonzero(node == number)
            _, size, turn = np.linalg.svd(self._R_bb[:, own], full_matrices=False)
            # Separate directions only if their singular values are far apart.
            if size[-1] * 16.0 > size[0]:
                size, turn = np.linalg.norm(self._R_bb[:, own], axis=0), np.eye(own.size)
            # Powers of two cause no rounding.
            exponent = np.round(np.log2(np.where(size > 0, size, 1.0))).astype(np.int64)
            R_bb[:, own] = np.ldexp(self._R_bb[:, own] @ turn.T, -exponent)
            U[own[:, None], own] = np.ldexp(turn.T, -exponent)
            inverse[own[:, None], own] = np.ldexp(turn.T, exponent).T
        self._R_bb, self.schur, change = R_bb, R_bb.T @ R_bb, sparse.csr_array(U)
        self._R_Ib = np.asarray(self._R_Ib @ change)
        return change, sparse.csr_array(inverse)

    def reduce(self, load: Array) -> Array:
        """Reduce a load to the boundary: f_b - S_bI S_II^-1 f_I."""
        half = solve_triangular(self._R_II, load[self._inner], trans="T")
        carried: Array = load[self._boundary] - self._R_Ib.T @ half
        return carried

    def expand(self, load: Array, z_b: Array) -> Array:
        """Return all unknowns from the boundary's."""
        half = solve_triangular(self._R_II, load[self._inner], trans="T") - self._R_Ib @ z_b
        z = np.empty_like(load)
        z[self._inner], z[self._boundary] = solve_triangular(self._R_II, half), z_b
        return z


def strains_can_be_factored(body: BasisSolid, unknowns: int) -> bool:
    """Whether the body has slender cells, moderate size, and an energy that is a sum of squares."""
    squares = body.dilatation == "pointwise" or bool(np.all(body.lam >= 0))
    return body.slender and squares and unknowns <= STRAIN_UNKNOWNS


def factor_of_strains(
    body: BasisSolid, P: sparse.csr_array, boundary: NDArray[np.int64]
) -> tuple[StrainFactor, sparse.csr_array, sparse.csr_array]:
    """Factor in unknowns y that have unit stiffness on the boundary (nb,), of ``u = P z``.
    Returns the factor, ``change`` of ``z = change y`` and its inverse, (nfree, nfree)."""
    factor, n, nb = StrainFactor(body, P, boundary), P.shape[1], boundary.size
    node = np.arange(nb)
    if P.nnz == n:  # each unknown is one dof, and dofs are numbered vector by vector
        node = np.asarray(P.tocsc().indices[boundary] // body.dim, dtype=np.int64)
    U, inverse = factor.equilibrate(node)
    place = sparse.csr_array((np.ones(nb), (boundary, np.arange(nb))), shape=(n, nb))
    rest = sparse.diags_array(1.0 - np.asarray(place.sum(axis=1)))
    change, back = (sparse.csr_array(rest + place @ part @ place.T) for part in (U, inverse))
    return factor, change, back
