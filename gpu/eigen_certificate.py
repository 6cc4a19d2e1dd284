"""The proof that what `eigs` returns are eigenpairs: residuals recomputed from the matrices."""

from __future__ import annotations

from typing import Any

import numpy as np

from gpu.arrays import to_host
from gpu.eigen_operator import Matrix, norm_of, unit_of
from gpu.errors import NotConverged

CERTIFIED = 1e-11  # |A x - lambda M x| over |A| + |lambda| |M|


def certify(
    matrix: Matrix,
    mass: Matrix | None,
    values: Any,
    vectors: Any,
    tol: float,
    scale: float,
    norms: Any = None,
) -> None:
    """Raise unless every returned pair satisfies its equation.

    Parameters
    ----------
    matrix, mass, tol
        As `eigs` has them.
    values : array, shape (k,)
    vectors : array, shape (n, k)
    scale : float
        A lower bound of |A|, zero where none is known.
    norms : array, shape (2, k), optional
        Of ``A x - lambda M x`` and of ``A x``, where they have been computed with the vectors.
    """
    unit = unit_of(matrix)
    scale = (scale or norm_of(matrix)) * unit
    if norms is None:
        xp = matrix.xp
        left = _product(matrix, vectors * unit)
        right = vectors if mass is None else _product(mass, vectors)
        error = xp.linalg.norm(left - right * (xp.asarray(values) * unit), axis=0)
        norms = xp.stack([error, xp.linalg.norm(left, axis=0)])
    # To the host at once: every look at a number on the device waits for it.
    error, size = to_host(norms)
    modulus = np.abs(to_host(values)) * unit
    allowed = (
        CERTIFIED
        * (max(float(size.max()), scale) + modulus * (1.0 if mass is None else norm_of(mass)))
        + 10 * tol * modulus
    )
    good = error <= allowed
    if not good.all():
        worst = CERTIFIED * float((error[~good] / allowed[~good]).max())
        kept = np.flatnonzero(good)
        raise NotConverged(
            f"{int((~good).sum())} of {len(values)} pairs fail their certificate: |A x - lambda x| "
            f"reaches {worst:.1e} |A|",
            eigenvalues=matrix.xp.asarray(values)[kept],
            eigenvectors=vectors[:, kept],
        )


def _product(matrix: Matrix, X: Any) -> Any:
    if matrix.explicit is not None:
        if matrix.real and X.dtype.kind == "c":
            # Parts side by side: a mixed product would copy the matrix into complex numbers.
            parts = matrix.explicit @ matrix.xp.concatenate((X.real, X.imag), axis=1)
            return parts[:, : X.shape[1]] + 1j * parts[:, X.shape[1] :]
        return matrix.explicit @ X
    columns = []
    for x in X.T:
        if matrix.real and X.dtype.kind == "c":  # an operator of real vectors
            columns.append(matrix.apply(x.real.copy()) + 1j * matrix.apply(x.imag.copy()))
        else:
            columns.append(matrix.apply(x.copy()))
    return matrix.xp.stack(columns, axis=1)
