"""One or several contact boundaries, each with its obstacle, friction and functional."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import sparse
from skfem import Mesh

from contact.body.axisymmetry import refuse_motions
from contact.body.cut_arc import CutArc
from contact.body.elastic_body import ElasticBody
from contact.body.rigid_modes import rigid_field
from contact.errors import InputError, warn
from contact.facet_basis import facet_basis
from contact.obstacles.rigid import ObstacleMotion, Rigid, plain
from contact.obstacles.rigid_motion import (
    RigidMotion,
    along_normal,
    gap_tells_place,
    motion_between,
    said_motion,
    unknown_motion,
)
from contact.obstacles.shapes import (
    ClosestPoint,
    Cylinder,
    Moved,
    ObstacleLike,
    Plane,
    Sphere,
    evaluate_gap,
    within_reach,
)
from contact.obstacles.surface_mesh import SurfaceMesh
from contact.rows.contact_rows import ContactRows
from contact.rows.discretise import boundary_points, contact_boundary
from contact.rows.frames import interleaved, tangent_frame
from contact.rows.gap_rule import GapRule, given_gaps
from contact.rows.outline import Outline
from contact.rows.shares import check_weights
from contact.rows.tool_rows import BoundaryPoints
from skfem_adini.ground.arguments import evaluated

Array = NDArray[np.float64]
Rows = TypeVar("Rows", bound=ContactRows)
_NONE = np.zeros(0, dtype=np.int64)
# Axis of the contact points in each array of `ContactRows`.
_AXES = {
    "gap": 0,
    "weights": 0,
    "x": 1,
    "x_nominal": 1,
    "normals": 1,
    "tangents": 2,
    "owner": 0,
    "axes": 0,
}


@dataclass(frozen=True)
class ContactBoundaries:
    """The contact boundaries of a body, each with its obstacle, discretised together."""

    body: ElasticBody
    rows: ContactRows  # of all boundaries, one after the other; their gap is not set
    rules: tuple[GapRule | ArcGap, ...]  # gap rule of each boundary
    several: bool  # obstacles and friction are given as lists, one entry for each boundary
    directions: tuple[Array | None, ...]  # (dim, m) towards a `ClosestPoint`; None: along n

    @classmethod
    def of(
        cls, body: ElasticBody, boundary: Any, obstacle: Any, functional: Any
    ) -> ContactBoundaries:
        """Discretise the boundaries as given to `ContactProblem`.
        Raises InputError for lists of different lengths, or boundaries that share facets."""
        several = (
            isinstance(boundary, list | tuple)
            and isinstance(obstacle, list | tuple)
            and not any(np.isscalar(b) and not isinstance(b, str) for b in boundary)
        )
        listed = isinstance(obstacle, list | tuple) and any(callable(plain(o)) for o in obstacle)
        if listed and not several:
            raise InputError(
                f"obstacle: a list of {len(obstacle)} needs a list of as many boundaries, one for "
                "each obstacle; parts of a curve are body.arc(where=...)"
            )
        boundaries = list(boundary) if several else [boundary]
        obstacles = list(obstacle) if several else [obstacle]
        if len(boundaries) != len(obstacles) or not boundaries:
            raise InputError(
                f"obstacle: {len(obstacles)} obstacles for {len(boundaries)} boundaries; give one "
                "for each, or one obstacle (not a list) for all of them together"
            )
        forms = _each("functional", functional, several, len(boundaries), shared=(str, type(None)))
        places = [b if isinstance(b, CutArc) else body.whole_facets(b) for b in boundaries]
        _refuse_overlap([p for p in places if not isinstance(p, CutArc)], "facet")
        _refuse_overlap([p.index for p in places if isinstance(p, CutArc)], "point of the curve")
        parts = [
            _discretised(body, p, form, _direction(o))
            for p, form, o in zip(places, forms, obstacles, strict=True)
        ]
        rows = parts[0][0] if len(parts) == 1 else joined([rows for rows, _ in parts])
        directions = tuple(
            _towards(o, rows.x_nominal) for o, (rows, _) in zip(obstacles, parts, strict=True)
        )
        return cls(body, rows, tuple(rule for _, rule in parts), several, directions)

    def _obstacles(self, obstacle: Any) -> list[ObstacleLike]:
        if not self.several:
            return [obstacle]
        if not isinstance(obstacle, list | tuple) or len(obstacle) != len(self.rules):
            raise InputError(
                f"obstacle: expected a list of {len(self.rules)}, one for each boundary"
            )
        return list(obstacle)

    def gap(self, obstacle: Any) -> Array:
        """Gap of every contact point, shape (m,)."""
        obstacles = self._obstacles(obstacle)
        self._check_directions(obstacles)
        gaps = [rule(plain(o)) for rule, o in zip(self.rules, obstacles, strict=True)]
        for rule, o, gap in zip(self.rules, map(plain, obstacles), gaps, strict=True):
            n = rule.normals
            if isinstance(o, ClosestPoint) and not isinstance(rule, ArcGap):  # n are directions
                n = outward_normals(self.body.mesh, rule.x)
            check_placement(o, gap, rule.x, n, self.body.extent)
        return np.concatenate(gaps)

    def change_of_gap(self, obstacle: Any, points: NDArray[np.int64], moves: Array) -> Array:
        """Change of the gap, (k,), where contact points move along tangents by `moves` (dim, k).
        ``inf`` beyond the edge of the obstacle; zero for gaps given as numbers."""
        change, start = np.zeros(points.size), 0
        for rule, o in zip(self.rules, self._obstacles(obstacle), strict=True):
            here = np.flatnonzero((points >= start) & (points < start + rule.order.size))
            start += rule.order.size
            if not here.size or not callable(plain(o)):
                continue
            x, n = self.rows.x_nominal[:, points[here]], self.rows.normals[:, points[here]]
            with suppress(InputError, ValueError, ArithmeticError, LookupError):
                rest, now = (evaluate_gap(plain(o), y, n) for y in (x, x + moves[:, here]))
                known = np.isfinite(rest)
                change[here] = np.where(known, now - np.where(known, rest, 0.0), 0.0)
        return change

    def rise(self, obstacle: Any) -> Array:
        """Gap from the curve that straight facets approximate minus the gap from them, (m,)."""
        return np.concatenate(
            [
                rule.rise(plain(o)) if isinstance(rule, GapRule) else np.zeros(rule.order.size)
                for rule, o in zip(self.rules, self._obstacles(obstacle), strict=True)
            ]
        )

    def _check_directions(self, obstacles: list[ObstacleLike]) -> None:
        places = self._of_each(self.rows.x_nominal)
        for there, o, x in zip(self.directions, obstacles, places, strict=True):
            now = _towards(o, x)
            same = there is None and now is None
            if there is not None and now is not None:
                # Looser tolerance: directions may come from difference quotients.
                same = bool(np.abs(there - now).max() <= 1e-7)
            if not same:
                raise InputError(
                    "obstacle: its contact forces act in other directions than those of the "
                    "problem's obstacle, for which the contact boundary was discretised; make a "
                    "new ContactProblem, or let Rigid(ClosestPoint(...), displacement=...) move"
                )

    def motion(self, obstacle: Any) -> ObstacleMotion | None:
        """The motions of the `Rigid` obstacles; None if there are none."""
        rows, dim = self.rows, self.body.dim
        start, found = 0, []
        for rule, o in zip(self.rules, self._obstacles(obstacle), strict=True):
            here = slice(start, start + rule.order.size)
            start = here.stop
            if not isinstance(o, Rigid):
                continue
            motion, force = o.components(dim)
            if self.body.is_ring:
                refuse_motions(motion, force)
            unit = rigid_field(self.body, o.about(dim))
            normal = np.zeros((rows.gap.size, unit.shape[1]))
            normal[here] = rows.G[here] @ unit
            along = slice(here.start * (dim - 1), here.stop * (dim - 1))
            tangent = np.zeros((rows.T.shape[0], unit.shape[1]))
            tangent[along] = rows.T[along] @ unit
            found.append(ObstacleMotion(normal, tangent, motion, force))
        return ObstacleMotion.of_all(found)

    def travel(
        self,
        before: Any,
        now: Any,
        said: Any,
        *,
        unchanged: NDArray[np.bool_],
        felt: Array,
        first: bool = False,
    ) -> Array:
        """Tangential path of the obstacles' shapes since the last step, (m, dim - 1).
        `said` are the caller's displacements, None: from the shapes. Raises InputError if a motion
        is unknown at a point with friction (`felt`) whose gap is not `unchanged`."""
        dim, start, path = self.body.dim, 0, np.zeros(self.rows.T.shape[0])
        each = _each("motion", said, self.several, len(self.rules), shared=(type(None),))
        listed = self.several and isinstance(before, list | tuple) and len(before) == len(each)
        was = before if listed else [None if self.several else before] * len(each)
        for rule, o, last, own in zip(self.rules, self._obstacles(now), was, each, strict=True):
            here = slice(start, start + rule.order.size)
            start = here.stop
            given = said_motion(own, dim)
            motion = motion_between(last, o)
            if given is not None:
                motion = RigidMotion.between(0.0 * given, given)
            if self.body.is_ring and motion is not None and not is_axial(motion):
                motion = None  # a motion of the section is not one of the ring
            if motion is None:
                still = bool(np.all(unchanged[here])) and (last is not None or gap_tells_place(o))
                known = along_normal(last, o, first) or still
                if not known and np.any(felt[here] > 0):
                    raise unknown_motion(last, o)
                continue
            if not motion.still:
                along = slice(here.start * (dim - 1), here.stop * (dim - 1))
                unit = rigid_field(self.body, motion.about)
                path[along] = self.rows.T[along] @ (unit @ motion.components)
        return path.reshape(-1, dim - 1)

    def friction(self, friction: Any) -> Array:
        """Coefficient or bound of every contact point, shape (m,), finite and not negative."""
        if not self.several or not isinstance(friction, list | tuple):
            return friction_values(friction, self.rows.x)
        each = _each("friction", friction, True, len(self.rules), shared=())
        places = self._of_each(self.rows.x)
        return np.concatenate([friction_values(f, x) for f, x in zip(each, places, strict=True)])

    @property
    def alone(self) -> tuple[ContactBoundaries, ...]:
        """Each boundary by itself."""
        ends = np.cumsum([rule.order.size for rule in self.rules])
        points = np.split(np.arange(self.rows.gap.size), ends[:-1])
        each = zip(self.rules, self.directions, points, strict=True)
        return tuple(
            ContactBoundaries(
                self.body, replace(selected(self.rows, own), part=_NONE), (rule,), False, (way,)
            )
            for rule, way, own in each
        )

    @cached_property
    def points(self) -> BoundaryPoints:
        """Where the functional of a single boundary reads the trace."""
        rule = self.rules[0]
        if isinstance(rule, ArcGap):
            found = BoundaryPoints(rule.mean, rule.trace, rule.x, rule.normals)
        else:
            found = boundary_points(rule)
            if self.directions[0] is not None:
                found = replace(found, normals=outward_normals(self.body.mesh, found.x))
        # Held along the boundary, as by symmetry, a point must not slip by a turn of all.
        turns = not self.body.is_ring and bool(self.body.unconstrained(self.rows.T).all())
        return replace(found, turns=turns)

    @property
    def outlines(self) -> list[Outline]:
        """Those of the facets of each boundary, none for arcs."""
        return [rule.source[0] for rule in self.rules if rule.source is not None]

    def _of_each(self, x: Array) -> list[Array]:
        """Values at all contact points, split by boundary."""
        return np.split(x, np.cumsum([rule.order.size for rule in self.rules])[:-1], axis=1)


def is_axial(motion: RigidMotion) -> bool:
    """Whether a motion is along the axis y, as it must be in a ring."""
    if motion.still:
        return True
    size = np.abs(motion.about).max() + np.abs(motion.translation).max()
    return abs(motion.translation[0]) <= 1e-12 * size and not np.any(motion.rotation)


def _refuse_overlap(places: list[NDArray[np.int64]], name: str) -> None:
    if places:
        seen, counts = np.unique(np.concatenate(places), return_counts=True)
        if np.any(counts > 1):
            raise InputError(
                f"boundary: {name} {int(seen[counts > 1][0])} belongs to two contact boundaries"
            )


def _discretised(
    body: ElasticBody, place: Any, form: str | None, direction: Callable[[Array], Array] | None
) -> tuple[ContactRows, GapRule | ArcGap]:
    if not isinstance(place, CutArc):
        return contact_boundary(body, place, form, direction)
    if place.body is not body:
        raise InputError("boundary: the arc belongs to another body; use body.arc() of this one")
    return arc_rows(place, form, direction)


def _direction(obstacle: Any) -> Callable[[Array], Array] | None:
    within = plain(obstacle)
    return within.direction if isinstance(within, ClosestPoint) else None


def _towards(obstacle: Any, x: Array) -> Array | None:
    direction = _direction(obstacle)
    return None if direction is None else direction(x)


def _each(name: str, given: Any, several: bool, count: int, shared: tuple[type, ...]) -> list[Any]:
    if not several or isinstance(given, shared):
        return [given] * count
    if not isinstance(given, list | tuple) or len(given) != count:
        raise InputError(f"{name}: expected one for all or a list of {count}, one a boundary")
    return list(given)


def friction_values(friction: Any, x: Array) -> Array:
    """Friction at places x, (dim, m), from a number, an array or a callable.
    Raises InputError if not finite, negative, or of a wrong shape."""
    value = evaluated("friction", friction, x)
    if value.shape not in ((), x.shape[1:]):
        raise InputError(
            f"friction: expected a number or {x.shape[1]} values, one for each contact point, got "
            f"shape {value.shape}"
        )
    if not np.all(np.isfinite(value)) or np.any(value < 0):
        raise InputError("friction: must be finite and not negative")
    return np.broadcast_to(value, x.shape[1:]).copy()


def joined(parts: list[Rows]) -> Rows:
    """Concatenate the rows of several boundaries."""
    names, first = dict.fromkeys(rows.functional for rows in parts), parts[0]
    tied = any(rows.bonded.size for rows in parts)
    several: dict[str, Any] = {
        name: np.concatenate([getattr(rows, name) for rows in parts], axis=axis)
        for name, axis in _AXES.items()
    }
    return replace(
        first,
        G=sparse.vstack([rows.G for rows in parts], format="csr"),
        T=sparse.vstack([rows.T for rows in parts], format="csr"),
        functional=",".join(names),
        part=np.repeat(np.arange(len(parts)), [rows.gap.size for rows in parts]),
        bonded=np.concatenate([rows.ties for rows in parts]) if tied else first.bonded,
        **several,
    )


def selected(rows: ContactRows, points: NDArray[np.int64]) -> ContactRows:
    """The rows of some contact points."""
    slips = rows.tangents.shape[1]
    along = (slips * points[:, None] + np.arange(slips)).ravel()
    known = _AXES | {"part": 0, "bonded": 0}
    some: dict[str, Any] = {
        name: np.take(getattr(rows, name), points, axis=axis)
        for name, axis in known.items()
        if getattr(rows, name).size
    }
    return replace(rows, G=rows.G[points], T=rows.T[along], **some)


def check_placement(obstacle: Any, gap: Array, x: Array, n: Array, size: float) -> None:
    """Raise or warn if the position of an obstacle is almost certainly a mistake: no normal meets
    it, most of the boundary is inside it and would be pushed out on the far side, or the overlap
    exceeds the body's `size`."""
    if obstacle is None:
        return
    shape = obstacle.obstacle if isinstance(obstacle, ClosestPoint) else obstacle
    x, n = x.reshape(x.shape[0], -1), n.reshape(n.shape[0], -1)
    if isinstance(shape, Moved):
        (x, n), shape = shape.at_home(x, n), shape.obstacle
    if isinstance(shape, Plane):
        _check_facing(shape, n)
    share = float(np.mean(_within(shape, x, n, size)))
    if share > 0.5:
        remedy = "turn its normal round" if isinstance(shape, Plane) else "change its place or sign"
        if isinstance(shape, Cylinder | Sphere | SurfaceMesh):
            remedy = f"for a hole that the body lies in, {type(shape).__name__}(..., hollow=True)"
            remedy = "hollow=False, for a body around it" if shape.hollow else remedy
        warn(
            f"obstacle: {share:.0%} of the contact boundary lie inside the "
            f"{_name(shape)} and face its surface from within, so that the body is pushed through "
            f"it to the other side; {remedy}"
        )
    elif gap.size and np.all(np.isposinf(gap)):
        if callable(shape):
            warn(
                f"obstacle: no normal of the contact boundary meets the {_name(shape)}, so that "
                "nothing can touch; check its place, or name the part of the boundary that faces "
                "it (ClosestPoint(obstacle) looks beside the normals, too)"
            )
    elif np.median(-gap[np.isfinite(gap)]) > size:
        warn(
            f"obstacle: most of the contact boundary overlaps it by more than {size:.4g}, the "
            "size of the body; a gap is positive where there is one, and a Plane's normal points "
            "towards the body"
        )


def outward_normals(mesh: Mesh, x: Array) -> Array:
    """Outward normals of the boundary facets nearest to places x, (dim, ...)."""
    basis = facet_basis(mesh, mesh.elem(), mesh.boundary_facets(), intorder=1)
    middle = np.asarray(basis.global_coordinates()).mean(axis=2)
    near = scipy.spatial.KDTree(middle.T).query(x.reshape(x.shape[0], -1).T)[1]
    normals: Array = np.asarray(basis.normals).mean(axis=2)[:, near].reshape(x.shape)
    return normals


def _check_facing(plane: Plane, n: Array) -> None:
    normal = np.asarray(plane.normal, dtype=float)
    if np.all(normal @ n >= -1e-12 * np.linalg.norm(normal)):
        turned = tuple(float(0.0 - c) for c in normal)
        raise InputError(
            f"obstacle: no part of the contact boundary faces the plane with normal={plane.normal}"
            f"; a normal points out of the obstacle towards the body: normal={turned}, or another "
            "boundary"
        )


def _within(obstacle: Any, x: Array, n: Array, size: float) -> NDArray[np.bool_]:
    """Points inside the obstacle whose nearest obstacle surface is in the direction of n."""
    if not hasattr(obstacle, "distance"):
        return np.zeros(1, dtype=bool)
    try:
        distance, gradient = obstacle.distance(x)
    except InputError:  # no direction at a centre or where a function is flat
        return np.zeros(1, dtype=bool)
    inside: NDArray[np.bool_] = distance < -1e-9 * size
    return inside & (np.sum(gradient * n, axis=0) > 0)


def _name(obstacle: Any) -> str:
    return type(obstacle).__name__ if hasattr(obstacle, "distance") else "obstacle"


# Contact on a curve that cuts the cells of a mesh: hat functions along the arc as multipliers.
#
# The boundary of a cut domain crosses its cells in pieces of any length; one multiplier per cell
# would violate the inf-sup condition. Instead the arc is divided evenly, its length measured in
# local cell sizes. With hats :math:`N_k \ge 0`, :math:`\sum N_k = 1`,
#
# .. math::
#     u_{n,k} = \frac{1}{w_k} \int N_k \, n \cdot u, \qquad
#     d_k = \frac{1}{w_k} \int N_k \, d, \qquad w_k = \int N_k,
#
# and the multipliers are those of the continuous pressure
# :math:`p = \sum_k (\mu_k / w_k) N_k \ge 0`: a uniform one is exact on any mesh, and
# :math:`|t_k| \le F \mu_k` keeps :math:`|q| \le F p`.
#
# The default distance of hats is 1.5 cells. At 2, 1.5, 1, .75, .5 cells the least eigenvalue of W,
# relative to that on cells a quarter of the size, is .75, .54, .30, .08, .02 for the shear.


def arc_rows(
    arc: CutArc,
    functional: str | None = None,
    direction: Callable[[Array], Array] | None = None,
) -> tuple[ContactRows, ArcGap]:
    """Contact rows of an arc, and the rule that evaluates its gap.
    `direction` as for `contact_boundary`; raises InputError for a functional other than "hat"."""
    if functional not in (None, "hat"):
        raise InputError(f"functional={functional!r}: a cut arc offers 'hat' alone")
    hats, x = hats_along(arc)
    mean = sparse.csr_array(hats @ sparse.diags_array(arc.weights))
    weights = np.asarray(mean.sum(axis=1), dtype=float)
    check_weights(weights, float(arc.weights.sum()), "hat")
    mean = sparse.csr_array(sparse.diags_array(1.0 / weights) @ mean)
    normals = arc.normals if direction is None else direction(arc.x)
    tangents = tangent_frame(normals)[:, 0]
    middle = normals @ mean.T
    middle /= np.linalg.norm(middle, axis=0)
    count = weights.size
    rows = ContactRows(
        _directed(arc, mean, normals),
        _directed(arc, mean, tangents),
        np.full(count, np.inf),
        weights,
        x,
        arc.x @ mean.T,
        middle,
        tangent_frame(middle),
        "hat",
    )
    return rows, ArcGap(arc.x, arc.normals, mean, rows.x_nominal, arc.body.extent, arc.trace)


@dataclass(frozen=True)
class ArcGap:
    """The gap between an arc and an obstacle, averaged by the hats, as `gap_rule.GapRule`."""

    x: Array  # quadrature points, shape (2, n)
    normals: Array  # outward unit normals there, shape (2, n)
    mean: sparse.csr_array  # means of a function weighted by each hat, shape (m, n)
    x_nominal: Array  # shape (2, m)
    size: float  # largest extent of the body
    trace: sparse.csr_array  # scalar functions at the points, (n, scalar dofs)
    source: None = None

    @property
    def order(self) -> NDArray[np.int64]:
        """Order of the multipliers, which are sorted already, shape (m,)."""
        return np.arange(self.mean.shape[0])

    def __call__(self, obstacle: ObstacleLike) -> Array:
        """Gap of every contact point, shape (m,); ``inf`` where there is no obstacle.
        Raises InputError for NaN, minus infinity or a wrong shape."""
        if isinstance(obstacle, np.ndarray | list | tuple):
            return given_gaps(obstacle, self.x_nominal)
        at = evaluate_gap(obstacle, self.x, self.normals)
        at = within_reach(obstacle, at, float(np.abs(at).min(initial=np.inf)), self.size)
        open_ = np.isinf(at)
        gap = self.mean @ np.where(open_, 0.0, at)
        return np.where(self.mean @ open_.astype(float) > 0, np.inf, gap)


def _directed(arc: CutArc, mean: sparse.csr_array, direction: Array) -> sparse.csr_array:
    """Means of ``direction . u`` as rows of all dofs."""
    return interleaved([mean @ sparse.diags_array(v) @ arc.trace for v in direction])


def hats_along(arc: CutArc) -> tuple[sparse.csr_array, Array]:
    """Values of the hats at the points, shape (m, n), and the places of the knots, (2, m)."""
    rows, columns, values, knots, first = [], [], [], [], 0
    for curve in arc.curves:
        # Round a quotient that is an integer up to rounding.
        pieces = max(int(curve.length / arc.spacing + 1e-9), 1)
        count = pieces if curve.closed or curve.length < arc.spacing else pieces + 1
        t = curve.s / curve.length * pieces
        low = np.minimum(t.astype(np.int64), pieces - 1)
        for knot, value in ((low, 1 - (t - low)), (low + 1, t - low)):
            rows.append(first + knot % count)
            columns.append(curve.points)
            values.append(value)
        at = np.arange(count) if count > 1 else np.array([0.5])
        period = float(pieces) if curve.closed else None
        knots.append([np.interp(at, t, arc.x[c, curve.points], period=period) for c in (0, 1)])
        first += count
    place = np.concatenate(rows), np.concatenate(columns)
    hats = sparse.coo_array((np.concatenate(values), place), shape=(first, arc.weights.size))
    return sparse.csr_array(hats), np.hstack(knots)
