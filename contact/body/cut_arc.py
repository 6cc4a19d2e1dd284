"""The curved boundary of a cut body: its quadrature points, ordered along curves, and the trace."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import sparse

from contact.body.elastic_body import ElasticBody

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CutArc:
    """Part of the curved boundary of a `CutBody`, by its n quadrature points."""

    body: ElasticBody  # the `CutBody` itself
    index: NDArray[np.int64]  # numbers among all points of the boundary, to detect overlaps
    x: Array  # points, shape (2, n)
    normals: Array  # outward unit normals, shape (2, n)
    weights: Array
    size: Array  # extent of the cell along the arc, shape (n,)
    part: NDArray[np.int64]  # leaf of the level set, or side of the polygon
    trace: sparse.csr_array  # scalar functions at the points, (n, scalar dofs)
    spacing: float  # distance of neighbouring multipliers, in cell sizes

    def __repr__(self) -> str:
        return f"CutArc({self.index.size} points)"

    @cached_property
    def curves(self) -> list[Curve]:
        """The connected smooth curves that the arc consists of."""
        return curves(self.x, self.normals, self.weights, self.size, self.part)

    def integral(self, density: Array) -> Array:
        """Load vector on all dofs of a traction, shape (2, n), at the points."""
        load = np.zeros(2 * self.trace.shape[1])
        for c in range(2):
            load[c::2] = self.trace.T @ (self.weights * density[c])
        return load


Index = NDArray[np.int64]


@dataclass(frozen=True)
class Curve:
    """One connected curve."""

    points: Index  # its quadrature points in order, the body on the left, shape (n,)
    s: Array  # arc length of each point, in units of the local cell size, shape (n,)
    length: float  # in the same units
    closed: bool


def curves(x: Array, normals: Array, weights: Array, size: Array, part: Index) -> list[Curve]:
    """Put quadrature points x (2, n) of smooth curves in order; curves end where `part` changes.
    The successor of a point is the nearest one ahead along the tangent whose own nearest one
    behind it is. Distances, in units of `size`, are chords, corrected as on circles."""
    # Points of smaller weight cannot be ordered reliably.
    heavy = np.flatnonzero(weights > 1e-9 * weights.max())
    successor = np.full(weights.size, -1)
    for k in np.unique(part[heavy]):
        here = heavy[part[heavy] == k]
        tangents = np.array([-normals[1, here], normals[0, here]])
        ahead, behind = (_nearest(x[:, here], tangents, weights[here], d) for d in (1.0, -1.0))
        mutual = np.flatnonzero((ahead >= 0) & (behind[ahead] == np.arange(here.size)))
        successor[here[mutual]] = here[ahead[mutual]]
    found = [
        _measured(run, closed, x, normals, weights, size) for run, closed in _runs(successor, heavy)
    ]
    return _with_the_rest(found, heavy, x)


def _nearest(x: Array, tangents: Array, weights: Array, sign: float) -> Index:
    """Return the nearest point ahead (sign 1) or behind (-1) of each, -1 where a curve ends."""
    tree, count = scipy.spatial.KDTree(x.T), weights.size
    result = np.full(count, -1)
    left = np.arange(count)
    k = min(16, count)
    while left.size and count > 1:
        # Points are dense where a curve cuts the corner of a cell: more neighbours are needed.
        near = np.asarray(tree.query(x[:, left].T, k=k)[1]).reshape(left.size, k)
        way = x[:, near] - x[:, left, None]
        along = sign * np.sum(way * tangents[:, left, None], axis=0)
        across = np.abs(np.sum(way * tangents[::-1, left, None] * [[[-1.0]], [[1.0]]], axis=0))
        alike = np.sum(tangents[:, near] * tangents[:, left, None], axis=0) > 0.5
        close = along <= weights[near] + weights[left, None]
        fits = (along > 0) & (across <= along) & alike & close
        found = fits.any(axis=1)
        first = near[np.arange(left.size), np.argmin(np.where(fits, along, np.inf), axis=1)]
        result[left[found]] = first[found]
        left = left[~found]
        if k == count:
            break
        k = min(4 * k, count)
    return result


def _runs(successor: Index, heavy: Index) -> list[tuple[Index, bool]]:
    """Return the points of each curve in order, and whether it is closed."""
    following = successor.tolist()
    has_predecessor = set(successor[successor >= 0].tolist())
    left = set(heavy.tolist())
    starts = [i for i in heavy.tolist() if i not in has_predecessor]
    found = []
    while left:
        closed = not starts
        i = min(left) if closed else starts.pop(0)
        run = []
        while i in left:
            left.remove(i)
            run.append(i)
            i = following[i]
        found.append((np.array(run), closed))
    return found


def _measured(
    run: Index, closed: bool, x: Array, normals: Array, weights: Array, size: Array
) -> Curve:
    after = np.roll(run, -1) if closed else run[1:]
    before = run if closed else run[:-1]
    chord = np.hypot(*(x[:, after] - x[:, before]))
    cosine = np.sum(normals[:, after] * normals[:, before], axis=0)
    half = np.arccos(np.clip(cosine, -1.0, 1.0)) / 2
    step = chord / np.sinc(half / np.pi) * (0.5 / size[before] + 0.5 / size[after])
    if closed:
        return Curve(run, np.cumsum(step) - step, float(step.sum()), True)
    s = np.concatenate(([0.0], np.cumsum(step)))
    end = max(float(np.sum(weights[run] / size[run])) - s[-1], 0.0)
    return Curve(run, s + end / 2, s[-1] + end, False)


def _with_the_rest(found: list[Curve], heavy: Index, x: Array) -> list[Curve]:
    """Insert each point of negligible weight next to its nearest neighbour."""
    rest = np.setdiff1d(np.arange(x.shape[1]), heavy)
    if rest.size == 0:
        return found
    owner = np.concatenate([np.full(curve.points.size, k) for k, curve in enumerate(found)])
    points = np.concatenate([curve.points for curve in found])
    s = np.concatenate([curve.s for curve in found])
    near = np.asarray(scipy.spatial.KDTree(x[:, points].T).query(x[:, rest].T)[1])
    result = []
    for k, curve in enumerate(found):
        mine = owner[near] == k
        order = np.concatenate((curve.points, rest[mine]))
        place = np.concatenate((curve.s, s[near[mine]]))
        sort = np.argsort(place, kind="stable")
        result.append(Curve(order[sort], place[sort], curve.length, curve.closed))
    return result
