"""Whether a callable is a function of the point: it is called twice, with other points beside it.

The value of a function at a point does not depend on the other points of a call. A callable of
arrays may violate this: it may subtract a mean, shift or sum along the array, or return an array of
its own. Tracing cannot see that, and along a characteristic it would be called with other points
than the nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cip.errors import InputError

Array = NDArray[np.float64]
Box = Sequence[tuple[float, float]]

# Points of the first sample in each direction, by dimension. The second sample has a new point,
# then every other point of the first in reverse order.
_COUNTS = {1: (8,), 2: (4, 2), 3: (2, 2, 2)}
# Multiples of these irrational numbers, modulo 1, are spread over (0, 1) without order: the golden
# ratio and the two numbers of the analogous sequence in the plane.
_RATIOS = (0.6180339887498949, 0.7548776662466927, 0.5698402909980532)
# Relative difference allowed between two values at the same point, some thousand roundings:
# vectorised loops and the scalar loops at the end of an array round differently.
_ROUNDING = 1e-12


class Samples:
    """Two sets of points of a box that have some points in common: flat arrays of the coordinates
    of all points or, if `sparse`, one array for each direction, which broadcast; then `t`, if
    given."""

    def __init__(self, box: Box, sparse: bool = False, t: float | None = None) -> None:
        lines, others, self._shared = [], [], []
        for ratio, count, (low, high) in zip(_RATIOS, _COUNTS[len(box)], box, strict=False):
            parts = (0.31 + ratio * np.arange(count + 1)) % 1.0
            line = low + (high - low) * parts
            again = np.arange(count)[::-1][::2]
            lines.append(line[:count])
            others.append(np.concatenate([line[count:], line[again]]))
            self._shared.append(again)
        self.points = []
        for axes in (lines, others):
            mesh = np.meshgrid(*axes, indexing="ij", sparse=sparse)
            self.points.append([*(x if sparse else x.ravel() for x in mesh), *_time(t)])
        self._shapes = [tuple(len(line) for line in axes) for axes in (lines, others)]

    def __iter__(self) -> Iterator[list[Any]]:
        return iter(self.points)

    def differ(self, first: Any, second: Any) -> str | None:
        """A text about the first common point with different values on the two samples, or None."""
        a, b = (
            np.reshape(np.broadcast_to(x, np.broadcast_shapes(*map(np.shape, point))), shape)
            for x, point, shape in zip((first, second), self, self._shapes, strict=True)
        )
        a, b = a[np.ix_(*self._shared)], b[(slice(1, None),) * b.ndim]
        wrong = ~alike(a, b, _ROUNDING)
        if not wrong.any():
            return None
        place = tuple(int(q) for q in np.argwhere(wrong)[0])
        return f"{a[place]:.6g} among {np.size(first)} and {b[place]:.6g} among {np.size(second)}"


def _time(t: float | None) -> list[float]:
    return [] if t is None else [t]


def alike(a: Any, b: Any, tolerance: float) -> NDArray[np.bool_]:
    """For each entry, whether the two agree within `tolerance` times the largest finite one of a.
    NaN equals NaN, and infinity equals infinity of the same sign.
    """
    a, b = np.broadcast_arrays(np.asarray(a, dtype=float), np.asarray(b, dtype=float))
    with np.errstate(all="ignore"):
        largest = np.abs(a[np.isfinite(a)]).max(initial=0.0)
        near = np.abs(a - b) <= tolerance * largest
    return np.asarray(near | (a == b) | (np.isnan(a) & np.isnan(b)))


def check_pointwise(function: Callable[..., Any], samples: Samples, name: str) -> None:
    """Raise `InputError` if values at a point depend on the other points of the call."""
    where = samples.differ(*(function(*point) for point in samples))
    if where is not None:
        raise InputError(
            f"{name}: it is no function of the place: at one point it gives {where} points, as a "
            "mean, a shift or a sum along the array does; pass its values at the nodes as an array"
        )
