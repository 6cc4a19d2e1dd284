"""Numbering and order of the contact points, and the facet values that they share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from contact.rows.functionals import FacetFunctional
from contact.rows.outline import Outline

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def numbering(outline: Outline, form: FacetFunctional) -> tuple[Index, int]:
    """Contact point of each facet's values, shape (nfacets, nvalues), and how many there are.
    -1 marks values determined by others, see `contact.rows.shares`: of C1 traces at vertices within
    a straight line, and on facets of a curve all but the corner values."""
    count, ends = outline.facets.size, outline.corners.T
    carried = form.shared
    number = np.full((count, carried.size), -1, dtype=np.int64)
    entity = [
        ends[c] if isinstance(c, int) else _edge_key(ends[list(c)], outline.body.mesh.nvertices)
        for c in form.vertex
        if c != -1
    ]
    carrier = np.array(entity, dtype=np.int64).reshape(-1, count).T
    curved = outline.curved[:, None]
    if form.smooth:
        straight = ~curved & ~outline.curved[outline.beyond[0]]
        carrier = np.where(outline.continued & straight, -1, carrier)
    elif form.reduced:
        carrier = np.where(curved & (np.arange(carrier.shape[1]) >= ends.shape[0]), -1, carrier)
    kept, inverse = np.unique(carrier, return_inverse=True)
    dropped = int(kept.size > 0 and kept[0] < 0)
    number[:, carried] = inverse.reshape(carrier.shape) - dropped
    shared = kept.size - dropped
    alone = np.broadcast_to(~carried & ~(curved & form.reduced), number.shape)
    number[alone] = shared + np.arange(alone.sum())
    return number, shared + int(alone.sum())


def _edge_key(ends: Index, nvertices: int) -> Index:
    """A unique number per edge, equal for both facets and larger than all vertex numbers."""
    low, high = np.sort(ends.astype(np.int64), axis=0)
    return np.asarray(nvertices * (1 + low) + high)


def first_occurrence(number: Index, count: int) -> tuple[Index, Index]:
    """First facet and value number of each contact point, shapes (count,)."""
    first = np.zeros(count, dtype=np.int64)
    flat = number.ravel()
    used = np.flatnonzero(flat >= 0)[::-1]
    first[flat[used]] = used
    return np.divmod(first, number.shape[1])


def along(outline: Outline, form: FacetFunctional, number: Index, count: int) -> Index:
    """Order of the contact points, shape (count,): along the boundary in 2-D, unchanged in 3-D."""
    if outline.body.mesh.dim() == 3:
        return np.arange(count)
    return in_order(outline, np.broadcast_to(form.nominal[0], number.shape), number, count)


def in_order(outline: Outline, nominal: Array, number: Index, count: int) -> Index:
    """Order of the contact points along a boundary in 2-D, shape (count,).
    `nominal` and `number`, (nfacets, nvalues): nominal places on the reference facet, and the
    contact point of each value, -1 for none."""
    mesh, ends = outline.body.mesh, outline.corners.T
    length = np.linalg.norm(mesh.p[:, ends[1]] - mesh.p[:, ends[0]], axis=0)
    at: dict[int, list[int]] = {}
    for f, (a, b) in enumerate(ends.T.tolist()):
        at.setdefault(a, []).append(f)
        at.setdefault(b, []).append(f)
    left, lengths, (start, end) = set(range(length.size)), length.tolist(), ends.tolist()
    arc, walk = 0.0, []
    starts = [v for v, around in at.items() if len(around) == 1]
    starts.sort(key=lambda v: tuple(mesh.p[:, v]))
    while left:
        vertex = next((v for v in starts if at[v][0] in left), start[min(left)])
        while True:
            ahead = [f for f in at[vertex] if f in left]
            if not ahead:
                break
            f = ahead[0]
            left.discard(f)
            forward = start[f] == vertex
            walk.append((f, arc, forward))
            arc += lengths[f]
            vertex = end[f] if forward else start[f]
        arc += 1e-9 * length.sum()  # separates disconnected pieces
    facets, before, forwards = map(np.array, zip(*walk, strict=True))
    s = np.where(forwards[:, None], nominal[facets], 1.0 - nominal[facets])
    places, points = before[:, None] + s * length[facets, None], number[facets]
    place = np.full(count, np.inf)
    np.minimum.at(place, points[points >= 0], places[points >= 0])
    return np.argsort(place, kind="stable")
