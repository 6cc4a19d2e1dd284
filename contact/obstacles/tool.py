r"""A rigid obstacle in its current pose, its curvature, and its motion since the last step.

The signed distance :math:`\phi` of a posed shape is that of the shape at ``R^T (x - c - m) + m``.
With the position y of a body's point relative to a point of the tool, before (1) and after (2) a
step, the tool's rotation vector :math:`\omega` and the body's own rotation :math:`R_b` by
:math:`\omega_b`, the point slips along the tool by

.. math:: s = y_2 - R_b y_1 - (\omega - \omega_b) \times \tfrac12 (R_b y_1 + y_2) ,

the integral of the relative velocity in the frame of the body: arc lengths for a spinning tool, and
exactly zero where tool and body make the same rigid motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError, NotConverged
from contact.obstacles.arguments import column
from contact.obstacles.rigid import Rigid, plain
from contact.obstacles.rigid_motion import RigidMotion, matrix_of, turn_of
from contact.obstacles.shapes import ClosestPoint, Cone, Cylinder, Moved, Parabola, Plane, Sphere
from contact.obstacles.signed_distance import SignedDistance
from contact.obstacles.surface_mesh import SurfaceMesh

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """The motion of a `Rigid` from rest: its components, and the rotation matrix."""

    motion: Array  # as of `Rigid.components`, shape (k,)
    turn: Array  # R, (dim, dim)

    @classmethod
    def at_rest(cls, dim: int) -> Pose:
        """No motion."""
        return cls(np.zeros(dim * (dim + 1) // 2), np.eye(dim))

    def under(self, prescribed: Array) -> Pose:
        """The pose after the prescribed components, NaN where free, have taken their values."""
        free, dim = np.isnan(prescribed), len(self.turn)
        motion, turns = np.where(free, self.motion, prescribed), slice(dim, None)
        if dim == 2 or not free[turns].any():
            return Pose(motion, matrix_of(motion[turns]))
        held = ~free[turns]
        back = matrix_of(-self.motion[turns] * held)
        return Pose(motion, matrix_of(motion[turns] * held) @ back @ self.turn)

    def moved(self, change: Array) -> Pose:
        """The pose after a small change: a translation, and a rotation about fixed axes."""
        dim = len(self.turn)
        return Pose(self.motion + change, matrix_of(change[dim:]) @ self.turn)

    def spin_since(self, last: Pose) -> Array:
        """Rotation vector since the last step; whole turns about one axis count."""
        dim = len(self.turn)
        said = self.motion[dim:] - last.motion[dim:]
        if dim == 2:
            return said
        found = turn_of(self.turn @ last.turn.T)
        angle, size = float(np.linalg.norm(said)), 0.0 if found is None else np.linalg.norm(found)
        if found is None or (angle > np.pi and size < 1e-9):
            if np.linalg.norm(np.cross(self.motion[dim:], last.motion[dim:])) > 1e-12 * angle:
                raise NotConverged(
                    "Rigid: it turns by half a turn about a changing axis; take smaller steps"
                )
            return said
        if size == 0.0:
            return found
        way = np.sign(found @ said) or 1.0
        turns = np.round((angle - way * size) / (2 * np.pi))
        return np.asarray(found * (1.0 + 2 * np.pi * turns * way / size))


@dataclass(frozen=True)
class Tool:
    """A shape in its pose, and the motion of one of its points since the last step."""

    shape: Any
    pose: Pose
    centre: Array  # of rotation, before the motion, (dim,)
    start: Array  # where the point was, (dim,)
    end: Array  # where it is, (dim,)
    spin: Array  # rotation vector since the last step, (1,) or (3,)
    last: Pose  # that of the last step

    @classmethod
    def of(
        cls,
        obstacle: Any,
        pose: Pose,
        last: Pose,
        step: RigidMotion,
        flat: tuple[Array, Array] | None,
    ) -> Tool:
        """The tool of an obstacle at `pose`, `last` the one before.
        `step` is the motion of the shape inside the `Rigid`, `flat` a point of the boundary and its
        normals there, which place a `Parabola`."""
        dim, within = len(pose.turn), plain(obstacle)
        shape = within.obstacle if isinstance(within, ClosestPoint) else within
        if isinstance(shape, Parabola) and flat is not None:
            shape = Paraboloid.of(shape, *flat)
        centre = obstacle.about(dim) if isinstance(obstacle, Rigid) else np.zeros(dim)
        was = now = centre
        spin = np.zeros(pose.motion.size - dim)
        if not step.still:
            was, now = step.about - 0.5 * step.translation, step.about + 0.5 * step.translation
            spin = pose.turn @ step.rotation if dim == 3 else step.rotation
        elif not isinstance(obstacle, Rigid) and step.about.size:
            was = now = step.about
        tool = cls(shape, pose, centre, was, now, spin + pose.spin_since(last), last)
        ahead = last.turn @ (was - centre) + centre + last.motion[:dim]
        return replace(tool, start=ahead, end=tool.away(now))

    @property
    def bounded(self) -> bool:
        """Whether the shape is a solid of its own, not the region behind a plane or a sheet."""
        shape = self.shape.obstacle if isinstance(self.shape, Moved) else self.shape
        if isinstance(shape, SurfaceMesh):
            return not shape.sheet
        return isinstance(shape, Cylinder | Sphere | Cone | SignedDistance)

    @property
    def place(self) -> Array:
        """Where the centre of rotation is, (dim,)."""
        return self.centre + self.pose.motion[: self.centre.size]

    def away(self, x: Array) -> Array:
        """Where the pose takes a point."""
        return np.asarray(self.pose.turn @ (x - self.centre) + self.place)

    def within(self, x: Array, frame: Array) -> Array:
        """Where points x (dim, n) are in the shape's own `frame`, (dim, dim + 1)."""
        return np.asarray(frame[:, :-1].T @ (self._home(x) - frame[:, -1:]))

    def _home(self, x: Array) -> Array:
        return self.pose.turn.T @ (x - self.place[:, None]) + self.centre[:, None]

    def distance(self, x: Array) -> tuple[Array, Array]:
        """Signed distance of x (dim, n) and its gradient.
        Raises NotConverged where no closest point is unique."""
        try:
            phi, gradient = distance_of(self.shape, self._home(x))
        except InputError as error:
            raise NotConverged(
                f"finite sliding: {error}; it has no unique closest point there, take smaller steps"
            ) from error
        return np.asarray(phi), np.asarray(self.pose.turn @ gradient)

    def curvature(self, x: Array) -> Array:
        """Derivative of the gradient at x (dim, n), shape (dim, dim, n)."""
        R = self.pose.turn
        return np.einsum("ai,ijn,bj->abn", R, curvature_of(self.shape, self._home(x)), R)

    def velocities(self, x: Array) -> Array:
        """Motion of the tool's points at x (dim, n) for unit changes of the pose, (dim, k, n)."""
        return np.stack([rate(k, x - self.place[:, None]) for k in range(self.pose.motion.size)], 1)


def moved_frame(frame: Array, step: RigidMotion) -> Array:
    """A frame (dim, dim + 1), rotation and place of its origin, after the motion of a shape."""
    if step.still:
        return frame
    R, half = matrix_of(step.rotation), 0.5 * step.translation
    place = R @ (frame[:, -1] - step.about + half) + step.about + half
    return np.column_stack((R @ frame[:, :-1], place))


@dataclass(frozen=True)
class WornTools:
    """Depths worn off tools: multilinear between the corners of cells that move with each tool.
    A corner gains the mean of what the points around it have lost, weighted by their areas."""

    cell: float
    held: Array  # number of the tool, of the corner along each axis, and depth, (dim + 2, k)

    def depth(self, tool: int, x: Array) -> Array:
        """Depths at places x (dim, n) in the frame of a tool."""
        number, hats, known, _ = self._around(tool, x)
        return np.asarray((known[number] * hats).sum(axis=0))

    def after(self, tool: int, x: Array, lost: Array, area: Array) -> WornTools:
        """After points at x have lost more; area (n,) is zero where they are not opposite."""
        number, hats, known, corners = self._around(tool, x)
        share = hats * area
        gain, of = (
            np.bincount(number.ravel(), v.ravel(), known.size) for v in (share * lost, share)
        )
        depth = known + gain / np.where(of > 0, of, 1.0)
        return replace(self, held=np.vstack((corners, depth))[:, depth > 0])

    def _around(self, tool: int, x: Array) -> tuple[Any, ...]:
        """Numbers and hats of the corners around x, (2^dim, n), depths and places of corners."""
        low, near = np.floor(x / self.cell), np.indices((2,) * len(x)).reshape(len(x), -1, 1)
        part = (x / self.cell - low)[:, None]
        hats: Array = np.prod(np.where(near, part, 1 - part), axis=0)
        at = (low[:, None] + near).reshape(len(x), -1)
        every = np.hstack((self.held[:-1], np.vstack((np.full(at.shape[1], tool), at))))
        corners, number = np.unique(every, axis=1, return_inverse=True)
        old, new = np.split(number.ravel(), [self.held.shape[1]])
        known = np.bincount(old, self.held[-1], corners.shape[1])
        return new.reshape(hats.shape), hats, known, corners


def rate(k: int, arm: Array) -> Array:
    """Velocity at arms (dim, n) under the unit translation, then rotation, number k."""
    dim = len(arm)
    if k < dim:
        return np.broadcast_to(np.eye(dim)[:, k : k + 1], arm.shape)
    return cross(np.eye(dim * (dim - 1) // 2)[:, k - dim], arm)


def cross(omega: Array, v: Array) -> Array:
    """``omega x v`` of a rotation vector (1,) or (3,) and vectors (dim, n)."""
    if omega.size == 1:
        return omega[0] * np.array([-v[1], v[0]])
    return np.cross(omega, v, axisa=0, axisb=0, axisc=0)


@dataclass(frozen=True)
class Paraboloid:
    """A `Parabola` over a flat boundary: its distance is that along the normal, to first order."""

    apex: Array
    axis: Array  # out of the body, into the obstacle
    radius: float

    @classmethod
    def of(cls, shape: Parabola, x: Array, normals: Array) -> Paraboloid:
        """The obstacle opposite a boundary through x with `normals` (dim, n)."""
        n = normals.mean(axis=1)
        if np.abs(normals - n[:, None]).max() > 1e-9:
            raise InputError(
                "obstacle: a Parabola is a gap over a flat boundary; opposite a curved one it has "
                "no place of its own to move from, take a Cylinder or a Sphere"
            )
        apex = np.asarray(shape.apex, dtype=float)
        return cls(apex + n * (n @ (x - apex) + shape.offset), n, float(shape.radius))

    def distance(self, x: Array) -> tuple[Array, Array]:
        """Distance of x (dim, n) and its gradient."""
        away = x - self.apex[:, None]
        along = self.axis @ away
        aside = away - np.outer(self.axis, along)
        slope = aside / self.radius - self.axis[:, None]
        size = np.linalg.norm(slope, axis=0)
        return (0.5 * np.sum(aside**2, axis=0) / self.radius - along) / size, slope / size


def distance_of(shape: Any, x: Array) -> tuple[Array, Array]:
    """Signed distance of x (dim, n) from a shape, and its gradient."""
    if isinstance(shape, Moved):
        phi, gradient = distance_of(shape.obstacle, shape.at_home(x, x)[0])
        return phi, matrix_of(np.asarray(shape.rotation)) @ gradient
    if not isinstance(shape, Cone):
        phi, gradient = shape.distance(x)
        if isinstance(shape, SignedDistance):  # the function may underestimate the distance
            step = 1e-6 * (float(np.ptp(x)) or 1.0)
            ends = [np.asarray(shape.function(x + h * gradient)) for h in (step, -step)]
            phi = phi / np.clip((ends[0] - ends[1]) / (2.0 * step), 0.1, None)
        return phi, gradient
    a = np.asarray(shape.axis, dtype=float) / np.linalg.norm(shape.axis)
    away, c, s = (
        x - column(np.asarray(shape.apex), x),
        np.cos(shape.half_angle),
        np.sin(shape.half_angle),
    )
    h = a @ away
    p = away - np.outer(a, h)
    rho, size = np.linalg.norm(p, axis=0), np.linalg.norm(away, axis=0)
    tip, axial = rho * s + h * c <= 0, rho <= 1e-12 * np.abs(h)  # nearest to the apex; on the axis
    safe = np.where(rho > 0, rho, 1.0)
    gradient = np.where(axial, -a[:, None], c * p / safe - np.outer(a, np.full(h.size, s)))
    gradient = np.where(tip & (size > 0), away / np.where(size > 0, size, 1.0), gradient)
    return np.where(tip, size, np.where(axial, -h, c * rho - s * h)), gradient


def curvature_of(shape: Any, x: Array) -> Array:
    """Derivative of the gradient of `distance_of` at x (dim, n), shape (dim, dim, n).
    Closed forms for planes, facets and round shapes, central differences for others."""
    dim, n = x.shape
    if isinstance(shape, Moved):
        R = matrix_of(np.asarray(shape.rotation))
        here = curvature_of(shape.obstacle, shape.at_home(x, x)[0])
        return np.asarray(np.einsum("ai,ijn,bj->abn", R, here, R))
    if isinstance(shape, Plane | SurfaceMesh):
        return np.zeros((dim, dim, n))
    if isinstance(shape, Cylinder | Sphere):
        phi, g = shape.distance(x)
        across = np.eye(dim)
        if isinstance(shape, Cylinder) and dim == 3:
            axis = np.asarray(shape.axis, dtype=float) / np.linalg.norm(shape.axis)
            across = across - np.outer(axis, axis)
        sign = -1.0 if shape.hollow else 1.0
        radius = shape.radius + sign * phi
        return np.asarray(sign * (across[:, :, None] - g[:, None] * g) / radius)
    step = 1e-5 * (float(np.ptp(x)) or 1.0)
    shifts = step * np.eye(dim)[:, :, None]
    pairs = [(distance_of(shape, x + h)[1], distance_of(shape, x - h)[1]) for h in shifts]
    return np.stack([(ahead - behind) / (2.0 * step) for ahead, behind in pairs], axis=1)
