"""VTK data carry the fields: of one body, and a block for each of several with both faces."""

import numpy as np
import pytest
import pyvista
from families import PLANE
from pressed_pairs import PROBLEMS, pair, slit, stack
from skfem import ElementHex1, ElementTetP1
from two_blocks import block, turned

from contact import ContactProblem, LoadStepper
from contact.output.contact_runs import arc_length
from skfem_adini import ElementQuadAdini


@pytest.fixture(scope="module", params=[*PLANE, ElementTetP1, ElementHex1])
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


@pytest.mark.parametrize("subdivide", [None, 1, 4])
def test_grid_points_carry_the_displacement(result, subdivide):
    dim = result.system.body.dim
    grid = result.to_pyvista(*([] if subdivide is None or dim == 3 else [subdivide]))
    if subdivide and dim == 2:
        assert grid.n_cells >= result.system.body.mesh.nelements * subdivide**2
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


def test_boundary_grid(result, tmp_path):
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
    assert cloud.n_lines == (dim == 2)
    # Written and read again by pyvista; the fields are the same.
    grid = result.to_pyvista()
    grid.save(tmp_path / "body.vtu")
    cloud.save(tmp_path / "boundary.vtp")
    for path, original in (("body.vtu", grid), ("boundary.vtp", cloud)):
        again = pyvista.read(tmp_path / path)
        for name, values in original.point_data.items():
            assert np.array_equal(again.point_data[name], values, equal_nan=True)
        for name, values in original.cell_data.items():
            assert np.array_equal(again.cell_data[name], values)


def test_lines_and_gaps(make):
    """Contact on two sides is two lines, of a slit one; without an obstacle gaps are NaN."""
    body = make.block(6, sides=()).fix("top", "y")
    cloud = ContactProblem(body, ["left", "right"], 0.01).solve().boundary_to_pyvista()
    assert cloud.n_lines == 2
    assert cloud.compute_cell_sizes()["Length"].max() < 1.01
    open_ = ContactProblem(make.block(4), "bottom", None, 0.03, "tresca").solve()
    assert np.all(np.isnan(open_.boundary_to_pyvista()["gap"]))
    closed = slit().solve()
    assert isinstance(closed.to_pyvista(), pyvista.UnstructuredGrid)
    assert closed.boundary_to_pyvista().n_lines == 1


def resultant(face, weights):
    """Force of the tractions of a face on its body, summed in the plane."""
    push = -np.asarray(face["pressure"])[:, None] * face["normal"] + face["shear"]
    return (weights[:, None] * push).sum(axis=0)[:2]


def in_plane(points):
    return np.asarray(points, dtype=float)[:, :2].T


@pytest.mark.parametrize("name", [name for name in PROBLEMS if name not in ("slit", "stack")])
def test_blocks(name):
    """Names, displacements, and tractions whose sums are the forces that each body feels."""
    problem = PROBLEMS[name]()
    result = problem.solve()
    blocks = result.to_pyvista()
    called = [body.name or f"body {k}" for k, body in enumerate(problem.body.bodies)]
    assert blocks.keys() == [*called, "contact 0", "contact 0 opposite"]
    for k, key in enumerate(called):
        grid, own = blocks[key], result[k]
        assert grid.n_cells == own.body.mesh.nelements
        expected = own.sample(in_plane(grid.points))
        # Grid points on cell boundaries may be found in a neighbour: continuous to rounding.
        off = np.asarray(grid["displacement"])[:, :2].T - expected
        assert np.abs(off).max() < 1e-12 * np.abs(expected).max()
    weights, size = result.system.rows.weights, np.abs(result.resultant).max()
    for k, key in enumerate(("contact 0", "contact 0 opposite")):
        # Straight facets: the mean normal of a point is that of the face.
        off = resultant(blocks[key], weights) - result[k].resultant
        assert np.abs(off).max() < 1e-10 * size
    assert np.array_equal(blocks["contact 0"]["pressure"], result.pressure)


def test_opposite_face_lies_on_the_other_body():
    """Of blocks that are turned, and apart: moved by the gap the points reach the lower one."""
    angle, gap = 0.3, 0.05
    place = turned(angle)
    upper = block(ElementQuadAdini, np.linspace(0.2, 0.8, 5), [gap, 0.5, 1.0], place=place)
    lower = block(ElementQuadAdini, np.linspace(0, 1, 8), [-1.0, -0.5, 0.0], place=place)
    n = np.array([-np.sin(angle), np.cos(angle)])  # upwards
    upper.fix("top", "x", -(gap + 0.01) * n[0]).fix("top", "y", -(gap + 0.01) * n[1])
    lower.fix("bottom", "xy")
    result = ContactProblem(upper, "bottom", lower.surface("top"), friction=0.2).solve()
    blocks = result.to_pyvista()
    first, opposite = (in_plane(blocks[f"contact 0{of}"].points) for of in ("", " opposite"))
    # Heights over the lower body's upper side.
    np.testing.assert_allclose(n @ first, gap, rtol=1e-12)
    np.testing.assert_allclose(n @ opposite, 0.0, atol=1e-14)
    np.testing.assert_allclose(blocks["contact 0"]["normal"][:, :2].T, -n[:, None] + 0 * first)
    np.testing.assert_allclose(
        blocks["contact 0 opposite"]["normal"][:, :2].T, n[:, None] + 0 * first
    )


def test_every_pair_has_its_surface():
    """A rigid foundation has no face; each part of the tractions stands in its own block."""
    result = stack().solve()
    blocks = result.to_pyvista()
    faces = ["contact 0", "contact 0 opposite", "tie 1", "tie 1 opposite", "contact 2"]
    assert blocks.keys() == ["top block", "body 1", "low/block", *faces]
    s, run = arc_length(result)
    assert np.array_equal(run, result.part)
    for k in range(3):
        own = result.part == k
        # Each run is as long as the side of its body, and continues the one before.
        np.testing.assert_allclose(np.abs(s[own] - k - 0.5), np.abs(result.x[0, own] - 0.5))
        assert np.all(np.diff(s[own]) > 0)
        grid = blocks["tie 1" if k == 1 else f"contact {k}"]
        assert np.array_equal(grid["pressure"], result.pressure[own])
        assert grid.n_lines == 1
        off = resultant(grid, result.system.rows.weights[own]) - result.resultants[k]
        assert np.abs(off).max() < 1e-10 * np.abs(result.resultants).max()


def test_series(tmp_path):
    """ParaView's list of steps, each a list of blocks, whose files are complete."""
    stepper = LoadStepper(pair()).load("top", (0.05, 0.0), np.sin, body="upper")
    history = stepper.run([0.5, 1.0])
    path = history.to_pvd(tmp_path / "run.pvd")
    reader = pyvista.get_reader(path)
    assert list(reader.time_values) == [0.5, 1.0]
    for t, result in zip([0.5, 1.0], history, strict=True):
        reader.set_active_time_value(t)
        (blocks,) = reader.read()
        assert blocks.keys() == ["upper", "lower", "contact 0", "contact 0 opposite"]
        for key, expected in zip(blocks.keys(), result.to_pyvista(), strict=True):
            assert np.array_equal(blocks[key].points, expected.points)
            for name in expected.point_data:
                assert np.array_equal(blocks[key].point_data[name], expected.point_data[name])
    boundary = pyvista.get_reader(tmp_path / "run_boundary.pvd")
    boundary.set_active_time_value(1.0)
    assert np.array_equal(boundary.read()[0]["pressure"], history[1].pressure)
    assert not [p.name for p in tmp_path.iterdir() if p.name.startswith("tmp")]


def test_list_of_blocks_appears_last(tmp_path, monkeypatch):
    """A disk that fills while a block is written leaves no list that names a missing file."""
    from skfem_adini.ground import vtk_files

    written, whole = [], vtk_files.write_grid

    def full(path, grid):
        if len(written) == 2:
            raise OSError("no space left")
        written.append(path)
        whole(path, grid)

    monkeypatch.setattr(vtk_files, "write_grid", full)
    with pytest.raises(OSError, match="no space"):
        vtk_files.write_blocks(tmp_path / "step.vtm", pair().solve().to_pyvista())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["step_0.vtu", "step_1.vtu"]
