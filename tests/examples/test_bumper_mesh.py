"""The bumper's curved mesh: outline, quality, names, and the Gmsh file read back."""

import numpy as np
import pytest
from example_scripts import load
from skfem import Basis, ElementTriP2, MeshTri2

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


def _relative_jacobian(mesh):
    """Jacobian determinant at the six nodes over the mean of its triangle."""
    det = mesh.mapping().detDF(ElementTriP2.doflocs.T)
    return det / det.mean(axis=1, keepdims=True)


@pytest.mark.turns(4)
def test_default_mesh_is_well_shaped_and_curved_without_folds(default):
    """At most one curved edge a triangle: the determinant is linear, its corners bound it."""
    assert 6000 <= default.nelements <= 8000
    angles = _angles(default)
    assert angles.min() >= 20
    assert script.smallest_angle(default) == pytest.approx(angles.min(), abs=1e-9)
    assert np.median(angles.min(axis=0)) >= 45
    assert isinstance(default, MeshTri2)
    assert _relative_jacobian(default).min() > 0.8
    on_boundary = np.isin(default.t2f, default.boundary_facets()).sum(axis=0)
    bent = np.isin(default.t2f, np.concatenate([default.boundaries[k] for k in NAMES - {"mount"}]))
    assert on_boundary.max() <= 2  # at the corners of the mount
    assert bent.sum(axis=0).max() == 1


def test_triangles_tile_the_region_once(coarse):
    """Positive area, no hanging node, one hole; the names part the boundary."""
    p, t = coarse.p, coarse.t
    u, v = p[:, t[1]] - p[:, t[0]], p[:, t[2]] - p[:, t[0]]
    assert (u[0] * v[1] - u[1] * v[0]).min() > 0
    assert coarse.nvertices - coarse.nfacets + coarse.nelements == 0
    assert np.array_equal(np.unique(t), np.arange(coarse.nvertices))
    assert p.shape[1] == coarse.nvertices + coarse.nfacets  # corners, then middles
    assert len(np.unique(np.round(p, 9), axis=1).T) == p.shape[1]
    assert set(coarse.boundaries) == NAMES
    facets = np.concatenate(list(coarse.boundaries.values()))
    assert np.array_equal(np.sort(facets), coarse.boundary_facets())


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
    assert np.array_equal(mesh.subdomains["rubber"], np.arange(mesh.nelements))
    assert not caplog.records


@pytest.mark.parametrize("seed", [0, 1])
def test_main_writes_a_good_mesh_of_any_size_and_seed_and_a_picture(seed, tmp_path, capsys):
    file, picture = tmp_path / "new" / "bumper.msh", tmp_path / "bumper.png"
    script.main(["--size", "4", "--output", str(file), "--plot", str(picture)])
    assert "triangles, angles >= " in capsys.readouterr().out
    assert set(ElasticBody.from_mesh(file, E=1.0, nu=0.3).mesh.boundaries) == NAMES
    assert picture.stat().st_size > 10_000
    mesh, again = script.bumper_mesh(4.0, seed), script.bumper_mesh(4.0, seed)
    assert _angles(mesh).min() >= 20
    assert _relative_jacobian(mesh).min() > 0.5
    assert np.array_equal(again.p, mesh.p)
    assert np.array_equal(again.t, mesh.t)


def test_bad_size_is_refused(tmp_path, capsys):
    for size in (0.0, -1.0, 0.1, 10.0, np.inf, np.nan):
        with pytest.raises(ValueError, match=r"size: .* expected 0.4 to 4.0 mm"):
            script.bumper_mesh(size)
    with pytest.raises(SystemExit):
        script.main(["--size", "99", "--output", str(tmp_path / "bumper.msh")])
    assert "size: 99.0 mm given" in capsys.readouterr().err
