"""A circular cone as a rigid obstacle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError
from contact.obstacles.arguments import column, keep_vectors, vector
from contact.obstacles.rigid_motion import RigidMotion, turn_between
from skfem_adini.ground.arguments import finite_number

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cone:
    r"""A circular cone; in two dimensions a wedge, or the cone of an axisymmetric body.

    Parameters
    ----------
    apex : sequence of float
    axis : sequence of float
        Direction from the apex into the cone; need not be a unit vector. For an axisymmetric body
        apex and axis lie on the axis r = 0.
    half_angle : float
        Between the axis and the surface, in radians, in (0, pi / 2).

    References
    ----------
    I. N. Sneddon, Int. J. Engng Sci. 3 (1965), 47-57: on a half space, at the depth
    :math:`\delta`, the force is :math:`2 E^* \delta^2 \tan\alpha / \pi` and the contact radius
    :math:`2 \delta \tan\alpha / \pi`.

    Examples
    --------
    A cone below the origin with its apex up, .1 away from it:

    >>> cone = Cone((0.0, -0.1), (0.0, -1.0), np.arctan(2.0))
    >>> cone(np.array([[0.0, 0.2], [0.0, 0.0]]), np.array([[0.0, 0.0], [-1.0, -1.0]])).round(12)
    array([0.1, 0.2])
    """

    apex: Sequence[float]
    axis: Sequence[float]
    half_angle: float

    def __post_init__(self) -> None:
        keep_vectors(self, "apex", "axis")

    def __call__(self, x: Array, n: Array) -> Array:
        """Return the gap along n from x; both of shape (dim, ...)."""
        apex, axis = vector("apex", self.apex), vector("axis", self.axis)
        if not np.any(axis):
            raise InputError("axis: the zero vector is no direction")
        angle = finite_number("half_angle", self.half_angle)
        if not 0 < angle < 0.5 * np.pi:
            raise InputError(f"half_angle={angle!r}: expected an angle between 0 and pi / 2")
        into, slope = column(axis / np.linalg.norm(axis), x), np.tan(angle)
        from_apex = x - column(apex, x)
        h, c = np.sum(from_apex * into, axis=0), np.sum(n * into, axis=0)
        p, q = from_apex - into * h, n - into * c
        h, c = slope * h, slope * c  # radius of the cone at x, and its growth along n
        # |p + d q|^2 = (h + d c)^2 where the ray enters: a d^2 + 2 b d + rest = 0.
        a, b = np.sum(q * q, axis=0) - c * c, np.sum(p * q, axis=0) - h * c
        rest = np.sum(p * p, axis=0) - h * h
        # b^2 - a rest, in a form that keeps its digits where the ray passes by the apex.
        apart = np.sum((q * h - p * c) ** 2, axis=0)
        skew = [p[i] * q[j] - p[j] * q[i] for j in range(len(p)) for i in range(j)]
        discriminant = apart - np.sum(np.square(skew), axis=0)
        # Steeper than the surface the ray enters this half of the double cone only along the axis.
        enters = np.where(a < 0, c > 0, (discriminant >= 0) & ((b < 0) | (a > 0)))
        root = np.sqrt(np.where(enters, np.maximum(discriminant, 0.0), 1.0))
        towards = b < 0  # then the other form of the same root would cancel
        d = np.where(towards, rest, -b - root) / np.where(
            enters, np.where(towards, root - b, a), 1.0
        )
        inside = (rest <= 0) & (h >= 0)
        reach = h + d * c >= -1e-12 * np.abs(h)
        return np.where(enters & reach & ((d >= 0) | inside), d, np.inf)

    def motion_from(self, before: Cone) -> RigidMotion | None:
        """The motion of the apex, with the smallest rotation between the axes."""
        if before.half_angle != self.half_angle:
            return None
        turn = turn_between(vector("axis", before.axis), vector("axis", self.axis))
        return None if turn is None else RigidMotion.between(before.apex, self.apex, turn)
