"""The bumper's curved mesh: outline, quality, names, and the Gmsh file read back."""

import meshio
import numpy as np
import pytest
from example_scripts import load
from skfem import Basis, ElementTriP2, FacetBasis, MeshTri2

from contact import ElasticBody

NAMES = {"mount", "flank", "contact", "bore"}


script = load("bumper_mesh")


@pytest.fixture(scope="module")
def coarse():
    return script.bumper_mesh(3.0)


@pytest.fixture(scope="module")
def default():
    return script.bumper_mesh()


def _angles(mesh):
    """Law of cosines, independent of the script's complex quotients."""
    corners = mesh.p[:, mesh.t]
    a, b, c = (
        np.linalg.norm(np.roll(corners, k, 1) - np.roll(corners, k + 1, 1), axis=0)
        for k in range(3)
    )
    return np.rad2deg(np.arccos((b**2 + c**2 - a**2) / (2 * b * c)))


def _lengths(mesh, facets):
    ends = mesh.p[:, mesh.facets[:, facets]]
    return np.hypot(*(ends[:, 1] - ends[:, 0]))


def _boundary_nodes(mesh, name):
    return mesh.p[:, mesh.dofs.get_facet_dofs(mesh.boundaries[name]).all()]


def _relative_jacobian(mesh):
    """Jacobian determinant at the six nodes over the mean of its triangle."""
    det = mesh.mapping().detDF(ElementTriP2.doflocs.T)
    return det / det.mean(axis=1, keepdims=True)


@pytest.mark.turns(4)
def test_default_size_is_graded_and_well_shaped(default):
    assert 6000 <= default.nelements <= 8000
    angles = _angles(default)
    assert angles.min() >= 20
    assert script.smallest_angle(default) == pytest.approx(angles.min(), abs=1e-9)
    assert np.median(angles.min(axis=0)) >= 45
    contact = _lengths(default, default.boundaries["contact"])
    mount = _lengths(default, default.boundaries["mount"])
    assert contact.max() < 0.5 * mount.min()


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("size", [3.2, 4.0])
def test_any_size_and_seed_gives_a_good_mesh(size, seed):
    mesh = script.bumper_mesh(size, seed)
    assert _angles(mesh).min() >= 20
    assert _relative_jacobian(mesh).min() > 0.5


def test_default_mesh_is_curved_without_folds(default):
    """At most one curved edge a triangle: the determinant is linear, its corners bound it."""
    assert isinstance(default, MeshTri2)
    assert _relative_jacobian(default).min() > 0.8
    on_boundary = np.isin(default.t2f, default.boundary_facets()).sum(axis=0)
    bent = np.isin(default.t2f, np.concatenate([default.boundaries[k] for k in NAMES - {"mount"}]))
    assert on_boundary.max() <= 2  # at the corners of the mount
    assert bent.sum(axis=0).max() == 1


def test_triangles_tile_the_polygon_once(coarse):
    """Positive area equal to the outline's (Green): no overlap, no gap, no hanging node."""
    p, t = coarse.p, coarse.t
    u, v = p[:, t[1]] - p[:, t[0]], p[:, t[2]] - p[:, t[0]]
    area = (u[0] * v[1] - u[1] * v[0]) / 2
    assert area.min() > 0
    polygon = 0.0
    for name, sign in [("outer", 1), ("bore", -1)]:
        x, y = p[:, _loop(coarse, name)]
        polygon += sign * abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2
    assert area.sum() == pytest.approx(polygon, rel=1e-12)
    assert coarse.nvertices - coarse.nfacets + coarse.nelements == 0  # one hole
    assert np.array_equal(np.unique(t), np.arange(coarse.nvertices))
    assert p.shape[1] == coarse.nvertices + coarse.nfacets  # corners, then middles
    assert len(np.unique(np.round(p, 9), axis=1).T) == p.shape[1]


def _loop(mesh, name):
    """Nodes of a boundary loop by walking its facets from one to the next."""
    bore = mesh.boundaries["bore"]
    chosen = bore if name == "bore" else np.setdiff1d(mesh.boundary_facets(), bore)
    neighbours = {}
    for a, b in mesh.facets[:, chosen].T:
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    walk = [min(neighbours)]
    walk.append(neighbours[walk[0]][0])
    while walk[-1] != walk[0]:
        walk.append(next(n for n in neighbours[walk[-1]] if n != walk[-2]))
    assert len(walk) - 1 == len(chosen) == len(neighbours)
    return walk[:-1]


def test_boundary_edges_follow_the_outline_in_sequence(coarse):
    """Boundary nodes are numbered along the outline: neighbours differ by one, but at the seam."""
    for name in ("outer", "bore"):
        step = np.abs(np.diff(_loop(coarse, name)))
        assert np.array_equal(step, np.ones_like(step))


def _distance_to_flank(x, y):
    """From the drawing: nose R22, 5 degrees of draft, fillet R3, shoulder y = 42, corner R2."""
    x = np.abs(x)
    tangent = np.deg2rad(5.0)
    n = np.array([np.cos(tangent), -np.sin(tangent)])
    centre = np.array([(25 + n[1] * -17) / n[0], 39.0])  # n . (centre - (0, 22)) = 22 + 3
    pieces = [
        (y <= 22 + 22 * n[1], np.hypot(x, y - 22) - 22),
        ((y >= 22 + 22 * n[1]) & (y <= centre[1] - 3 * n[1]), n[0] * x + n[1] * (y - 22) - 22),
        ((y > 38) & (x <= centre[0]), np.hypot(x - centre[0], y - 39) - 3),
        ((x >= centre[0]) & (x <= 28), y - 42),
        ((x >= 28) & (y <= 44), np.hypot(x - 28, y - 44) - 2),
        (y >= 44, x - 30),
    ]
    tolerance = [np.where(where, np.abs(distance), np.inf) for where, distance in pieces]
    return np.min(tolerance, axis=0)


def test_boundary_nodes_lie_exactly_on_the_drawing(default):
    """Corners and middles alike."""
    xy = {name: _boundary_nodes(default, name) for name in NAMES}
    x, y = xy["contact"]
    assert np.abs(np.hypot(x, y - 22) - 22).max() < 1e-12
    assert y.max() == pytest.approx(22 - 22 * np.cos(np.pi / 3), abs=1e-12)
    assert np.hypot(x, y).min() < 1e-12  # the lowest point is a node
    x, y = xy["bore"]
    assert np.abs(np.hypot(x, y - 22) - 10).max() < 1e-12
    x, y = xy["mount"]
    assert np.abs(y - 50).max() < 1e-12
    assert (x.min(), x.max()) == (-30, 30)
    assert _distance_to_flank(*xy["flank"]).max() < 1e-12


def test_middles_are_halfway_along_their_edges(default):
    a, b = np.moveaxis(default.p[:, default.facets], 1, 0)
    middle = default.p[:, default.dofs.facet_dofs[0]]
    to_ends = np.linalg.norm(middle - a, axis=0) - np.linalg.norm(middle - b, axis=0)
    assert np.abs(to_ends).max() < 1e-12
    inner = np.setdiff1d(np.arange(default.nfacets), default.boundary_facets())
    assert np.abs(middle - (a + b) / 2)[:, inner].max() < 1e-14
    assert np.linalg.norm(middle - (a + b) / 2, axis=0).max() > 1e-3  # but the outline is curved


def _exact_area():
    """Green's theorem on the drawing, 2 A = int x dy - y dx over lines and arcs of the right half.

    A line from a to b gives Im(conj(a) b), an arc of centre c R^2 (angle) + Im(conj(c) (b - a)).
    """
    draft = np.deg2rad(5.0)
    n = np.exp(-1j * draft)
    fillet = 39j + (25 - n.imag * 17) / n.real
    arcs = [  # centre, radius, angles; lines between them and from the last to the mount
        (22j, 22.0, -np.pi / 2, -draft),
        (fillet, 3.0, np.pi - draft, np.pi / 2),
        (28 + 44j, 2.0, -np.pi / 2, 0.0),
    ]
    twice, points = 0.0, []
    for centre, radius, start, end in arcs:
        a, b = centre + radius * np.exp(1j * np.array([start, end]))
        twice += radius**2 * (end - start) + (centre.conjugate() * (b - a)).imag
        points += [a, b]
    points += [30 + 50j, 30 + 50j, 50j]
    lines = zip(points[1::2], points[2::2], strict=True)
    twice += sum((a.conjugate() * b).imag for a, b in lines)
    return twice - np.pi * 10**2  # both halves less the bore


@pytest.mark.parametrize("name", ["coarse", "default"])
def test_curved_triangles_have_the_area_of_the_drawing(name, request):
    mesh = request.getfixturevalue(name)
    u, v = (mesh.p[:, mesh.t[k]] - mesh.p[:, mesh.t[0]] for k in (1, 2))
    error_of_polygon = abs(np.sum(u[0] * v[1] - u[1] * v[0]) / 2 - _exact_area())
    error = abs(Basis(mesh, ElementTriP2()).dx.sum() - _exact_area())
    assert error < 1e-6 * _exact_area()
    assert error < 0.01 * error_of_polygon


def test_contact_boundary_has_length_and_normals_of_the_arc(coarse):
    facets = coarse.boundaries["contact"]
    basis = FacetBasis(coarse, ElementTriP2(), facets=facets)
    exact = 22 * 2 * np.pi / 3
    assert basis.dx.sum() == pytest.approx(exact, rel=1e-7)
    assert exact - _lengths(coarse, facets).sum() > 1e-5 * exact
    x = basis.global_coordinates() - np.array([0.0, 22.0])[:, None, None]
    normal = basis.normals - x / np.linalg.norm(x, axis=0)
    angle = _lengths(coarse, facets).max() / 22
    assert np.linalg.norm(normal, axis=0).max() < 1e-3 * angle  # angle / 2 on the polygon


def test_outline_is_closed_and_tangent_except_at_the_mount():
    corners = []
    for loop in script.outline():
        for (_, _, at), (_, _, following) in zip(loop, loop[1:] + loop[:1], strict=True):
            end, start = at(np.array([1.0, 1 - 1e-6])), following(np.array([0.0, 1e-6]))
            assert abs(end[0] - start[0]) < 1e-12
            turn = np.angle((start[1] - start[0]) / (end[0] - end[1]))
            if abs(turn) > 1e-4:
                corners.append(end[0])
    assert np.allclose(corners, [30 + 50j, -30 + 50j], atol=1e-12)


def test_boundaries_partition_the_boundary_facets(coarse):
    assert set(coarse.boundaries) == NAMES
    facets = np.concatenate(list(coarse.boundaries.values()))
    assert min(map(len, coarse.boundaries.values())) > 0
    assert np.array_equal(np.sort(facets), coarse.boundary_facets())
    assert np.array_equal(coarse.subdomains["rubber"], np.arange(coarse.nelements))


def test_file_gives_back_the_mesh_and_its_names(coarse, tmp_path, capfd, caplog):
    path = tmp_path / "bumper.msh"
    script.write_msh(coarse, path)
    assert capfd.readouterr() == ("", "")
    assert path.read_text().startswith("$MeshFormat\n2.2 0 8\n")
    mesh = ElasticBody.from_mesh(path, E=1.0, nu=0.3).mesh
    assert isinstance(mesh, MeshTri2)
    assert np.array_equal(mesh.p, coarse.p)
    assert np.array_equal(mesh.t, coarse.t)
    assert set(mesh.boundaries) == NAMES
    for name, facets in mesh.boundaries.items():
        assert np.array_equal(np.sort(facets), np.sort(coarse.boundaries[name]))
    assert set(mesh.subdomains) == {"rubber"}
    assert np.array_equal(mesh.subdomains["rubber"], np.arange(mesh.nelements))
    assert not caplog.records


def test_file_has_second_order_cells_in_the_order_of_gmsh(coarse, tmp_path):
    """Corners anticlockwise, then the middles of the edges 01, 12, 20; ends, then the middle."""
    script.write_msh(coarse, tmp_path / "bumper.msh")
    read = meshio.read(tmp_path / "bumper.msh")
    assert set(read.cells_dict) == {"triangle6", "line3"}
    nodes = np.moveaxis(read.points[read.cells_dict["triangle6"]], 1, 0)
    a, b, c = nodes[:3]
    assert np.cross(b - a, c - a)[:, 2].min() > 0
    line3 = np.moveaxis(read.points[read.cells_dict["line3"]], 1, 0)
    for start, end, middle in [(a, b, nodes[3]), (b, c, nodes[4]), (c, a, nodes[5]), line3]:
        chord, sag = (np.linalg.norm(v, axis=1) for v in (end - start, middle - (start + end) / 2))
        assert (sag / chord).max() < 0.1
    assert {name: dim for name, (_, dim) in read.field_data.items()} == {
        **dict.fromkeys(NAMES, 1),
        "rubber": 2,
    }


def test_file_makes_an_elastic_body(coarse, tmp_path):
    """Rigid motions load no node: every triangle has its nodes in the right places."""
    script.write_msh(coarse, tmp_path / "bumper.msh")
    body = ElasticBody.from_mesh(tmp_path / "bumper.msh", ElementTriP2(), E=1, nu=0.3)
    assert body.basis.dx.sum() == pytest.approx(_exact_area(), rel=1e-6)
    x, y = body.basis.doflocs
    rotation = np.where(np.arange(body.basis.N) % 2 == 0, -y, x)
    stretch = np.where(np.arange(body.basis.N) % 2 == 0, x, 0.0)
    assert np.abs(body.stiffness @ rotation).max() < 1e-11
    inner = np.setdiff1d(np.arange(body.basis.N), body.basis.get_dofs().all())
    force = np.abs(body.stiffness @ stretch)
    assert force[inner].max() < 1e-11 < 1e-2 < force.max()
    for name in NAMES:
        assert len(body.facets(name)) == len(coarse.boundaries[name])


def test_same_seed_gives_the_same_bits(coarse):
    again = script.bumper_mesh(3.0)
    assert np.array_equal(again.p, coarse.p)
    assert np.array_equal(again.t, coarse.t)
    other = script.bumper_mesh(3.0, seed=1)
    assert not np.array_equal(other.p, coarse.p)


@pytest.mark.parametrize("size", [0.0, -1.0, 0.1, 10.0, np.inf, np.nan])
def test_bad_size_is_refused(size):
    with pytest.raises(ValueError, match=r"size: .* expected 0.4 to 4.0 mm"):
        script.bumper_mesh(size)


def test_main_writes_mesh_and_picture(tmp_path, capsys):
    mesh, picture = tmp_path / "new" / "bumper.msh", tmp_path / "bumper.png"
    script.main(["--size", "4", "--output", str(mesh), "--plot", str(picture)])
    assert "triangles, angles >= " in capsys.readouterr().out
    body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3)
    assert set(body.mesh.boundaries) == NAMES
    assert picture.stat().st_size > 10_000


def test_main_refuses_a_bad_size_with_one_line(tmp_path, capsys):
    with pytest.raises(SystemExit):
        script.main(["--size", "99", "--output", str(tmp_path / "bumper.msh")])
    assert "size: 99.0 mm given" in capsys.readouterr().err
