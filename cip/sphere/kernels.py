"""Loops over points of a sphere: line integrals of splines along edges."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cip.formulas.spline_loops import weights
from skfem_adini.ground.jit import loop


@loop
def edge_points(nodes: Any, values: Any, slopes: Any, rule: Any, points: Any, north: Any) -> None:
    """Points of the quadrature on traced edges, as (lon, s, weight dlon, 1 + z or z - 1). `nodes`
    (3, nlon, nlat + 1, 1 + 2 inner) are corners and inner nodes of the edges east and north of
    them, `values` and `slopes` (points, inner + 2) of Lagrange's polynomials."""
    nlon, nlat, inner = nodes.shape[1], nodes.shape[2] - 1, (nodes.shape[3] - 1) // 2
    curve = np.empty((3, inner + 2))
    for i in range(nlon):
        for j in range(nlat + 1):
            for along in range(2):
                if (along == 0 and j == 0) or j == nlat:
                    continue
                e, g = ((i + 1) % nlon, j) if along == 0 else (i, j + 1)
                for c in range(3):
                    curve[c, 0] = nodes[c, i, j, 0]
                    curve[c, inner + 1] = nodes[c, e, g, 0]
                    for q in range(inner):
                        curve[c, q + 1] = nodes[c, i, j, 1 + along * inner + q]
                upper = curve[2].sum() > 0.0
                north[along, i, j] = upper
                for m in range(rule.size):
                    x, y, z, dx, dy = 0.0, 0.0, 0.0, 0.0, 0.0
                    for q in range(inner + 2):
                        x += values[m, q] * curve[0, q]
                        y += values[m, q] * curve[1, q]
                        z += values[m, q] * curve[2, q]
                        dx += slopes[m, q] * curve[0, q]
                        dy += slopes[m, q] * curve[1, q]
                    square = x * x + y * y
                    size = math.sqrt(square + z * z)
                    points[along, i, j, m, 0] = math.atan2(y, x)
                    points[along, i, j, m, 1] = math.atan2(math.sqrt(square), -z)
                    turn = (x * dy - y * dx) / square if square > 0.0 else 0.0
                    points[along, i, j, m, 2] = rule[m] * turn
                    near = -z if upper else z  # where it is negative the pole of the chart is near
                    rest = square / (size * (size - near)) if near < 0.0 else 1.0 + near / size
                    points[along, i, j, m, 3] = -rest if upper else rest


@loop
def edge_integrals(
    points: Any, north: Any, coefs: Any, top: Any, mean: Any, degree: Any, pad: Any, out: Any
) -> None:
    """Integrals of P dlon along edges, P the mass from the south pole up, or from the north pole
    down. coefs (fields, nlon + 2 pad, nlat + 1 + 2 pad) have degree and degree + 1."""
    nlon, nlat = coefs.shape[1] - 2 * pad, coefs.shape[2] - 1 - 2 * pad
    fields = coefs.shape[0]
    a, b = np.empty(degree + 1), np.empty(degree + 2)
    start = pad - degree // 2
    for along in range(2):
        for i in range(nlon):
            for j in range(nlat):
                for f in range(fields):
                    out[along, f, i, j] = 0.0
                if along == 0 and j == 0:
                    continue
                for m in range(points.shape[3]):
                    x = points[along, i, j, m, 0] * (0.5 * nlon / math.pi)
                    y = points[along, i, j, m, 1] * (nlat / math.pi)
                    k, l = math.floor(x), min(math.floor(y), nlat - 1)
                    weights(x - k, degree, a)
                    weights(y - l, degree + 1, b)
                    k = k % nlon + start
                    l += start
                    for f in range(fields):
                        total = mean[f] * points[along, i, j, m, 3]
                        for p in range(degree + 1):
                            row = -top[f, k + p] if north[along, i, j] else 0.0
                            for q in range(degree + 2):
                                row += b[q] * coefs[f, k + p, l + q]
                            total += a[p] * row
                        out[along, f, i, j] += points[along, i, j, m, 2] * total


@loop
def cell_masses(integrals: Any, north: Any, turns: Any, out: Any) -> None:
    """Masses of traced cells from the integrals along their edges, in one chart for each cell;
    `turns` (2, fields, nlon, nlat) are the differences between the charts along edges."""
    fields, nlon, nlat = out.shape
    for f in range(fields):
        for i in range(nlon):
            e = (i + 1) % nlon
            for j in range(nlat):
                total = integrals[1, f, i, j] - integrals[1, f, e, j] - integrals[0, f, i, j]
                if j + 1 < nlat:
                    total += integrals[0, f, i, j + 1]
                up = north[0, i, j] if j > 0 else north[1, i, j]
                top = north[0, i, j + 1] if j + 1 < nlat else north[1, i, j]
                if not (up and top and north[1, i, j] and north[1, e, j]):
                    if north[1, i, j]:
                        total += turns[1, f, i, j]
                    if north[1, e, j]:
                        total -= turns[1, f, e, j]
                    if j > 0 and north[0, i, j]:
                        total -= turns[0, f, i, j]
                    if j + 1 < nlat and north[0, i, j + 1]:
                        total += turns[0, f, i, j + 1]
                out[f, i, j] = total
