"""Frames of contact points: normals, tangents, and how supports and facets turn them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.supports import few_times, norms
from contact.rows.outline import NEARLY

Array = NDArray[np.float64]


def tangent_frame(normals: Array) -> Array:
    """Orthonormal tangents of the unit normals of one contact boundary.

    In two dimensions the tangent is the normal turned by +90 degrees: (1, 0) on a bottom edge. In
    three the frame is a smooth function of the normal on the whole sphere except one pole,
    (0, 0, 1) for a boundary whose mean normal has n_z <= 0, else (0, 0, -1): no frame is smooth on
    all of a sphere. Where n_y = 0 the first tangent lies in the plane of x and z: it is (1, 0, 0)
    on horizontal faces. Friction is isotropic: another frame changes the components of the shear,
    not the vector.

    Parameters
    ----------
    normals : ndarray, shape (dim, m)

    Returns
    -------
    ndarray, shape (dim, dim - 1, m)

    References
    ----------
    T. Duff et al., Building an orthonormal basis, revisited, J. Comput. Graph. Tech. 6 (2017).

    Examples
    --------
    >>> tangent_frame(np.array([[0.0], [-1.0]])).ravel().tolist()
    [1.0, 0.0]
    """
    if normals.shape[0] == 2:
        return np.array([[-normals[1]], [normals[0]]])
    x, y, z = normals
    # A mean n_z of up to 1e-9 is zero but for rounding.
    sign = np.full(z.size, 1.0 if z.sum() > 1e-9 * z.size else -1.0)
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
    r"""Tangents rotated with their normal: :math:`t - (n \cdot t) (m + n) / (1 + m \cdot n)`.

    Parameters
    ----------
    tangents : ndarray, shape (dim, dim - 1, ...)
        Orthonormal to `mean`.
    mean, normals : ndarray, shape (dim, ...)
        Unit normals m of the tangents, and n, to which the shortest rotation takes m.
    """
    along = np.sum(normals[:, None] * tangents, axis=0)
    size = 1.0 + np.sum(mean * normals, axis=0)
    return np.asarray(tangents - (mean + normals)[:, None] * (along / size)[None])


def within_supports(B: sparse.csr_array, normals: Array, P: sparse.csr_array) -> Array:
    """Turn normals that lie in a plane of symmetry up to a small angle exactly into it.

    Where a curved boundary ends at a support along an axis, the mean normal contains the facets of
    one side only, and is off by half the angle between a facet and its mirror image. The tangent
    would then have a small component that no support prescribes, and friction would act on it.

    Parameters
    ----------
    B : csr_array, shape (m, scalar dofs)
        Rows of the scalar trace.
    normals : ndarray, shape (dim, m)
    P : csr_array, shape (ndofs, nfree)
        Free unknowns of the body.
    """
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
    """Turn the frames so that a prescribed tangential direction is one of their axes.

    Where supports (a plane of symmetry, say) fix a contact point in one tangential direction
    only, the two tangential rows in any other frame would be linearly dependent.

    Parameters
    ----------
    B, P
        As for `within_supports`.
    tangents : ndarray, shape (3, 2, m)
    """
    rows = [few_times(directed(B, tangents[:, j]), P) for j in (0, 1)]
    a, b, c = (
        np.asarray(rows[i].multiply(rows[j]).sum(axis=1)).ravel()
        for i, j in ((0, 0), (0, 1), (1, 1))
    )
    # Least eigenvalue of the Gram matrix of both rows: zero, up to rounding, if they are dependent.
    least = 0.5 * (a + c) - np.hypot(0.5 * (a - c), b)
    angle = np.where(least < 1e-12 * (a + c), 0.5 * np.arctan2(2 * b, a - c), 0.0)
    cos, sin = np.cos(angle), np.sin(angle)
    first, second = tangents[:, 0], tangents[:, 1]
    return np.stack([cos * first + sin * second, cos * second - sin * first], axis=1)


def directed(B: sparse.csr_array, direction: Array) -> sparse.csr_array:
    """Rows of ``direction . u`` from rows of the scalar trace; direction has the shape (dim, m)."""
    dim, coo = direction.shape[0], B.tocoo()
    data = np.concatenate([coo.data * direction[c][coo.row] for c in range(dim)])
    columns = np.concatenate([dim * coo.col + c for c in range(dim)])
    rows = np.tile(coo.row, dim)
    result = sparse.coo_array((data, (rows, columns)), shape=(B.shape[0], dim * B.shape[1])).tocsr()
    result.eliminate_zeros()
    return result
