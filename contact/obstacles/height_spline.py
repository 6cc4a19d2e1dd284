"""Heights between the points of a grid, by tensor products of splines, with derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

DEGREES = {"linear": 1, "cubic": 3}


@dataclass(frozen=True, eq=False)
class HeightSpline:
    """A spline through the heights, periodic or on one patch.

    Attributes
    ----------
    lengths : ndarray, shape (dim - 1,)
        Period, or size of the patch.
    periodic : bool
    steepest : float
        A bound of the slope.
    """

    lengths: Array
    periodic: bool
    steepest: float
    _spline: Any
    _heights: Array

    @classmethod
    def through(cls, heights: Array, lengths: Array, degree: int, periodic: bool) -> HeightSpline:
        """The spline of degree 1 or 3 that takes the given heights on an equidistant grid."""
        knots, slopes = [], []
        closed = np.pad(heights, [(0, 1)] * heights.ndim, mode="wrap") if periodic else heights
        c = closed
        for axis, length in enumerate(lengths):
            x = np.linspace(0.0, length, closed.shape[axis])
            kind: Literal["periodic"] | None = "periodic" if periodic and degree > 1 else None
            piece = scipy.interpolate.make_interp_spline(x, c, degree, bc_type=kind, axis=axis)
            knots.append(piece.t)
            c = np.moveaxis(np.asarray(piece.c), 0, axis)
        for axis, t in enumerate(knots):
            # Coefficients of the derivative bound it, as its B-splines sum to one.
            rise = np.diff(c, axis=axis)
            run = (t[degree + 1 : -1] - t[1 : -degree - 1]) / degree
            shape = [1] * rise.ndim
            shape[axis] = run.size
            slopes.append(float(np.abs(rise / run.reshape(shape)).max()))
        spline = scipy.interpolate.NdBSpline(tuple(knots), c, degree, extrapolate=False)
        return cls(lengths, periodic, float(np.hypot.reduce(slopes)), spline, heights)

    def within(self, places: Array) -> NDArray[np.bool_]:
        """Whether places (dim - 1, ...) lie on the surface: all of them do if it is periodic."""
        if self.periodic:
            return np.ones(places.shape[1:], dtype=bool)
        size = self.lengths.reshape((-1,) + (1,) * (places.ndim - 1))
        slack = 1e-9 * size
        return np.asarray(np.all((places >= -slack) & (places <= size + slack), axis=0))

    def height(self, places: Array) -> Array:
        """Heights at places (dim - 1, ...), beyond the edge of a patch those of its edge."""
        return self._value(places, np.zeros(len(places), dtype=int))

    def over(self, axes: Sequence[Array]) -> Array:
        """Heights of a periodic surface on a tensor grid; on its own points those that were given.

        Parameters
        ----------
        axes : sequence of ndarray
            Coordinates along each direction.
        """
        numbers = []
        for x, length, n in zip(axes, self.lengths, self._heights.shape, strict=True):
            number = np.rint(x * (n / length))
            if np.abs(x * (n / length) - number).max(initial=0.0) > 1e-12 * n:
                return self._on_grid(list(axes), np.zeros(len(axes), dtype=int))
            numbers.append(number.astype(np.int64) % n)
        return self._heights[np.ix_(*numbers)]

    def slope(self, places: Array) -> Array:
        """Derivatives along each direction at places (dim - 1, ...), of the same shape."""
        return np.array([self._value(places, row) for row in np.eye(len(places), dtype=int)])

    def _value(self, places: Array, order: NDArray[np.int64]) -> Array:
        size = self.lengths.reshape((-1,) + (1,) * (places.ndim - 1))
        axes = _axes(places)
        if axes is not None:
            return self._on_grid(axes, order)
        inside = places % size if self.periodic else places
        return np.asarray(self._spline(np.moveaxis(np.clip(inside, 0.0, size), 0, -1), nu=order))

    def _on_grid(self, axes: list[Array], order: NDArray[np.int64]) -> Array:
        """Values on a tensor grid, direction by direction: many times faster than by places."""
        values = self._spline.c
        for axis, (x, length, nu) in enumerate(zip(axes, self.lengths, order, strict=True)):
            inside = np.clip(x % length if self.periodic else x, 0.0, length)
            t, degree = self._spline.t[axis], self._spline.k[axis]
            values = scipy.interpolate.BSpline(t, values, degree, axis=axis)(inside, nu=nu)
        return np.asarray(values)


def _axes(places: Array) -> list[Array] | None:
    """Coordinates along each axis of places (dim - 1, ...) that are a tensor grid, else None."""
    if places.ndim != len(places) + 1 or not places.size:
        return None
    axes = []
    for i, x in enumerate(places):
        lines = np.moveaxis(x, i, 0).reshape(x.shape[i], -1)
        if not np.all(lines == lines[:, :1]):
            return None
        axes.append(lines[:, 0])
    return axes
