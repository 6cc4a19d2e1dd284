"""Values of splines at many points, by loops that numba compiles; imported where they run."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cip.grid import Array as Reals
from skfem_adini.ground.jit import Array, Index, Out, kernel, loop


def basis(knots: Reals, degree: int, x: Reals, order: int) -> tuple[Any, Reals]:
    """Number of the first B-spline that is not zero at each point, and the derivatives of this
    order of all `degree` + 1 (de Boor, A Practical Guide to Splines, 1978, chapter X); polynomials
    of the end pieces beyond the ends."""
    from scipy.interpolate import BSpline

    d = degree - order
    inner = knots[order : knots.size - order]
    row = BSpline.design_matrix(x, inner, d, extrapolate=True)
    first = row.indices.reshape(-1, d + 1)[:, 0].astype(np.int64)
    weights = row.data.reshape(-1, d + 1)
    interval = first[:, None] + degree
    for d in range(degree - order, degree):
        j = np.arange(d + 1)
        part = (d + 1) * weights / (knots[interval + 1 + j] - knots[interval - d + j])
        weights = np.pad(part, ((0, 0), (1, 0))) - np.pad(part, ((0, 0), (0, 1)))
    return first, np.ascontiguousarray(weights)


@loop
def run_sums(
    start: Index, stop: Index, data: Array, first: Array, a: Array, b: Array, c: Array, d: Array,
    out: Out,
) -> None:  # fmt: skip
    """Sums over four axes at points start..stop; ``first[axis, o]`` is the first coefficient."""
    for o in range(start, stop):
        p, q, r, s = first[0, o], first[1, o], first[2, o], first[3, o]
        total = 0.0
        for i in range(a.shape[1]):
            for j in range(b.shape[1]):
                for k in range(c.shape[1]):
                    w = a[o, i] * b[o, j] * c[o, k]
                    for l in range(d.shape[1]):
                        total += w * d[o, l] * data[p + i, q + j, r + k, s + l]
        out[o] = total


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
