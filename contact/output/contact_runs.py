"""The contact boundary of a result as connected runs of facets, and arc lengths (2-D)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import NDArray

from contact.body.cut_body import CutBody
from contact.output.drawn import Drawn, side

if TYPE_CHECKING:
    from skfem import Mesh

Array = NDArray[np.float64]
Index = NDArray[np.int64]
_PIECES = 16  # straight pieces per curved facet
_FACING = 0.1  # least cosine between the normals of a point and of its facet


@dataclass(frozen=True)
class Run:
    """Contact points that follow one another along the boundary."""

    points: Index  # contact points in order along the boundary, shape (n,)
    s: Array  # arc length of each point along the run, shape (n,)
    length: float  # length of the run's facets, or between the end knots of a cut arc
    closed: bool  # the first point follows the last one


def arc_length(result: Drawn, runs: list[Run] | None = None) -> tuple[Array, Index]:
    """Arc length of each contact point along the boundary (2-D), and its connected run, (m,).
    Measured from the start of the boundary; each run continues the lengths of the one before, a
    closed one starts at the facet of its first point."""
    s, number = np.zeros(result.mu.size), np.zeros(result.mu.size, dtype=np.int64)
    begin = 0.0
    for k, run in enumerate(contact_runs(result) if runs is None else runs):
        s[run.points], number[run.points] = begin + run.s, k
        begin += run.length
    return s, number


def contact_runs(result: Drawn) -> list[Run]:
    """The connected runs of the contact points of a result in two dimensions."""
    runs: list[Run] = []
    for k in range(int(result.part.max()) + 1):
        here = np.flatnonzero(result.part == k)
        cut = isinstance(side(result, here).body, CutBody)
        runs += _runs_of_arc(result, here) if cut else _runs_of_facets(result, here)
    return runs


def _runs_of_arc(result: Drawn, here: Index) -> list[Run]:
    """Runs of a cut arc: its knots in order along each of its curves."""
    arc, x = side(result, here).body.arc(), result.x[:, here]
    owner = np.empty(arc.weights.size, dtype=np.int64)
    for k, curve in enumerate(arc.curves):
        owner[curve.points] = k
    own = owner[scipy.spatial.KDTree(arc.x.T).query(x.T)[1]]
    runs = []
    for k in dict.fromkeys(own.tolist()):
        mine = np.flatnonzero(own == k)
        steps = np.r_[0.0, np.linalg.norm(np.diff(x[:, mine], axis=1), axis=0)]
        # The whole closed curve, up to rounding of its weights.
        taken = result.system.rows.weights[here[mine]].sum()
        whole = taken > (1 - 1e-9) * arc.weights[arc.curves[k].points].sum()
        closed = bool(arc.curves[k].closed and whole)
        runs.append(Run(here[mine], np.cumsum(steps), float(steps.sum()), closed))
    return runs


def _runs_of_facets(result: Drawn, here: Index) -> list[Run]:
    x, nominal, rows = result.x[:, here], result.x_nominal[:, here], result.system.rows
    own = side(result, here)
    vertex = _vertices(own.trace, own.G) if "centroid" in rows.functional else None
    lines = _lines(own.mesh, nominal, rows.normals[:, here], vertex)
    nearest = np.argmin([line.project(nominal)[1] for line in lines], axis=0)
    runs = []
    for j in dict.fromkeys(nearest.tolist()):  # in the order of the contact points
        mine, line = np.flatnonzero(nearest == j), lines[j]
        s = line.along(x[:, mine], nominal[:, mine])
        order = np.argsort(line.along(*(nominal[:, mine],) * 2), kind="stable")
        runs.append(Run(here[mine[order]], s[order], line.length, line.closed))
    return runs


def _vertices(trace: Any, G: Any) -> Index | None:
    """The vertex of each point, if every point belongs to a single vertex."""
    dofs = trace.scalar_dofs.nodal_dofs[0]
    size = sum(abs(G[:, trace.dim * dofs + c]) for c in range(trace.dim))
    vertex = np.asarray(size.argmax(axis=1)).ravel()
    return vertex if np.unique(vertex).size == vertex.size else None


@dataclass(frozen=True)
class _Line:
    """A polyline; `starts` are the arc lengths at which facets begin."""

    points: Array
    starts: Array
    closed: bool

    @property
    def steps(self) -> Array:
        return np.asarray(np.linalg.norm(np.diff(self.points, axis=1), axis=0))

    @property
    def length(self) -> float:
        return float(self.steps.sum())

    def project(self, x: Array) -> tuple[Array, Array]:
        """Arc length of the nearest point of the line, and the distance to it."""
        a, way, size = self.points[:, :-1], np.diff(self.points, axis=1), self.steps
        before = np.cumsum(size) - size
        place, away = np.empty(x.shape[1]), np.empty(x.shape[1])
        for i in range(x.shape[1]):
            t = np.clip(np.sum((x[:, i : i + 1] - a) * way, axis=0) / size**2, 0.0, 1.0)
            far = np.linalg.norm(a + t * way - x[:, i : i + 1], axis=0)
            j = int(np.argmin(far))
            place[i], away[i] = before[j] + t[j] * size[j], far[j]
        return place, away

    def along(self, x: Array, nominal: Array) -> Array:
        """Arc lengths of x, in the order of the nominal places."""
        length, starts = self.length, self.starts
        place, order = self.project(x)[0], self.project(nominal)[0]
        if np.sum(np.sign(np.diff(order))) < 0:
            place, order = length - place, length - order
            starts = length - np.r_[starts[1:], length]
        if not self.closed:
            return place
        slack = 1e-9 * length
        first = starts[starts <= order[0] + slack].max(initial=0.0)
        turned = np.mod(order - first + slack, length) - slack
        aside = np.mod(place - order + 0.5 * length, length) - 0.5 * length
        return np.clip(turned + aside, 0.0, length)


def _lines(mesh: Mesh, nominal: Array, normals: Array, vertex: Index | None) -> list[_Line]:
    """The runs of the facets that the contact points belong to.
    Points that belong to a `vertex` each may lie off the facets between them."""
    facets = mesh.boundary_facets()
    s = np.linspace(0.0, 1.0, _PIECES + 1)[None]
    curve = np.asarray(mesh.mapping().G(s, find=facets))
    chord = curve[:, :, -1] - curve[:, :, 0]
    size = np.linalg.norm(chord, axis=0)
    outward = np.array([chord[1], -chord[0]]) / size
    inside = mesh.p[:, mesh.t[:, mesh.f2t[0, facets]]].mean(axis=1)
    outward *= np.sign(np.sum(outward * (curve[:, :, 0] - inside), axis=0))
    ends = mesh.facets[:, facets]
    if vertex is None:
        chosen = _met(curve, outward, nominal, normals)
    else:
        normal, of_point = np.zeros((2, mesh.nvertices)), np.zeros(mesh.nvertices, dtype=bool)
        normal[:, vertex], of_point[vertex] = normals, True
        facing = np.einsum("df,def->ef", outward, normal[:, ends]) > _FACING
        chosen = np.all(of_point[ends] & facing, axis=0)
    return _chained(curve[:, chosen], ends[:, chosen])


def _met(curve: Array, outward: Array, nominal: Array, normals: Array) -> NDArray[np.bool_]:
    """Facets with a point inside, or points at both ends."""
    size = np.linalg.norm(curve[:, :, -1] - curve[:, :, 0], axis=0)
    touched = np.zeros((size.size, 2), dtype=bool)
    within = np.zeros(size.size, dtype=bool)
    near_end = 1e-2  # relative to the facet: points this near to its end belong to the vertex
    for x, n in zip(nominal.T, normals.T, strict=True):
        to = x[:, None, None] - curve
        far = np.sqrt(np.min(np.sum(to * to, axis=0), axis=1))
        facing = n @ outward > _FACING
        near = np.flatnonzero((far < size / _PIECES) & facing)
        for f in near:
            line = _Line(curve[:, f], np.zeros(1), False)
            place, away = (float(v[0]) for v in line.project(x[:, None]))
            if away > near_end * size[f]:
                continue
            touched[f, 0] |= place < near_end * line.length
            touched[f, 1] |= place > (1 - near_end) * line.length
            within[f] |= near_end * line.length < place < (1 - near_end) * line.length
    return np.asarray(within | touched.all(axis=1))


def _chained(curve: Array, ends: Index) -> list[_Line]:
    """Facets sorted into chains."""
    at: dict[int, list[int]] = {}
    for f, pair in enumerate(ends.T.tolist()):
        for v in pair:
            at.setdefault(v, []).append(f)
    left, lines = set(range(ends.shape[1])), []
    loose = [v for v, around in at.items() if len(around) == 1]
    while left:
        vertex = next((v for v in loose if at[v][0] in left), int(ends[0, min(left)]))
        begin, pieces = vertex, []
        while ahead := [f for f in at[vertex] if f in left]:
            left.discard(ahead[0])
            forward = ends[0, ahead[0]] == vertex
            pieces.append(curve[:, ahead[0], :: 1 if forward else -1])
            vertex = int(ends[1 if forward else 0, ahead[0]])
        sizes = [np.linalg.norm(np.diff(piece, axis=1), axis=0).sum() for piece in pieces]
        joined = np.hstack([pieces[0][:, :1], *(piece[:, 1:] for piece in pieces)])
        lines.append(_Line(joined, np.cumsum(sizes) - sizes, vertex == begin))
    return lines
