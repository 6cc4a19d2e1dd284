"""Reference coordinates in parallelogram cells, inside or beyond them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def reference_points(mesh: Any, cells: NDArray[np.integer], x: Array) -> Array:
    """Return X with F(X) = x for points x, shape (2, len(cells), points), any distance away.
    scikit-fem's `invF` iterates, and converges only near the cell."""
    origin, first, last = (mesh.p[:, mesh.t[i, cells]][:, :, None] for i in (0, 1, 3))
    a, b, d = first - origin, last - origin, x - origin
    determinant = a[0] * b[1] - a[1] * b[0]
    return np.array([d[0] * b[1] - d[1] * b[0], a[0] * d[1] - a[1] * d[0]]) / determinant
