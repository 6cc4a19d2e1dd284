"""A quadratic program of contact in variables and rows of unit size, for other packages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cholesky, eigh, solve_triangular

Array = NDArray[np.float64]

_LOOSE = 1e-10  # a motion with less stiffness, in units of the diagonal, is rigid up to rounding


@dataclass(frozen=True)
class UnitProgram:
    r"""The program ``min z^T S z / 2 - f^T z`` with rows G z, R z and E z, in w of ``z = M w``.

    Other packages use absolute tolerances, and one step length for all unknowns. For a dense S with
    ``S = L L^T`` the change of variables is ``M = L^{-T}``: the quadratic form becomes the
    identity, and the program is as well conditioned as possible. Free rigid motions become
    variables without stiffness. For a sparse S, M is diagonal and gives S a diagonal of ones. Every
    row is divided by its length, all rows of one contact point by the same.

    Attributes
    ----------
    P : array or sparse array, shape (n, n)
    f : ndarray, shape (n,)
    G, R, E : like P, shapes (m, n), (k * dim_t, n) and (l, n)
    normal, tangential, tied : ndarray, shapes (m,), (k,) and (l,)
        Lengths of the rows: value of a row in the caller's units = its value here * length.
    back : array or sparse array, shape (n, n)
        M.
    """

    P: Any
    f: Array
    G: Any
    R: Any
    E: Any
    normal: Array
    tangential: Array
    tied: Array
    back: Any

    @classmethod
    def of(cls, S: Any, f: Array, G: Any, R: Any, dim_t: int, E: Any) -> Self:
        """Change variables; S a dense or a sparse array, like G and R.

        Parameters
        ----------
        S, f, G, R, E
            As above, in any units; S positive semidefinite with a positive diagonal.
        dim_t : int
            Rows of R that belong to one contact point.
        """
        unit = 1.0 / np.sqrt(S.diagonal())
        back: Any
        P: Any
        if sparse.issparse(S):
            back = sparse.diags_array(unit)
            P = sparse.csr_array(back @ S @ back)
        else:
            back, P = _unit_form(unit[:, None] * S * unit)
            back = unit[:, None] * back
        G, R, E = G @ back, R @ back, E @ back
        normal = np.sqrt(_squares(G))
        tangential = np.sqrt(_squares(R).reshape(-1, dim_t).sum(axis=1))
        normal, tangential, tied = (
            np.where(size > 0, size, 1.0) for size in (normal, tangential, np.sqrt(_squares(E)))
        )
        return cls(
            P,
            back.T @ f,
            _divided(G, normal),
            _divided(R, np.repeat(tangential, dim_t)),
            _divided(E, tied),
            normal,
            tangential,
            tied,
            back,
        )


def _unit_form(A: Array) -> tuple[Array, Array]:
    """M and ``M^T A M``, which is the identity with zeros in the rows of rigid motions."""
    try:
        L = cholesky(A, lower=True)
        if np.all(np.diag(L) ** 2 > _LOOSE):
            return solve_triangular(L, np.eye(A.shape[0]), lower=True).T, np.eye(A.shape[0])
    except np.linalg.LinAlgError:
        pass
    stiffness, V = eigh(A)
    elastic = stiffness > _LOOSE
    return V / np.sqrt(np.where(elastic, stiffness, 1.0)), np.diag(elastic.astype(float))


def _squares(rows: Any) -> Array:
    return np.asarray((rows * rows).sum(axis=1)).ravel()


def _divided(rows: Any, size: Array) -> Any:
    if sparse.issparse(rows):
        by: Any = sparse.diags_array(1.0 / size)
        return sparse.csr_array(by @ rows)
    return rows / size[:, None]
