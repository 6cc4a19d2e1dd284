"""Rigid obstacles: the gap from a boundary point along the body's outward normal.

An obstacle is called as ``obstacle(x, n)`` with points and unit normals of shape (dim, ...) and
returns the signed distance d along n to its surface: positive where there is a gap, zero where they
touch, negative where undeformed body and obstacle overlap (a press fit), and ``inf`` where the ray
misses the obstacle or meets it at an angle of less than a degree. The contact condition is u_n <=
d. Instead of an obstacle, a function of x that returns d may be given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError
from contact.obstacles.arguments import (
    GRAZING,
    column,
    direction,
    keep_vectors,
    vector,
)
from contact.obstacles.rigid import ObstacleLike as ObstacleLike
from contact.obstacles.rigid import plain
from contact.obstacles.rigid_motion import (
    RigidMotion,
    gap_tells_place,
    matrix_of,
    motion_between,
    turn_between,
    turn_of,
)
from contact.obstacles.rough import Rough
from contact.obstacles.signed_distance import SignedDistance
from contact.obstacles.surface_mesh import SurfaceMesh
from skfem_adini.ground.arguments import evaluated, finite_number, flag, numbers, positive_number

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plane:
    """The half space behind a plane.

    Parameters
    ----------
    point : sequence of float
        Any point of the plane.
    normal : sequence of float
        Points out of the obstacle, towards the body; need not be a unit vector.

    Examples
    --------
    >>> foundation = Plane((0.0, -0.03), (0.0, 1.0))
    >>> foundation(np.array([[0.5], [0.0]]), np.array([[0.0], [-1.0]])).tolist()
    [0.03]
    """

    point: Sequence[float]
    normal: Sequence[float]
    _slides_in_itself: ClassVar[bool] = True

    def __post_init__(self) -> None:
        keep_vectors(self, "point", "normal")

    def __call__(self, x: Array, n: Array) -> Array:
        """Return the gap along n from x; both of shape (dim, ...)."""
        point, normal = vector("point", self.point), direction("normal", self.normal)
        height = np.sum((x - column(point, x)) * column(normal, x), axis=0)
        slope = -np.sum(n * column(normal, x), axis=0)
        facing = slope > GRAZING * float(np.linalg.norm(normal))
        return np.where(facing, height / np.where(facing, slope, 1.0), np.inf)

    def distance(self, x: Array) -> tuple[Array, Array]:
        """Signed distance of x and its gradient."""
        point, normal = vector("point", self.point), direction("normal", self.normal)
        unit = column(normal / np.linalg.norm(normal), x)
        return np.sum((x - column(point, x)) * unit, axis=0), np.broadcast_to(unit, x.shape)

    def motion_from(self, before: Plane) -> RigidMotion | None:
        """The motion of `point`, with the smallest rotation between the normals."""
        turn = turn_between(vector("normal", before.normal), vector("normal", self.normal))
        return None if turn is None else RigidMotion.between(before.point, self.point, turn)


def _first_meeting(x: Array, n: Array, radius: float) -> Array:
    """Distance d at which x + d n enters |x + d n| <= radius: the smaller root of a d^2 + 2 b d +
    c."""
    a, b, c = np.sum(n * n, axis=0), np.sum(x * n, axis=0), np.sum(x * x, axis=0) - radius**2
    discriminant = b**2 - a * c
    # The root is the radius times the sine of the angle between ray and surface.
    meets = (discriminant >= (GRAZING * radius) ** 2) & (a > 1e-24)
    ahead = meets & ((c < 0) | (b < 0))
    root = np.sqrt(np.where(ahead, discriminant, 1.0))
    # c / (root - b) is the same root without cancellation where b < 0.
    towards = b < 0
    near = np.where(towards, c, -b - root) / np.where(ahead, np.where(towards, root - b, a), 1.0)
    return np.where(ahead, near, np.inf)


def _round_gap(obstacle: Cylinder | Sphere, x: Array, n: Array) -> Array:
    """Gap of points x about the centre; for a hole, the reversed ray's entry is the exit."""
    radius = positive_number("radius", obstacle.radius)
    if not flag("hollow", obstacle.hollow):
        return _first_meeting(x, n, radius)
    d = _first_meeting(x, -n, radius)
    return np.where(np.isinf(d), np.inf, -d)


@dataclass(frozen=True)
class Cylinder:
    """A disk in two dimensions; in three, a cylinder of infinite length.

    Parameters
    ----------
    centre : sequence of float
    radius : float
    axis : sequence of float
        Three dimensions only: direction of the axis.
    hollow : bool
        The obstacle is the outside, a bore, and the body lies in it.

    Examples
    --------
    >>> roller = Cylinder((0.0, -2.0), 1.5)
    >>> roller(np.array([[0.0, 3.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [-1.0, -1.0]])).tolist()
    [0.5, inf]
    >>> bore = Cylinder((0.0, 0.0), 1.5, hollow=True)
    >>> bore(np.array([[0.0], [-1.0]]), np.array([[0.0], [-1.0]])).tolist()
    [0.5]
    """

    centre: Sequence[float]
    radius: float
    axis: Sequence[float] = (0.0, 0.0, 1.0)
    hollow: bool = False

    def __post_init__(self) -> None:
        keep_vectors(self, "centre", "axis")

    @property
    def _slides_in_itself(self) -> bool:
        return len(self.centre) == 3

    def __call__(self, x: Array, n: Array) -> Array:
        """Return the gap along n from x; both of shape (dim, ...)."""
        centre = vector("centre", self.centre)
        return _round_gap(self, self._across(x - column(centre, x)), self._across(n))

    def _across(self, x: Array) -> Array:
        """The component of x perpendicular to the axis."""
        if x.shape[0] == 2:
            return x
        axis = vector("axis", self.axis)
        if axis.size != 3 or not np.any(axis):
            raise InputError(f"axis={self.axis!r}: expected a direction of three components")
        unit = column(axis / np.linalg.norm(axis), x)
        return np.asarray(x - unit * np.sum(x * unit, axis=0))

    def distance(self, x: Array) -> tuple[Array, Array]:
        """Signed distance of x and its gradient."""
        centre = column(vector("centre", self.centre), x)
        return _from_centre(self, self._across(x - centre))

    def motion_from(self, before: Cylinder) -> RigidMotion | None:
        """The motion of the centre, with the smallest rotation between the axes."""
        if (before.radius, before.hollow) != (self.radius, self.hollow):
            return None
        if len(self.centre) == 2:
            return RigidMotion.between(before.centre, self.centre)
        one, other = vector("axis", before.axis), vector("axis", self.axis)
        turn = turn_between(one, other if one @ other >= 0 else -other)  # an axis has no sign
        return RigidMotion.between(before.centre, self.centre, turn)


@dataclass(frozen=True)
class Sphere:
    """A ball.

    Parameters
    ----------
    centre : sequence of float
    radius : float
    hollow : bool
        The obstacle is what lies outside: a spherical hole, with the body in it.

    Examples
    --------
    >>> ball = Sphere((0.0, 0.0, -2.0), 1.5)
    >>> ball(np.array([[0.0], [0.0], [0.0]]), np.array([[0.0], [0.0], [-1.0]])).tolist()
    [0.5]
    """

    centre: Sequence[float]
    radius: float
    hollow: bool = False

    def __post_init__(self) -> None:
        keep_vectors(self, "centre")

    def __call__(self, x: Array, n: Array) -> Array:
        """Return the gap along n from x; both of shape (dim, ...)."""
        return _round_gap(self, x - column(vector("centre", self.centre), x), n)

    def distance(self, x: Array) -> tuple[Array, Array]:
        """Signed distance of x and its gradient."""
        centre = column(vector("centre", self.centre), x)
        return _from_centre(self, x - centre)

    def motion_from(self, before: Sphere) -> RigidMotion | None:
        """The motion of the centre, without rotation."""
        if (before.radius, before.hollow) != (self.radius, self.hollow):
            return None
        return RigidMotion.between(before.centre, self.centre)


@dataclass(frozen=True)
class Parabola:
    """The parabolic gap ``offset + |x_t - apex_t|^2 / (2 radius)`` of Hertz's theory.

    Parameters
    ----------
    apex : sequence of float
    radius : float
        Radius of curvature at the apex.
    offset : float
        Gap at the apex; negative for interference.

    References
    ----------
    K. L. Johnson, Contact Mechanics, Cambridge University Press 1985, chapter 4.

    Examples
    --------
    A roller of radius 2 below the origin, .1 away where it is nearest:

    >>> roller = Parabola((0.0, 0.0), 2.0, offset=0.1)
    >>> roller(np.array([[0.0, 0.2], [0.0, 0.0]]), np.array([[0.0, 0.0], [-1.0, -1.0]])).round(12)
    array([0.1 , 0.11])
    """

    apex: Sequence[float]
    radius: float
    offset: float = 0.0

    def __post_init__(self) -> None:
        keep_vectors(self, "apex")

    def __call__(self, x: Array, n: Array) -> Array:
        """Return the gap along n from x; both of shape (dim, ...)."""
        x = x - column(vector("apex", self.apex), x)
        tangential = np.sum(x * x, axis=0) - np.sum(x * n, axis=0) ** 2
        return finite_number("offset", self.offset) + tangential / (
            2 * positive_number("radius", self.radius)
        )

    def motion_from(self, before: Parabola) -> RigidMotion | None:
        """The motion of the apex; `offset` is one along the normal."""
        if before.radius != self.radius:
            return None
        return RigidMotion.between(before.apex, self.apex)


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
        apex, axis = vector("apex", self.apex), direction("axis", self.axis)
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
        # A ray steeper than the surface enters this half of the double cone only along the axis.
        enters = np.where(a < 0, c > 0, (discriminant >= 0) & ((b < 0) | (a > 0)))
        root = np.sqrt(np.where(enters, np.maximum(discriminant, 0.0), 1.0))
        towards = b < 0  # avoids cancellation in the root
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


_PLACED = (Plane, Cylinder, Sphere, Cone, SurfaceMesh, Rough, SignedDistance)  # not a Parabola


@dataclass(frozen=True)
class ClosestPoint:
    r"""Measure the gap to the closest point of an obstacle instead of along the body's normal.

    With the signed distance phi of the obstacle, the contact condition is
    :math:`-\nabla\phi \cdot u \le \phi`: the pressure acts along the normal of the *obstacle*,
    which matters where the boundary is not parallel to it. The two conditions agree to second
    order in the angle between the normals.

    Parameters
    ----------
    obstacle : Plane, Cylinder, Sphere, SurfaceMesh, SignedDistance, Rough, or one of them `Moved`

    Raises
    ------
    InputError
        An obstacle without a distance of its own.

    Examples
    --------
    >>> slope = Plane((0.0, -1.0), (3.0, 4.0))
    >>> x, n = np.zeros((2, 1)), np.array([[0.0], [-1.0]])
    >>> print(slope(x, n), ClosestPoint(slope)(x, n), ClosestPoint(slope).direction(x).ravel())
    [1.] [0.8] [-0.6 -0.8]
    """

    obstacle: Any

    def __post_init__(self) -> None:
        known = (Plane, Cylinder, Sphere, SurfaceMesh, SignedDistance, Rough)
        within = self.obstacle.obstacle if isinstance(self.obstacle, Moved) else self.obstacle
        if not isinstance(within, known):
            raise InputError(
                f"ClosestPoint: a {type(self.obstacle).__name__} has no distance; use a Plane, "
                "Cylinder, Sphere, SurfaceMesh, SignedDistance or Rough"
            )

    @property
    def _slides_in_itself(self) -> bool:
        return not gap_tells_place(self.obstacle)

    def __call__(self, x: Array, n: Array) -> Array:
        """Return the signed distance of x, shape (...); n is not used."""
        return self.obstacle.distance(x)[0]

    def direction(self, x: Array) -> Array:
        """Unit vectors from x towards the closest point of the obstacle's surface, (dim, ...)."""
        return -np.asarray(self.obstacle.distance(x)[1])

    def motion_from(self, before: ClosestPoint) -> RigidMotion | None:
        """The motion of the inner obstacle."""
        return motion_between(before.obstacle, self.obstacle)


@dataclass(frozen=True)
class Moved:
    r"""A shape at another place, by any distance and angle: ``x -> R (x - centre) + centre + c``.

    Use it for a tool with a large motion in `LoadStepper.obstacle`: gaps are those of the tool at
    its current position, and friction acts on the motion of its surface points from step to step. A
    `Rigid` makes small motions, also under forces, and may contain a `Moved`.

    Parameters
    ----------
    obstacle : Plane, Cylinder, Sphere, Cone, SurfaceMesh, Rough or SignedDistance
        The same in every step of a history.
    displacement : sequence of float
        Translation c, one number a direction.
    rotation : float (2-D) or sequence of 3 (3-D)
        Angle in radians, counter-clockwise, or the rotation vector; whole turns count.
    centre : sequence of float, optional
        The fixed point of the rotation. Default: the origin.

    Raises
    ------
    InputError
        An obstacle that is no such shape, wrong lengths, numbers that are not finite.

    Examples
    --------
    >>> wheel = Cylinder((0.0, -1.0), 1.0)
    >>> moved = Moved(wheel, (0.5, -0.1), rotation=-0.5, centre=(0.0, -1.0))
    >>> moved(np.array([[0.5], [0.0]]), np.array([[0.0], [-1.0]])).round(12).tolist()
    [0.1]
    """

    obstacle: Any
    displacement: Sequence[float]
    rotation: float | Sequence[float] = 0.0
    centre: Sequence[float] | None = None
    _slides_in_itself: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not isinstance(self.obstacle, _PLACED):
            raise InputError(
                f"Moved: a {type(self.obstacle).__name__} is no shape to be moved and turned; "
                f"expected one of {', '.join(kind.__name__ for kind in _PLACED)}. Move the apex "
                "and the offset of a Parabola; put a Moved into Rigid and ClosestPoint"
            )
        c = vector("displacement", self.displacement)
        size = 1 if c.size == 2 else 3
        turn = np.atleast_1d(numbers("rotation", self.rotation))
        if turn.size == 1 and not np.any(turn):
            turn = np.zeros(size)
        if turn.shape != (size,) or not np.all(np.isfinite(turn)):
            raise InputError(
                f"rotation={self.rotation!r}: expected {'an angle' if size == 1 else '3 numbers'}"
            )
        centre = np.zeros(c.size) if self.centre is None else vector("centre", self.centre, c.size)
        for name, value in (("displacement", c), ("rotation", turn), ("centre", centre)):
            object.__setattr__(self, name, tuple(value.tolist()))

    def __call__(self, x: Array, n: Array) -> Array:
        """Return the gap along n from x; both of shape (dim, ...)."""
        return np.asarray(self.obstacle(*self.at_home(x, n)))

    def distance(self, x: Array) -> tuple[Array, Array]:
        """Signed distance of x and its gradient."""
        d, gradient = self.obstacle.distance(self.at_home(x, x)[0])
        return d, np.tensordot(self._matrix, gradient, axes=1)

    def at_home(self, x: Array, n: Array) -> tuple[Array, Array]:
        """Points and directions in the obstacle's original frame."""
        centre, c = np.asarray(self.centre), np.asarray(self.displacement)
        back, away = self._matrix.T, x - column(centre + c, x)
        return np.tensordot(back, away, axes=1) + column(centre, x), np.tensordot(back, n, axes=1)

    @property
    def _matrix(self) -> Array:
        return matrix_of(np.asarray(self.rotation))

    @staticmethod
    def moved_between(before: Any, now: Any) -> RigidMotion | None:
        """The motion of a shape between two positions, either of which may be the original."""
        dim = len(next(o.displacement for o in (before, now) if isinstance(o, Moved)))
        one, other = (o if isinstance(o, Moved) else _unmoved(o, dim) for o in (before, now))
        if one is None or other is None:
            return None
        within = one.obstacle is other.obstacle or motion_between(one.obstacle, other.obstacle)
        if within is None or (isinstance(within, RigidMotion) and not within.still):
            return None
        first, last = np.asarray(one.rotation), np.asarray(other.rotation)
        turn: Array | None = last - first  # with whole turns, where the axis is the same
        if first.size == 3 and np.linalg.norm(np.cross(first, last)) > 1e-14:
            turn = turn_of(other._matrix @ one._matrix.T)
        if turn is None:
            return None
        end, was = np.asarray(other.centre), np.asarray(one.centre)
        start = one._matrix @ (end - was) + was + np.asarray(one.displacement)
        return RigidMotion.between(start, end + np.asarray(other.displacement), turn)


_SHAPES = (*_PLACED, Parabola, ClosestPoint, Moved)


def is_tool(obstacle: Any) -> bool:
    """Whether an obstacle is a shape with a place of its own, not a gap of each point."""
    return isinstance(plain(obstacle), _SHAPES)


def _unmoved(obstacle: Any, dim: int) -> Moved | None:
    try:
        return Moved(obstacle, (0.0,) * dim)
    except InputError:  # not a shape
        return None


def _from_centre(obstacle: Cylinder | Sphere, x: Array) -> tuple[Array, Array]:
    """Distance of places x about the centre, and its gradient."""
    radius, length = positive_number("radius", obstacle.radius), np.linalg.norm(x, axis=0)
    if np.any(length < 1e-12 * radius):
        raise InputError("ClosestPoint: a contact point lies on the obstacle's centre")
    outward = -1.0 if flag("hollow", obstacle.hollow) else 1.0
    return outward * (length - radius), outward * x / length


def evaluate_gap(obstacle: ObstacleLike, x: Array, n: Array) -> Array:
    """Gap, shape (...), of any obstacle, number or function at points x with normals n, (dim,
    ...)."""
    if obstacle is None:
        return np.full(x.shape[1:], np.inf)
    if isinstance(obstacle, type):
        raise InputError(
            f"obstacle: {obstacle.__name__} is a class; give one, {obstacle.__name__}(...)"
        )
    if hasattr(obstacle, "surface"):
        raise InputError("obstacle: a body touches by a boundary; give body.surface(name)")
    if isinstance(obstacle, _SHAPES):
        gap = obstacle(x, n)
    else:
        gap = evaluated("obstacle", obstacle, x)
    if gap.shape not in ((), x.shape[1:]):  # other shapes would be broadcast along a grid axis
        raise InputError(f"obstacle: gap of shape {gap.shape} for points of shape {x.shape[1:]}")
    gap = np.broadcast_to(gap, x.shape[1:])
    if np.any(np.isnan(gap)) or np.any(np.isneginf(gap)):
        raise InputError("obstacle: the gap holds NaN or minus infinity")
    return np.array(gap)


def within_reach(obstacle: ObstacleLike, gap: Array, nearest: float, size: float) -> Array:
    """The gap, ``inf`` where it exceeds the boundary's least gap by more than the body's size.
    Normals near the equator of a ball meet a plane below it far away; such a gap would close only
    if the body sank by more than its size. Gaps not along normals are unchanged."""
    if isinstance(obstacle, _PLACED):
        gap = np.where(np.abs(gap) <= nearest + size, gap, np.inf)
    return gap
