"""The check that results of `eigs` are eigenpairs: residuals recomputed from the matrices."""

from __future__ import annotations

from typing import Any

import numpy as np

from gpu.arrays.namespace import to_host
from gpu.eigenvalues.operator import Matrix
from gpu.errors import NotConverged

# Largest |A x - lambda M x| over |A| + |lambda| |M| of a certified pair: 4e4 machine epsilons,
# above the rounding of products of any order, and far below the residual of a wrong pair.
CERTIFIED_PAIR = 1e-11


def certify(
    matrix: Matrix,
    mass: Matrix | None,
    values: Any,
    vectors: Any,
    tol: float,
    scale: float,
    squares: Any = None,
) -> None:
    """Raise unless every returned pair satisfies its equation.

    Parameters
    ----------
    matrix, mass, tol
        As `eigs` has them.
    values : ndarray, shape (k,)
        On the host.
    vectors : array, shape (n, k)
    scale : float
        A lower bound of |A|, zero where none is known.
    squares : array, shape (2, k), optional
        Squares of the norms of ``A x - lambda M x`` and of ``A x``, if they are known already.

    Raises
    ------
    NotConverged
        With the pairs that satisfy their equation as attributes.
    """
    unit = matrix.unit
    scale = (scale or matrix.norm) * unit
    # All numbers are copied to the host at once, as each copy waits for the device.
    if squares is None:
        xp = matrix.xp
        left = _product(matrix, vectors * unit)
        right = vectors if mass is None else _product(mass, vectors)
        error = xp.linalg.norm(left - right * (xp.asarray(values) * unit), axis=0)
        error, size = to_host(xp.stack([error, xp.linalg.norm(left, axis=0)]))
    else:
        error, size = np.sqrt(to_host(squares))
    modulus = np.abs(values) * unit
    allowed = (
        CERTIFIED_PAIR
        * (max(float(size.max()), scale) + modulus * (1.0 if mass is None else mass.norm))
        + 10 * tol * modulus
    )
    good = np.isfinite(allowed) & (error <= allowed)
    if not good.all():
        with np.errstate(invalid="ignore"):  # some may be NaN
            worst = CERTIFIED_PAIR * float((error[~good] / allowed[~good]).max())
        kept = np.flatnonzero(good)
        raise NotConverged(
            f"{int((~good).sum())} of {len(values)} pairs fail their certificate: |A x - lambda x| "
            f"reaches {worst:.1e} |A|",
            eigenvalues=matrix.xp.asarray(values)[kept],
            eigenvectors=vectors[:, kept],
        )


def _product(matrix: Matrix, X: Any) -> Any:
    """``A X``; a real A is multiplied by the real and the nonzero imaginary parts of X instead."""
    xp = matrix.xp
    if not matrix.real or X.dtype.kind != "c":
        return _multiplied(matrix, X)
    imaginary = to_host(xp.any(X.imag != 0, axis=0))
    parts = _multiplied(matrix, xp.concatenate((X.real, X.imag[:, imaginary]), axis=1))
    product = parts[:, : X.shape[1]].astype(complex)
    product[:, imaginary] += 1j * parts[:, X.shape[1] :]
    return product


def _multiplied(matrix: Matrix, X: Any) -> Any:
    if matrix.explicit is not None:
        return matrix.explicit @ X
    product = matrix.xp.empty_like(X, dtype=matrix.dtype)
    for j, x in enumerate(X.T):  # of copies: an operator may return its argument or reuse an array
        product[:, j] = matrix.apply(x.copy())
    return product
