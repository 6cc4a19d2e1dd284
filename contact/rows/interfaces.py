"""All pairs of boundaries of several bodies, discretised together.

Two numbers per contact point measure how well the meshes resolve their interface: `risen`, since
straight facets of length h miss a curve of radius R by up to h^2 / 8R on each side, which falsifies
the gap; and `facet_ratio`, since the coarser mesh limits the accuracy of the pressure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.cut_arc import CutArc
from contact.body.rigid_modes import rigid_field
from contact.body.several_bodies import Bodies
from contact.errors import InputError
from contact.obstacles.rigid import ObstacleMotion, Rigid
from contact.obstacles.tool import Tool
from contact.rows.contact_boundaries import ContactBoundaries, friction_values, joined, selected
from contact.rows.contact_rows import ContactRows
from contact.rows.mortar.mortar_rows import Interface, MortarRows, with_clearance
from contact.rows.mortar.sliding_derivative import SlidingDerivative
from contact.rows.outline import Outline, hats
from contact.rows.pairs import Pair, Tie
from contact.rows.tool_rows import RowsInMotion, ToolRows

Array = NDArray[np.float64]
Side = Interface | ContactBoundaries


@dataclass(frozen=True)
class Interfaces:
    """The pairs of a problem of several bodies, with the methods of `ContactBoundaries`."""

    bodies: Bodies
    rows: ContactRows  # of all pairs, one after the other, on the dofs of all bodies
    pairs: tuple[Pair, ...]
    sides: tuple[Side, ...]  # interface of two bodies, or boundary opposite a rigid obstacle
    risen: Array  # `interface_rise`, 0 for ties, obstacles and given clearances, shape (m,)
    facet_ratio: Array  # see `facet_ratio` below, 1 for ties and obstacles, (m,)
    # set by `displaced`, for sliding pairs and tools
    projected: tuple[MortarRows | ToolRows | None, ...] = ()

    def __repr__(self) -> str:
        return f"Interfaces({len(self.pairs)} pairs, {self.rows.gap.size} points)"

    @classmethod
    def of(cls, bodies: Bodies, pairs: Sequence[Pair]) -> Interfaces:
        """Discretise the pairs.
        Raises InputError for an unknown body, or boundaries that share facets."""
        _refuse_shared(bodies, pairs)
        sides: list[Side] = []
        parts, risen, ratios = [], [], []
        for pair in pairs:
            if pair.two_bodies:
                with _said_of(bodies, pair):
                    interface = _interface(pair)
                    found = interface.rows()
                size, tied = found.rows.gap.size, isinstance(pair, Tie)
                outlines, known = (interface.first, interface.second), tied
                if pair.opposite.clearance is not None:
                    found, known = with_clearance(found, pair.opposite.clearance), True
                rows = _of_two(bodies, interface, found)
                parts.append(_bonded(rows, pair) if tied else rows)
                sides.append(interface)
                risen.append(np.zeros(size) if known else interface_rise(*outlines, found))
                ratios.append(np.ones(size) if tied else facet_ratio(*outlines, found))
            else:
                side = ContactBoundaries.of(
                    pair.body.trace, pair.boundary, pair.opposite, pair.functional
                )
                k = bodies.number_of(pair.body)
                G, T = (bodies.embedded(k, part) for part in (side.rows.G, side.rows.T))
                parts.append(_owned(pair.body.trace, side.rows, k, G, T))
                sides.append(side)
                risen.append(np.zeros(side.rows.gap.size))
                ratios.append(np.ones(side.rows.gap.size))
        extra = np.concatenate(risen), np.concatenate(ratios)
        return cls(bodies, joined(parts), tuple(pairs), tuple(sides), *extra)

    @classmethod
    def of_obstacles(cls, body: Any, boundaries: ContactBoundaries, obstacle: Any) -> Interfaces:
        """The boundaries of one body opposite rigid obstacles, as pairs."""
        bodies, sides = Bodies([body]), boundaries.alone
        each = obstacle if boundaries.several else [obstacle]
        pairs = tuple(Pair(body, None, o) for o in each)
        parts = [
            _owned(side.body, side.rows, 0, body.embed(side.rows.G), body.embed(side.rows.T))
            for side in sides
        ]
        size = boundaries.rows.gap.size
        return cls(bodies, joined(parts), pairs, sides, np.zeros(size), np.ones(size))

    def displaced(
        self, u: Array, tools: Sequence[Tool | None] = (), last: Array | None = None
    ) -> Interfaces:
        """The same pairs projected at displacement u, with the gap between the reference positions.
        `tools` are those opposite the sides, `last` (ndofs,) the displacement of the last step.
        Raises InputError where no facet of a pair faces another one any longer."""
        parts, projected = [], list[MortarRows | ToolRows | None]()
        each = zip(self.pairs, self.sides, self.points, tools or self.pairs, strict=True)
        for pair, side, own, tool in each:
            if isinstance(side, ContactBoundaries) and isinstance(tool, Tool) and last is not None:
                k = self.bodies.number_of_trace(side.body)
                mine = self.bodies.slices[k]
                touched = ToolRows.of(side.points, side.rows, tool, u[mine], last[mine])
                G, T = (self.bodies.embedded(k, v) for v in (touched.rows.G, touched.rows.T))
                parts.append(_owned(side.body, touched.rows, k, G, T))
                projected.append(touched)
                continue
            if isinstance(side, ContactBoundaries) or isinstance(pair, Tie):
                parts.append(selected(self.rows, own))
                projected.append(None)
                continue
            one, two = (
                u[self.bodies.slices[self.bodies.number_of_trace(outline.body)]]
                for outline in side.outlines
            )
            found = side.displaced(one, two)
            parts.append(_of_two(self.bodies, side, found))
            projected.append(found)
        return replace(self, rows=joined(parts), projected=tuple(projected))

    def in_motion(
        self, u: Array, last: Array, mu: Array, t: Array, opposites: Sequence[Any]
    ) -> RowsInMotion | None:
        """Derivatives of the rows of `displaced` at u; None if there are other contact points.
        `last` is the displacement of the last step; mu (m,) and t (m, dim - 1) are contact
        forces."""
        if self.rows.gap.size != mu.size:
            return None
        parts, total = [], self.bodies.slices[-1].stop
        each = zip(self.sides, self.projected, opposites, self.points, strict=True)
        for side, found, o, own in each:
            k = self.rows.axes.shape[1] * (self.rows.axes.shape[1] + 1) // 2
            still = RowsInMotion.still(own.size, self.rows, total, k * isinstance(o, Rigid))
            if isinstance(side, ContactBoundaries):
                if isinstance(found, ToolRows):
                    d = found.derivative(mu[own], t[own])
                    d = d if isinstance(o, Rigid) else d.alone
                    still = d.among(total, [self._own(side.body)])
            elif isinstance(found, MortarRows):
                mine = [self._own(outline.body) for outline in side.outlines]
                now, was = ((v[mine[0]], v[mine[1]]) for v in (u, last))
                since = now[0] - was[0], now[1] - was[1]
                b = SlidingDerivative.of(side, found, now, since, (mu[own], t[own]))
                n = b.normal.shape[1]
                still = RowsInMotion.still(own.size, self.rows, n, 0)
                still = replace(
                    still, normal=b.normal, tangential=b.tangential, force=b.force
                ).among(total, mine)
            parts.append(still)
        return RowsInMotion.joined(parts)

    def _own(self, trace: Any) -> slice:
        """Slice of the dofs of a body."""
        return self.bodies.slices[self.bodies.number_of_trace(trace)]

    @property
    def boundary_dofs(self) -> sparse.csr_array:
        """Row with nonzeros at the dofs of the facets on all sides of the pairs, (1, ndofs)."""
        seen = np.zeros(self.bodies.slices[-1].stop)
        for side in self.sides:
            if isinstance(side, ContactBoundaries):
                read = [(side.body, np.unique(side.points.N.indices))]
            else:
                read = [(o.body, np.unique(o.scalar_dofs)) for o in side.outlines]
            for body, scalar in read:
                start = self.bodies.slices[self.bodies.number_of_trace(body)].start
                for c in range(body.dim):
                    seen[start + body.dim * scalar + c] = 1.0
        return sparse.csr_array(seen[None])

    @property
    def points(self) -> list[NDArray[np.int64]]:
        """Slices of the contact points of each pair."""
        return np.split(np.arange(self.rows.gap.size), np.cumsum(self._sizes)[:-1])

    @property
    def _sizes(self) -> NDArray[np.int64]:
        return np.bincount(self.rows.part, minlength=len(self.pairs))

    def _of_each(self, values: Array) -> list[Array]:
        """Values at all contact points, their last axis split by pair."""
        return np.split(values, np.cumsum(self._sizes)[:-1], axis=-1)

    def gap(self, opposites: Sequence[Any]) -> Array:
        """Gap of every contact point, shape (m,); only rigid `opposites` are evaluated."""
        return self._read(ContactBoundaries.gap, opposites, self.rows.gap)

    def rise(self, opposites: Sequence[Any]) -> Array:
        """Gap from the curve that straight facets approximate minus the gap from them, (m,)."""
        return self._read(ContactBoundaries.rise, opposites, self.risen)

    def _read(
        self, read: Callable[[ContactBoundaries, Any], Array], opposites: Any, known: Array
    ) -> Array:
        """Values at every contact point: `known` between bodies, evaluated by `read` at
        obstacles."""
        each = zip(opposites, self._kept, self._of_each(known), strict=True)
        return np.concatenate([own if side is None else read(side, o) for o, side, own in each])

    @property
    def _kept(self) -> list[ContactBoundaries | None]:
        """Sides opposite rigid obstacles whose rows are those at rest; None for others."""
        projected = self.projected or [None] * len(self.sides)
        each = zip(self.sides, projected, strict=True)
        return [
            s if isinstance(s, ContactBoundaries) and found is None else None for s, found in each
        ]

    def travel(
        self,
        before: Any,
        now: Sequence[Any],
        said: Any,
        *,
        unchanged: NDArray[np.bool_],
        felt: Array,
        first: bool = False,
    ) -> Array:
        """Tangential path of rigid obstacles in a step; see `ContactBoundaries.travel`."""
        none, count = [None] * len(self.sides), len(self.sides)
        if said is not None and not (isinstance(said, list | tuple) and len(said) == count):
            raise InputError(f"motion: expected a list of {count}, one for each pair, or None")
        known = isinstance(before, list | tuple) and len(before) == count
        was = before if known else none
        each = zip(self._kept, was, now, said or none, self.points, strict=True)
        paths = []
        for number, (side, last, o, own, at) in enumerate(each):
            if side is not None:
                still, rubs = unchanged[at], felt[at]
                with _said_of(self.bodies, self.pairs[number]):
                    path = side.travel(last, o, own, unchanged=still, felt=rubs, first=first)
                paths.append(path)
            else:
                paths.append(np.zeros((at.size, self.rows.tangents.shape[1])))
        return np.concatenate(paths)

    def motion(self, opposites: Sequence[Any]) -> ObstacleMotion | None:
        """The motions of the `Rigid` obstacles; None if there are none."""
        m, slips = self.rows.gap.size, self.rows.tangents.shape[1]
        start, found = 0, []
        projected = self.projected or [None] * len(self.sides)
        for o, side, found_of, size in zip(
            opposites, self.sides, projected, self._sizes, strict=True
        ):
            own = side.motion(o) if isinstance(side, ContactBoundaries) else None
            if own is not None and isinstance(found_of, ToolRows):
                own = replace(own, normal=found_of.normal, tangent=found_of.tangent)
            if own is not None:
                normal = np.zeros((m, own.normal.shape[1]))
                tangent = np.zeros((m * slips, own.normal.shape[1]))
                normal[start : start + size] = own.normal
                tangent[slips * start : slips * (start + size)] = own.tangent
                found.append(replace(own, normal=normal, tangent=tangent))
            start += size
        return ObstacleMotion.of_all(found)

    def friction(self, given: Any) -> Array:
        """Coefficient or bound of every contact point, shape (m,), for all pairs or one for each.
        None uses the friction of each pair. Raises InputError for invalid values."""
        if given is None:
            each = [pair.friction for pair in self.pairs]
        elif isinstance(given, list | tuple):
            if len(given) != len(self.pairs):
                raise InputError(f"friction: {len(given)} given for {len(self.pairs)} pairs")
            each = list(given)
        elif isinstance(given, np.ndarray) and given.ndim:
            return friction_values(given, self.rows.x)
        else:
            each = [0.0 if isinstance(pair, Tie) else given for pair in self.pairs]
        places = self._of_each(self.rows.x)
        return np.concatenate([friction_values(f, x) for f, x in zip(each, places, strict=True)])


@contextmanager
def _said_of(bodies: Bodies, pair: Pair) -> Iterator[None]:
    """Context in which errors name the bodies of the pair, and the side as the caller named it."""
    try:
        yield
    except InputError as error:
        sides = [pair.body, *([pair.opposite.body] if pair.two_bodies else [])]
        names = dict.fromkeys(bodies.called(bodies.number_of(body)) for body in sides)
        said = str(error).replace("others:", "opposite:", 1)
        whose = f"the {type(pair).__name__} of {' and '.join(names)}"
        raise InputError(f"{said} ({whose})") from error


def _interface(pair: Pair) -> Interface:
    if isinstance(pair.boundary, CutArc):
        raise InputError(
            "boundary: the arc of a CutBody touches rigid obstacles; two elastic bodies touch each "
            "other along facets"
        )
    first, facets = pair.body, pair.body.trace.whole_facets(pair.boundary)
    second, others = pair.opposite.body, pair.opposite.facets
    if pair.multipliers == "second":
        first, facets, second, others = second, others, first, facets
    tied, functional = isinstance(pair, Tie), pair.functional
    if functional is None and tied and first.dim == 2:
        functional = "standard"  # in space the degree is not reduced at fixed edges
    return Interface.of(first.trace, facets, second.trace, others, functional, tied)


def _of_two(bodies: Bodies, interface: Interface, found: MortarRows) -> ContactRows:
    """Rows of an interface on the dofs of all bodies."""
    own, first, second = found.rows, interface.first.body, interface.second.body
    i, k = (bodies.number_of_trace(body) for body in (first, second))
    G = bodies.embedded(i, own.G) + bodies.embedded(k, found.other_G)
    T = bodies.embedded(i, own.T) + bodies.embedded(k, found.other_T)
    return _owned(first, own, i, G, T)


def _bonded(rows: ContactRows, pair: Pair) -> ContactRows:
    """Rows of tied boundaries: a measured gap is kept, a given clearance is closed."""
    gap = rows.gap if pair.opposite.clearance is not None else np.zeros(rows.gap.size)
    return replace(rows, gap=gap, bonded=np.ones(rows.gap.size, dtype=bool))


def _owned(
    trace: Any, rows: ContactRows, k: int, G: sparse.csr_array, T: sparse.csr_array
) -> ContactRows:
    """Rows of one body's trace, with G and T on the dofs of all bodies."""
    m, dim = rows.gap.size, trace.dim
    shifts = rigid_field(trace, np.zeros(dim))[:, :dim]
    axes = np.concatenate(
        ((rows.G @ shifts)[:, None], (rows.T @ shifts).reshape(m, dim - 1, dim)), axis=1
    )
    owner = np.full(m, k, dtype=np.int64)
    return replace(rows, G=sparse.csr_array(G), T=sparse.csr_array(T), owner=owner, axes=axes)


def _refuse_shared(bodies: Bodies, pairs: Sequence[Pair]) -> None:
    """Raise if a facet carries the multipliers of two pairs, or faces itself."""
    taken: dict[int, list[NDArray[np.int64]]] = {}
    faced: dict[int, list[NDArray[np.int64]]] = {}
    for pair in pairs:
        arc = isinstance(pair.boundary, CutArc)
        # Points of arcs have negative numbers, facets non-negative ones.
        with _said_of(bodies, pair):
            own = -1 - pair.boundary.index if arc else pair.body.trace.whole_facets(pair.boundary)
        sides = [(pair.body, own)]
        if pair.two_bodies:
            sides.append((pair.opposite.body, pair.opposite.facets))
        if pair.multipliers == "second":
            sides.reverse()
        for (body, facets), where in zip(sides, (taken, faced), strict=False):
            where.setdefault(bodies.number_of(body), []).append(facets)
    for k, own in taken.items():
        # A facet may face several others but carry only one set of multipliers.
        seen, counts = np.unique(np.concatenate(own), return_counts=True)
        opposite = np.unique(np.concatenate(faced.get(k, [np.zeros(0, dtype=np.int64)])))
        twice = np.union1d(seen[counts > 1], np.intersect1d(seen, opposite))
        if twice.size:
            number = int(twice[0])
            place = f"facet {number}" if number >= 0 else f"point {-1 - number} of the curve"
            raise InputError(
                f"boundary: {place} of {bodies.called(k)} belongs to two pairs, or to both sides "
                "of one"
            )


def interface_rise(first: Outline, second: Outline, found: MortarRows) -> Array:
    """Gap between the curves that straight facets approximate minus the measured gap, (m,)."""
    q = found.quadrature
    raised = _heights(first, q.facet, q.x, q.X) + _heights(second, q.other, q.y, q.Y)
    return np.asarray(-(found.P @ raised))


def facet_ratio(first: Outline, second: Outline, found: MortarRows) -> Array:
    """Largest length ratio, at least 1, of two facets that face at a contact point, (m,)."""
    own, other = (
        facet_lengths(first)[found.quadrature.facet],
        facet_lengths(second)[found.quadrature.other],
    )
    ratio, P = np.maximum(own / other, other / own), found.P
    largest = np.ones(P.shape[0])
    point = np.repeat(np.arange(P.shape[0]), np.diff(P.indptr))
    np.maximum.at(largest, point, ratio[P.indices])
    return largest


def _heights(outline: Outline, facet: NDArray[np.int64], x: Array, X: Array) -> Array:
    """Height of the smooth curve above points on facets, see `Outline.raised`."""
    corner = outline.body.mesh.p[:, outline.corners]
    change = outline.turned - outline.at_corners
    off = np.sum(change[:, facet] * (x[:, :, None] - corner[:, facet]), axis=0)
    height = -0.5 * np.sum(off * hats(X, corner.shape[2]).T, axis=1)
    return np.where(outline.bent[facet], height, 0.0)


def facet_lengths(outline: Outline) -> Array:
    """Mean length of the sides of each facet."""
    corner = outline.body.mesh.p[:, outline.corners]
    sides = np.roll(corner, -1, axis=2) - corner
    return np.asarray(np.linalg.norm(sides, axis=0).mean(axis=1))
