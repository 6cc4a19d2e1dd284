"""The bumper's mesh: outline, quality, names, and the Gmsh file read back."""

import importlib.util
from pathlib import Path

import meshio
import numpy as np
import pytest
import skfem

SCRIPT = Path(__file__).resolve().parents[2] / "examples" / "bumper_mesh.py"
NAMES = {"mount", "flank", "contact", "bore"}


def _load():
    spec = importlib.util.spec_from_file_location("bumper_mesh", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


script = _load()


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
    assert _angles(script.bumper_mesh(size, seed)).min() >= 20


def test_triangles_tile_the_polygon_once(coarse):
    """Positive area equal to the outline's (Green): no overlap, no gap, no hanging node."""
    p, t = coarse.p, coarse.oriented().t
    u, v = p[:, t[1]] - p[:, t[0]], p[:, t[2]] - p[:, t[0]]
    area = (u[0] * v[1] - u[1] * v[0]) / 2
    assert area.min() > 0
    polygon = 0.0
    for name, sign in [("outer", 1), ("bore", -1)]:
        x, y = p[:, _loop(coarse, name)]
        polygon += sign * abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2
    assert area.sum() == pytest.approx(polygon, rel=1e-12)
    assert coarse.nvertices - coarse.nfacets + coarse.nelements == 0  # one hole
    assert np.array_equal(np.unique(t), np.arange(p.shape[1]))
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
    xy = {
        name: default.p[:, np.unique(default.facets[:, facets])]
        for name, facets in default.boundaries.items()
    }
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


@pytest.mark.parametrize("load", [skfem.MeshTri.load, skfem.Mesh.load], ids=["MeshTri", "Mesh"])
def test_file_gives_back_the_mesh_and_its_names(coarse, tmp_path, capfd, caplog, load):
    path = tmp_path / "bumper.msh"
    script.write_msh(coarse, path)
    assert capfd.readouterr() == ("", "")
    assert path.read_text().startswith("$MeshFormat\n2.2 0 8\n")
    mesh = load(path)
    assert isinstance(mesh, skfem.MeshTri)
    assert np.array_equal(mesh.p, coarse.p)
    assert np.array_equal(mesh.t, coarse.t)
    assert set(mesh.boundaries) == NAMES
    for name, facets in mesh.boundaries.items():
        assert np.array_equal(np.sort(facets), np.sort(coarse.boundaries[name]))
    assert set(mesh.subdomains) == {"rubber"}
    assert np.array_equal(mesh.subdomains["rubber"], np.arange(mesh.nelements))
    assert not caplog.records


def test_file_has_anticlockwise_triangles(coarse, tmp_path):
    script.write_msh(coarse, tmp_path / "bumper.msh")
    read = meshio.read(tmp_path / "bumper.msh")
    a, b, c = np.moveaxis(read.points[read.cells_dict["triangle"]], 1, 0)
    assert np.cross(b - a, c - a)[:, 2].min() > 0


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
    assert set(skfem.Mesh.load(mesh).boundaries) == NAMES
    assert picture.stat().st_size > 10_000


def test_main_refuses_a_bad_size_with_one_line(tmp_path, capsys):
    with pytest.raises(SystemExit):
        script.main(["--size", "99", "--output", str(tmp_path / "bumper.msh")])
    assert "size: 99.0 mm given" in capsys.readouterr().err
