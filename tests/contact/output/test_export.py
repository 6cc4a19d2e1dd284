"""VTK data carry the fields, and their values at sampled points are the result's own."""

import numpy as np
import pytest
import pyvista
from skfem import ElementHex1, ElementQuad1, ElementQuad2, ElementTetP1, ElementTriP1, ElementTriP2

from contact import ContactProblem
from skfem_adini import ElementQuadAdini

ELEMENTS = [
    ElementQuadAdini,
    ElementQuad1,
    ElementQuad2,
    ElementTriP1,
    ElementTriP2,
    ElementTetP1,
    ElementHex1,
]


@pytest.fixture(params=ELEMENTS)
def result(request, make):
    if request.param().dim == 3:
        return make.dome(request.param).solve()
    return make.solved(n=6, element=request.param, friction=0.4)[1]


def inside(result, n=80):
    low, high = result.system.body.mesh.p.min(axis=1), result.system.body.mesh.p.max(axis=1)
    share = np.random.default_rng(7).uniform(0.01, 0.99, (low.size, n))
    return low[:, None] + (high - low)[:, None] * share


def in_space(points):
    padded = np.zeros((points.shape[1], 3))
    padded[:, : points.shape[0]] = points.T
    return padded


def test_grid_points_carry_the_displacement(result):
    grid = result.to_pyvista()
    dim = result.system.body.dim
    u = np.asarray(grid.point_data["displacement"])
    assert u.shape == (grid.n_points, 3)
    if dim == 2:
        assert not u[:, 2].any()
    # Grid points on cell boundaries may be found in a neighbour: continuous to rounding.
    expected = result.sample(np.asarray(grid.points, dtype=float)[:, :dim].T)
    assert np.abs(u[:, :dim].T - expected).max() < 1e-12


def test_sampled_by_vtk(result):
    """The cells' own interpolation gives the element's field at any point."""
    points = inside(result)
    sampled = pyvista.PolyData(in_space(points)).sample(result.to_pyvista())
    assert np.all(sampled["vtkValidPointMask"] == 1)
    expected = result.sample(points)
    found = np.asarray(sampled["displacement"])[:, : points.shape[0]].T
    # Exact Lagrange cells; VTK's inverse mapping of high-order cells stops at 1e-6 of a cell.
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("subdivide", [1, 4])
def test_linear_sub_cells(subdivide, make):
    _, result = make.solved(n=4)
    grid = result.to_pyvista(subdivide)
    assert grid.n_cells >= 16 * subdivide**2
    expected = result.sample(np.asarray(grid.points, dtype=float)[:, :2].T)
    # Continuous to rounding.
    assert np.abs(np.asarray(grid.point_data["displacement"])[:, :2].T - expected).max() < 1e-12


def test_cell_fields(result):
    """Means over the cell, as integrals by the basis's own quadrature; all components are there."""
    body, grid = result.system.body, result.to_pyvista()
    names = ["xx", "yy", "xy"] if body.dim == 2 else ["xx", "yy", "zz", "xy", "yz", "xz"]
    assert {"von_mises", *(f"stress_{name}" for name in names)} <= set(grid.cell_data)
    assert grid.n_cells == body.mesh.nelements
    area = body.basis.dx.sum(axis=1)
    stress, mises = result.stress(), result.von_mises()
    for name in names:
        i, j = ("xyz".index(letter) for letter in name)
        mean = (stress[i, j] * body.basis.dx).sum(axis=1) / area
        # Rounding.
        np.testing.assert_allclose(grid.cell_data[f"stress_{name}"], mean, rtol=1e-12, atol=1e-15)
    mean = (mises * body.basis.dx).sum(axis=1) / area
    np.testing.assert_allclose(grid.cell_data["von_mises"], mean, rtol=1e-12)


def test_boundary_grid(result):
    cloud, rows = result.boundary_to_pyvista(), result.system.rows
    dim, m = rows.x.shape
    assert {"pressure", "shear", "slip", "normal", "gap", "status"} <= set(cloud.point_data)
    assert cloud.n_points == m
    # pyvista keeps the given float64 points.
    assert np.abs(np.asarray(cloud.points)[:, :dim].T - rows.x).max() < 1e-15
    assert np.array_equal(cloud["pressure"], result.pressure)
    assert np.array_equal(cloud["status"], result.status)
    assert np.array_equal(cloud["gap"], result.gap)
    # Rounding of the tangent frame.
    size = np.linalg.norm(cloud["shear"], axis=1)
    assert np.abs(size - np.linalg.norm(result.shear, axis=1)).max() < 1e-15
    assert np.abs(np.sum(cloud["shear"] * cloud["normal"], axis=1)).max() < 1e-15
    assert np.abs(np.linalg.norm(cloud["normal"], axis=1) - 1).max() < 1e-14
    # Displacement of a point at its nominal place: u_n along n and the slip, for point values.
    if rows.functional == "nodal":
        u = result.sample(rows.x_nominal)
        tangential = u - np.sum(u * rows.normals, axis=0) * rows.normals
        assert np.abs(np.asarray(cloud["slip"])[:, :dim].T - tangential).max() < 1e-12
    if dim == 2:
        assert cloud.n_lines == 1
    else:
        assert cloud.n_lines == 0


def test_separate_runs_are_separate_lines(make):
    """Contact on left and right: no line crosses the body."""
    body = make.block(6, sides=()).fix("top", "y")
    result = ContactProblem(body, ["left", "right"], 0.01).solve()
    cloud = result.boundary_to_pyvista()
    assert cloud.n_lines == 2
    assert cloud.compute_cell_sizes()["Length"].max() < 1.01


def test_open_gap_without_obstacle_is_nan(make):
    result = ContactProblem(make.block(4), "bottom", None, 0.03, "tresca").solve()
    assert np.all(np.isnan(result.boundary_to_pyvista()["gap"]))


def test_files_are_readable(result, tmp_path):
    """Written and read again by pyvista; the fields are the same."""
    grid, cloud = result.to_pyvista(), result.boundary_to_pyvista()
    grid.save(tmp_path / "body.vtu")
    cloud.save(tmp_path / "boundary.vtp")
    for path, original in (("body.vtu", grid), ("boundary.vtp", cloud)):
        again = pyvista.read(tmp_path / path)
        for name, values in original.point_data.items():
            assert np.array_equal(again.point_data[name], values, equal_nan=True)
        for name, values in original.cell_data.items():
            assert np.array_equal(again.cell_data[name], values)
