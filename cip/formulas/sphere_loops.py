"""Loops over points of a sphere: splines at any points."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skfem_adini.ground.jit import kernel, loop


@kernel
def weights(x: Any, degree: Any, out: Any) -> None:
    """Values at x in [0, 1) between knots of the B-splines that are not zero there."""
    out[0] = 1.0
    for d in range(1, degree + 1):
        saved = 0.0
        for r in range(d):
            part = out[r] / d
            out[r] = saved + (r + 1 - x) * part
            saved = (x + d - 1 - r) * part
        out[d] = saved


@loop
def interpolate(points: Any, coefs: Any, degree: Any, pad: Any, out: Any) -> None:
    """Splines of values in cells at points (3, n): coefs (fields, nlon + 2 pad, nlat + 2 pad)."""
    nlon, nlat = coefs.shape[1] - 2 * pad, coefs.shape[2] - 2 * pad
    a, b = np.empty(degree + 1), np.empty(degree + 1)
    shift = 0.5 * (degree % 2)  # knots are centres of cells for odd degrees, else edges
    start = pad - degree // 2
    for k in range(points.shape[1]):
        r = math.hypot(points[0, k], points[1, k])
        x = math.atan2(points[1, k], points[0, k]) * (0.5 * nlon / math.pi) - shift
        y = math.atan2(r, -points[2, k]) * (nlat / math.pi) - shift
        i, j = math.floor(x), math.floor(y)
        weights(x - i, degree, a)
        weights(y - j, degree, b)
        i = i % nlon + start
        j += start
        for f in range(coefs.shape[0]):
            total = 0.0
            for p in range(degree + 1):
                row = 0.0
                for q in range(degree + 1):
                    row += b[q] * coefs[f, i + p, j + q]
                total += a[p] * row
            out[f, k] = total
