"""Surfaces from files: what pyvista wrote is read again, in another unit; others are refused."""

import sys

import numpy as np
import pytest
import pyvista
from surfaces import ball, bumpy, ring

from contact import InputError, MissingDependency, SurfaceMesh

X = np.random.default_rng(0).uniform(-1.5, 1.5, (3, 200))


@pytest.mark.parametrize("ending", [".stl", ".ply", ".obj", ".vtp", ".STL"])
@pytest.mark.parametrize("scale", [1.0, 1e-3, 25.4])
def test_formats(tmp_path, ending, scale):
    surface = SurfaceMesh(*bumpy(np.random.default_rng(1), 3))
    path = tmp_path / f"bumpy{ending}"
    surface.to_pyvista().save(tmp_path / f"bumpy{ending.lower()}")
    if not path.exists():
        (tmp_path / f"bumpy{ending.lower()}").rename(path)
    for given in (path, str(path)):
        read = SurfaceMesh.from_file(given, scale)
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


def test_polygons_are_cut_into_triangles(tmp_path):
    pyvista.Cube().save(tmp_path / "cube.vtp")
    assert SurfaceMesh.from_file(tmp_path / "cube.vtp").facets.shape == (3, 12)


def test_outlines(tmp_path):
    """Lines without faces are an obstacle in the plane; one of many points, or of two each."""
    outline = SurfaceMesh(*ring(30))
    outline.to_pyvista().save(tmp_path / "ring.vtp")
    points = np.pad(outline.points.T, ((0, 0), (0, 1)))
    line = pyvista.PolyData(points, lines=np.r_[31, outline.facets[0], outline.facets[0, 0]])
    line.save(tmp_path / "line.vtp")
    for name in ("ring.vtp", "line.vtp"):
        read = SurfaceMesh.from_file(tmp_path / name, 2.0)
        np.testing.assert_allclose(
            read.distance(2 * X[:2])[0], 2 * outline.distance(X[:2])[0], atol=1e-6
        )


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


@pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, np.inf, "mm", None, [1.0, 2.0]])
def test_scale(tmp_path, scale):
    with pytest.raises(InputError, match="scale"):
        SurfaceMesh.from_file(tmp_path / "ball.stl", scale)


def test_files_that_are_none(tmp_path):
    with pytest.raises(InputError, match=r"path=.*no such file"):
        SurfaceMesh.from_file(tmp_path / "ball.stl")
    with pytest.raises(InputError, match=r"path=.*read from \.stl, \.ply"):
        SurfaceMesh.from_file(tmp_path / "ball.step")
    with pytest.raises(InputError, match="path=3"):
        SurfaceMesh.from_file(3)
    (tmp_path / "empty.obj").write_text("")
    with pytest.raises(InputError, match=r"path=.*no faces and no lines"):
        SurfaceMesh.from_file(tmp_path / "empty.obj")
    curve = pyvista.PolyData(np.eye(3), lines=[4, 0, 1, 2, 0])
    curve.save(tmp_path / "curve.vtp")
    with pytest.raises(InputError, match=r"path=.*constant z"):
        SurfaceMesh.from_file(tmp_path / "curve.vtp")


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
