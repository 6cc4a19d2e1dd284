"""Krylov methods on grid arrays of NumPy or CuPy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.spectral.transforms import namespace

Operator = Callable[[Any], Any]


def gmres(
    product: Operator, right: Any, precondition: Operator, tol: float, most: int, restart: int = 40
) -> tuple[Any, int]:
    r"""Solve A x = b by restarted GMRES with a right preconditioner M: A M^-1 y = b, x = M^-1 y.

    Parameters
    ----------
    product, precondition : callable
        A x and M^-1 y of vectors.
    right : array, shape (n,)
    tol : float
        Ends where :math:`|b - A x| \le` tol |b|.
    most : int
        Products in all; the best x until then is returned.
    restart : int

    Returns
    -------
    x : array, shape (n,)
    products : int

    References
    ----------
    Y. Saad and M. H. Schultz, GMRES, SIAM J. Sci. Stat. Comput. 7 (1986) 856.
    """
    xp = namespace(right)
    x, residual, used = xp.zeros_like(right), right, 0
    goal = tol * float(xp.linalg.norm(right))
    while used < most:
        size = float(xp.linalg.norm(residual))
        if size <= goal or size == 0.0:
            break
        basis = [residual / size]
        H = np.zeros((restart + 1, restart))
        least: NDArray[np.float64] = np.zeros(0)
        for j in range(min(restart, most - used)):
            w = product(precondition(basis[j]))
            used += 1
            for _ in range(2):  # twice is enough (Kahan)
                for i, v in enumerate(basis):
                    part = float(xp.vdot(v, w))
                    H[i, j] += part
                    w = w - part * v
            H[j + 1, j] = float(xp.linalg.norm(w))
            e = np.zeros(j + 2)
            e[0] = size
            least = np.asarray(np.linalg.lstsq(H[: j + 2, : j + 1], e, rcond=None)[0], dtype=float)
            left = float(np.linalg.norm(e - H[: j + 2, : j + 1] @ least))
            if left <= goal or H[j + 1, j] <= 1e-14 * size:
                break
            basis.append(w / H[j + 1, j])
        step = sum(float(c) * v for c, v in zip(least, basis, strict=False))
        x = x + precondition(step)
        residual = right - product(x)
        used += 1
    return x, used
