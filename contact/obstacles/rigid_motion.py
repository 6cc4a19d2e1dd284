"""The rigid motion that takes an obstacle from one step of a history to the next.

Friction acts on the slip, and the obstacle's part of it is the path of its surface points. A
shape's method ``motion_from(before)`` returns its motion, or None if the shapes differ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from contact.errors import InputError
from contact.obstacles.rigid import plain
from skfem_adini.ground.arguments import numbers

Array = NDArray[np.float64]

_HALF_TURN = np.pi - 1e-6  # larger rotations have no unique axis and sense


@dataclass(frozen=True)
class RigidMotion:
    r"""The motion :math:`w(x) = c + \theta \times (x - m)`.
    It is evaluated at the contact points: a spinning wheel slips by its arc length, a rolling one
    does not slip."""

    translation: Array  # c, translation of a point of the shape, (dim,)
    rotation: Array  # theta, radians, counter-clockwise, (1,) in 2-D and (3,) in 3-D
    about: Array  # m, midway between that point's positions, (dim,)

    @classmethod
    def between(cls, p: ArrayLike, q: ArrayLike, rotation: ArrayLike | None = None) -> RigidMotion:
        """The motion that takes a point of the obstacle from p to q."""
        start, end = np.asarray(p, dtype=float), np.asarray(q, dtype=float)
        turn = np.zeros(end.size * (end.size - 1) // 2)
        if rotation is not None:
            turn = turn + np.asarray(rotation, dtype=float)
        return cls(end - start, turn, 0.5 * (start + end))

    @classmethod
    def at_rest(cls) -> RigidMotion:
        """No motion, in any dimension."""
        return cls(np.zeros(0), np.zeros(0), np.zeros(0))

    @property
    def components(self) -> Array:
        """Translation, then rotation, as of `Rigid.components`."""
        return np.concatenate((self.translation, self.rotation))

    @property
    def still(self) -> bool:
        """Whether nothing moves."""
        return not np.any(self.components)


def motion_between(before: Any, now: Any) -> RigidMotion | None:
    """Motion of an obstacle from step to step; None if its shapes do not determine it.
    The small motion of a `Rigid` is not included."""
    before, now = plain(before), plain(now)
    for moved in (now, before):  # either may be a Moved of the shape
        if hasattr(moved, "moved_between"):
            known: RigidMotion | None = moved.moved_between(before, now)
            return known
    if type(now) is not type(before) or not hasattr(now, "motion_from"):
        return None
    found: RigidMotion | None = now.motion_from(before)
    return found


def along_normal(before: Any, now: Any, first: bool = False) -> bool:
    """Whether the obstacle is a number, a gap along the normal only, in both steps.
    In the first step of a history a shape, which then starts there, may replace it."""
    before, now = plain(before), plain(now)
    return is_number(before) and (is_number(now) or first)


def gap_tells_place(obstacle: Any) -> bool:
    """Whether equal gaps imply an unmoved shape, unlike for planes, prisms and spinning tools."""
    return not getattr(plain(obstacle), "_slides_in_itself", False)


def is_number(obstacle: Any) -> bool:
    """Whether an obstacle is one gap for all points."""
    return isinstance(obstacle, int | float | np.number) or (
        isinstance(obstacle, np.ndarray) and obstacle.ndim == 0
    )


def same_gaps(one: Array, other: Array) -> NDArray[np.bool_]:
    """Mask of gaps that are equal up to rounding, 1e-12 of the largest."""
    if one.shape != other.shape:
        return np.zeros(other.shape, dtype=bool)
    size = np.abs(other[np.isfinite(other)]).max(initial=0.0)
    near = np.isclose(one, other, rtol=0.0, atol=1e-12 * size)
    return np.asarray(near)


def turn_between(one: Array, other: Array) -> Array | None:
    """The smallest rotation from one direction to another; None for opposite ones."""
    one, other = one / np.linalg.norm(one), other / np.linalg.norm(other)
    if one.size == 2:
        across = np.array([one[0] * other[1] - one[1] * other[0]])
    else:
        across = np.cross(one, other)
    length = float(np.linalg.norm(across))
    angle = np.arctan2(length, one @ other)
    if angle > _HALF_TURN:
        return None
    return np.asarray(across * (angle / length if length > 0 else 1.0))


def turn_of(R: Array) -> Array | None:
    """Angle, or rotation vector, of an orthogonal matrix; None for a reflection or half a turn."""
    if np.linalg.det(R) < 0:
        return None
    if len(R) == 2:
        turn = np.array([np.arctan2(R[1, 0], R[0, 0])])
    else:
        turn = np.asarray(scipy.spatial.transform.Rotation.from_matrix(R).as_rotvec())
    angle = np.linalg.norm(turn)
    if angle > _HALF_TURN:
        return None
    return turn if angle > 1e-14 else 0.0 * turn  # rounding of a matrix product


def matrix_of(rotation: Array) -> Array:
    """Orthogonal matrix of an angle (1,), or of a rotation vector (3,)."""
    if rotation.size == 1:
        c, s = np.cos(rotation[0]), np.sin(rotation[0])
        return np.array([[c, -s], [s, c]])
    return np.asarray(scipy.spatial.transform.Rotation.from_rotvec(rotation).as_matrix())


def fitted(before: Array, now: Array) -> RigidMotion | None:
    """The rigid motion that takes points (dim, n) to their new positions; None if none does."""
    p, q = before.mean(axis=1), now.mean(axis=1)
    here, there = before - p[:, None], now - q[:, None]
    size = float(np.abs(here).max())
    if np.abs(there - here).max() <= 1e-12 * size:
        return RigidMotion.between(p, q)
    R = closest_rotation(before, now)
    turn = turn_of(R)
    # No rigid motion fits all points.
    if turn is None or np.abs(there - R @ here).max() > 1e-9 * size:
        return None
    return RigidMotion.between(p, q, turn)


def closest_rotation(before: Array, now: Array, weight: Array | None = None) -> Array:
    """The rotation that takes points (dim, n), less their means, closest to others.
    Least squares with weights (n,): W. Kabsch, Acta Cryst. A 32 (1976), 922-923."""
    w = np.ones(before.shape[1]) if weight is None else weight
    here, there = (v - (v @ w / w.sum())[:, None] for v in (before, now))
    U, _, V = np.linalg.svd((there * w) @ here.T)
    U[:, -1] *= np.sign(np.linalg.det(U @ V))
    return np.asarray(U @ V)


def said_motion(said: Any, dim: int) -> Array | None:
    """Check the caller's displacement: dim numbers, or 0 for none; None if not given."""
    if said is None:
        return None
    value = numbers("motion", said)
    if value.shape == () and value == 0.0:
        return np.zeros(dim)
    if value.shape != (dim,) or not np.all(np.isfinite(value)):
        raise InputError(
            f"motion={said!r}: expected the {dim} components of the obstacle's displacement, or 0 "
            "where it moves along the normal only"
        )
    return value


def unknown_motion(before: Any, now: Any, where: str = "") -> InputError:
    """The error for a motion that friction needs and the shapes do not determine."""
    one, other = (type(plain(o)).__name__ for o in (before, now))
    if before is None:
        one = "unknown in a result from a file"
    return InputError(
        f"motion: the obstacle{where} changes from one step to the next ({one}, then {other}), and "
        "how far its surface moved along the boundary, which friction needs, cannot be read from "
        "it; say how far it has moved, motion=lambda t: (x, y) of LoadStepper.obstacle, or motion= "
        "of solve and of GridContact.history, where 0 stands for along the normal only; or give "
        "the same shape in every step, as Moved(shape, displacement) does, or a Rigid in finite "
        "sliding"
    )
