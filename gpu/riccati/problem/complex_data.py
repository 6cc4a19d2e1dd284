"""Equations with complex data, as real ones of twice the order."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from gpu.riccati.problem.lqr_problem import numbers
from skfem_adini.ground.arrays import namespace


def complex_among(**matrices: Any) -> bool:
    """Whether an argument holds complex numbers."""
    given = (numbers(name, M, True) for name, M in matrices.items() if M is not None)
    return any(M.dtype is not None and np.dtype(M.dtype).kind == "c" for M in given)


def through_reals(solve: Callable[..., Any], **matrices: Any) -> Any:
    r"""The hermitian solution X of an equation in a, b, q, r, e and s, by one in real numbers.

    :math:`M \mapsto \begin{pmatrix} \Re M & -\Im M \\ \Im M & \Re M \end{pmatrix}` maps sums,
    products and adjoints to such, so the real equation has the image of X for its stabilising
    solution. The projection on images, which removes rounding, comes no farther from it.
    """
    X = solve(*(_image(name, M) for name, M in matrices.items()))
    n = len(X) // 2
    real = X[:n, :n] + X[n:, n:]
    return (real + 1j * (X[n:, :n] - X[:n, n:])) / 2


def _image(name: str, M: Any) -> Any:
    if M is None:
        return None
    M = numbers(name, M, complex_too=True)
    M = M.toarray() if hasattr(M, "toarray") else M
    xp = namespace(M)
    if M.ndim == 1:
        M = M[:, None] if name in ("b", "s") else xp.diag(M)
    rows = xp.concatenate([M.real, -M.imag], axis=1), xp.concatenate([M.imag, M.real], axis=1)
    return xp.concatenate(rows)
