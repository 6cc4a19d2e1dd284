"""Gaps to surface meshes: every facet in turn, VTK, planes, circles and spheres; files."""

import sys

import numpy as np
import pytest
import pyvista
from families import PLANE_AND_BFS, SOLID
from hypothesis import given
from hypothesis import strategies as st
from skfem import ElementQuad1
from surfaces import ball, brick, bumpy, ring, rotation

from contact import (
    ClosestPoint,
    ContactProblem,
    ContactWarning,
    Cylinder,
    ElasticBody,
    InputError,
    MissingDependency,
    Plane,
    SurfaceMesh,
)
from contact.obstacles import box_tree
from contact.obstacles.box_tree import BoxTree
from contact.obstacles.facets import gap_to_facets

seeds = st.integers(0, 10**6)


def places(rng, dim, count=60, size=1.6):
    n = rng.standard_normal((dim, count))
    return rng.uniform(-size, size, (dim, count)), n / np.linalg.norm(n, axis=0)


def met_one_by_one(corners, x, n):
    """The meetings of one line with each facet by a linear solve."""
    met = []
    for c in corners:
        edges = (c[1:] - c[0]).T
        try:
            *s, d = np.linalg.solve(np.column_stack((edges, -n)), x - c[0])
        except np.linalg.LinAlgError:
            continue
        if min(s) >= 0 and sum(s) <= 1:
            turn = np.linalg.det(np.column_stack((edges, n)))
            met.append((d, (turn if len(n) == 3 else -turn) < 0))
    ahead, behind = [m for m in met if m[0] >= 0], [m for m in met if m[0] < 0]
    enters = [m[0] for m in (*sorted(ahead)[:1], *sorted(behind)[-1:]) if m[1]]
    return min(enters, key=abs, default=np.inf)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_gap_as_if_every_facet_were_tried(dim, unit):
    @given(st.integers(0, 10**6), st.integers(1, 40))
    def check(seed, facets):
        rng = np.random.default_rng(seed)
        corners = rng.uniform(-1, 1, (facets, dim, dim)) * unit
        x, n = rng.uniform(-1, 1, (20, dim)) * unit, rng.standard_normal((20, dim))
        n /= np.linalg.norm(n, axis=1)[:, None]
        expected = [met_one_by_one(corners, *pair) for pair in zip(x, n, strict=True)]
        # The oracle's solve loses the digits of facets seen edge on.
        np.testing.assert_allclose(
            gap_to_facets(corners, BoxTree(corners), x, n), expected, rtol=1e-7, atol=1e-9 * unit
        )

    check()


def one_by_one(points, facets, x):
    """Least distance to all facets: to each of their parts by least squares, where within."""
    dim = len(points)
    subsets = (
        [(0,), (1,), (0, 1)] if dim == 2 else [(0,), (1,), (2,), (0, 1), (1, 2), (0, 2), (0, 1, 2)]
    )
    best = np.full(x.shape[1], np.inf)
    for f in facets.T:
        for subset in subsets:
            c = points[:, f[list(subset)]]
            edges = c[:, 1:] - c[:, :1]
            s = np.linalg.pinv(edges) @ (x - c[:, :1])
            within = (s >= 0).all(axis=0) & (s.sum(axis=0) <= 1)
            away = np.linalg.norm(x - c[:, :1] - edges @ s, axis=0)
            best = np.where(within, np.minimum(best, away), best)
    return best


@pytest.mark.sampled(2)
@pytest.mark.parametrize("dim", [2, 3])
def test_distance_as_if_every_facet_were_tried(dim):
    @given(seeds)
    def check(seed):
        rng = np.random.default_rng(seed)
        points, facets = bumpy(rng, dim)
        x, _ = places(rng, dim)
        surface = SurfaceMesh(points, facets)
        d, gradient = surface.distance(x)
        np.testing.assert_allclose(np.abs(d), one_by_one(points, facets, x), rtol=1e-9, atol=1e-12)
        feet = surface.closest(x)
        np.testing.assert_allclose(np.linalg.norm(x - feet, axis=0), np.abs(d), atol=1e-12)
        np.testing.assert_allclose(x - d * gradient, feet, atol=1e-10)
        # A star: inside where the ray from the middle leaves it farther out. To get there from
        # within, one goes back along -ray.
        ray = x / np.linalg.norm(x, axis=0)
        out = -surface(0 * ray, -ray)
        assert np.all(np.isfinite(out))
        assert np.array_equal(d < 0, np.linalg.norm(x, axis=0) < out)

    check()


@pytest.mark.parametrize("dim", [2, 3])
def test_moved_turned_scaled_renumbered(dim):
    @given(seeds, st.sampled_from([1e-6, 1.0, 1e3]), st.booleans())
    def check(seed, unit, turn_round):
        rng = np.random.default_rng(seed)
        points, facets = bumpy(rng, dim)
        x, n = places(rng, dim, 30)
        q, shift = rotation(rng, dim), unit * rng.uniform(-5, 5, (dim, 1))
        number, shuffled = rng.permutation(points.shape[1]), rng.permutation(facets.shape[1])
        there = np.empty_like(points)
        there[:, number] = unit * q @ points + shift
        renumbered = np.roll(number[facets[:, shuffled]], rng.integers(dim) if dim == 3 else 0, 0)
        if turn_round:  # which a closed surface does not mind
            renumbered = renumbered[::-1]
        here, moved = SurfaceMesh(points, facets), SurfaceMesh(there, renumbered)
        home, away = here(x, n), moved(unit * q @ x + shift, q @ n)
        np.testing.assert_array_equal(np.isinf(home), np.isinf(away))
        seen = np.isfinite(home)
        # Rounding over the angle at which facets are met.
        np.testing.assert_allclose(away[seen], unit * home[seen], rtol=1e-8, atol=1e-9 * unit)
        d, gradient = here.distance(x)
        far, turned = moved.distance(unit * q @ x + shift)
        np.testing.assert_allclose(far, unit * d, rtol=1e-9, atol=1e-11 * unit)
        np.testing.assert_allclose(turned, q @ gradient, atol=1e-6)

    check()


def test_triangles_without_shared_points_are_joined():
    points, facets = ball(2)
    rng = np.random.default_rng(4)
    soup = points[:, facets.T.ravel()] + rng.uniform(-1e-9, 1e-9, (3, facets.size))
    surface = SurfaceMesh(soup, np.arange(facets.size).reshape(-1, 3).T)
    assert surface.points.shape == points.shape
    x, _ = places(rng, 3)
    there = SurfaceMesh(points, facets)
    np.testing.assert_allclose(surface.distance(x)[0], there.distance(x)[0], atol=1e-8)


@pytest.mark.parametrize("dim", [2, 3])
def test_many_places_in_parts(dim, monkeypatch):
    """A search that meets more boxes than it keeps at once goes on in parts."""
    surface = SurfaceMesh(*bumpy(np.random.default_rng(8), dim))
    x, n = places(np.random.default_rng(9), dim, 300)
    gap, distance, closest = surface(x, n), surface.distance(x), surface.closest(x)
    monkeypatch.setattr(box_tree, "_TOGETHER", 50)
    np.testing.assert_array_equal(surface(x, n), gap)
    np.testing.assert_array_equal(surface.closest(x), closest)
    for ours, theirs in zip(surface.distance(x), distance, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    none = np.zeros((dim, 0))
    assert surface(none, none).shape == (0,)
    assert surface.distance(none)[1].shape == (dim, 0)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_no_line_slips_through(unit):
    """Through corners, middles of edges and of triangles, and from places on them."""
    points, facets = ball(3)
    rng = np.random.default_rng(10)
    points = unit * (rotation(rng, 3) @ points)
    corners = points[:, facets]
    edges = (0.5 * (corners + np.roll(corners, 1, axis=1))).reshape(3, -1)
    aims = np.hstack((points, edges, corners.mean(axis=1)))
    n = -aims / np.linalg.norm(aims, axis=0)
    surface = SurfaceMesh(points, facets)
    for d in unit * np.array([0.7, 1e-6, 0.0, -1e-6, -0.3]):
        np.testing.assert_allclose(surface(aims - d * n, n), d, rtol=0, atol=1e-12 * unit)
    skew = n + rng.uniform(-0.5, 0.5, n.shape)
    skew /= np.linalg.norm(skew, axis=0)
    # The surface may be met before, where the line goes almost along it.
    assert np.all(surface(aims - unit * skew, skew) < unit * (1 + 1e-12))


def test_between_two_layers_of_a_sheet():
    """A little behind the first, far before the second: not on the way to the second."""
    points = np.array([[0.0, 1.0, 0.0, 1.0], [0.0, 0.0, -1.0, -1.0]])
    layers = SurfaceMesh(points, [[1, 3], [0, 2]], sheet=True)
    x = np.array([[0.5, 0.5, 0.5], [0.1, -0.1, -0.9]])
    gap = layers(x, np.tile([[0.0], [-1.0]], 3))
    np.testing.assert_allclose(gap, [0.1, -0.1, 0.1], atol=1e-15)


@pytest.mark.parametrize("dim", [2, 3])
def test_sheet(dim):
    """A wall from 0 to 1: what is behind it and in front of it; nothing meets its border."""
    wall = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1], [0]])
    if dim == 3:
        wall = brick((0.0, 0.0, -1.0), (1.0, 1.0, 0.0))
        top = np.flatnonzero((wall[0][2, wall[1]] == 0).all(axis=0))
        wall = wall[0], wall[1][:, top]
    sheet = SurfaceMesh(*wall, sheet=True)
    x = np.full((dim, 3), 0.5)
    x[-1] = 0.2, -0.3, 0.2
    x[0, 2] = 1.1
    down = np.tile(-np.eye(dim)[-1:].T, 3)
    for gap in (sheet, ClosestPoint(sheet)):
        np.testing.assert_allclose(gap(x, down), [0.2, -0.3, np.inf], atol=1e-15)
    assert np.all(np.isinf(sheet(x, -down)[[0, 2]]))
    assert np.all(np.isfinite(sheet.distance(x)[1]))
    back = SurfaceMesh(*wall, sheet=True, hollow=True)
    np.testing.assert_allclose(back.distance(x)[0], [-0.2, 0.3, np.inf], atol=1e-15)


def test_normals_at_the_corners_of_a_cube():
    """However many of the triangles at a corner lie in each face."""
    points, facets = brick((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    d, gradient = SurfaceMesh(points, facets).distance(points)
    np.testing.assert_allclose(d, 0.0, atol=1e-15)
    np.testing.assert_allclose(gradient, points / np.sqrt(3), rtol=1e-14)
    middles = 0.5 * (points[:, facets] + np.roll(points[:, facets], 1, axis=1)).reshape(3, -1)
    gradient = SurfaceMesh(points, facets).distance(middles)[1]
    on = np.abs(middles) == 1
    np.testing.assert_allclose(gradient, middles * on / np.sqrt(on.sum(axis=0)), atol=1e-14)


def test_inside_near_a_sharp_corner():
    """Many thin triangles on one side of a spike do not outweigh the others."""
    around = np.r_[np.linspace(0.0, 0.3, 40), 2.0, 4.0]
    rim = np.array([np.cos(around), np.sin(around), 0 * around])
    points = np.c_[rim, [0.9, 0.1, 3.0], [0.0, 0.0, 0.0]]
    here, last = np.arange(42), 42
    there = np.roll(here, -1)
    facets = np.c_[[here, there, 0 * here + last], [there, here, 0 * here + last + 1]]
    surface = SurfaceMesh(points, facets)
    x = points[:, [last]] + np.random.default_rng(11).uniform(-0.3, 0.3, (3, 3000))
    # The spike is convex: inside is behind all planes.
    height = np.einsum("if,ifk->fk", surface.normals, x[:, None] - points[:, facets[0]][:, :, None])
    inside = np.all(height < 0, axis=0)
    assert inside.any()
    assert np.array_equal(surface.distance(x)[0] < 0, inside)


# Bodies pressed on surface meshes, beside the obstacles whose shape the meshes approach.
def cube(make, element, cells=None, unit=1.0, E=1.0, push=0.02, drag=0.01):
    """The unit square or cube in another unit, pushed down and dragged along x."""
    dim = 3 if element in SOLID else 2
    ticks = unit * np.linspace(0, 1, (cells or (4 if dim == 3 else 8)) + 1)
    body = ElasticBody.from_mesh(make.box(element, *(ticks,) * dim), element(), E=E, nu=0.3)
    body.fix("top", "x", drag * unit).fix("top", dim - 1, -push * unit)
    return body.fix("top", "y") if dim == 3 else body


def floor(dim, unit=1.0, slope=0.0):
    """A box whose top is turned about its middle, and the plane of that top."""
    low, high = np.full(dim, -3.0), np.full(dim, 4.0)
    high[-1] = 0.0
    points, facets = brick(low, high)
    middle = np.zeros(dim)
    middle[:-1] = 0.5
    turn = np.eye(dim)
    c, s = np.cos(slope), np.sin(slope)
    turn[np.ix_([0, -1], [0, -1])] = [[c, -s], [s, c]]
    points = unit * (turn @ (points - middle[:, None]) + middle[:, None])
    return SurfaceMesh(points, facets), Plane(unit * middle, turn[:, -1])


@pytest.mark.sampled(4)
@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e3])
@pytest.mark.parametrize("element", [*PLANE_AND_BFS, *SOLID], ids=lambda e: e.__name__)
def test_a_box_presses_as_its_plane(make, element, unit):
    """Every family, along the body's normal and to the closest point, with friction."""
    body = cube(make, element, 3, unit, E=2e5 / unit**2)
    box, plane = floor(body.dim, unit, slope=0.01)
    for how in (lambda o: o, ClosestPoint):
        ours, theirs = (ContactProblem(body, "bottom", how(o), 0.3).solve() for o in (box, plane))
        top = theirs.pressure.max()
        assert top > 0
        # Rounding of the gap times the condition of the body.
        np.testing.assert_allclose(ours.pressure, theirs.pressure, rtol=0, atol=1e-9 * top)
        np.testing.assert_allclose(ours.shear, theirs.shear, rtol=0, atol=1e-9 * top)
        assert max(ours.kkt.values()) <= 1e-10


def test_a_bore_and_its_cavity(make):
    """An eighth of turn into a hole given by a polygon, beside the round one."""
    angles = np.linspace(0, np.pi / 2, 17)
    flat = make.box(ElementQuad1, np.linspace(1.0, 2.0, 9), angles)
    r, angle = flat.p
    mesh = make.remesh(flat, np.array([r * np.sin(angle), -r * np.cos(angle)]))
    body = ElasticBody.from_mesh(mesh, ElementQuad1(), E=1.0, nu=0.3)
    body.fix("bottom", "x").fix("top", "y")
    exact = ContactProblem(body, "right", Cylinder((0.0, 0.0), 1.95, hollow=True), 0.2).solve()
    hole = SurfaceMesh(*ring(2000, 1.95), hollow=True)
    result = ContactProblem(body, "right", hole, 0.2).solve()
    # The sagitta over the interference: (2 pi / 2000)^2 * 1.95 / 8 / .05.
    np.testing.assert_allclose(result.pressure, exact.pressure, rtol=1e-3)
    with pytest.warns(ContactWarning, match=r"SurfaceMesh\(\.\.\., hollow=True\)"):
        ContactProblem(body, "right", SurfaceMesh(*ring(200, 2.05)), 0.2).condense()


# Files: what pyvista wrote is read again, in another unit.
X = np.random.default_rng(0).uniform(-1.5, 1.5, (3, 200))


@pytest.mark.parametrize("ending", [".stl", ".ply", ".obj", ".vtp", ".STL"])
@pytest.mark.parametrize("scale", [1.0, 1e-3, 25.4])
def test_formats(tmp_path, ending, scale):
    surface = SurfaceMesh(*bumpy(np.random.default_rng(1), 3))
    path = tmp_path / f"bumpy{ending}"
    surface.to_pyvista().save(tmp_path / f"bumpy{ending.lower()}")
    if not path.exists():
        (tmp_path / f"bumpy{ending.lower()}").rename(path)
    for name in (path, str(path)):
        read = SurfaceMesh.from_file(name, scale)
        assert read.facets.shape == surface.facets.shape
        assert read.points.shape == surface.points.shape
        # Files in single precision.
        theirs = read.distance(scale * X)[0]
        np.testing.assert_allclose(theirs, scale * surface.distance(X)[0], atol=1e-6 * scale)


def test_text_of_an_stl_file(tmp_path):
    """As programs of drawing write it: each triangle with its own corners."""
    points, facets = ball(1)
    lines = ["solid ball"]
    for f in facets.T:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex " + " ".join(map(str, p)) for p in points[:, f].T]
        lines += ["endloop", "endfacet"]
    (tmp_path / "ball.stl").write_text("\n".join([*lines, "endsolid ball"]))
    read = SurfaceMesh.from_file(tmp_path / "ball.stl")
    assert repr(read) == "SurfaceMesh(18 points, 32 triangles)"
    theirs = SurfaceMesh(points, facets).distance(X)[0]
    np.testing.assert_allclose(read.distance(X)[0], theirs, atol=1e-6)


def test_polygons_and_outlines(tmp_path):
    """Lines without faces are an obstacle in the plane; one of many points, or of two each."""
    pyvista.Cube().save(tmp_path / "cube.vtp")
    assert SurfaceMesh.from_file(tmp_path / "cube.vtp").facets.shape == (3, 12)
    outline = SurfaceMesh(*ring(30))
    outline.to_pyvista().save(tmp_path / "ring.vtp")
    points = np.pad(outline.points.T, ((0, 0), (0, 1)))
    line = pyvista.PolyData(points, lines=np.r_[31, outline.facets[0], outline.facets[0, 0]])
    line.save(tmp_path / "line.vtp")
    for name in ("ring.vtp", "line.vtp"):
        read = SurfaceMesh.from_file(tmp_path / name, 2.0)
        found, own = read.distance(2 * X[:2])[0], outline.distance(X[:2])[0]
        np.testing.assert_allclose(found, 2 * own, atol=1e-6)


def test_what_a_sheet_or_a_hole_is(tmp_path):
    surface = SurfaceMesh(*ball(1))
    surface.to_pyvista().save(tmp_path / "ball.stl")
    hole = SurfaceMesh.from_file(tmp_path / "ball.stl", hollow=True)
    assert hole.distance(np.zeros((3, 1)))[0][0] > 0
    pyvista.Plane().triangulate().save(tmp_path / "plane.stl")
    with pytest.raises(InputError, match="sheet=True"):
        SurfaceMesh.from_file(tmp_path / "plane.stl")
    sheet = SurfaceMesh.from_file(tmp_path / "plane.stl", sheet=True)
    np.testing.assert_allclose(np.abs(sheet.normals[2]), 1.0)


def test_vtk_of_the_surface():
    for surface in (SurfaceMesh(*ball(2)), SurfaceMesh(*ring(12))):
        data = surface.to_pyvista()
        dim = len(surface.points)
        np.testing.assert_array_equal(np.asarray(data.points).T[:dim], surface.points)
        np.testing.assert_array_equal(data.cell_data["normal"].T[:dim], surface.normals)
        outwards = np.sum(data.cell_centers().points * data.cell_data["normal"], axis=1)
        assert np.all(outwards > 0.9)


def test_without_pyvista(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    (tmp_path / "ball.stl").write_text("solid")
    with pytest.raises(MissingDependency, match="pip install"):
        SurfaceMesh.from_file(tmp_path / "ball.stl")
    with pytest.raises(MissingDependency, match="pip install"):
        SurfaceMesh(*ball(1)).to_pyvista()
