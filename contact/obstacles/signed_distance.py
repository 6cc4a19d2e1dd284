"""An obstacle given by its signed distance function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.errors import InputError
from contact.obstacles.rigid_motion import RigidMotion
from skfem_adini.ground.arguments import evaluated, numbers

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SignedDistance:
    """An obstacle given by its signed distance function, positive outside.

    The gap is found by steps of the distance along the ray, then by bisection and secant steps at
    the sign change; any continuous function that is positive outside and does not overestimate the
    distance is suitable.

    Parameters
    ----------
    function : callable x -> ndarray
        x of shape (dim, npoints), result of shape (npoints,).
    reach : float
        Rays without an intersection within this length have the gap ``inf``.

    References
    ----------
    J. C. Hart, Sphere tracing, The Visual Computer 12 (1996), 527-545.

    Examples
    --------
    A square block of side 2 whose upper face lies .5 below the point:

    >>> import numpy as np
    >>> block = SignedDistance(lambda x: np.maximum(np.abs(x[0]), np.abs(x[1] + 1.5)) - 1.0)
    >>> block(np.array([[0.0], [0.0]]), np.array([[0.0], [-1.0]])).round(9)
    array([0.5])
    """

    function: Callable[[Array], ArrayLike]
    reach: float = np.inf

    def __call__(self, x: Array, n: Array) -> Array:
        """Return the gap along n from x; both of shape (dim, ...)."""
        shape, x, n = x.shape[1:], x.reshape(x.shape[0], -1), n.reshape(n.shape[0], -1)
        start = self._at(x)
        sign = np.where(start < 0, -1.0, 1.0)  # inside the obstacle: go back along the ray
        limit = numbers("reach", self.reach)
        if limit.shape != () or not limit > 0:
            raise InputError(f"reach={self.reach!r}: expected a positive number")
        if not start.size:
            return start.reshape(shape)
        reach = min(float(limit), 1e3 * float(np.ptp(x) + np.abs(start).max(initial=0.0) + 1e-300))
        d = np.zeros(start.size)
        before = d.copy()
        crossed = start == 0
        open_ = np.flatnonzero(~crossed)
        for _ in range(5000):  # at grazing incidence the distance shrinks slowly along the ray
            if open_.size == 0:
                break
            value = self._at(x[:, open_] + d[open_] * n[:, open_])
            met = value * sign[open_] <= 0
            crossed[open_[met]] = True
            open_, value = open_[~met], value[~met]
            before[open_] = d[open_]
            d[open_] += sign[open_] * np.maximum(np.abs(value), 1e-9 * reach)
            open_ = open_[np.abs(d[open_]) <= reach]
        low, high = before.copy(), d.copy()
        for _ in range(80):
            middle = 0.5 * (low + high)
            outside = self._at(x + middle * n) * sign > 0
            low, high = np.where(outside, middle, low), np.where(outside, high, middle)
        gap = 0.5 * (low + high)
        return np.where(crossed & (np.abs(gap) <= reach), gap, np.inf).reshape(shape)

    def distance(self, x: Array) -> tuple[Array, Array]:
        """Signed distance of x by the function, and its normalised gradient."""
        flat = x.reshape(x.shape[0], -1)
        step = 1e-6 * max(float(np.ptp(flat)), float(np.abs(self._at(flat)).max()), 1e-300)
        gradient = np.empty_like(flat)
        for i in range(flat.shape[0]):
            shift = step * np.eye(flat.shape[0])[:, i : i + 1]
            gradient[i] = self._at(flat + shift) - self._at(flat - shift)
        length = np.linalg.norm(gradient, axis=0)
        if np.any(length < 1e-3 * step):
            raise InputError("SignedDistance: the function is flat at a contact point")
        return self._at(flat).reshape(x.shape[1:]), (gradient / length).reshape(x.shape)

    def motion_from(self, before: SignedDistance) -> RigidMotion | None:
        """No motion for the same function, else None: see `Moved`."""
        return RigidMotion.at_rest() if before.function is self.function else None

    def _at(self, x: Array) -> Array:
        if not callable(self.function):
            raise InputError(f"SignedDistance: {self.function!r} is no function of x")
        value = evaluated("SignedDistance", self.function, x)
        if value.shape != x.shape[1:] or np.any(np.isnan(value)):
            raise InputError(
                f"SignedDistance: the function must return {x.shape[1:]} numbers, got "
                f"{value.shape}" + (" with NaN" if np.any(np.isnan(value)) else "")
            )
        return value
