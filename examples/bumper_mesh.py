"""Curved mesh of a D-shaped rubber bumper, written as a Gmsh file with physical names.

The part is the cross-section of a moulded machine buffer, in mm, symmetric about x = 0, its lowest
point the origin. Every joint but the two corners of the mount is tangent-continuous.

- ``mount``: y = 50, |x| <= 30, bonded to the bolted base plate;
- ``flank``: foot 8 thick, its corners R2, fillet R3, 5 degrees of draft, sides of the nose;
- ``contact``: the arc of the nose, R22 about (0, 22), within 60 degrees of its lowest point;
- ``bore``: R10 about the same centre; ``rubber``: all triangles.

Lines and arcs are divided in proportion to a size function h(p), so the boundary nodes lie on the
outline itself and never move. The interior nodes come from DistMesh (P.-O. Persson and G. Strang,
A simple mesh generator in MATLAB, SIAM Review 46, 2004): the edges of a Delaunay triangulation
are springs with a rest length l0 in proportion to h that only push, and the nodes follow the force

    F(p) = sum over edges (p, q) of max(l0 - |p - q|, 0) (p - q) / |p - q|.

The triangles are of second order: an edge on the outline has its middle node on the line or arc,
halfway along it, every other edge on its chord. Straight edges would make an arc a polygon, whose
corners show as a zigzag of a few per cent in the contact pressure.

A point (x, y) is the complex number x + iy up to the finished mesh.
"""

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import meshio
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, cKDTree
from skfem import MeshTri, MeshTri2

Array = NDArray[np.float64]
Points = NDArray[np.complex128]
Indices = NDArray[np.int64]
SizeFunction = Callable[[Points], Array]
# A line or arc, the body on its left: physical name, length, points at s in [0, 1].
Curve = tuple[str, float, Callable[[Array], Points]]

HALF_WIDTH, HEIGHT, SHOULDER = 30.0, 50.0, 42.0  # the foot is 50 - 42 = 8 thick
NOSE_RADIUS, BORE_RADIUS, FILLET_RADIUS, FOOT_RADIUS = 22.0, 10.0, 3.0, 2.0
DRAFT, CONTACT_ANGLE = np.deg2rad(5.0), np.deg2rad(60.0)
# The flank is the tangent n . (p - c) = R of the nose, n = exp(-i a) with the draft a; the fillet
# between it and the shoulder has its centre on n . (p - c) = R + r.
CENTRE, NORMAL, KNEE = 1j * NOSE_RADIUS, np.exp(-1j * DRAFT), CONTACT_ANGLE - np.pi / 2
_UP = SHOULDER - FILLET_RADIUS - NOSE_RADIUS  # from the centre of the nose to that of the fillet
FILLET = CENTRE + 1j * _UP + (NOSE_RADIUS + FILLET_RADIUS - NORMAL.imag * _UP) / NORMAL.real
CORNER = HALF_WIDTH - FOOT_RADIUS + 1j * (SHOULDER + FOOT_RADIUS)
ROUND = CORNER + FOOT_RADIUS * np.exp(-0.25j * np.pi)  # the middle of the corner's arc

GRADING = 0.15  # growth of h with the distance from a refined arc
SIZE_LIMITS, MIN_ANGLE = (0.4, 4.0), 20.0  # mm (about 31,000 and 900 triangles), degrees


def _line(name: str, a: complex, b: complex) -> Curve:
    return name, abs(b - a), lambda s: (1 - s) * a + s * b


def _arc(name: str, centre: complex, radius: float, start: float, end: float) -> Curve:
    def at(s: Array) -> Points:
        return np.asarray(centre + radius * np.exp(1j * ((1 - s) * start + s * end)))

    return name, radius * abs(end - start), at


def _mirrored(name: str, length: float, at: Callable[[Array], Points]) -> Curve:
    return name, length, lambda s: -at(1 - s).conj()


def outline() -> list[list[Curve]]:
    """Closed loops of the outline: the outer one anticlockwise from (0, 0), the bore clockwise."""
    right = [
        _arc("contact", CENTRE, NOSE_RADIUS, -np.pi / 2, KNEE),
        _arc("flank", CENTRE, NOSE_RADIUS, KNEE, -DRAFT),
        _line("flank", CENTRE + NOSE_RADIUS * NORMAL, FILLET - FILLET_RADIUS * NORMAL),
        _arc("flank", FILLET, FILLET_RADIUS, np.pi - DRAFT, np.pi / 2),
        _line("flank", FILLET.real + 1j * SHOULDER, CORNER.real + 1j * SHOULDER),
        _arc("flank", CORNER, FOOT_RADIUS, -np.pi / 2, 0.0),
        _line("flank", HALF_WIDTH + 1j * CORNER.imag, HALF_WIDTH + 1j * HEIGHT),
        _line("mount", HALF_WIDTH + 1j * HEIGHT, 1j * HEIGHT),
    ]
    left = [_mirrored(*curve) for curve in reversed(right)]
    bore = _arc("bore", CENTRE, BORE_RADIUS, -np.pi / 2, -5 * np.pi / 2)
    return [right + left, [bore]]


def _size_at(p: Points, size: float) -> Array:
    """h(p) = min(size, size f_k + GRADING dist(p, arc k)), f the fraction of size on the arc."""
    right, radius = abs(p.real) + 1j * p.imag, abs(p - CENTRE)
    above = p.imag - NOSE_RADIUS * (1 + np.sin(KNEE))  # the ends of the contact arc
    contact = size * 0.3 + GRADING * np.maximum(abs(radius - NOSE_RADIUS), above)
    bore = size * 0.45 + GRADING * abs(radius - BORE_RADIUS)
    fillet = size * 0.3 + GRADING * abs(abs(right - FILLET) - FILLET_RADIUS)
    corner = size * 0.3 + GRADING * abs(right - ROUND)
    return np.asarray(np.minimum(size, np.min([contact, bore, fillet, corner], axis=0)))


def _xy(points: Points) -> Array:
    return np.column_stack([points.real, points.imag])


def _boundary(h: SizeFunction) -> tuple[Points, Points, Indices, NDArray[np.str_]]:
    """Nodes of the outline; the middle, end node and physical name of the edge from each."""
    points, middles, s = list[Points](), list[Points](), np.linspace(0, 1, 2001)
    after, names = list[int](), list[str]()
    for loop in outline():
        first = len(names)
        for name, length, at in loop:
            per_edge = length / 2000 / h(at((s[1:] + s[:-1]) / 2))
            count = np.concatenate([[0.0], np.cumsum(per_edge)])
            n = max(1, round(count[-1]))
            knots = np.interp(np.arange(n + 1) * count[-1] / n, count, s)
            points.append(at(knots[:-1]))
            middles.append(at((knots[:-1] + knots[1:]) / 2))
            names += [name] * n
        after += [*range(first + 1, len(names)), first]
    return np.concatenate(points), np.concatenate(middles), np.array(after), np.array(names)


def _relaxed(fixed: Points, after: Indices, h: SizeFunction, seed: int) -> tuple[Points, Indices]:
    """DistMesh nodes, the fixed ones first, and triangles, anticlockwise."""
    tree, n = cKDTree(_xy(fixed)), len(fixed)
    chord = fixed[after] - fixed
    normal = -1j * (chord + chord[np.argsort(after)])  # of the edges from and to the node
    normal /= abs(normal)

    def depth(points: Points) -> Array:  # below the tangent at the nearest node, > 0 in the body
        near = tree.query(_xy(points))[1]
        return ((fixed[near] - points) * normal[near].conj()).real

    def triangles(points: Points) -> Indices:
        t = Delaunay(_xy(points)).simplices.astype(np.int64)  # anticlockwise
        inside = depth(points[t].mean(axis=1)) > 1e-9
        return t[inside | (t >= n).any(axis=1)]  # boundary nodes alone can span the outside

    # Start: a triangular lattice of the finest spacing, kept with probability (spacing / h)^2.
    spacing = h(fixed).min()
    j, i = np.mgrid[: 2 * HALF_WIDTH / spacing, : 2 * HALF_WIDTH / spacing].reshape(2, -1)
    p = spacing * (i + j % 2 / 2 + 1j * np.sqrt(0.75) * j) - HALF_WIDTH
    kept = np.random.default_rng(seed).random(len(p)) < (spacing / h(p)) ** 2
    p = np.concatenate([fixed, p[kept & (depth(p) > 0.7 * h(p))]])
    for step in range(80):
        t = triangles(p)
        ends = np.sort(t[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2))
        a, b = np.divmod(np.unique(ends @ [len(p), 1]), len(p))
        vector = p[a] - p[b]
        length = abs(vector)
        rest = (h(p)[a] + h(p)[b]) / 2
        rest *= 1.2 * np.sqrt(np.sum(length**2) / np.sum(rest**2))  # 1.2 keeps the springs pushing
        push = np.maximum(rest - length, 0) * vector / length
        force = np.zeros_like(p)
        np.add.at(force, np.array([a, b]), np.array([push, -push]))
        p[n:] += 0.2 * force[n:]
        drop = depth(p) < 0.4 * h(p)  # come to the outline or beyond
        drop[b[(rest > 2 * length) & (step in (9, 19, 29, 39))]] = True  # crowded; b > a is inner
        p = p[~drop | (np.arange(len(p)) < n)]
    return p, triangles(p)


def smallest_angle(mesh: MeshTri) -> float:
    """Smallest angle of the triangles between their corners, in degrees."""
    a, b, c = (mesh.p[0] + 1j * mesh.p[1])[mesh.t]
    quotients = np.array([(c - a) / (b - a), (a - b) / (c - b), (b - c) / (a - c)])
    return float(np.rad2deg(np.abs(np.angle(quotients)).min()))


def bumper_mesh(size: float = 1.0, seed: int = 0) -> MeshTri2:
    """Unstructured curved mesh of the bumper, finer at the contact arc, the bore and the fillets.

    Parameters
    ----------
    size
        Edge length in mm where nothing is refined, .4 to 4; the contact arc gets .3 of it.
    seed
        Seed of the random choice of the starting nodes.

    Returns
    -------
    MeshTri2
        Boundaries ``mount``, ``flank``, ``contact``, ``bore``, subdomain ``rubber``. Triangles are
        anticlockwise; the corners on the boundary come first, in the order of the outline.

    Raises
    ------
    ValueError
        If the size is not a number within its limits.
    RuntimeError
        If the triangulation lost a boundary edge, has an angle below 20 degrees, or folds.
    """
    if not SIZE_LIMITS[0] <= size <= SIZE_LIMITS[1]:
        raise ValueError(f"size: {size} mm given, expected {SIZE_LIMITS[0]} to {SIZE_LIMITS[1]} mm")
    h = partial(_size_at, size=float(size))
    fixed, outline_middles, after, names = _boundary(h)
    p, t = _relaxed(fixed, after, h, seed)
    straight = MeshTri(np.array([p.real, p.imag]), np.ascontiguousarray(t.T), sort_t=False)
    facet = {tuple(straight.facets[:, i]): i for i in straight.boundary_facets()}
    wanted = [tuple(sorted(edge)) for edge in enumerate(after)]
    angle, euler = smallest_angle(straight), len(p) - straight.nfacets + len(t)  # 0 with one hole
    if set(facet) != set(wanted) or euler != 0 or angle < MIN_ANGLE:
        raise RuntimeError(f"mesh rejected, smallest angle {angle:.1f} degrees: try another seed")
    facets = np.array([facet[edge] for edge in wanted])
    middles = p[straight.facets].mean(axis=0)
    middles[facets] = outline_middles
    nodes = np.concatenate([p, middles])
    mesh = MeshTri2(np.array([nodes.real, nodes.imag]), straight.t)
    # With one curved edge the Jacobian determinant is linear, so its corner values bound it.
    if mesh.mapping().detDF(mesh.elem.refdom.p).min() <= 0:
        raise RuntimeError("mesh rejected, a curved edge folds its triangle: try another seed")
    sets = {name: facets[names == name] for name in ("mount", "flank", "contact", "bore")}
    return mesh.with_boundaries(sets).with_subdomains({"rubber": np.arange(len(t))})


def write_msh(mesh: MeshTri2, path: str | Path) -> None:
    """Write Gmsh 2.2 text, boundaries and subdomains as physical names.

    Gmsh and scikit-fem agree on the order of the nodes: the corners, then the middles of the edges
    01, 12, 20; on a boundary edge the ends, then the middle.
    """
    named = (1, mesh.boundaries), (2, mesh.subdomains)
    sets = [(dim, *item) for dim, group in named for item in group.items()]
    edges = np.vstack([mesh.facets, mesh.dofs.facet_dofs])
    cells = {1: edges.T, 2: mesh.dofs.element_dofs.T}
    tags = [np.full(len(members), tag) for tag, (_, _, members) in enumerate(sets, start=1)]
    out = meshio.Mesh(
        np.column_stack([mesh.p.T, np.zeros(mesh.p.shape[1])]),
        [(("line3", "triangle6")[dim - 1], cells[dim][members]) for dim, _, members in sets],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={name: np.array([i, dim]) for i, (dim, name, _) in enumerate(sets, start=1)},
    )
    meshio.write(path, out, file_format="gmsh22", binary=False)


def plot(mesh: MeshTri2, path: str | Path) -> None:
    """Draw the triangles and the named boundaries into an image file."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 7), layout="constrained")
    ax = figure.add_subplot(aspect="equal", xlabel="x (mm)", ylabel="y (mm)")
    ax.triplot(*mesh.p, mesh.t.T, color="0.6", linewidth=0.4)
    for i, (name, facets) in enumerate(mesh.boundaries.items()):
        curves = mesh.mapping().G(np.linspace(0, 1, 9)[None], find=facets)
        ax.plot(*curves.transpose(0, 2, 1), color=f"C{i}")[0].set_label(name)
    figure.legend(loc="outside upper center", ncols=len(mesh.boundaries), frameon=False)
    figure.savefig(path, dpi=200)


def main(argv: Sequence[str] | None = None) -> None:
    """Write and draw the mesh, print its size and smallest angle."""
    parser = argparse.ArgumentParser(description="Mesh of a D-shaped rubber bumper")
    parser.add_argument("--size", type=float, default=1.0, help="edge length in mm (%(default)s)")
    parser.add_argument("--output", type=Path, default=Path("out/bumper.msh"), metavar="FILE")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="picture; else beside the mesh")
    args = parser.parse_args(argv)
    try:
        mesh = bumper_mesh(args.size)
    except ValueError as error:
        parser.error(str(error))
    args.output.parent.mkdir(parents=True, exist_ok=True)
    write_msh(mesh, args.output)
    print(f"{args.output}: {mesh.nelements} triangles, angles >= {smallest_angle(mesh):.1f} deg")
    plot(mesh, args.plot or args.output.with_name("bumper_mesh.png"))


if __name__ == "__main__":
    main()
