"""Implicit restart of an Arnoldi factorisation by explicitly shifted QR steps."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def shifted_qr(H: Array, beta: float, values: Array, keep: int) -> tuple[Array, Array, Array]:
    r"""Reduce ``A V = V H + \beta v e_m^T`` to `keep` columns with the unwanted values as shifts.

    Each shift :math:`\mu` costs a QR factorisation :math:`H - \mu I = Q R` and
    :math:`H \leftarrow Q^* H Q`; a conjugate pair of a real H is taken as one quadratic step,
    :math:`H^2 - 2 \mathrm{Re}(\mu) H + |\mu|^2 I = Q R`, so that H stays real.

    Parameters
    ----------
    H : ndarray, shape (m, m)
        Upper Hessenberg.
    beta : float
    values : ndarray, shape (m,)
        Eigenvalues of H; those from `keep` on are the shifts. They must not split a pair.
    keep : int

    Returns
    -------
    Q : ndarray, shape (m, keep)
    projected : ndarray, shape (keep, keep)
        Upper Hessenberg.
    spike : ndarray, shape (keep,)
        Coefficients of the old residual vector; see Notes.

    Notes
    -----
    The new residual is ``V Q[:, keep] H[keep, keep-1] + \beta Q[m-1, keep-1] v``, a combination
    of two vectors. With exact shifts the first coefficient is zero up to rounding, and only the
    second term is kept. The neglected first term is the error of this restart and the reason why
    Krylov-Schur is the default.

    References
    ----------
    D. C. Sorensen, Implicit application of polynomial filters in a k-step Arnoldi method, SIAM J.
    Matrix Anal. Appl. 13 (1992).
    """
    m = len(H)
    H, Q, unit = H.copy(), np.eye(m, dtype=H.dtype), np.eye(m)
    j = keep
    while j < m:
        shift = values[j]
        if np.isrealobj(H) and shift.imag != 0:
            polynomial = H @ H - 2 * shift.real * H + abs(shift) ** 2 * unit
            j += 2
        else:
            polynomial = H - (shift.real if np.isrealobj(H) else shift) * unit
            j += 1
        factor = np.linalg.qr(polynomial)[0]
        H = np.triu(factor.conj().T @ H @ factor, -1)
        Q = Q @ factor
    return Q[:, :keep], H[:keep, :keep], beta * Q[m - 1, :keep]
