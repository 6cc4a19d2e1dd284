"""Prevention of denormal numbers in large dense products and factorisations on the host."""

from __future__ import annotations

from typing import Any

import numpy as np


def filled(M: Any) -> Any:
    """M plus random noise of 1e-40 of its norm if M is large and on the host, else M itself.

    Inverses of banded matrices decay exponentially off the diagonal, down to denormal numbers, with
    which processors are slower by two orders of magnitude: doubling with 2048 states took five
    minutes instead of half a minute. The noise is symmetric, so symmetric matrices remain so.
    """
    if not isinstance(M, np.ndarray) or len(M) < 256:  # slow arithmetic does not matter there
        return M
    size = float(np.linalg.norm(M))
    if not np.isfinite(size):
        return M
    noise: Any = np.random.default_rng(0).standard_normal(M.shape)
    noise += noise.T
    noise *= 1e-40 * size  # far above denormal numbers, even squared, and far below all rounding
    noise += M
    return noise
