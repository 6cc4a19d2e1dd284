"""Frames of contact points: normals and tangents, aligned with supports."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.supports import few_times, norms
from contact.rows.outline import NEARLY

Array = NDArray[np.float64]


def tangent_frame(normals: Array) -> Array:
    """Orthonormal tangents, (dim, dim - 1, m), of unit normals (dim, m): (1, 0) on a bottom edge.
    In space they are smooth in n except at one pole, (0, 0, 1) if the mean n_z <= 0; the first is
    (1, 0, 0) on horizontal faces. T. Duff et al., J. Comput. Graph. Tech. 6 (2017)."""
    if normals.shape[0] == 2:
        return np.array([[-normals[1]], [normals[0]]])
    x, y, z = normals
    # A mean n_z of up to 1e-4 counts as zero, as on a vertical face whose vertices move a little.
    sign = np.full(z.size, 1.0 if z.sum() > 1e-4 * z.size else -1.0)
    square = x * x + y * y
    sign[(square < 1e-290) & (sign * z < 0)] *= -1.0  # the pole itself
    # a = -1 / (sign + z), without cancellation near that pole.
    near = sign * z < 0
    a = -sign * np.where(near, (1.0 + np.abs(z)) / np.where(near, square, 1.0), 1 / (1 + np.abs(z)))
    b = x * y * a
    first = np.array([1.0 + sign * x * x * a, sign * b, -sign * x])
    second = np.array([b, sign + y * y * a, -y])
    return np.stack([first, second], axis=1)


def turned_tangents(tangents: Array, mean: Array, normals: Array) -> Array:
    r"""Tangents of unit normals m, rotated by the shortest rotation of m to n:
    :math:`t - (n \cdot t) (m + n) / (1 + m \cdot n)`."""
    along = np.sum(normals[:, None] * tangents, axis=0)
    size = 1.0 + np.sum(mean * normals, axis=0)
    return np.asarray(tangents - (mean + normals)[:, None] * (along / size)[None])


def within_supports(B: sparse.csr_array, normals: Array, P: sparse.csr_array) -> Array:
    """Turn normals that are nearly in a plane of symmetry exactly into it.
    At the end of a curve the mean lacks the mirrored facet; its tangent would have a small
    unsupported component. B (m, scalar dofs): the trace, P (ndofs, nfree): free unknowns."""
    dim = normals.shape[0]
    turned = normals.copy()
    for c in range(dim):
        axis = np.zeros_like(normals)
        axis[c] = 1.0
        held = norms(few_times(directed(B, axis), P)) <= 1e-9 * norms(
            B
        )  # prescribed, up to rounding
        turned[c, held & (np.abs(normals[c]) < NEARLY)] = 0.0
    return turned / np.linalg.norm(turned, axis=0)


def along_supports(B: sparse.csr_array, tangents: Array, P: sparse.csr_array) -> Array:
    """Turn the frames (3, 2, m) so that a prescribed tangential direction is one of their axes.
    In any other frame the two rows would be linearly dependent. B, P as for `within_supports`."""
    rows = [few_times(directed(B, tangents[:, j]), P) for j in (0, 1)]
    a, b, c = (
        np.asarray(rows[i].multiply(rows[j]).sum(axis=1)).ravel()
        for i, j in ((0, 0), (0, 1), (1, 1))
    )
    # Least eigenvalue of the rows' Gram matrix: zero up to rounding if they are dependent.
    least = 0.5 * (a + c) - np.hypot(0.5 * (a - c), b)
    angle = np.where(least < 1e-12 * (a + c), 0.5 * np.arctan2(2 * b, a - c), 0.0)
    cos, sin = np.cos(angle), np.sin(angle)
    first, second = tangents[:, 0], tangents[:, 1]
    return np.stack([cos * first + sin * second, cos * second - sin * first], axis=1)


def directed(B: sparse.csr_array, direction: Array) -> sparse.csr_array:
    """Rows of ``direction . u`` from rows of the scalar trace; direction has the shape (dim, m)."""
    result = interleaved([scaled(v, B) for v in direction])
    result.eliminate_zeros()
    return result


def interleaved(parts: Sequence[sparse.csr_array]) -> sparse.csr_array:
    """Rows on all dofs from one matrix of scalar rows per component."""
    dim, (m, n) = len(parts), parts[0].shape
    coo = [part.tocoo() for part in parts]
    data, row = (np.concatenate([getattr(c, name) for c in coo]) for name in ("data", "row"))
    column = np.concatenate([dim * part.col + c for c, part in enumerate(coo)])
    return sparse.csr_array(sparse.coo_array((data, (row, column)), shape=(m, dim * n)))


def scaled(v: Array, rows: sparse.csr_array) -> sparse.csr_array:
    """Multiply each row by its entry of v."""
    result = rows.copy()
    result.data *= np.repeat(v, np.diff(rows.indptr))
    return result


def by_point(rows: Sequence[sparse.csr_array]) -> sparse.csr_array:
    """Reorder rows grouped by tangent into rows grouped by contact point."""
    count, m = len(rows), rows[0].shape[0]
    together = np.arange(m * count).reshape(count, m).T.ravel()
    return sparse.csr_array(sparse.csr_array(sparse.vstack(rows))[together])
