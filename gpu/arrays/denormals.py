"""Keeps denormal numbers out of large dense products and factorisations on the host."""

from __future__ import annotations

from typing import Any

import numpy as np

LEAST_FILLED = 256  # below this order slow numbers do not matter
# Of the norm: far above the denormal numbers, also squared, and far below the rounding of anything.
NOISE = 1e-40


def filled(M: Any) -> Any:
    """M with noise of 1e-40 of its norm, where it is large and on the host.

    Inverses of banded matrices decay exponentially off the diagonal, through the denormal
    numbers, with which processors are slower by two orders of magnitude: doubling of 2048 states
    took five minutes instead of half of one. Symmetric matrices stay so.
    """
    if not isinstance(M, np.ndarray) or len(M) < LEAST_FILLED:
        return M
    size = float(np.linalg.norm(M))
    if not np.isfinite(size):
        return M
    noise: Any = np.random.default_rng(0).standard_normal(M.shape)
    noise += noise.T
    noise *= NOISE * size
    noise += M
    return noise
