"""How well two meshes resolve their interface, by two numbers of every contact point.

Straight facets of length h lie off a curve of radius R by up to h^2 / 8R, so that the measured gap
is wrong by the sagittas of both sides; and the coarser of the two meshes limits the pressure."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from contact.rows.mortar.interface_rows import MortarRows
from contact.rows.outline import Outline, hats

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def interface_rise(first: Outline, second: Outline, found: MortarRows) -> Array:
    """Gap between the curves that straight facets approximate less the measured one, (m,)."""
    q = found.quadrature
    raised = _heights(first, q.facet, q.x, q.X) + _heights(second, q.other, q.y, q.Y)
    return np.asarray(-(found.P @ raised))


def facet_ratio(first: Outline, second: Outline, found: MortarRows) -> Array:
    """Largest ratio, at least 1, of the lengths of two facets facing at a contact point, (m,)."""
    own, other = (
        facet_lengths(first)[found.quadrature.facet],
        facet_lengths(second)[found.quadrature.other],
    )
    ratio, P = np.maximum(own / other, other / own), found.P
    largest = np.ones(P.shape[0])
    point = np.repeat(np.arange(P.shape[0]), np.diff(P.indptr))
    np.maximum.at(largest, point, ratio[P.indices])
    return largest


def _heights(outline: Outline, facet: Index, x: Array, X: Array) -> Array:
    """Height of the smooth curve above places on facets, see `Outline.raised`."""
    corner = outline.body.mesh.p[:, outline.corners]
    change = outline.turned - outline.at_corners
    off = np.sum(change[:, facet] * (x[:, :, None] - corner[:, facet]), axis=0)
    height = -0.5 * np.sum(off * hats(X, corner.shape[2]).T, axis=1)
    return np.where(outline.bent[facet], height, 0.0)


def facet_lengths(outline: Outline) -> Array:
    """Mean length of the sides of each facet."""
    corner = outline.body.mesh.p[:, outline.corners]
    sides = np.roll(corner, -1, axis=2) - corner
    return np.asarray(np.linalg.norm(sides, axis=0).mean(axis=1))
