"""Contact rows: normal and tangential displacement of a boundary as sparse functionals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import FacetBasis

from contact.body import ElasticBody
from contact.errors import InputError
from contact.functionals import FacetFunctional, facet_functional
from contact.gap import GapRule
from contact.obstacles import Gap
from contact.weights import mean_shares, weights_and_places

Array = NDArray[np.float64]
NEARLY = 0.2  # sine of the angle up to which a normal counts as lying in a plane of symmetry


@dataclass(frozen=True)
class ContactRows:
    """The contact boundary, discretised: m points, each with a normal and dim - 1 tangents.

    Attributes
    ----------
    G : csr_array, shape (m, ndofs)
        ``G u`` is the normal displacement u_n along the outward normal of the body.
    T : csr_array, shape (m * (dim - 1), ndofs)
        Tangential displacement; the rows of one point are consecutive.
    gap : ndarray, shape (m,)
        The gap d under the same functional; ``inf`` where there is no obstacle.
    weights : ndarray, shape (m,)
        Length or area of each point: a multiplier (a force) over its weight is a pressure.
    x : ndarray, shape (dim, m)
        Mean place of the functional's dual function: where the pressure is reported.
    x_nominal : ndarray, shape (dim, m)
    normals : ndarray, shape (dim, m)
    tangents : ndarray, shape (dim, dim - 1, m)
    functional : str
    part : ndarray of int, shape (m,)
        Number of the contact boundary of each point; empty where there is one only.
    """

    G: sparse.csr_array
    T: sparse.csr_array
    gap: Array
    weights: Array
    x: Array
    x_nominal: Array
    normals: Array
    tangents: Array
    functional: str
    part: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


def contact_rows(
    body: ElasticBody, facets: NDArray[np.int64], obstacle: Gap, functional: str | None
) -> ContactRows:
    """Discretise a contact boundary.

    Parameters
    ----------
    body : ElasticBody
    facets : ndarray of int
    obstacle : obstacle, number, callable, array or None
        See `contact.obstacles`; None means friction without a contact law, a gap of ``inf``.
    functional : str or None
        See `contact.functionals`.

    Raises
    ------
    InputError
        The gap holds NaN or has a wrong shape; the element offers no such functional.
    """
    rows, rule = contact_boundary(body, facets, functional)
    return replace(rows, gap=rule(obstacle))


def contact_boundary(
    body: ElasticBody,
    facets: NDArray[np.int64],
    functional: str | None,
    direction: Callable[[Array], Array] | None = None,
) -> tuple[ContactRows, GapRule]:
    """Discretise a contact boundary whose obstacle comes later: rows, and how to read a gap.

    Parameters
    ----------
    body, facets, functional
        As for `contact_rows`.
    direction : callable x -> n, optional
        Unit vectors that take the place of the outward normals, see `ClosestPoint`.
    """
    form = facet_functional(body.element, functional)
    at_points = _facet_basis(body, facets, form.points)
    normals_at = np.asarray(at_points.normals)
    integrals = _facet_basis(body, facets, None)
    length = integrals.dx.sum(axis=1)
    number, count = _numbering(body, facets, form, normals_at)

    # A shared number is the same from either facet: take each from the first that has it.
    facet, slot = _first_occurrence(number, count)
    trace = np.stack([np.asarray(field[0]) for field in at_points.basis], axis=-1)
    values = (form.C @ trace)[facet, slot]
    columns = at_points.element_dofs.T[facet]
    values[np.abs(values) < 1e-11 * body.lengths[0][body.dim * columns]] = 0.0  # inverse-map dirt
    B = sparse.coo_array(
        (values.ravel(), (np.repeat(np.arange(count), columns.shape[1]), columns.ravel())),
        shape=(count, body.scalar_dofs.N),
    ).tocsr()
    B.eliminate_zeros()

    x_nominal = at_points.mapping.G(form.nominal, find=facets)[:, facet, slot]
    offset = None
    if form.mean:
        vertex = body.mesh.facets[np.array(form.vertex)][:, facets].T[facet, slot]
        B, offset, weights, x = mean_shares(body, integrals, vertex)
        x_nominal = x_nominal + offset
    else:
        weights, x = weights_and_places(integrals, form, B, number, length, x_nominal)
    normals = _mean_normals(normals_at, form, number, length, count)
    if direction is not None:
        normals = direction(x_nominal)
    else:
        normals = _within_supports(B, normals, body.constraint[0])
    tangents = tangent_frame(normals)
    if body.dim == 3:
        tangents = _along_supports(B, tangents, body.constraint[0])

    order = _along(body, facets, form, number, length, count)
    rule = GapRule(
        np.asarray(at_points.global_coordinates()),
        normals_at,
        form,
        number,
        x_nominal,
        normals,
        order,
        offset,
    )
    dim = body.dim
    G = _directed(B[order], normals[:, order])
    T = sparse.vstack([_directed(B[order], tangents[:, j][:, order]) for j in range(dim - 1)])
    interleaved = np.arange(count * (dim - 1)).reshape(dim - 1, count).T.ravel()
    rows = ContactRows(
        G,
        sparse.csr_array(T)[interleaved],
        np.full(count, np.inf),
        weights[order],
        x[:, order],
        x_nominal[:, order],
        normals[:, order],
        tangents[:, :, order],
        form.name,
    )
    return rows, rule


def _facet_basis(body: ElasticBody, facets: NDArray[np.int64], points: Array | None) -> FacetBasis:
    """Scalar trace at given reference points, or at Gauss points that integrate x * trace."""
    rule = None if points is None else (points, np.ones(points.shape[1]))
    return FacetBasis(
        body.mesh,
        body.element,
        facets=facets,
        dofs=body.scalar_dofs,
        quadrature=rule,
        intorder=None if rule else 2 * body.element.maxdeg + 2,
        disable_doflocs=True,
    )


def _numbering(
    body: ElasticBody, facets: NDArray[np.int64], form: FacetFunctional, normals: Array
) -> tuple[NDArray[np.int64], int]:
    """Global number of each facet's values, shape (nfacets, nvalues); -1 for a dropped one."""
    carried = form.shared
    number = np.full((facets.size, carried.size), -1, dtype=np.int64)
    ends = body.mesh.facets[:, facets]
    corner = (
        np.array(
            [
                ends[c] if isinstance(c, int) else _edge_key(ends[list(c)], body.mesh.nvertices)
                for c in form.vertex
                if c != -1
            ],
            dtype=np.int64,
        )
        .reshape(-1, facets.size)
        .T
    )
    if form.smooth:
        smooth = _continued_vertices(corner, normals[:, :, carried])
        corner = np.where(np.isin(corner, smooth), -1, corner)
    kept, inverse = np.unique(corner, return_inverse=True)
    inverse = inverse.reshape(corner.shape) - int(kept.size > 0 and kept[0] < 0)
    number[:, carried] = inverse
    shared = kept.size - int(kept.size > 0 and kept[0] < 0)
    own = facets.size * int((~carried).sum())
    number[:, ~carried] = shared + np.arange(own).reshape(facets.size, -1)
    return number, shared + own


def _edge_key(ends: NDArray[np.int64], nvertices: int) -> NDArray[np.int64]:
    """A number for each edge, the same from either side and above those of the vertices."""
    low, high = np.sort(ends.astype(np.int64), axis=0)
    return np.asarray(nvertices * (1 + low) + high)


def _continued_vertices(corner: NDArray[np.int64], normals: Array) -> NDArray[np.int64]:
    """Vertices where two facets meet without a kink."""
    flat, normal = corner.ravel(), normals.reshape(normals.shape[0], -1)
    order = np.argsort(flat, kind="stable")
    twice = np.flatnonzero(flat[order][1:] == flat[order][:-1])
    cosine = np.sum(normal[:, order[twice]] * normal[:, order[twice + 1]], axis=0)
    return flat[order][twice[cosine > 1 - 1e-10]]


def _first_occurrence(
    number: NDArray[np.int64], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    first = np.zeros(count, dtype=np.int64)
    flat = number.ravel()
    used = np.flatnonzero(flat >= 0)[::-1]
    first[flat[used]] = used
    return np.divmod(first, number.shape[1])


def _mean_normals(
    normals: Array, form: FacetFunctional, number: NDArray[np.int64], length: Array, count: int
) -> Array:
    """Unit normals; at a shared vertex the mean of its facets', weighted by their size."""
    dim = normals.shape[0]
    # Each value takes the normal of the evaluation point that weighs most in it.
    at = normals[:, :, np.argmax(np.abs(form.C), axis=1)] * length[:, None]
    used = number.ravel() >= 0
    total = np.array(
        [np.bincount(number.ravel()[used], at[i].ravel()[used], count) for i in range(dim)]
    )
    size = np.linalg.norm(total, axis=0)
    if np.any(size < 1e-9 * length.min()):
        raise InputError("boundary: facets with opposite normals meet at a contact point")
    unit: Array = total / size
    return unit


def tangent_frame(normals: Array) -> Array:
    """Orthonormal tangents of the unit normals of one contact boundary.

    In two dimensions the tangent is the normal turned by +90 degrees: (1, 0) on a bottom edge. In
    three the frame is a smooth function of the normal on all of the sphere but one point, the pole
    (0, 0, 1) for a boundary whose mean normal has n_z <= 0, (0, 0, -1) for others: about that pole
    frames turn twice, as they must somewhere on a closed surface. The first tangent lies in the
    plane of x and z where n_y = 0, so (1, 0, 0) on horizontal faces. Friction knows no directions:
    a turn of the frame changes the components of the shear, not the vector.

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
    sign = np.full(z.size, 1.0 if z.sum() > 1e-9 * z.size else -1.0)
    square = x * x + y * y
    sign[(square < 1e-290) & (sign * z < 0)] *= -1.0  # the pole itself
    # -1 / (sign + z), which would cancel near that pole.
    near = sign * z < 0
    a = -sign * np.where(near, (1.0 + np.abs(z)) / np.where(near, square, 1.0), 1 / (1 + np.abs(z)))
    b = x * y * a
    first = np.array([1.0 + sign * x * x * a, sign * b, -sign * x])
    second = np.array([b, sign + y * y * a, -y])
    return np.stack([first, second], axis=1)


def live_rows(rows: sparse.csr_array, body: ElasticBody) -> NDArray[np.bool_]:
    """Rows that the prescribed displacements leave something of.

    Parameters
    ----------
    rows : csr_array, shape (nrows, ndofs)
    body : ElasticBody

    Returns
    -------
    ndarray of bool, shape (nrows,)
    """
    of_dof, of_free = body.lengths
    left = rows @ body.constraint[0] @ sparse.diags_array(1.0 / of_free)
    return _norms(left) > 1e-9 * _norms(rows @ sparse.diags_array(1.0 / of_dof))


def _norms(rows: sparse.csr_array) -> Array:
    return np.sqrt(np.asarray(rows.multiply(rows).sum(axis=1), dtype=float).ravel())


def _within_supports(B: sparse.csr_array, normals: Array, T: sparse.csr_array) -> Array:
    """Turn normals that all but lie in a plane of symmetry into it.

    Where a curved boundary ends at a support along an axis, the mean normal is that of one side
    only, off by half the turn of a facet; friction would act on what is left of the tangent.
    """
    dim = normals.shape[0]
    turned = normals.copy()
    for c in range(dim):
        axis = np.zeros_like(normals)
        axis[c] = 1.0
        held = _norms(_directed(B, axis) @ T) <= 1e-9 * _norms(B)
        turned[c, held & (np.abs(normals[c]) < NEARLY)] = 0.0
    return turned / np.linalg.norm(turned, axis=0)


def _along_supports(B: sparse.csr_array, tangents: Array, T: sparse.csr_array) -> Array:
    """Turn the frames so that a prescribed tangential direction is one of their axes.

    Where supports (a plane of symmetry, say) hold a contact point in one tangential direction
    only, two rows in a general frame would depend on each other.
    """
    rows = [_directed(B, tangents[:, j]) @ T for j in (0, 1)]
    a, b, c = (
        np.asarray(rows[i].multiply(rows[j]).sum(axis=1)).ravel()
        for i, j in ((0, 0), (0, 1), (1, 1))
    )
    least = 0.5 * (a + c) - np.hypot(0.5 * (a - c), b)
    angle = np.where(least < 1e-12 * (a + c), 0.5 * np.arctan2(2 * b, a - c), 0.0)
    cos, sin = np.cos(angle), np.sin(angle)
    first, second = tangents[:, 0], tangents[:, 1]
    return np.stack([cos * first + sin * second, cos * second - sin * first], axis=1)


def _directed(B: sparse.csr_array, direction: Array) -> sparse.csr_array:
    """Rows of ``direction . u`` from rows of the scalar trace."""
    dim, coo = direction.shape[0], B.tocoo()
    data = np.concatenate([coo.data * direction[c][coo.row] for c in range(dim)])
    columns = np.concatenate([dim * coo.col + c for c in range(dim)])
    rows = np.tile(coo.row, dim)
    result = sparse.coo_array((data, (rows, columns)), shape=(B.shape[0], dim * B.shape[1])).tocsr()
    result.eliminate_zeros()
    return result


def _along(
    body: ElasticBody,
    facets: NDArray[np.int64],
    form: FacetFunctional,
    number: NDArray[np.int64],
    length: Array,
    count: int,
) -> NDArray[np.int64]:
    """In two dimensions the points in the order in which the boundary is run through."""
    if body.dim == 3:
        return np.arange(count)
    ends = body.mesh.facets[:, facets]
    at: dict[int, list[int]] = {}
    for f, (a, b) in enumerate(ends.T.tolist()):
        at.setdefault(a, []).append(f)
        at.setdefault(b, []).append(f)
    place = np.full(count, np.inf)
    left = set(range(facets.size))
    arc = 0.0
    starts = [v for v, around in at.items() if len(around) == 1]
    starts.sort(key=lambda v: tuple(body.mesh.p[:, v]))
    while left:
        closed = int(ends[0, min(left)])
        vertex: int = next((v for v in starts if at[v][0] in left), closed)
        while True:
            ahead = [f for f in at[vertex] if f in left]
            if not ahead:
                break
            f = ahead[0]
            left.discard(f)
            forward = ends[0, f] == vertex
            s = form.nominal[0] if forward else 1.0 - form.nominal[0]
            used = number[f] >= 0
            place[number[f][used]] = np.minimum(place[number[f][used]], arc + (s * length[f])[used])
            arc += length[f]
            vertex = int(ends[1, f] if forward else ends[0, f])
        arc += 1e-9 * length.sum()
    return np.argsort(place, kind="stable")
