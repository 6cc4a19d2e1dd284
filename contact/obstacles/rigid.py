"""Rigid obstacles that move by a given displacement or under a given force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError
from contact.obstacles.arguments import vector
from skfem_adini.ground.arguments import array_of, numbers

Array = NDArray[np.float64]
Components = float | Sequence[float | None]
ObstacleLike = Any  # an obstacle, a number, a callable x -> d, an array of gaps, or None


@dataclass(frozen=True)
class Rigid:
    r"""A rigid obstacle with a motion of its own, ``w(x) = c + theta x (x - centre)``.

    The contact law acts on the relative displacement: :math:`u_n - w_n \le d`, and friction on
    :math:`u_t - w_t`. Every component of the translation c and of the rotation theta is either
    prescribed or free; a free one is found such that the contact forces balance the given force or
    moment. Motions are assumed small: the gap changes by w_n at the original contact points. With
    `LoadStepper` and ``sliding="finite"`` they may have any size, for shapes: the rotation is then
    about the axis of theta, whole turns count, and the moment acts about the displaced `centre`.
    Elsewhere give the obstacle at its new position, in a history as a `Moved`, possibly inside the
    `Rigid`: friction acts on the sum of both motions.

    Parameters
    ----------
    obstacle : obstacle, number, callable or array
        Where the obstacle is before it moves.
    displacement : sequence of float or None, optional
        Translation, one number a direction. None, as a whole or for one direction, means zero
        there, or free if a force is given.
    force : sequence of float or None, optional
        External force on the obstacle, per unit depth in 2-D; None in directions with a prescribed
        displacement. A force that presses a foundation below the body against it points up.
    rotation : float (2-D) or sequence of 3 (3-D), optional
        Prescribed rotation in radians, counter-clockwise.
    moment : float (2-D) or sequence of 3 (3-D), optional
        External moment on the obstacle about `centre`; it may then turn.
    centre : sequence of float, optional
        Default: the origin.

    Raises
    ------
    InputError
        Displacement and force for the same direction, wrong lengths, numbers that are not finite.

    Examples
    --------
    A stamp pressed down on a block by a force of 2, held sideways and free to tilt:

    >>> stamp = Rigid(0.0, force=(None, -2.0), moment=0.0, centre=(0.5, 1.0))
    >>> stamp.components(2)[1].tolist()
    [nan, -2.0, 0.0]
    """

    obstacle: ObstacleLike
    displacement: Sequence[float | None] | None = None
    force: Sequence[float | None] | None = None
    rotation: Components | None = None
    moment: Components | None = None
    centre: Sequence[float] | None = None

    def components(self, dim: int) -> tuple[Array, Array]:
        """Prescribed motions and given forces, translations first, shape (3,) in 2-D and (6,) in
        3-D; for each component exactly one of the two is NaN."""
        turns = dim * (dim - 1) // 2
        motion = np.concatenate(
            (_read("displacement", self.displacement, dim), _read("rotation", self.rotation, turns))
        )
        force = np.concatenate(
            (_read("force", self.force, dim), _read("moment", self.moment, turns))
        )
        both = np.flatnonzero(~np.isnan(motion) & ~np.isnan(force))
        if both.size:
            raise InputError(
                f"Rigid: component {int(both[0])} of motion and force (translations first) has "
                "both a prescribed value and a given force; leave one of them None"
            )
        motion = np.where(np.isnan(motion) & np.isnan(force), 0.0, motion)
        return motion, force

    def about(self, dim: int) -> Array:
        """Centre of rotation, shape (dim,)."""
        if self.centre is None:
            return np.zeros(dim)
        return vector("centre", self.centre, dim)


def plain(obstacle: ObstacleLike) -> Any:
    """The obstacle without its `Rigid` motion, if it has one."""
    return obstacle.obstacle if isinstance(obstacle, Rigid) else obstacle


def _read(name: str, given: Any, count: int) -> Array:
    if given is None:
        return np.full(count, np.nan)
    values = np.atleast_1d(array_of(name, given))
    if values.ndim != 1 or np.ma.is_masked(given):
        raise InputError(f"{name}={given!r}: expected {count} finite numbers (or None)")
    # None means "not given"; a NaN from the caller does not.
    entries = [np.inf if v is not None and v != v else v for v in values.tolist()]
    array = numbers(name, [np.nan if v is None else v for v in entries])
    if array.shape != (count,) or np.any(np.isinf(array)):
        raise InputError(f"{name}={given!r}: expected {count} finite numbers (or None)")
    return array


@dataclass(frozen=True)
class ObstacleMotion:
    """The k motions of all obstacles, expressed at the m contact points."""

    normal: Array  # w_n of unit motions, by the contact functional, (m, k)
    tangent: Array  # shape (m * (dim - 1), k)
    prescribed: Array  # NaN for a free motion, shape (k,)
    force: Array  # force or moment on a free motion, else NaN, (k,)
    travel: Array | None = None  # tangential path of shapes since rest, (m, dim - 1)
    turns: Array | None = None  # rotation of each `Rigid`, in finite sliding, (n, dim, dim)

    @classmethod
    def of_all(cls, found: Sequence[ObstacleMotion]) -> ObstacleMotion | None:
        """The motions of several obstacles at the same contact points; None if there are none."""
        if not found:
            return None
        return cls(
            np.hstack([own.normal for own in found]),
            np.hstack([own.tangent for own in found]),
            np.concatenate([own.prescribed for own in found]),
            np.concatenate([own.force for own in found]),
        )

    @classmethod
    def with_travel(cls, motion: ObstacleMotion | None, travel: Array) -> ObstacleMotion:
        """The given motion, or an empty one, with the path of the shapes."""
        if motion is not None:
            return replace(motion, travel=travel)
        m, slips = travel.shape
        none = np.zeros(0)
        return cls(np.zeros((m, 0)), np.zeros((m * slips, 0)), none, none, travel)

    @property
    def free(self) -> NDArray[np.bool_]:
        """Whether each motion is free, driven by a force, shape (k,)."""
        return np.isnan(self.prescribed)

    @property
    def drags(self) -> NDArray[np.bool_]:
        """Tangents of points along which free motions move the obstacle, shape (m, dim - 1)."""
        along = np.abs(self.tangent[:, self.free]).max(axis=1, initial=0.0)
        moved = along > 1e-12 * along.max(initial=0.0)  # smaller values are rounding
        return np.asarray(moved.reshape(self.normal.shape[0], -1))

    def displacement(self, motion: Array) -> tuple[Array, Array]:
        """w_n (m,) and w_t (m, dim - 1) of the contact points; a NaN motion counts as zero."""
        known = np.nan_to_num(motion)
        along = (self.tangent @ known).reshape(self.normal.shape[0], -1)
        return self.normal @ known, along if self.travel is None else along + self.travel

    def unbalanced(self, mu: Array, t: Array) -> Array:
        """Contact forces on the free motions plus the given forces: zero in equilibrium."""
        on_obstacle = self.normal.T @ mu + self.tangent.T @ t.ravel()
        return np.asarray((on_obstacle + self.force)[self.free])
