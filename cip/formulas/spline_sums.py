"""Values of tensor-product splines at many points: B-splines of each axis, then compiled sums."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skfem_adini.ground.jit import Array, Index, Out, loop

Reals = NDArray[np.float64]


def basis(knots: Reals, degree: int, x: Reals, order: int) -> tuple[Any, Reals]:
    """Number of the first B-spline that is not zero at each point, and the derivatives of this
    order of all `degree` + 1 (de Boor, A Practical Guide to Splines, 1978, chapter X); polynomials
    of the end pieces beyond the ends."""
    from scipy.interpolate import BSpline

    d = degree - order
    inner = knots[order : knots.size - order]
    row = BSpline.design_matrix(x, inner, d, extrapolate=True)
    first, weights = (
        row.indices.reshape(-1, d + 1)[:, 0].astype(np.int64),
        row.data.reshape(-1, d + 1),
    )
    first = first.astype(np.int64)
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
